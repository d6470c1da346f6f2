# SPDX-License-Identifier: Apache-2.0
"""A model that another program trained on this plant's images and cameras, brought into the plant's scene.

Programs that keep the cameras' frame (INRIA's, gsplat with `--no-normalize-world-space`, Brush, LichtFeld) need nothing
but their PLY. nerfstudio trains in a frame of its own, x' = scale (R x + t), and writes R, t and scale to
dataparser_transforms.json (https://docs.nerf.studio/quickstart/data_conventions.html). This module undoes the
transform for means, sizes, orientations, and the colours' spherical harmonics, which depend on directions in that
frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.runs import StageOutcome
from ..core.scene import Float64, Gaussians
from ..errors import BadInput, MissingInput
from ..gaussians.harmonics import rotate_harmonics
from ..io.ply import read_gaussians
from ..schemas.document import Document
from ..schemas.train import TrainMetrics
from .quality import LOW_PSNR_DB
from .trainer import Fit

RIGID: Final = 1e-3
"""Largest error of a rotation that was saved in single precision."""


@dataclass(frozen=True)
class DataparserTransforms(Document):
    """dataparser_transforms.json, which nerfstudio writes beside a model: x' = scale (R x + t)."""

    REMEDY = "give the one that nerfstudio wrote beside the model's config.yml"

    transform: tuple[tuple[float, ...], ...]
    """Three rows of R and t."""
    scale: float


@dataclass(frozen=True)
class Similarity:
    """x' = scale (rotation @ x + shift)."""

    rotation: Float64
    """(3, 3)"""
    shift: Float64
    """(3,)"""
    scale: float


def read_foreign(ply: Path, transforms: Path | None = None) -> Gaussians:
    """The Gaussians of a PLY in INRIA's layout, with columns in any order, in the plant's scene.

    Args:
        transforms: dataparser_transforms.json of nerfstudio; None = the model is in the cameras' frame.
    Raises:
        MissingInput: a file is not there. BadInput: a file does not hold such a model, or such a transform.
    """
    for path in (ply, transforms):
        if path and not path.is_file():
            raise MissingInput(f"{path} is not there; give the file that the other program exported")
    gaussians = read_gaussians(ply, remedy="export it again")
    return apply_inverse(gaussians, read_dataparser_transforms(transforms)) if transforms else gaussians


def read_dataparser_transforms(path: Path) -> Similarity:
    """From the plant's scene to nerfstudio's.

    Raises:
        BadInput: it has no `transform` (3, 4) with a rotation, or no `scale` above 0.
    """
    transforms = DataparserTransforms.load(path)
    lengths = {len(row) for row in transforms.transform}
    matrix = np.array(transforms.transform, np.float64) if lengths == {4} else np.zeros(0)
    if matrix.shape != (3, 4) or not np.isfinite(matrix).all() or not 0 < transforms.scale < np.inf:
        raise BadInput(f"{path.name} has no 3 x 4 transform with a scale above 0; {transforms.REMEDY}")
    rotation = matrix[:, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > RIGID or np.linalg.det(rotation) < 0:
        raise BadInput(f"{path.name} has a transform that is not a rotation; {transforms.REMEDY}")
    return Similarity(rotation, matrix[:, 3], transforms.scale)


def apply_inverse(gaussians: Gaussians, similarity: Similarity) -> Gaussians:
    """The Gaussians in the frame that a similarity starts from."""
    rotation, scale = similarity.rotation, similarity.scale
    return Gaussians(
        ((gaussians.means / scale - similarity.shift) @ rotation).astype(np.float32),
        _after(gaussians.quats, rotation.T),
        (gaussians.log_scales - np.log(scale)).astype(np.float32),
        gaussians.opacity_logits,
        rotate_harmonics(gaussians.sh, rotation),
    )


def _after(quats: NDArray[np.float32], rotation: Float64) -> NDArray[np.float32]:
    """(N, 4) wxyz of the orientations after a further rotation."""
    from scipy.spatial.transform import Rotation

    orientations = Rotation.from_quat(np.roll(np.asarray(quats, np.float64), -1, axis=1))
    xyzw = (Rotation.from_matrix(rotation) * orientations).as_quat()
    wxyz: NDArray[np.float32] = np.roll(xyzw, 1, axis=1).astype(np.float32)
    return wxyz


def as_fit(gaussians: Gaussians) -> Fit:
    """A training without any step of this program."""
    return Fit(gaussians, [{"step": 0, "seconds": 0.0, "cpu_seconds": 0.0, "n_gaussians": len(gaussians)}])


def explained(outcome: StageOutcome, metrics: TrainMetrics) -> StageOutcome:
    """Add what to do about a model that is unlike the images, as more steps of this program do not help."""
    if not metrics.psnr_db < LOW_PSNR_DB:
        return outcome
    doubt = (
        f"the model differs from the photos (PSNR {metrics.psnr_db:.1f} dB); is it of this plant's cameras, and in"
        " their frame? nerfstudio's needs --transforms dataparser_transforms.json"
    )
    others = tuple(warning for warning in outcome.warnings if "--preset paper" not in warning)
    return replace(outcome, warnings=(*others, doubt))
