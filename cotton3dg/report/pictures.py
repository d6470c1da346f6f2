# SPDX-License-Identifier: Apache-2.0
"""The parts of a plant's page that need its photos, masks and model, each read once and only if its stage is done."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import BollInstance
from ..core.measurements import Scale
from ..core.plant_map import PlantMap
from ..core.scene import Camera, Gaussians
from ..geometry.camera_orbit import Orbit, azimuths, evenly_spaced, fit_orbit
from ..io.arrays import read_array
from ..io.colmap import read_cameras
from ..io.images import read_ids, read_image
from ..io.ply import read_gaussians
from ..io.tables import parse_number
from ..schemas.bolls import boll_labels, read_bolls
from ..schemas.scale import read_scale
from ..schemas.skeleton import read_map
from ..traits.surface import dilate_gaussians
from ..workspace import Workspace
from .facts import Facts
from .figures import (
    Picture,
    box_around,
    choose_views,
    cut_out,
    draw_ruler,
    jpeg_uri,
    number_bolls,
    outline_masks,
    render_photo,
)
from .frame import Frame, plant_frame
from .scene import boll_bodies, box_of, shown_rows, side_picture, skeleton_lines
from .splats import JUDGING_VIEWS, choose_splats, pack_splats
from .walk import draw_walk

WIDE_PX: Final = 1100
MIDDLE_PX: Final = 800
SMALL_PX: Final = 200
COMPARED: Final = 3
OVERLAID: Final = 4
STRIP: Final = 10
CUT_OUTS: Final = 3
MANY_BOLLS: Final = 120
MOST_BOLLS: Final = 500
"""Cut-outs per boll; one if there are many bolls. Bolls beyond the most have a row but no picture: no plant has as
many, but a room full of white things may."""


class Pictures:
    """A plant's photos, masks and model, as far as they exist and belong together."""

    def __init__(self, workspace: Workspace, facts: Facts):
        self.workspace, self.facts = workspace, facts

    # ------------------------------------------------------------- what there is
    @cached_property
    def cameras(self) -> list[Camera]:
        return read_cameras(self.workspace.undistorted / "sparse") if self.facts.done("sfm") else []

    @cached_property
    def camera_of(self) -> dict[str, Camera]:
        return {camera.name: camera for camera in self.cameras}

    @cached_property
    def orbit(self) -> Orbit:
        return fit_orbit(self.cameras)

    @cached_property
    def gaussians(self) -> Gaussians | None:
        return read_gaussians(self.workspace.gaussians_ply) if self.facts.done("train") else None

    @cached_property
    def bolls(self) -> list[BollInstance]:
        if not self.facts.done("cluster"):
            return []
        final = self.workspace.final_bolls() if self.facts.done("traits") else None
        return read_bolls(*(final or (self.workspace.bolls_json, self.workspace.labels_npy)))[0]

    @cached_property
    def scale(self) -> Scale | None:
        return read_scale(self.workspace.scale_json) if self.facts.done("scale") else None

    @cached_property
    def masked(self) -> list[str]:
        """Images that have masks, in order of name."""
        if not self.facts.done("masks"):
            return []
        return [name for name in sorted(self.camera_of) if self._ids_png(name).is_file()]

    @cached_property
    def _ids_png(self) -> Callable[[str], Path]:
        return self.workspace.boll_ids_png if self.facts.done("cluster") else self.workspace.mask_png

    @cached_property
    def owners(self) -> dict[str, dict[int, int]]:
        """View -> mask id -> boll."""
        owners: dict[str, dict[int, int]] = {}
        for boll in self.bolls:
            for view, mask_id in boll.masks:
                owners.setdefault(view, {})[mask_id] = boll.boll_id
        return owners

    @cached_property
    def plant_rows(self) -> NDArray[np.bool_]:
        n = len(self.gaussians) if self.gaussians is not None else 0
        if not self.facts.done("traits"):
            return np.zeros(n, bool)
        rows = read_array(self.workspace.plant_npy)
        return rows if rows.shape == (n,) else np.zeros(n, bool)

    @cached_property
    def _ids(self) -> dict[str, NDArray[np.uint16]]:
        return {name: read_ids(self._ids_png(name)) for name in self.masked}

    def photo(self, name: str) -> Picture:
        """The undistorted image."""
        return read_image(self.workspace.undistorted_image(name))

    def part_of(self, name: str) -> tuple[slice, slice]:
        """Rows and columns of an undistorted image that show the plant."""
        camera = self.camera_of[name]
        if self.gaussians is not None and self.plant_rows.any():
            around = self.gaussians.means[self.plant_rows]
        else:
            around = np.array([boll.centre for boll in self.bolls]).reshape(-1, 3)
        return box_around(camera.project(around)[0], camera.width, camera.height)

    # --------------------------------------------------------------------- parts
    def strip(self) -> list[dict[str, Any]]:
        """Small images of the walk."""
        images = self.facts.frames.images if self.facts.frames else ()
        missed = self.facts.sfm.unregistered if self.facts.sfm else ()
        chosen = [images[i * len(images) // min(STRIP, len(images))] for i in range(min(STRIP, len(images)))]
        return [
            {
                "src": jpeg_uri(read_image(self.workspace.folder("frames") / image.name), SMALL_PX, 75),
                "name": image.name,
                "time_s": image.timestamp_s,
                "missed": image.name in missed,
            }
            for image in chosen
        ]

    def counted(self) -> list[dict[str, Any]]:
        """Two photos from opposite sides with every boll numbered: the one that shows most bolls, and its opposite."""
        if not self.bolls or not self.owners:
            return []
        cameras = [camera for camera in self.cameras if camera.name in self._ids]
        shown = [set(self.owners.get(camera.name, {}).values()) for camera in cameras]
        first = int(np.argmax([len(bolls) for bolls in shown]))
        angles = azimuths(cameras, self.orbit)
        second = int(np.argmin(np.abs(np.mod(angles - angles[first], 2 * np.pi) - np.pi)))
        centres = {boll.boll_id: boll.centre for boll in self.bolls}
        pictures = []
        for i in dict.fromkeys((first, second)):
            name, camera = cameras[i].name, cameras[i]
            drawn = outline_masks(self.photo(name), self._ids[name], self.owners.get(name, {}))
            part = self.part_of(name)
            size_px = part[1].stop - part[1].start
            beside_px = 0.5 * camera.fx * np.median([boll.diameter_su for boll in self.bolls]) / self.orbit.radius
            drawn = number_bolls(drawn, camera, centres, shown[i], size_px, beside_px)[part]
            pictures.append({"src": jpeg_uri(drawn, WIDE_PX), "name": name, "n": len(shown[i]), "of": len(centres)})
        return pictures

    def compared(self) -> list[dict[str, Any]]:
        """Photo and render of images that the training never saw, spread over the walk."""
        judged = self.facts.metrics.held_out if self.facts.metrics else ()
        held_out = [item for item in judged if item.image in self.camera_of]
        if self.gaussians is None or not held_out:
            return []
        chosen = [held_out[i] for i in evenly_spaced(np.linspace(0, 2 * np.pi, len(held_out) + 1)[:-1], COMPARED)]
        pictures = []
        for item in chosen:
            name = item.image
            part = self.part_of(name)
            pictures.append(
                {
                    "name": name,
                    "photo": jpeg_uri(self.photo(name)[part], MIDDLE_PX),
                    "render": jpeg_uri(render_photo(self.gaussians, self.camera_of[name])[part], MIDDLE_PX),
                    "psnr_db": item.plant_psnr_db if math.isfinite(item.plant_psnr_db) else item.psnr_db,
                }
            )
        return pictures

    def overlaid(self) -> list[dict[str, Any]]:
        """Photos with the outlines of their masks, from all sides."""
        named = [camera for camera in self.cameras if camera.name in self._ids]
        if not named:
            return []
        chosen = [named[i].name for i in evenly_spaced(azimuths(named, self.orbit), OVERLAID)]
        pictures = []
        for name in chosen:
            ids = self._ids[name]
            drawn = outline_masks(self.photo(name), ids, self.owners.get(name, {}))[self.part_of(name)]
            pictures.append({"src": jpeg_uri(drawn, MIDDLE_PX), "name": name, "n": len(np.unique(ids[ids > 0]))})
        return pictures

    def cut_outs(self) -> dict[int, list[dict[str, str]]]:
        """Boll -> its cut-outs from photos of different sides."""
        if not self.owners:
            return {}
        areas = {name: dict(enumerate(np.bincount(ids.ravel()).tolist())) for name, ids in self._ids.items()}
        number_each = CUT_OUTS if len(self.bolls) <= MANY_BOLLS else 1
        chosen = choose_views(self.owners, areas, self.cameras, number_each)
        wanted: dict[str, list[tuple[int, int]]] = {}
        for boll, views in sorted(chosen.items())[:MOST_BOLLS]:
            for name, mask_id in views:
                wanted.setdefault(name, []).append((boll, mask_id))
        found: dict[int, list[dict[str, str]]] = {}
        for name in sorted(wanted):  # each photo is decoded once
            ids, photo = self._ids[name], self.photo(name)
            drawn = outline_masks(photo, ids, self.owners[name], thickness_px=1)
            for boll, mask_id in wanted[name]:
                part = cut_out(drawn, ids, mask_id)
                if part is not None:
                    found.setdefault(boll, []).append({"src": jpeg_uri(part, 150, 80), "name": name})
        return found

    def references(self) -> list[dict[str, str]]:
        """The table's outline with a ruler on it, and what the scale stage drew of other references."""
        if not self.facts.done("scale"):
            return []
        drawn = sorted(self.workspace.folder("scale").glob("*.jpg"))
        pictures = []
        height_cm = parse_number(self.facts.traits.get("plant_height_cm"))
        if self.scale is not None and height_cm > 0:
            drawn = [path for path in drawn if not path.name.startswith("table_")]
            foot = self.frame().origin
            for i in evenly_spaced(azimuths(self.cameras, self.orbit), COMPARED):
                camera = self.cameras[i]
                picture = draw_ruler(self.photo(camera.name), camera, self.scale, foot, height_cm)
                pictures.append({"src": jpeg_uri(picture, MIDDLE_PX), "name": camera.name})
        return pictures + [{"src": jpeg_uri(read_image(path), MIDDLE_PX), "name": path.name} for path in drawn[:3]]

    def frame(self) -> Frame:
        """Coordinates of the 3D view and of the map of the walk."""
        cells = {row["boll_id"]: [parse_number(row[f"{axis}_cm"]) for axis in "xyz"] for row in self.facts.bolls}
        centres = np.array([boll.centre for boll in self.bolls]).reshape(-1, 3)
        known_cm = [cells.get(str(boll.boll_id), [math.nan] * 3) for boll in self.bolls]
        plant = self.gaussians.means[self.plant_rows] if self.gaussians is not None else np.zeros((0, 3))
        centres_cm = np.array(known_cm, np.float64).reshape(-1, 3)
        return plant_frame(self.scale, self.orbit, centres, centres_cm, plant)

    def scene(self) -> dict[str, Any]:
        """Data of the 3D view; empty without a model."""
        if self.gaussians is None:
            return {}
        frame = self.frame()
        volumes = {int(row["boll_id"]): parse_number(row["volume_cm3"]) for row in self.facts.bolls}
        known = {boll: volume for boll, volume in volumes.items() if volume > 0}
        pixel_su = self.facts.metrics.pixel_su if self.facts.metrics else 0.0
        drawn = dilate_gaussians(self.gaussians, pixel_su)
        plant, wanted = shown_rows(self.gaussians, self.plant_rows, self.scale, self.orbit, frame)
        judging = evenly_spaced(azimuths(self.cameras, self.orbit), JUDGING_VIEWS)
        rows = choose_splats(self.gaussians, wanted, [self.cameras[i] for i in judging])
        if not plant[rows].any():
            return {}
        box = box_of(frame.places(self.gaussians.means[rows[plant[rows]]]))
        return {
            "unit": frame.unit,
            "pixel": pixel_su * self.scale.cm_per_su if self.scale else 0.0,
            "relative_error": self.scale.relative_error if self.scale else 0.0,
            "box": box.round(3).tolist(),
            "picture": jpeg_uri(side_picture(self.gaussians[rows], box, frame), WIDE_PX),
            "splats": pack_splats(drawn[rows], boll_labels(self.bolls, len(self.gaussians))[rows], frame),
            "bolls": boll_bodies(drawn, self.bolls[:MOST_BOLLS], known, frame),
            "skeleton": skeleton_lines(self.plant_map) if self.plant_map else [],
        }

    @property
    def plant_map(self) -> PlantMap | None:
        """The plant map; None if there is none."""
        found = read_map(self.facts.skeleton) if self.facts.skeleton else None
        return found if found and found.axes else None

    def walk(self) -> dict[str, Any]:
        """The walk seen from above."""
        images = self.facts.frames.images if self.facts.frames else ()
        frame = self.frame() if len(self.cameras) > 2 else None
        names = [image.name for image in images]
        return draw_walk(images, names, self.cameras, frame, self.scale)

    def widths_px(self) -> list[float]:
        """Widths of the bolls in the training images."""
        metrics = self.facts.metrics
        return [boll.diameter_su / metrics.pixel_su for boll in self.bolls] if metrics else []
