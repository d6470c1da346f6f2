# SPDX-License-Identifier: Apache-2.0
"""A film of the trained model: a turntable, or the walk of the camera that filmed the plant.

Not a stage of the pipeline: nothing depends on it.

    render/<view>_<show>[_plant]/   the video, or an image a frame; render.json (size, speed)
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .. import _native
from ..command_options import RenderOptions
from ..core.machine import usable_cores
from ..core.runs import Progress, silent
from ..core.scene import Camera, Float64, Gaussians
from ..errors import BadInput, BadUsage, NoBolls
from ..gaussians import rasterizer
from ..gaussians.appearance import depth_colours, recolour_bolls
from ..gaussians.metrics import to_uint8
from ..geometry.camera_orbit import azimuths, fit_orbit
from ..geometry.camera_paths import reframe, turntable, walk
from ..io.arrays import read_array
from ..io.colmap import read_cameras
from ..io.encode import video_encoder
from ..io.images import fit_size, write_image
from ..io.ply import read_gaussians
from ..io.saving import json_text
from ..option_rules import as_dict
from ..options import TrainOptions
from ..schemas.bolls import boll_labels, read_bolls_of
from ..schemas.frames import FramesInfo
from ..schemas.scale import read_scale
from ..workspace import Workspace

QUALITY: Final = 18
"""x264's constant rate factor; viewers can hardly distinguish the video from the images themselves."""
BACKGROUNDS: Final = {"black": 0.0, "white": 1.0}
DEPTH_RANGE: Final = (0.5, 1.5)
"""Range of depths that the colours span, in distances of the camera from its target: plant and table."""
RECORD: Final = "render.json"


def render(workspace: Workspace, options: RenderOptions, progress: Progress = silent) -> dict[str, Any]:
    """Film the model and save the film with its render.json.

    Returns:
        The content of render.json.
    Raises:
        MissingInput: a required stage has not run. BadInput: its result is damaged or of another model.
        NoBolls: the film should show bolls and there are none. BadUsage: the size cannot be encoded.
    """
    workspace.require(workspace.gaussians_ply, "train")  # before a lock is left in a folder without a model
    with workspace.locked():
        gaussians = read_gaussians(workspace.require(workspace.gaussians_ply, "train"))
        cameras = _order_cameras(workspace)
        plant = _find_plant_rows(workspace, len(gaussians), required=options.plant_only)
        shown = gaussians
        if options.show == "bolls":
            shown = recolour_bolls(gaussians, _read_labels(workspace, gaussians), BACKGROUNDS[options.background])
        if options.plant_only:
            shown = shown[plant]
        target, up = _target_and_up(workspace, cameras, gaussians.means[plant])
        if options.view == "turntable":
            path = turntable(cameras, target, up, options.frames)
        else:
            path = walk(cameras, options.frames)
        size = _choose_size(workspace, path[0], options)
        path = [reframe(camera, *size) for camera in path]
        distance_su = float(np.median([np.linalg.norm(camera.centre - target) for camera in path]))
        return _film(workspace, shown, path, distance_su, options, progress)


def _film(
    workspace: Workspace,
    gaussians: Gaussians,
    path: list[Camera],
    distance_su: float,
    options: RenderOptions,
    progress: Progress,
) -> dict[str, Any]:
    """Render and save, one frame in memory at a time, and count the time of the core alone."""
    background = BACKGROUNDS[options.background]
    near_su, far_su = (share * distance_su for share in DEPTH_RANGE)
    threads = options.threads or len(usable_cores())
    name = "_".join([options.view, options.show, *["plant"] * options.plant_only])
    wall_s = cpu_s = 0.0
    with workspace.writing(f"{workspace.render.name}/{name}") as folder:
        with _saver(folder, name, path[0], options) as save:
            for i, camera in enumerate(path):
                wall_s, cpu_s = wall_s - time.perf_counter(), cpu_s - time.process_time()
                rendered = rasterizer.render(gaussians, camera, background=(background,) * 3, threads=threads)
                wall_s, cpu_s = wall_s + time.perf_counter(), cpu_s + time.process_time()
                image: NDArray[Any] = rendered.image
                if options.show == "depth":
                    image = depth_colours(rendered.depth, rendered.transmittance, near_su, far_su, background)
                save(camera, to_uint8(image))
                progress(i + 1, len(path), "rendering")
        saved = workspace.render / name / (f"{name}.mp4" if options.format == "mp4" else "")
        record: dict[str, Any] = {
            "options": as_dict(options),
            "saved_as": saved.relative_to(workspace.root).as_posix(),
            "frames": len(path),
            "width": path[0].width,
            "height": path[0].height,
            "n_gaussians": len(gaussians),
            "sh_degree": gaussians.sh_degree,
            "fps_rendered": len(path) / wall_s,
            "cpu_ms_per_frame": 1000 * cpu_s / len(path),
            "threads": threads,
            "instruction_set": _native.instruction_set(),
        }
        if options.show == "depth":
            record |= {"depth_near_su": near_su, "depth_far_su": far_su}
        (folder / RECORD).write_text(json_text(record), encoding="utf-8")
    return record


@contextmanager
def _saver(
    folder: Path, name: str, camera: Camera, options: RenderOptions
) -> Iterator[Callable[[Camera, NDArray[np.uint8]], None]]:
    """A function that saves the frame that a camera of the path took."""
    if options.format != "mp4":
        yield lambda camera, image: write_image(folder / f"{camera.name}.{options.format}", image)
        return
    with video_encoder(folder / f"{name}.mp4", camera.width, camera.height, options.fps, QUALITY) as append:
        yield lambda camera, image: append(image)


def _order_cameras(workspace: Workspace) -> list[Camera]:
    """The registered cameras in the order in which the walk passed them; photos without an order, around the plant."""
    cameras = read_cameras(workspace.require(workspace.undistorted / "sparse", "sfm"))
    if len(cameras) < 2:
        raise BadInput("a film needs at least 2 registered images; run `cotton3dg sfm` again")
    taken = FramesInfo.load_if_there(workspace.frames_json)
    if taken is None or taken.ordered:
        return cameras
    return [cameras[i] for i in np.argsort(azimuths(cameras, fit_orbit(cameras)), kind="stable")]


def _read_labels(workspace: Workspace, gaussians: Gaussians) -> NDArray[np.int32]:
    """(N,) boll of each Gaussian, 0 = none."""
    labels_npy = workspace.require(workspace.labels_npy, "cluster")
    bolls = read_bolls_of(gaussians, workspace.require(workspace.bolls_json, "cluster"), labels_npy)
    if not bolls:
        raise NoBolls("this plant has no bolls to show; use --show colour, or look at masks/")
    return boll_labels(bolls, len(gaussians))


def _find_plant_rows(workspace: Workspace, n: int, required: bool) -> NDArray[np.bool_]:
    """(N,) which of the n Gaussians are the plant; none of them if that is neither known nor required."""
    unknown = np.zeros(n, bool)
    if not required and not workspace.plant_npy.exists():
        return unknown
    rows = read_array(workspace.require(workspace.plant_npy, "traits"))
    record = workspace.read_record("traits")
    measured = record.inputs if record else {}
    now = workspace.hashes(workspace.gaussians_ply)
    current = rows.shape == (n,) and all(measured.get(name, found) == found for name, found in now.items())
    if current and rows.any():
        return rows
    if not required:
        return unknown
    if not current:
        raise BadInput("plant.npy belongs to another model than gaussians.ply; run `cotton3dg traits` again")
    raise BadInput("no plant was found on the table (is there a scale?); render without --plant-only")


def _target_and_up(workspace: Workspace, cameras: list[Camera], plant: NDArray[Any]) -> tuple[Float64, Float64]:
    """The point that the camera circles: the middle of the plant, else of the orbit; and up by the table or orbit.

    Args:
        plant: (P, 3) means of the plant's Gaussians, su; P = 0 if it is not known.
    """
    orbit = fit_orbit(cameras)
    scale = read_scale(workspace.scale_json) if workspace.scale_json.exists() else None
    if scale is None:
        return orbit.centre, orbit.axis
    if not len(plant):
        return orbit.centre, scale.up
    places = plant.astype(np.float64) @ scale.table_frame.T
    # The extent without its outermost hundredth: remaining floaters may be far away.
    return np.percentile(places, [1, 99], axis=0).mean(axis=0) @ scale.table_frame, scale.up


def _choose_size(workspace: Workspace, camera: Camera, options: RenderOptions) -> tuple[int, int]:
    """Width and height, px: those of the training images; if one is given, their aspect ratio gives the other."""
    record = workspace.read_record("train")
    trained = (record.options if record else {}).get("max_side", TrainOptions().max_side)
    width, height = fit_size(camera.width, camera.height, trained)
    if options.width or options.height:
        width = options.width or _even(options.height * camera.width / camera.height)
        height = options.height or _even(options.width * camera.height / camera.width)
    else:
        width, height = _even(width), _even(height)
    if options.format == "mp4" and (width % 2 or height % 2):
        raise BadUsage(f"{width}x{height} cannot be encoded; choose even numbers, or --format png")
    return width, height


def _even(side_px: float) -> int:
    return max(2, 2 * round(side_px / 2))
