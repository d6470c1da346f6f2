# SPDX-License-Identifier: Apache-2.0
"""Instance segmentation by YOLO networks: YOLOv8, YOLO11 and similar ones (https://docs.ultralytics.com/tasks/segment).

A network sees an image fitted into a frame and answers with predictions, a column an anchor (box centre and size, a
score a class, mask coefficients), and with prototype masks; a mask is the sum of the prototypes weighted by its
coefficients, cut to its box. This module does everything around the network, so that the same weights give the same
masks whether ultralytics or OpenCV runs them. Masks are interpolated before they are cut at 0, at the image's own
resolution (`retina_masks` of ultralytics).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float32, Float64
from ..errors import BadInput
from .non_max_suppression import Candidate, crop, cut_by_tile, paint_candidates, resolve_overlaps, tiles
from .yolo_networks import Network

PADDING: Final = 114 / 255
"""Grey around the image, as in training."""
STRIDE: Final = 32
"""Sides of a network's input are multiples of its coarsest step, px."""


@dataclass(frozen=True)
class Fit:
    """How an image was fitted into a network's frame: scaled, then moved; px."""

    scale: float
    left: int
    top: int


def detect_yolo(
    image: NDArray[np.uint8],
    network: Network,
    *,
    image_size: int,
    confidence: float,
    nms_iou: float,
    tile_px: int = 0,
    classes: Collection[int] = (),
) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """Instance ids (H, W) of one image, and their scores.

    Args:
        image: (H, W, 3) RGB.
        image_size: longer side of what the network sees, px.
        confidence: least score. nms_iou: IoU of boxes above which only the surest is kept.
        tile_px: side of the squares that the network sees one by one; 0 = the whole image at once.
        classes: numbers of the classes that count; none = all.
    Raises:
        BadInput: the network's answer is not that of a segmentation model.
    """
    height, width = image.shape[:2]
    found: list[Candidate] = []
    for tile in tiles(height, width, tile_px):
        top, left, bottom, right = tile
        pixels, fit = fit_image(image[top:bottom, left:right], image_size)
        predictions, prototypes = check_answer(*network.forward(pixels))
        boxes, scores, coefficients = decode(predictions, len(prototypes), confidence, classes)
        boxes = (boxes - np.tile([fit.left, fit.top], 2)) / fit.scale
        keep = suppress(boxes, scores, nms_iou)
        stride = pixels.shape[3] / prototypes.shape[2]
        for row in keep:
            box = boxes[row] + np.tile([left, top], 2)
            if cut_by_tile(box, tile, height, width):
                continue
            corner, mask = mask_in_box(
                coefficients[row], prototypes, boxes[row], fit, stride, (bottom - top, right - left)
            )
            candidate = crop(mask, top + corner[0], left + corner[1], scores[row])
            if candidate:
                found.append(candidate)
    return paint_candidates(resolve_overlaps(found), height, width)


def fit_image(image: NDArray[np.uint8], size: int) -> tuple[Float32, Fit]:
    """(1, 3, s, s) as a network sees an image (H, W, 3): scaled so that the longer side is `size`, grey around it.

    s is `size` rounded up to a multiple of `STRIDE`. ultralytics itself leaves out most of the grey, which is quicker.
    But the network's attention covers the whole frame, so masks would differ from those of an ONNX export, which is
    made for squares.
    """
    import cv2

    height, width = image.shape[:2]
    scale = size / max(height, width)
    inner = max(round(height * scale), 1), max(round(width * scale), 1)
    side = -(-size // STRIDE) * STRIDE
    top, left = ((side - length) // 2 for length in inner)
    pixels = np.full((side, side, 3), PADDING, np.float32)
    scaled = cv2.resize(image, inner[::-1], interpolation=cv2.INTER_LINEAR) if scale != 1 else image
    pixels[top : top + inner[0], left : left + inner[1]] = scaled.astype(np.float32) / 255
    return np.ascontiguousarray(pixels.transpose(2, 0, 1)[None]), Fit(scale, left, top)


def check_answer(predictions: NDArray[Any], prototypes: NDArray[Any]) -> tuple[Float32, Float32]:
    """Predictions (C, A) and prototypes (M, h, w) of one image.

    Raises:
        BadInput: they do not fit together, or are not finite.
    """
    if predictions.ndim != 3 or prototypes.ndim != 4 or len(predictions) != 1 or len(prototypes) != 1:
        raise BadInput("the model does not answer as a YOLO segmentation model does; export a YOLO11-seg model")
    columns, masks = predictions[0], prototypes[0]
    if len(columns) < 5 + len(masks) or columns.shape[1] < 1 or masks.shape[1] != masks.shape[2]:
        raise BadInput(
            f"predictions {predictions.shape} and prototypes {prototypes.shape} are not those of a YOLO segmentation "
            "model; export a YOLO11-seg model with nms=False"
        )
    if not (np.isfinite(columns).all() and np.isfinite(masks).all()):
        raise BadInput("the model answers with values that are not finite; its training failed, take other weights")
    return columns.astype(np.float32), masks.astype(np.float32)


def decode(
    predictions: Float32, n_masks: int, confidence: float, classes: Collection[int]
) -> tuple[Float64, Float32, Float32]:
    """Boxes (n, 4) left, top, right, bottom in px of the frame, scores (n,) and coefficients (n, M), surest first."""
    n_classes = len(predictions) - 4 - n_masks
    unknown = [number for number in classes if not 0 <= number < n_classes]
    if unknown:
        raise BadInput(f"the model has no class {unknown[0]}, only 0 to {n_classes - 1}; correct --classes")
    scores = predictions[4 : 4 + n_classes][sorted(classes) or slice(None)].max(axis=0)
    order = np.argsort(-scores, kind="stable")
    order = order[scores[order] >= confidence]
    middle, half = predictions[:2, order].T.astype(np.float64), predictions[2:4, order].T.astype(np.float64) / 2
    return np.hstack([middle - half, middle + half]), scores[order], predictions[4 + n_classes :, order].T


def suppress(boxes: Float64, scores: NDArray[Any], iou: float) -> list[int]:
    """Indices of boxes (n, 4), the surest first, without those that overlap a surer one by more than `iou`."""
    import cv2

    sides = boxes[:, 2:] - boxes[:, :2]
    return list(cv2.dnn.NMSBoxes(np.hstack([boxes[:, :2], sides]).tolist(), scores.tolist(), 0.0, iou))


def mask_in_box(
    coefficients: Float32, prototypes: Float32, box: Float64, fit: Fit, stride: float, shape: tuple[int, int]
) -> tuple[tuple[int, int], NDArray[np.bool_]]:
    """Top and left, and the mask (h, w), of the object in a box; px of the image.

    Args:
        coefficients: (M,). prototypes: (M, h, w). box: left, top, right, bottom, px of the image.
        stride: px of the frame in one of the prototypes. shape: of the image.
    """
    import cv2

    left, top = np.clip(np.floor(box[:2]), 0, [shape[1], shape[0]]).astype(int)
    right, bottom = np.clip(np.ceil(box[2:]), [left, top], [shape[1], shape[0]]).astype(int)
    if right <= left or bottom <= top:
        return (int(top), int(left)), np.zeros((0, 0), bool)
    x = ((np.arange(left, right) + 0.5) * fit.scale + fit.left) / stride - 0.5
    y = ((np.arange(top, bottom) + 0.5) * fit.scale + fit.top) / stride - 0.5
    logits = np.tensordot(coefficients, prototypes, 1)
    columns, rows = (values.astype(np.float32) for values in np.meshgrid(x, y))
    inside = cv2.remap(logits, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) > 0
    centres_x, centres_y = np.arange(left, right) + 0.5, np.arange(top, bottom) + 0.5
    inside &= ((centres_x >= box[0]) & (centres_x <= box[2]))[None]
    inside &= ((centres_y >= box[1]) & (centres_y <= box[3]))[:, None]
    return (int(top), int(left)), inside
