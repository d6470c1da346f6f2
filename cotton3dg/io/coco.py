# SPDX-License-Identifier: Apache-2.0
"""COCO instance annotations: https://cocodataset.org/#format-data; run lengths as in pycocotools' maskApi.c."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..errors import BadInput
from .instances import AnnotatedImage, Instance, check_size, fill_polygons, parse_score, trace_outlines

EXPORT_TOLERANCE_PX: Final = 0.5
"""Half a pixel: finer than people draw, with a tenth of the corners."""


def is_coco(document: Any) -> bool:
    return isinstance(document, dict) and "annotations" in document and "images" in document


def parse_coco(document: Any, name: str) -> dict[str, AnnotatedImage]:
    """The images of a COCO document, by the stem of their file name.

    Args:
        name: of the file, for messages.
    Raises:
        BadInput: the document is damaged or not COCO.
    """
    try:
        labels = {category["id"]: str(category["name"]) for category in document.get("categories", [])}
        images = {image["id"]: image for image in document["images"]}
        annotations: dict[Any, list[dict[str, Any]]] = {key: [] for key in images}
        for annotation in document["annotations"]:
            annotations[annotation["image_id"]].append(annotation)
        parsed: dict[str, AnnotatedImage] = {}
        for key, image in images.items():
            stem = Path(str(image["file_name"]).replace("\\", "/")).stem
            if stem in parsed:
                raise BadInput(f"the image {stem} is listed twice; keep one entry")
            height, width = int(image["height"]), int(image["width"])
            check_size(height, width)
            instances = [
                Instance(
                    labels.get(item.get("category_id"), str(item.get("category_id", ""))),
                    fill_segmentation(item.get("segmentation") or [], height, width),
                    parse_score(item.get("score", 1.0)),
                )
                for item in annotations[key]
            ]
            parsed[stem] = AnnotatedImage(height, width, instances)
        return parsed
    except BadInput as error:
        raise BadInput(f"{name}: {error}") from error
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError, RecursionError) as error:
        raise BadInput(f"{name} is not a whole COCO file ({error!r:.80}); export it again") from error


def fill_segmentation(segmentation: Any, height: int, width: int) -> NDArray[np.int64]:
    """Indices of the pixels of a COCO segmentation: polygons as flat x, y lists, or run lengths, plain or compressed.

    Raises:
        BadInput: the segmentation cannot belong to this image.
    """
    if not isinstance(segmentation, dict):
        return fill_polygons(segmentation, height, width)
    if [int(side) for side in segmentation["size"]] != [height, width]:
        size = segmentation["size"]
        raise BadInput(f"a run-length mask of size {size} is in an image of {height} x {width}; export it again")
    counts = segmentation["counts"]
    if isinstance(counts, str):
        counts = decompress_counts(counts)
    runs = np.array(counts, np.int64)
    if (runs < 0).any() or (runs > height * width).any() or runs.sum() != height * width:
        raise BadInput(f"run lengths do not add up to {height} x {width} px; export the file again")
    values = np.arange(len(runs)) % 2 == 1
    return np.flatnonzero(np.repeat(values, runs).reshape(width, height).T)


def decompress_counts(text: str) -> list[int]:
    """Run lengths of COCO's compressed text: 5 bits a character, from the third on relative to the one two before."""
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


def coco_document(masks: Mapping[str, NDArray[np.uint16]]) -> dict[str, Any]:
    """Masks as a COCO document with polygons, which annotation tools can edit.

    Polygons have no holes: the background that shows through a boll becomes part of it.

    Args:
        masks: (H, W) ids by the name of the image file.
    """
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for number, (name, ids) in enumerate(sorted(masks.items()), start=1):
        height, width = ids.shape
        images.append({"id": number, "file_name": name, "height": height, "width": width})
        for value in np.unique(ids[ids > 0]).tolist():
            mask = ids == value
            polygons = [corners.round(2) for corners in trace_outlines(mask, EXPORT_TOLERANCE_PX)]
            if polygons:
                annotations.append(
                    {
                        "id": len(annotations) + 1,
                        "image_id": number,
                        "category_id": 1,
                        "segmentation": [corners.ravel().tolist() for corners in polygons],
                        "bbox": _bounding_box(polygons),
                        "area": int(mask.sum()),
                        "iscrowd": 0,
                    }
                )
    return {"images": images, "annotations": annotations, "categories": [{"id": 1, "name": "boll"}]}


def _bounding_box(polygons: Sequence[NDArray[Any]]) -> list[float]:
    """Left, top, width, height."""
    corners = np.concatenate(polygons)
    low, high = corners.min(axis=0), corners.max(axis=0)
    return [round(float(value), 2) for value in (*low, *(high - low))]
