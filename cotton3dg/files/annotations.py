"""Boll masks made elsewhere: a folder of grey PNG files, or COCO JSON with polygons or run lengths.

COCO's format: https://cocodataset.org/#format-data; its compressed run lengths are those of pycocotools' maskApi.c.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import MaskSet
from ..core.scene import Camera
from ..errors import BadInput, MissingInput
from .images import MAX_PIXELS, list_images, read_ids

MAX_JSON_BYTES = 2**28
SAME_ASPECT = 0.01
"""Relative difference of aspect ratios that rounding to whole pixels leaves in small images."""


def read_masks(source: Path) -> MaskSet:
    """Read masks from a folder of grey PNGs, one an image, from a COCO file, or from a folder that holds one.

    Returns:
        By the stem of the image's file name, at the size they have in the source.
    Raises:
        MissingInput: nothing is there. BadInput: a file is damaged or no mask.
    """
    if not source.exists():
        raise MissingInput(f"{source} is not there; give a folder of PNG masks or a COCO file as --source")
    if source.is_file():
        return read_coco(source)
    documents = sorted(source.glob("*.json"))
    images = [path for path in list_images(source) if path.suffix.lower() == ".png"]
    if len(documents) == 1 and not images:
        return read_coco(documents[0])
    if not images:
        raise MissingInput(f"{source} holds no PNG masks and no single COCO file; put one mask an image there")
    return MaskSet({path.stem: read_ids(path) for path in images})


def read_coco(path: Path) -> MaskSet:
    """Read instance masks from a COCO file; where instances overlap, the smaller one is in front.

    Raises:
        BadInput: the file is damaged or not COCO.
    """
    if path.stat().st_size > MAX_JSON_BYTES:
        raise BadInput(f"{path.name} is larger than {MAX_JSON_BYTES >> 20} MiB; export fewer images or as PNG masks")
    try:
        document = json.loads(path.read_bytes())
        images = {image["id"]: image for image in document["images"]}
        annotations: dict[Any, list[dict[str, Any]]] = {key: [] for key in images}
        for annotation in document["annotations"]:
            annotations[annotation["image_id"]].append(annotation)
        ids, scores = {}, {}
        for key, image in images.items():
            stem = Path(str(image["file_name"]).replace("\\", "/")).stem
            if stem in ids:
                raise BadInput(f"{path.name} lists the image {stem} twice; keep one entry")
            ids[stem], scores[stem] = _painted(annotations[key], int(image["height"]), int(image["width"]))
    except BadInput as error:
        raise BadInput(str(error) if path.name in str(error) else f"{path.name}: {error}") from error
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError, RecursionError) as error:
        raise BadInput(f"{path.name} is not a whole COCO file ({error!r:.80}); export it again") from error
    return MaskSet(ids, scores)


def _painted(annotations: list[dict[str, Any]], height: int, width: int) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """One image's (H, W) ids, 1 ... in the order of the annotations, and their scores."""
    if not 0 < height * width <= MAX_PIXELS or min(height, width) <= 0:
        raise BadInput(f"an image of {width} x {height} px cannot be; export it again")
    if len(annotations) > np.iinfo(np.uint16).max:
        raise BadInput(f"{len(annotations)} instances in one image do not fit into 16 bits; leave some out")
    areas, pieces = [], []
    for annotation in annotations:
        mask = instance_mask(annotation["segmentation"], height, width)
        pixels = np.flatnonzero(mask)
        areas.append(len(pixels))
        pieces.append(pixels)
    ids = np.zeros(height * width, np.uint16)
    for index in np.argsort(-np.array(areas, np.int64), kind="stable"):
        ids[pieces[index]] = index + 1
    scores = {}
    for number, annotation in enumerate(annotations, start=1):
        score = float(annotation.get("score", 1.0))
        scores[number] = min(max(score, 0.0), 1.0) if math.isfinite(score) else 0.0
    return ids.reshape(height, width), {number: scores[number] for number in np.unique(ids[ids > 0]).tolist()}


def instance_mask(segmentation: Any, height: int, width: int) -> NDArray[np.bool_]:
    """(H, W) of a COCO segmentation: polygons as flat x, y lists, or run lengths, plain or compressed."""
    if isinstance(segmentation, dict):
        if [int(side) for side in segmentation["size"]] != [height, width]:
            size = segmentation["size"]
            raise BadInput(f"a run-length mask of size {size} is in an image of {height} x {width}; export it again")
        counts = segmentation["counts"]
        if isinstance(counts, str):
            counts = decompressed_counts(counts)
        runs = np.array(counts, np.int64)
        if (runs < 0).any() or (runs > height * width).any() or runs.sum() != height * width:
            raise BadInput(f"run lengths do not add up to {height} x {width} px; export the file again")
        values = np.arange(len(runs)) % 2 == 1
        return np.repeat(values, runs).reshape(width, height).T

    import cv2

    mask = np.zeros((height, width), np.uint8)
    for polygon in segmentation:
        corners = np.array(polygon, np.float64).reshape(-1, 2)
        if not np.isfinite(corners).all() or (np.abs(corners) > 1e5).any():
            raise BadInput("a polygon has a corner that is no number or far outside; export the file again")
        # Corners count from the corner of the first pixel, OpenCV counts from its centre; 4 bits of fraction.
        cv2.fillPoly(mask, [np.round((corners - 0.5) * 16).astype(np.int32)], 1, shift=4)
    return mask.astype(bool)


def decompressed_counts(text: str) -> list[int]:
    """Run lengths from COCO's compressed string: 5 bits a character, from the third run on relative to two before."""
    counts: list[int] = []
    value, shift = 0, 0
    for character in text.encode("ascii"):
        bits = character - 48
        if not 0 <= bits < 64 or shift > 50:
            raise BadInput("a compressed run-length mask is damaged; export the file again")
        value |= (bits & 0x1F) << shift
        shift += 5
        if not bits & 0x20:
            if bits & 0x10:
                value -= 1 << shift
            counts.append(value + (counts[-2] if len(counts) > 2 else 0))
            value, shift = 0, 0
    if shift:
        raise BadInput("a compressed run-length mask is cut off; export the file again")
    return counts


def undistorted_ids(name: str, ids: NDArray[np.uint16], camera: Camera, model_dir: Path) -> NDArray[np.uint16]:
    """Masks at the size of an undistorted image, whatever they were drawn on.

    Masks of that size or shape were drawn on the undistorted image; those of the size of the frame as filmed were
    drawn on that, and its distortion is taken out of them.

    Args:
        name: for the message. camera: of the undistorted image. model_dir: COLMAP model of the images as filmed.
    Raises:
        BadInput: another shape than both.
    """
    height, width = ids.shape
    if (height, width) == (camera.height, camera.width):
        return ids
    filmed = _filmed_camera(camera.name, model_dir)
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    if filmed is not None and (width, height) == (filmed.width, filmed.height):
        rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], -1).reshape(-1, 3)
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


def _filmed_camera(name: str, model_dir: Path) -> Any:
    """pycolmap's camera of an image as filmed; None when the model does not have it."""
    import pycolmap

    try:
        model = pycolmap.Reconstruction(model_dir)
    except (ValueError, RuntimeError) as error:
        raise BadInput(f"the COLMAP model in {model_dir.name} cannot be read; run `cotton3dg sfm` again") from error
    image = model.find_image_with_name(name)
    return None if image is None else model.cameras[image.camera_id]
