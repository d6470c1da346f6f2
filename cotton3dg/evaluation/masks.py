"""Masks beside true ones: precision, recall and F1 at several IoU, and mIoU, as in Table 5 of Cotton3DGaussians.

In each image, true and found masks are matched one to one, the largest IoU first. At a threshold t a pair with at least
that IoU is a hit; precision is hits / found and recall is hits / true, both over the masks of all judged images, so
that every mask weighs the same. mIoU is the mean IoU of the pairs that are hits at 0.5. Masks of fewer than `LEAST_PX`
pixels are judged only where they are hits: what is that small is visible by chance.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..documents.frames import FramesInfo
from ..errors import BadInput
from ..files.annotations import read_masks, undistort_ids
from ..files.colmap import read_cameras
from ..files.images import read_ids
from ..workspace import Workspace

THRESHOLDS = (0.25, 0.5, 0.75)
LEAST_PX = 40


@dataclass(frozen=True)
class MaskScore:
    """Detection at one IoU; NaN where nothing is true or found."""

    iou: float
    precision: float
    recall: float
    f1: float


def score_masks(pairs: Iterable[tuple[NDArray[np.uint16], NDArray[np.uint16]]]) -> tuple[list[MaskScore], float]:
    """Scores at `THRESHOLDS`, and mIoU (NaN without hits), of (found, true) id images (H, W), an entry an image."""
    counts = np.zeros((len(THRESHOLDS), 3))  # hits, found, true
    overlaps: list[float] = []
    for found, true in pairs:
        ious, found_px, true_px = match_ious(found, true)
        for row, threshold in enumerate(THRESHOLDS):
            hit = ious >= threshold
            counts[row] += hit.sum(), (hit | (found_px >= LEAST_PX))[found_px > 0].sum(), 0
            counts[row, 2] += (hit | (true_px >= LEAST_PX))[true_px > 0].sum()
        overlaps += ious[ious >= 0.5].tolist()
    scores = []
    for threshold, (hits, n_found, n_true) in zip(THRESHOLDS, counts, strict=True):
        precision, recall = (hits / n if n else math.nan for n in (n_found, n_true))
        scores.append(MaskScore(threshold, precision, recall, 2 * hits / (n_found + n_true) if n_true else math.nan))
    return scores, float(np.mean(overlaps)) if overlaps else math.nan


def match_ious(found: NDArray[np.uint16], true: NDArray[np.uint16]) -> tuple[NDArray, NDArray, NDArray]:
    """One entry a pair or a mask without partner: IoU (0 without), and pixels of the found and of the true mask."""
    found_px, true_px = np.bincount(found.ravel()), np.bincount(true.ravel())
    together, both_px = np.unique(np.stack([found.ravel(), true.ravel()], 1), axis=0, return_counts=True)
    real = (together > 0).all(axis=1)
    together, both_px = together[real].astype(np.int64), both_px[real]
    ious = both_px / (found_px[together[:, 0]] + true_px[together[:, 1]] - both_px)
    rows: list[tuple[float, int, int]] = []
    partners: tuple[set[int], set[int]] = (set(), set())
    for pair in np.argsort(-ious, kind="stable"):
        mine, theirs = together[pair].tolist()
        if mine not in partners[0] and theirs not in partners[1]:
            rows.append((float(ious[pair]), int(found_px[mine]), int(true_px[theirs])))
            partners[0].add(mine)
            partners[1].add(theirs)
    rows += [(0.0, int(found_px[i]), 0) for i in np.unique(found[found > 0]).tolist() if i not in partners[0]]
    rows += [(0.0, 0, int(true_px[i])) for i in np.unique(true[true > 0]).tolist() if i not in partners[1]]
    table = np.array(rows, np.float64).reshape(-1, 3)
    return table[:, 0], table[:, 1], table[:, 2]


def evaluate_masks(workspace: Workspace, folder: Path) -> tuple[list[MaskScore], float, int]:
    """Scores, mIoU and the number of judged images of a plant's masks.

    Args:
        folder: true masks: `instances/` of a simulated plant, or any that `masks --backend import` takes.
    Raises:
        BadInput: no image with masks has true ones.
    """
    truths = read_masks(folder).ids if not (folder / "frames.json").is_file() else _read_video_masks(workspace, folder)
    pairs = []
    for camera in read_cameras(workspace.require(workspace.undistorted / "sparse", "sfm")):
        stem, png = Path(camera.name).stem, workspace.mask_png(camera.name)
        if stem in truths and png.is_file():
            pairs.append((read_ids(png), undistort_ids(stem, truths[stem], camera, workspace.sfm_model)))
    if not pairs:
        raise BadInput(f"{folder} has true masks of no image that has masks; make more with masks --views 150")
    return *score_masks(pairs), len(pairs)


def _read_video_masks(workspace: Workspace, folder: Path) -> dict[str, NDArray[np.uint16]]:
    """True masks by the stem of the frame that was taken from the same place of the video."""
    document = json.loads((folder / "frames.json").read_text(encoding="utf-8"))
    file_of_index = {index: name for name, index in document.get("frames", document).items()}
    taken = FramesInfo.load(workspace.require(workspace.frames_json, "frames"))
    return {
        Path(image.name).stem: read_ids(folder / file_of_index[image.source_index])
        for image in taken.images
        if image.source_index in file_of_index
    }
