# SPDX-License-Identifier: Apache-2.0
"""sfm/sfm.json: the quality of the model of the cameras, and what it lacks."""

from __future__ import annotations

from dataclasses import dataclass

from .document import Document


@dataclass(frozen=True)
class LensDecision:
    """Whether the lens's distortion is modelled, and the evidence, unless the option forced it on."""

    option: str
    on: bool
    rise_pct: float | None = None
    """By how much the reprojection error rises without distortion."""
    needed_from_pct: float | None = None
    corner_px: float | None = None
    """By how much the distortion moves the corners of the image."""


@dataclass(frozen=True)
class RescueStep:
    """A step that was tried because too few images were placed."""

    name: str
    placed_before: int
    placed: int
    """Number of placed images; the step counts if it places more."""


@dataclass(frozen=True)
class SfmInfo(Document):
    """The result of the stage sfm."""

    REMEDY = "run `cotton3dg sfm --force`"

    n_frames: int
    registered: tuple[str, ...]
    """Images with a pose."""
    registered_pct: float
    unregistered: tuple[str, ...]
    n_models: int
    n_points: int
    mean_reprojection_error_px: float
    mean_track_length: float
    mean_observations: float
    """Points seen by an image."""
    camera_model: str
    camera_params: tuple[float, ...]
    focal_length_px: float
    orbit_coverage_deg: float
    orbit_largest_gap_deg: float
    orbit_radius_su: float
    orbit_axis: tuple[float, ...]
    orbit_target: tuple[float, ...]
    """(3,) su, the point at which the cameras look."""
    distortion: LensDecision
    plant_out_of_view: tuple[str, ...]
    """Images that do not show the point at which the cameras look."""
    contradicted_pct: float | None = None
    """Pairs of images whose matches their cameras contradict; None where there are no pairs."""
    rescue: tuple[RescueStep, ...] = ()
    """The steps in order; empty if enough images were placed at once."""
