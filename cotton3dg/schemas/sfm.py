"""sfm/sfm.json: how good the model of the cameras is and what it misses."""

from __future__ import annotations

from dataclasses import dataclass

from .document import Document


@dataclass(frozen=True)
class LensDecision:
    """Whether the lens's distortion is modelled, and the evidence, unless the option forced it on."""

    option: str
    on: bool
    rise_pct: float | None = None
    """By how much the reprojection error rises without."""
    needed_from_pct: float | None = None
    corner_px: float | None = None
    """By how much it moves the corners of the image."""


@dataclass(frozen=True)
class RescueStep:
    """What was tried because too few images were placed."""

    name: str
    placed_before: int
    placed: int
    """Images; the step counts when they are more."""


@dataclass(frozen=True)
class SfmInfo(Document):
    """What the stage sfm found."""

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
    """(3,) su, what the cameras look at."""
    distortion: LensDecision
    plant_out_of_view: tuple[str, ...]
    """Images that miss what the cameras look at."""
    contradicted_pct: float | None = None
    """Pairs of images whose matches their cameras contradict; None where there are no pairs."""
    rescue: tuple[RescueStep, ...] = ()
    """In order; empty where enough images were placed at once."""
