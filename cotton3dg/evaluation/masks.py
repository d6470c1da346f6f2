# SPDX-License-Identifier: Apache-2.0
"""Masks against true ones: precision, recall and F1 at several IoU, and mIoU, as in Table 5 of Cotton3DGaussians.

In each image, true and found masks are matched one to one, the largest IoU first. At a threshold t a pair with at least
that IoU is a hit; precision is hits / found and recall is hits / true, both over the masks of all judged images, so
that every mask weighs the same.

The paper does not say which masks its mIoU averages. The value is as large with recall 0.818 as with 0.930 (0.839 and
0.831), so misses cannot be zeros in it. This module therefore takes it as the mean IoU of the hits at 0.5. It also
gives the mean over all true masks, in which a missed one counts 0.

Masks of fewer than `LEAST_PX` pixels are visible by chance and are left out on both sides alike: a pair if both its
masks are that small, and a mask without a partner if it is that small, at any threshold. The result would be the same
if found and true masks changed places.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float64
from ..errors import BadInput
from ..io.annotations import read_whole_masks, undistort_ids
from ..io.colmap import read_cameras
from ..io.images import read_ids
from ..schemas.frames import FramesInfo
from ..schemas.truth import TrueMasks
from ..staleness import id_image
from ..workspace import Workspace

THRESHOLDS: Final = (0.25, 0.5, 0.75)
LEAST_PX: Final = 40


@dataclass(frozen=True)
class MaskScore:
    """Detection at one IoU; NaN if there are no true or no found masks."""

    iou: float
    precision: float
    recall: float
    f1: float


@dataclass(frozen=True)
class MaskCounts:
    """Counts from some images; counts of several images add up."""

    n_true: int = 0
    n_found: int = 0
    hits: tuple[int, ...] = (0,) * len(THRESHOLDS)
    """Pairs at each of `THRESHOLDS`."""
    hits_iou: float = 0.0
    """Sum of the IoU of the hits at 0.5."""
    true_iou: float = 0.0
    """Sum over all true masks of the IoU with their partner, 0 without one."""

    def __add__(self, other: MaskCounts) -> MaskCounts:
        return MaskCounts(
            self.n_true + other.n_true,
            self.n_found + other.n_found,
            tuple(a + b for a, b in zip(self.hits, other.hits, strict=True)),
            self.hits_iou + other.hits_iou,
            self.true_iou + other.true_iou,
        )

    @property
    def scores(self) -> list[MaskScore]:
        """Scores at each of `THRESHOLDS`."""
        return [
            MaskScore(
                threshold,
                hits / self.n_found if self.n_found else math.nan,
                hits / self.n_true if self.n_true else math.nan,
                2 * hits / (self.n_found + self.n_true) if self.n_true else math.nan,
            )
            for threshold, hits in zip(THRESHOLDS, self.hits, strict=True)
        ]

    @property
    def miou_hits(self) -> float:
        """Mean IoU of the hits at 0.5, which this module takes as the paper's mIoU; NaN without any."""
        hits = self.hits[THRESHOLDS.index(0.5)]
        return self.hits_iou / hits if hits else math.nan

    @property
    def miou_all(self) -> float:
        """Mean IoU over all true masks, missed ones with 0; NaN without any."""
        return self.true_iou / self.n_true if self.n_true else math.nan


def count_masks(found: NDArray[np.uint16], true: NDArray[np.uint16]) -> MaskCounts:
    """Count the masks of one image.

    Args:
        found, true: (H, W) ids, 0 = background.
    """
    ious, found_px, true_px = match_ious(found, true)
    judged = np.maximum(found_px, true_px) >= LEAST_PX
    ious, found_px, true_px = ious[judged], found_px[judged], true_px[judged]
    return MaskCounts(
        int((true_px > 0).sum()),
        int((found_px > 0).sum()),
        tuple(int((ious >= threshold).sum()) for threshold in THRESHOLDS),
        float(ious[ious >= 0.5].sum()),
        float(ious.sum()),
    )


def score_masks(pairs: Iterable[tuple[NDArray[np.uint16], NDArray[np.uint16]]]) -> tuple[list[MaskScore], float]:
    """Scores at `THRESHOLDS`, and mIoU of the hits (NaN without), of (found, true) id images (H, W)."""
    counts = sum((count_masks(found, true) for found, true in pairs), MaskCounts())
    return counts.scores, counts.miou_hits


def match_ious(found: NDArray[np.uint16], true: NDArray[np.uint16]) -> tuple[Float64, Float64, Float64]:
    """One entry per pair or mask without a partner: IoU (0 without), and pixels of the found and of the true mask."""
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


def evaluate_masks(workspace: Workspace, folder: Path) -> dict[str, MaskCounts]:
    """The counts of each judged image of a plant, by its name.

    Args:
        folder: true masks: `instances/` of a simulated plant, or any that `masks --backend import` takes.
    Raises:
        BadInput: no image with masks has true masks.
    """
    truths = read_true_masks(workspace, folder)
    counts, png_of = {}, id_image(workspace)
    for camera in read_cameras(workspace.require(workspace.undistorted / "sparse", "sfm")):
        stem, png = Path(camera.name).stem, png_of(camera.name)
        if stem in truths and png.is_file():
            true = undistort_ids(stem, truths[stem], camera, workspace.sfm_model)
            counts[camera.name] = count_masks(read_ids(png), true)
    if not counts:
        raise BadInput(f"{folder} has true masks of no image that has masks; make more with masks --views 150")
    return counts


def read_true_masks(workspace: Workspace, folder: Path) -> dict[str, NDArray[np.uint16]]:
    """True masks by the stem of their image, before the removal of its lens distortion; `folder` as in
    `evaluate_masks`."""
    if (folder / "frames.json").is_file():
        return _read_video_masks(workspace, folder)
    return read_whole_masks(folder).ids


def _read_video_masks(workspace: Workspace, folder: Path) -> dict[str, NDArray[np.uint16]]:
    """True masks by the stem of the frame from the same place of the video."""
    file_of_index = {index: name for name, index in TrueMasks.load(folder / "frames.json").frames.items()}
    taken = FramesInfo.load(workspace.require(workspace.frames_json, "frames"))
    return {
        Path(image.name).stem: read_ids(folder / file_of_index[image.source_index])
        for image in taken.images
        if image.source_index in file_of_index
    }
