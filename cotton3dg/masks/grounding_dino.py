# SPDX-License-Identifier: Apache-2.0
"""Finds boxes around the objects that a text names: Grounding DINO (Liu et al. 2023), which prompts SAM in
Cotton3DGaussians."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float64
from ..errors import BadInput
from .non_max_suppression import cut_by_tile, tiles
from .transformer_models import load_model, model_kind, normalise, transformers_class
from .yolo import suppress

KINDS: Final = ("grounding-dino",)
SHORT_SIDE_PX: Final = 800
LONG_SIDE_PX: Final = 1333
"""Size of the images it was trained on."""
SAME_BOX: Final = 0.7
"""IoU from which two boxes are one: several queries may find the same object."""
LARGEST: Final = 0.5
"""A box larger than this share of the image is the plant or the scene, and not a boll."""

Finder = Callable[[NDArray[np.uint8]], tuple[Float64, Float64]]
"""From an image (H, W, 3) to boxes (n, 4) left, top, right, bottom px and scores (n,)."""


def find_boxes(image: NDArray[np.uint8], find: Finder, *, confidence: float, tile_px: int = 0) -> Float64:
    """Boxes (n, 4) of the objects in an image, px, the surest first."""
    height, width = image.shape[:2]
    boxes, scores = [np.zeros((0, 4))], [np.zeros(0)]
    for tile in tiles(height, width, tile_px):
        top, left, bottom, right = tile
        inside, sure = find(image[top:bottom, left:right])
        inside = inside + np.tile([left, top], 2)
        areas = np.prod(np.maximum(inside[:, 2:] - inside[:, :2], 0), axis=1)
        whole = np.array([not cut_by_tile(box, tile, height, width) for box in inside], bool)
        keep = whole & (sure >= confidence) & (areas > 0) & (areas <= LARGEST * (bottom - top) * (right - left))
        boxes.append(inside[keep])
        scores.append(sure[keep])
    found, sureness = np.concatenate(boxes), np.concatenate(scores)
    return found[suppress(found, sureness, SAME_BOX)]


def open_grounding_dino(folder: Path, text: str, *, trusted: bool) -> Finder:
    """Grounding DINO from a folder that transformers saved; it finds the objects that `text` names.

    Raises:
        MissingInput, BadUsage, BadInput, EnvironmentUnusable: it cannot be used.
    """
    import torch

    model_kind(folder, "--detector", KINDS)
    model = load_model("GroundingDinoForObjectDetection", folder, trusted=trusted)
    try:
        tokenizer = transformers_class("AutoTokenizer").from_pretrained(folder, local_files_only=True)
        # It was trained on names in lower case, each with a full stop behind it.
        words = dict(tokenizer(text.strip().lower().rstrip(".") + ".", return_tensors="pt"))
    except Exception as error:
        raise BadInput(
            f"{folder.name} has no tokenizer that can be read ({error!r:.80}); copy the model's whole folder"
        ) from error

    @torch.inference_mode()
    def find(image: NDArray[np.uint8]) -> tuple[Float64, Float64]:
        height, width = image.shape[:2]
        factor = min(SHORT_SIDE_PX / min(height, width), LONG_SIDE_PX / max(height, width))
        pixels = normalise(image, max(round(height * factor), 1), max(round(width * factor), 1))
        output = model(pixel_values=torch.from_numpy(pixels[None]), **words)
        scores = output.logits[0].sigmoid().max(dim=1).values.double().numpy()
        middle, size = output.pred_boxes[0].double().numpy().reshape(-1, 2, 2).swapaxes(0, 1)
        boxes = np.hstack([middle - size / 2, middle + size / 2]) * np.tile([width, height], 2)
        return np.clip(boxes, 0, np.tile([width, height], 2)), scores

    finder: Finder = find
    return finder
