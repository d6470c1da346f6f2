# SPDX-License-Identifier: Apache-2.0
"""Segment Anything, SAM (Kirillov et al. 2023) and SAM 2 (Ravi et al. 2024), prompted by points and boxes.

An image is encoded once; each prompt then costs milliseconds. Several prompts may hit one boll, and one may come out as
a heap of them: `non_max_suppression.resolve_overlaps` decides. SAM's masks have 256 x 256 px for an image, so small
bolls need tiles.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float32, Float64
from ..errors import BadInput
from ..io.prompt_table import read_prompts
from .non_max_suppression import Candidate, crop, paint_candidates, resolve_overlaps, tiles
from .transformer_models import load_model, model_kind, normalise

CLASSES: Final = {"sam": "SamModel", "sam2": "Sam2Model", "sam2_video": "Sam2Model"}
"""Class of transformers by `model_type`; SAM 2 is published with the type of its video model."""
PROMPTS_AT_ONCE: Final = 32
MARGIN: Final = 0.05
"""Share by which a box is larger than its mask on each side, because masks may lack the fringe of a boll."""


@dataclass(frozen=True)
class Prompts:
    """The prompts for one image, px; one row for each boll."""

    points: Float64 | None = None
    """(n, 2) x, y inside."""
    boxes: Float64 | None = None
    """(n, 4) left, top, right, bottom; with points, both prompt the same boll."""

    @property
    def centres(self) -> Float64:
        """(n, 2) x, y."""
        if self.boxes is not None:
            middles: Float64 = self.boxes.reshape(-1, 2, 2).mean(axis=1)
            return middles
        return np.zeros((0, 2)) if self.points is None else self.points

    def choose(self, rows: NDArray[Any], offset: tuple[int, int]) -> Prompts:
        """Some of the prompts, seen from another corner of the image (x, y)."""
        points = None if self.points is None else self.points[rows] - offset
        return Prompts(points, None if self.boxes is None else self.boxes[rows] - np.tile(offset, 2))


Segmenter = Callable[[NDArray[np.uint8], Prompts], tuple[NDArray[np.bool_], Float32]]
"""From an image (H, W, 3) and n prompts to masks (n, H, W) and scores (n,)."""


def detect_sam(
    image: NDArray[np.uint8],
    segment: Segmenter,
    prompts: Prompts,
    *,
    confidence: float,
    tile_px: int = 0,
) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """Instance ids (H, W) of one image, and their scores.

    Args:
        image: (H, W, 3) RGB.
        confidence: least IoU that SAM expects its mask to have.
        tile_px: side of the squares that SAM sees one by one; 0 = the whole image at once.
    """
    height, width = image.shape[:2]
    squares = tiles(height, width, tile_px)
    middles = np.array([[(left + right) / 2, (top + bottom) / 2] for top, left, bottom, right in squares])
    found: list[Candidate] = []
    # Each prompt goes to the tile whose middle is nearest.
    owners = np.argmin(np.abs(prompts.centres[:, None] - middles).max(axis=2), axis=1)
    for number, (top, left, bottom, right) in enumerate(squares):
        rows = np.flatnonzero(owners == number)
        if not len(rows):
            continue
        masks, scores = segment(image[top:bottom, left:right], prompts.choose(rows, (left, top)))
        for mask, score in zip(masks, scores, strict=True):
            candidate = crop(mask, top, left, score) if score >= confidence else None
            if candidate:
                found.append(candidate)
    return paint_candidates(resolve_overlaps(found), height, width)


def prompts_around(ids: NDArray[np.uint16]) -> Prompts:
    """For each mask of an image: the box around it, and its point farthest from the border."""
    import cv2

    points, boxes = [], []
    for value in np.unique(ids[ids > 0]).tolist():
        mask = np.pad(ids == value, 1).astype(np.uint8)
        depths = cv2.distanceTransform(mask, cv2.DIST_L2, 3)[1:-1, 1:-1]
        y, x = np.unravel_index(int(np.argmax(depths)), depths.shape)
        points.append((x + 0.5, y + 0.5))
        rows, columns = np.nonzero(ids == value)
        low, high = np.array([columns.min(), rows.min()]), np.array([columns.max() + 1, rows.max() + 1])
        margin = MARGIN * (high - low)
        boxes.append(np.clip([*(low - margin), *(high + margin)], 0, np.tile(ids.shape[::-1], 2)))
    return Prompts(np.array(points, np.float64).reshape(-1, 2), np.array(boxes, np.float64).reshape(-1, 4))


def table_prompts(table: Path, cameras: Sequence[Camera]) -> dict[str, Prompts]:
    """Prompts of the user by the name of the image, px.

    Raises:
        BadInput: prompts of unknown images, or outside of theirs.
    """
    by_stem = {Path(camera.name).stem: camera for camera in cameras}
    prompts = {}
    for stem, rows in read_prompts(table).items():
        if stem not in by_stem:
            raise BadInput(
                f"{table.name} prompts {stem}, which is not an image with a pose; "
                f"use names such as {next(iter(by_stem))}"
            )
        camera = by_stem[stem]
        limits = np.tile([camera.width, camera.height], rows.shape[1] // 2)
        if ((rows < 0) | (rows > limits)).any():
            raise BadInput(
                f"{table.name} prompts {stem} outside of its {camera.width} x {camera.height} px; "
                "take them in the images of sfm/undistorted"
            )
        prompts[camera.name] = Prompts(points=rows) if rows.shape[1] == 2 else Prompts(boxes=rows)
    return prompts


def open_sam(folder: Path, *, trusted: bool) -> Segmenter:
    """SAM or SAM 2 from a folder that transformers saved.

    Raises:
        MissingInput, BadUsage, BadInput, EnvironmentUnusable: it cannot be used.
    """
    import torch
    import torch.nn.functional as F  # noqa: N812

    kind = model_kind(folder, "--weights", CLASSES)
    model = load_model(CLASSES[kind], folder, trusted=trusted)
    side = int(model.config.vision_config.image_size if kind == "sam" else model.prompt_encoder.input_image_size)

    @torch.inference_mode()
    def segment(image: NDArray[np.uint8], prompts: Prompts) -> tuple[NDArray[np.bool_], Float32]:
        height, width = image.shape[:2]
        inner = (side, side)
        if kind == "sam":  # keeps the aspect and pads below and right; SAM 2 stretches
            inner = max(round(side * height / max(height, width)), 1), max(round(side * width / max(height, width)), 1)
        frame = np.zeros((1, 3, side, side), np.float32)
        frame[0, :, : inner[0], : inner[1]] = normalise(image, *inner)
        code, factor = (
            model.get_image_embeddings(torch.from_numpy(frame)),
            np.array([inner[1] / width, inner[0] / height]),
        )
        masks, scores = [], []
        for first in range(0, len(prompts.centres), PROMPTS_AT_ONCE):
            part = prompts.choose(np.arange(first, min(first + PROMPTS_AT_ONCE, len(prompts.centres))), (0, 0))
            prompt_inputs = {}
            if part.points is not None:
                prompt_inputs["input_points"] = torch.from_numpy((part.points * factor)[None, :, None]).float()
                prompt_inputs["input_labels"] = torch.ones(prompt_inputs["input_points"].shape[:3], dtype=torch.int32)
            if part.boxes is not None:
                prompt_inputs["input_boxes"] = torch.from_numpy((part.boxes * np.tile(factor, 2))[None]).float()
            # A point alone is ambiguous, so the surest of three masks, whole to part, is taken; a box is unambiguous.
            output = model(image_embeddings=code, multimask_output=part.boxes is None, **prompt_inputs)
            surest = output.iou_scores[0].argmax(dim=1)
            rows = torch.arange(len(surest))
            logits = F.interpolate(output.pred_masks[0][rows, surest][:, None], (side, side), mode="bilinear")
            logits = F.interpolate(logits[..., : inner[0], : inner[1]], (height, width), mode="bilinear")
            masks.append((logits[:, 0] > 0).numpy())
            scores.append(output.iou_scores[0][rows, surest].clamp(0, 1).numpy())
        return np.concatenate(masks), np.concatenate(scores)

    segmenter: Segmenter = segment
    return segmenter
