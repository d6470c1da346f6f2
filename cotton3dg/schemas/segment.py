# SPDX-License-Identifier: Apache-2.0
"""segment/segment.json: the settings of the segmentation, and how its maps agree with the masks."""

from __future__ import annotations

from dataclasses import dataclass

from .document import Document


@dataclass(frozen=True)
class MeanIous:
    """Threshold -> mean binary IoU of maps with masks; None where no view is judged."""

    mbiou: dict[str, float] | None = None
    mbiou_held_out: dict[str, float] | None = None


@dataclass(frozen=True)
class ReachedIous(MeanIous):
    """Mean IoUs after some steps of an optimisation."""

    steps: int = 0
    seconds: float = 0.0


@dataclass(frozen=True)
class SegmentInfo(Document):
    """How the selections were made; a method leaves out the fields that it does not have."""

    REMEDY = "run `cotton3dg segment --force`"

    method: str
    target: int
    rim_px: int | None = None
    """lift, probability: distance from their edges at which masks end."""
    weights_seconds: float | None = None
    threshold: float | None = None
    """probability: value from which a Gaussian is lint."""
    vote: MeanIous | None = None
    """probability: of the share of weights, which `lift` takes."""
    by_steps: tuple[ReachedIous, ...] | None = None
    rays_seconds: float | None = None
    training_seconds: float | None = None
    """affinity, as are the following fields."""
    loss: tuple[float, ...] | None = None
    seconds: float | None = None
    sets: int | None = None
    dropped_masks: dict[str, int] | None = None
    """Number of dropped masks by reason."""
