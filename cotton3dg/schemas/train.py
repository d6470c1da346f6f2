# SPDX-License-Identifier: Apache-2.0
"""train/metrics.json and train/effects.json: the quality of the model, and the effects of the camera it allows for."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

from .document import Document
from .sfm import LensDecision

REMEDY: Final = "run `cotton3dg train --force`"


@dataclass(frozen=True)
class HeldOut:
    """One held-out image compared with its render; NaN where the plant does not show."""

    image: str
    psnr_db: float
    ssim: float
    plant_psnr_db: float
    plant_ssim: float
    plant_share: float
    """Share of the pixels that are judged as plant."""


@dataclass(frozen=True)
class RejectedStep:
    """A step whose loss was not finite; it was undone."""

    step: int
    image: str


@dataclass(frozen=True)
class TrainedSteps:
    """An entry of the history of `train.trainer.Fit`; a training that only passes on a model has no width and loss."""

    step: int
    seconds: float
    cpu_seconds: float
    n_gaussians: int
    width_px: int | None = None
    loss: float | None = None


@dataclass(frozen=True)
class TrainMetrics(Document):
    """The quality of the model; likeness is that of the held-out images, NaN without any."""

    REMEDY = REMEDY

    psnr_db: float
    ssim: float
    plant_psnr_db: float
    plant_ssim: float
    plant_region: str
    """The pixels that are judged as plant."""
    n_gaussians: int
    steps: int
    seconds: float
    cpu_seconds: float
    n_pruned: int
    n_split: int
    culled: dict[str, int]
    """Gaussians that could not be drawn, by reason, over all steps."""
    rejected_steps: tuple[RejectedStep, ...]
    held_out: tuple[HeldOut, ...]
    history: tuple[TrainedSteps, ...]
    """The state of the training at a few of its steps."""
    pixel_su: float
    """Size of a training image's pixel at the point at which the cameras look."""
    skipped_updates: int = 0
    """Skipped updates of single Gaussians, over all steps, because of a gradient that was not finite."""
    budget: int | None = None
    """Largest number of Gaussians of the model; None for a model that was not trained to its end here."""


@dataclass(frozen=True)
class ExposureDecision:
    """Whether images are brought to a common exposure, and the evidence, unless the option forbade it."""

    option: str
    on: bool
    spread_pct: float | None = None
    error_pct: float | None = None
    visible_from_pct: float | None = None
    n_observations: int | None = None
    gains: dict[str, tuple[float, ...]] | None = None
    """Image -> (3,) by which its render is multiplied."""
    likeness: float | None = None
    """Correlation of the gains from dark and from bright points."""


@dataclass(frozen=True)
class MotionBlurFound:
    """By how much the walk blurred the images; NaN where that could not be judged."""

    on: bool
    """Whether the model allows for it: never."""
    found: bool
    median_px: float
    error_px: float
    strong_px: float
    """Length below which nine of ten images stay."""
    visible_from_px: float
    flow_px: float
    lengths_px: dict[str, float]
    """Length by image."""


@dataclass(frozen=True)
class RollingShutterFound:
    """The effect of reading out the rows one after another; NaN where it could not be judged."""

    on: bool
    """Whether the model allows for it: never."""
    found: bool
    read_out_frames: float
    error_frames: float
    shift_px: float
    left_px: float
    """The part that the poses of the cameras do not absorb."""
    visible_from_px: float


@dataclass(frozen=True)
class Effects(Document):
    """The evidence for and against effects of the camera; None where there was nothing to judge."""

    REMEDY = REMEDY

    exposure: ExposureDecision
    distortion: LensDecision | None = None
    motion_blur: MotionBlurFound | None = None
    rolling_shutter: RollingShutterFound | None = None

    @property
    def on(self) -> list[str]:
        """Names of the effects that the model allows for."""
        found = {item.name: getattr(self, item.name) for item in fields(self)}
        return sorted(name for name, decision in found.items() if decision and decision.on)
