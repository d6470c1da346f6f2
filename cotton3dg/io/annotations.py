# SPDX-License-Identifier: Apache-2.0
"""Boll masks made elsewhere: PNG files, COCO, Labelme, or YOLO labels, fitted to a plant's images."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import MaskSet
from ..core.libraries import import_pycolmap
from ..core.scene import Camera
from ..errors import BadInput, MissingInput
from .coco import is_coco, parse_coco
from .images import IMAGE_SUFFIXES, read_image
from .instances import AnnotatedImage, paint_all, read_json
from .labelme import is_labelme, parse_labelme
from .listing import files_below, files_in
from .mask_pngs import read_mask_pngs
from .yolo_labels import find_labels, read_class_names, read_yolo_labels

SAME_ASPECT: Final = 0.01
"""Relative difference of aspect ratios that rounding to whole pixels leaves in small images."""


def read_masks(
    source: Path, sizes: Mapping[str, tuple[int, int]] | None = None, classes: Collection[str] = ()
) -> MaskSet:
    """Read masks from a COCO or Labelme file, or a folder with such files, YOLO labels or PNG masks, in this order.

    Args:
        sizes: height and width of images by stem, for YOLO labels that have no images beside them.
        classes: names of the classes that are bolls; none = the only one there is.
    Returns:
        By the stem of the image's file name, at the size they have in the source.
    Raises:
        MissingInput: there is nothing to read. BadInput: a file is damaged or not a mask.
    """
    if not source.exists():
        raise MissingInput(f"{source} is not there; give a folder of masks or an annotation file")
    images = _parse([source] if source.is_file() else files_below(source, (".json",)))
    if not images and source.is_dir():
        images = _read_labels(source, sizes or {}, classes)
    if images:
        return paint_all(images, classes, source.name)
    if source.is_file():
        raise BadInput(f"{source.name} is neither COCO nor Labelme; export one of these, or masks as PNG")
    pngs = files_in(source, (".png",))
    if not pngs:
        raise MissingInput(f"{source} holds no masks (PNG, COCO, Labelme, YOLO labels); put them there")
    return read_mask_pngs(pngs)


def read_whole_masks(source: Path, classes: Collection[str] = ()) -> MaskSet:
    """Read masks as `read_masks` does, for use as the truth or as training data.

    Raises:
        BadInput: also if masks are left out or may hold several bolls.
    """
    found = read_masks(source, classes=classes)
    if found.notes:
        raise BadInput(f"{source.name}: {found.notes[0]}")
    return found


def find_annotated_images(source: Path) -> dict[str, Path]:
    """The photos in and below a folder, by stem, that annotations may belong to.

    Raises:
        BadInput: two have the same stem.
    """
    found: dict[str, Path] = {}
    for path in files_below(source, IMAGE_SUFFIXES):
        if path.stem in found:
            raise BadInput(f"{source.name} has two images named {path.stem}; rename one, with its annotation")
        found[path.stem] = path
    return found


def _parse(documents: list[Path]) -> dict[str, AnnotatedImage]:
    """The annotations in COCO and Labelme files, by image; other JSON files are skipped."""
    images: dict[str, AnnotatedImage] = {}
    for path in documents:
        document = read_json(path)
        if is_coco(document):
            more = parse_coco(document, path.name)
        elif is_labelme(document):
            more = dict([parse_labelme(document, path)])
        else:
            continue
        if twice := sorted(images.keys() & more.keys()):
            raise BadInput(f"{path.name} annotates {twice[0]}, which another file annotates too; keep one of them")
        images |= more
    return images


def _read_labels(
    source: Path, sizes: Mapping[str, tuple[int, int]], classes: Collection[str]
) -> dict[str, AnnotatedImage]:
    """YOLO labels of an export, by image."""
    photos = find_annotated_images(source)
    paths = find_labels(source, {*photos, *sizes})
    if not paths:
        return {}
    try:
        names = read_class_names(source) or read_class_names(source.parent)
    except BadInput:
        # Numbers stand for the names, unless the user chooses classes by name.
        if any(not name.isdecimal() for name in classes):
            raise
        names = {}
    images = {}
    for path in paths:
        if path.stem in photos:
            height, width = read_image(photos[path.stem]).shape[:2]
        elif path.stem in sizes:
            height, width = sizes[path.stem]
        else:
            raise BadInput(f"{path.name} belongs to no known image; name labels like their images, or keep both there")
        images[path.stem] = read_yolo_labels(path, height, width, names)
    return images


def undistort_ids(name: str, ids: NDArray[np.uint16], camera: Camera, model_dir: Path) -> NDArray[np.uint16]:
    """Masks at the size of an undistorted image, whatever they were drawn on.

    Masks of that size or shape were drawn on the undistorted image. Masks of the size of the filmed frame were drawn on
    that frame; the function removes its lens distortion from them.

    Args:
        name: for the message. camera: of the undistorted image. model_dir: COLMAP model of the images as filmed.
    Raises:
        BadInput: the masks have neither shape.
    """
    height, width = ids.shape
    if (height, width) == (camera.height, camera.width):
        return ids
    filmed = _find_filmed_camera(camera.name, model_dir)
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    if filmed is not None and (width, height) == (filmed.width, filmed.height):
        rays = camera.rays(np.stack([x, y], axis=-1)).reshape(-1, 3)
        x, y = filmed.img_from_cam(rays).T.reshape(2, camera.height, camera.width)
    elif abs(width * camera.height / (height * camera.width) - 1) < SAME_ASPECT:
        x, y = x * width / camera.width, y * height / camera.height
    else:
        raise BadInput(
            f"the mask of {name} is {width} x {height} px, its image {camera.width} x {camera.height}; draw masks "
            "on the images of frames/ or of sfm/undistorted/images"
        )
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    columns, lines = np.where(inside, x, 0).astype(np.int64), np.where(inside, y, 0).astype(np.int64)
    return np.where(inside, ids[lines, columns], 0).astype(np.uint16)


def _find_filmed_camera(name: str, model_dir: Path) -> Any:
    """pycolmap's camera of an image as filmed; None when the model does not have it."""
    pycolmap = import_pycolmap()

    try:
        model = pycolmap.Reconstruction(model_dir)
    except (ValueError, RuntimeError) as error:
        raise BadInput(f"the COLMAP model in {model_dir.name} cannot be read; run `cotton3dg sfm` again") from error
    image = model.find_image_with_name(name)
    return None if image is None else model.cameras[image.camera_id]
