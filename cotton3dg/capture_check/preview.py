# SPDX-License-Identifier: Apache-2.0
"""A first look at a film once some or all of its cameras are placed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.machine import on_all_cores
from ..core.runs import Progress, silent
from ..core.scene import Camera
from ..gaussians.plant_windows import SEEN_MARGIN, find_plant_windows
from ..gaussians.views import View
from ..geometry.camera_orbit import Orbit, azimuths, evenly_spaced, fit_orbit
from ..io.colmap import read_cameras, read_points, read_positions, read_tracks
from ..io.images import read_image
from ..masks.bolls import open_bolls
from ..options import ScaleOptions
from ..scale.estimate_scale import FoundScale, Plant, estimate_scale, no_scale
from ..scale.stage import load_plant
from ..scale.table import outlines_table
from ..schemas.frames import FramesInfo
from ..train.photos import SparseModel, motion_blur_of
from ..workspace import Workspace
from .first_count import FoundBoll, find_bolls_in_space
from .plane_sweep import find_agreeing_places
from .view_detections import Sight, detect_in_view

VIEWS: Final = 12
"""Number of images in which bolls are searched."""
TABLE_VIEWS: Final = 20
"""Number of images in which the rim of the table is measured: half of those of `run`."""
TOLERANCES: Final = (3.0, 6.0, 10.0)
"""Grey levels by which agreeing photos may differ. With a lax tolerance a floor of one colour agrees with itself."""


@dataclass(frozen=True)
class Look:
    """The results of a first look."""

    frames: FramesInfo
    names: tuple[str, ...]
    """Images that had to be placed."""
    images: Path
    """Folder of the placed images, without lens distortion."""
    cameras: Sequence[Camera]
    """Cameras of the placed images."""
    orbit: Orbit
    sights: Sequence[Sight]
    bolls: Sequence[FoundBoll]
    scale: FoundScale
    blur_px: float = 0.0
    """Motion blur in images of the size that `run` trains on; 0 where none is found."""


def preview_capture(
    workspace: Workspace,
    names: Sequence[str],
    undistorted: Path,
    options: ScaleOptions,
    train_side_px: int,
    progress: Progress = silent,
) -> Look:
    """Look for bolls, for things of known size, and for motion blur.

    Args:
        names: images that had to be placed.
        undistorted: folder with `images/` and the COLMAP model `sparse/` of the placed ones.
        train_side_px: longer side of the images that `run` trains on.
    """
    cameras = read_cameras(undistorted / "sparse")
    orbit = fit_orbit(cameras)
    network = open_bolls()
    seen = evenly_spaced(azimuths(cameras, orbit), VIEWS)
    chosen = [cameras[i] for i in seen]
    photos = [read_image(undistorted / "images" / camera.name) for camera in chosen]
    tracks = read_points(undistorted / "sparse")[0]
    of_all = find_plant_windows(tracks, cameras, SEEN_MARGIN)
    windows = [of_all[i] for i in seen]
    plant = load_plant(workspace, options, undistorted, tracks, np.zeros((0, 3)))
    # The search for the table keeps one core busy and leaves the others to the network.
    with ThreadPoolExecutor(1) as beside:
        scale = beside.submit(_estimate_scale, plant, orbit, chosen, photos, options)
        sights = []
        for number, (camera, photo, window) in enumerate(zip(chosen, photos, windows, strict=True)):
            progress(number, len(chosen) + 1, "looking for bolls")
            sights.append(detect_in_view(photo, camera, network, window))
        progress(len(chosen), len(chosen) + 1, "looking for the table")
    frames = FramesInfo.load(workspace.frames_json)
    return Look(
        frames=frames,
        names=tuple(names),
        images=undistorted / "images",
        cameras=cameras,
        orbit=orbit,
        sights=sights,
        bolls=find_bolls_in_space(sights, orbit),
        scale=scale.result(),
        blur_px=_blur_px(undistorted, cameras, frames, train_side_px),
    )


def _blur_px(undistorted: Path, cameras: Sequence[Camera], frames: FramesInfo, side_px: int) -> float:
    """Motion blur as `run` will find it; 0 where it will find none."""
    sparse = undistorted / "sparse"
    model = SparseModel(cameras, read_tracks(sparse), read_positions(sparse))
    photos = on_all_cores(lambda camera: read_image(undistorted / "images" / camera.name), cameras)
    views = [View(camera, photo).limited(side_px) for camera, photo in zip(cameras, photos, strict=True)]
    blur = motion_blur_of(views, model, frames)
    return blur.median_px if blur and blur.found else 0.0


def _estimate_scale(
    plant: Plant, orbit: Orbit, cameras: Sequence[Camera], photos: Sequence[NDArray[np.uint8]], options: ScaleOptions
) -> FoundScale:
    """The scale by the points of structure from motion, or by these and places at which photos agree.

    Points are few on a bare table, and agreeing places many on bare walls, so both may mislead, and a check in the
    photos takes seconds. So points that outline a table of the known shape come first.
    """
    if options.method == "none":
        return no_scale("no reference was asked for")
    plant = replace(plant, photo=cache(plant.photo))  # each search looks at the same ones
    aspect = options.table_cm[0] / options.table_cm[1]

    def sources() -> Iterator[Plant]:
        yield plant
        for tolerance in TOLERANCES:
            places = find_agreeing_places(plant.tracks, orbit, cameras, photos, tolerance)
            yield replace(plant, solid=places.astype(np.float32))

    def likely_first() -> Iterator[Plant]:
        later = []
        for source in sources():
            if outlines_table(np.concatenate([source.tracks, source.solid]), orbit, aspect):
                yield source
            else:
                later.append(source)
        yield from later

    found: list[FoundScale] = []
    for source in likely_first():
        found.append(estimate_scale(source, options, views=TABLE_VIEWS))
        if found[-1].info.scale is not None:
            return found[-1]
    return found[0]
