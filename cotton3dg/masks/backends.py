# SPDX-License-Identifier: Apache-2.0
"""The back ends of the stage masks. Each makes the masks of the bolls from the photos of a plant."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import MaskSet
from ..core.machine import on_all_cores
from ..core.network_maps import Maps
from ..core.runs import Progress
from ..core.scene import Camera
from ..errors import BadInput, BadUsage, CaptureFailed
from ..gaussians.plant_windows import SEEN_MARGIN, find_plant_windows
from ..geometry.camera_orbit import azimuths, evenly_spaced, fit_orbit
from ..io.annotations import read_masks, undistort_ids
from ..options import MasksOptions
from .bolls import BollNetwork, open_bolls
from .grounding_dino import find_boxes, open_grounding_dino
from .group_votes import group_votes
from .sam import Prompts, detect_sam, open_sam, prompts_around, table_prompts
from .yolo import detect_yolo
from .yolo_networks import class_numbers, open_network

EXPORTED: Final = re.compile(r"_(?:jpe?g|png)\.rf\.\w+$")
"""What Roboflow puts behind an image's name."""
NO_LINT: Final = (
    "no boll was found in any image; if the plant has open bolls, look at sfm/undistorted/images: the plant "
    "should stand in the middle of the orbit with its lint lit; or draw masks and use --backend import"
)
NOTHING_FOUND: Final = {
    "bolls": NO_LINT,
    "import": "none of the imported images has a mask; if the plant has open bolls, draw them",
}
NO_DETECTION: Final = (
    "the network found no boll in any image; if the plant has open bolls, try a lower --confidence or --tile"
)

Detector = Callable[[str, NDArray[np.uint8]], tuple[NDArray[np.uint16], dict[int, float]]]
"""From the name and the pixels of an image to ids and scores."""


@dataclass(frozen=True)
class Plant:
    """The data of a plant that a back end may use."""

    cameras: Sequence[Camera]
    """Of all undistorted images."""
    photo: Callable[[str], NDArray[np.uint8]]
    """Name of an undistorted image -> (H, W, 3) RGB."""
    points: NDArray[np.float64]
    """(P, 3) su, triangulated."""
    filmed: Path
    """COLMAP model of the images before their lens distortion was taken out."""
    own_masks: Path
    """Folder of the user's masks, unless an option names another."""
    file: Callable[[str], Path]
    """The file or folder that the text of an option means."""


@dataclass(frozen=True)
class Found:
    """Masks, and how a back end made them."""

    masks: MaskSet
    notes: tuple[str, ...] = ()
    """Messages to the user."""
    maps: Mapping[str, Maps] = field(default_factory=dict)
    """Image name -> maps of the bolls' network, if it made the masks."""


def by_bolls(plant: Plant, options: MasksOptions, progress: Progress) -> Found:
    """Maps of the bolls' network for views evenly spaced around the plant, with the masks of each view alone."""
    own = options.bolls.weights
    return _find_bolls(plant, options.views, open_bolls(plant.file(own) if own else None), progress)


def _find_bolls(plant: Plant, n_views: int, network: BollNetwork, progress: Progress) -> Found:
    views = _spaced(plant, n_views)
    windows = find_plant_windows(plant.points, plant.cameras, SEEN_MARGIN)
    window_of = {camera.name: window for camera, window in zip(plant.cameras, windows, strict=True)}
    maps: dict[str, Maps] = {}
    for done, camera in enumerate(views):
        progress(done, len(views), camera.name)
        maps[camera.name] = network.maps(plant.photo(camera.name), window=window_of[camera.name])
    grouped = dict(zip(maps, on_all_cores(group_votes, maps.values()), strict=True))
    masks = MaskSet(
        {name: ids for name, (ids, _) in grouped.items()}, {name: own for name, (_, own) in grouped.items()}
    )
    return Found(masks, maps=maps)


def by_yolo(plant: Plant, options: MasksOptions, progress: Progress) -> Found:
    """Masks of a YOLO segmentation model."""
    own = options.yolo
    network = open_network(_given(plant, own.weights, "--weights"), trusted=own.trust_weights)
    classes = class_numbers(network, _listed(own.classes))

    def detect(_: str, image: NDArray[np.uint8]) -> tuple[NDArray[np.uint16], dict[int, float]]:
        return detect_yolo(
            image,
            network,
            image_size=own.image_size,
            confidence=own.confidence,
            nms_iou=own.nms_iou,
            tile_px=own.tile,
            classes=classes,
        )

    notes = (network.notice,) if network.notice else ()
    return Found(_each(plant, _spaced(plant, options.views), detect, progress), notes)


def by_sam(plant: Plant, options: MasksOptions, progress: Progress) -> Found:
    """Masks of SAM, prompted by the user's table or, without one, by the masks of `bolls`."""
    own = options.sam
    segment = open_sam(_given(plant, own.weights, "--weights"), trusted=own.trust_weights)
    if own.prompts:
        prompts = table_prompts(plant.file(own.prompts), plant.cameras)
        views = [camera for camera in plant.cameras if camera.name in prompts]
    else:
        bolls = _find_bolls(plant, options.views, open_bolls(), progress).masks
        prompts = {name: prompts_around(ids) for name, ids in bolls.ids.items()}
        views = [camera for camera in plant.cameras if camera.name in prompts]

    def detect(name: str, image: NDArray[np.uint8]) -> tuple[NDArray[np.uint16], dict[int, float]]:
        return detect_sam(image, segment, prompts[name], confidence=own.confidence, tile_px=own.tile)

    return Found(_each(plant, views, detect, progress))


def by_text(plant: Plant, options: MasksOptions, progress: Progress) -> Found:
    """Masks of SAM in the boxes that Grounding DINO finds for a text."""
    own = options.grounded_sam
    if not own.prompt.strip():
        raise BadUsage("--prompt is empty; say what to look for, e.g. --prompt 'cotton boll'")
    detector = _given(plant, own.detector, "--detector")
    find = open_grounding_dino(detector, own.prompt, trusted=own.trust_weights)
    segment = open_sam(_given(plant, own.weights, "--weights"), trusted=own.trust_weights)

    def detect(_: str, image: NDArray[np.uint8]) -> tuple[NDArray[np.uint16], dict[int, float]]:
        boxes = find_boxes(image, find, confidence=own.text_confidence, tile_px=own.tile)
        return detect_sam(image, segment, Prompts(boxes=boxes), confidence=own.confidence, tile_px=own.tile)

    return Found(_each(plant, _spaced(plant, options.views), detect, progress))


def imported(plant: Plant, options: MasksOptions, _: Progress) -> Found:
    """The user's masks, fitted to the undistorted images.

    Raises:
        BadInput: masks of images that do not exist, or of another shape than these.
    """
    own = options.imported
    source = plant.file(own.source) if own.source else plant.own_masks
    by_stem = {Path(camera.name).stem: camera for camera in plant.cameras}
    sizes = {stem: (camera.height, camera.width) for stem, camera in by_stem.items()}
    found = read_masks(source, sizes, _listed(own.classes))
    renamed = {stem: stem if stem in by_stem else EXPORTED.sub("", stem) for stem in found.ids}
    if len({*renamed.values()}) < len(renamed):
        raise BadInput(f"{source.name} has several versions of an image; export it without augmentation")
    unknown = sorted({*renamed.values()} - by_stem.keys())
    if unknown:
        raise BadInput(
            f"{len(unknown)} masks, e.g. {unknown[0]}, belong to no image with a pose "
            f"(e.g. {next(iter(by_stem))}); name masks like their images"
        )
    ids: dict[str, NDArray[np.uint16]] = {}
    for stem, mask in found.ids.items():
        camera = by_stem[renamed[stem]]
        ids[camera.name] = undistort_ids(stem, mask, camera, plant.filmed)
    masks = MaskSet(ids, {by_stem[renamed[stem]].name: scores for stem, scores in found.scores.items()})
    empty = sorted(name for name, drawn in ids.items() if not drawn.any())
    notes = found.notes
    if empty and len(empty) < len(ids):
        left = f"{len(empty)} of {len(ids)} imported images have no mask, e.g. {empty[0]}; true if no boll shows"
        notes = (*notes, left)
    if len(ids) - len(empty) == 1:
        notes = (*notes, "only one image has masks; a boll is counted where two agree, so draw eight around the plant")
    return Found(masks, notes)


def _spaced(plant: Plant, n_views: int) -> list[Camera]:
    """Cameras evenly spaced around the plant."""
    if len(plant.cameras) < 2:
        raise CaptureFailed("only one image has a pose; bolls are found from several sides, so film a full turn")
    angles = azimuths(plant.cameras, fit_orbit(plant.cameras))
    return [plant.cameras[i] for i in evenly_spaced(angles, n_views)]


def _each(plant: Plant, views: Sequence[Camera], detect: Detector, progress: Progress) -> MaskSet:
    """The masks of views, one image at a time."""
    masks = MaskSet({}, {})
    for done, camera in enumerate(views):
        progress(done, len(views), camera.name)
        image = plant.photo(camera.name)
        masks.ids[camera.name], masks.scores[camera.name] = detect(camera.name, image)
    return masks


def _given(plant: Plant, text: str, option: str) -> Path:
    """The file or folder of an option that this back end requires."""
    if not text:
        raise BadUsage(f"this back end needs weights, and none are downloaded; give a local file or folder as {option}")
    return plant.file(text)


def _listed(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


BACK_ENDS: Final[dict[str, Callable[[Plant, MasksOptions, Progress], Found]]] = {
    "bolls": by_bolls,
    "import": imported,
    "yolo": by_yolo,
    "sam": by_sam,
    "grounded-sam": by_text,
}
