# SPDX-License-Identifier: Apache-2.0
"""The cameras that structure from motion could place: whether they suffice, and the flags and warnings about them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from ..core.runs import StageOutcome
from ..core.scene import Camera
from ..errors import CaptureFailed
from ..geometry.camera_orbit import find_out_of_view, fit_orbit
from ..schemas.sfm import LensDecision, SfmInfo
from .lens import NEEDLESS_RISE_PCT, adjust_without_distortion

MIN_REGISTERED_PCT: Final = 40.0
FEW_REGISTERED_PCT: Final = 80.0
MIN_REGISTERED: Final = 3
MIN_OBSERVATIONS: Final = 10.0
"""Least mean number of the model's points that an image shows; images of a plant show thousands. A model with hardly
any points is not a reconstruction: its cameras may be anywhere."""
MIN_COVERAGE_DEG: Final = 90.0
"""Coverage below which traits would be those of one side. Besides, a camera that only turns on the spot can pass for a
short arc, as a wrong lens explains its rotation."""
MAX_GAP_DEG: Final = 60.0
"""Beyond this gap in the orbit, sides of bolls were never seen."""

CONTRADICTED_PCT: Final = 5.0
MAX_CONTRADICTED_PCT: Final = 25.0
"""Share of what pairs of images have in common that the cameras contradict: doubtful above the first, refused above the
second. Good films have 0.0 %."""


def require_images(names: Sequence[str]) -> None:
    """Check before the reconstruction that there are enough images to place."""
    if len(names) < MIN_REGISTERED:
        raise CaptureFailed(f"{len(names)} images in frames; film one slow full turn around the plant")


def require_registered(models: Sequence[Any], names: Sequence[str]) -> None:
    """Check after the reconstruction that enough images were placed; else the plant would be measured from one side."""
    n = models[0].num_reg_images() if models else 0
    if n < MIN_REGISTERED or 100 * n < MIN_REGISTERED_PCT * len(names):
        raise CaptureFailed(
            f"{n} of {len(names)} frames registered ({MIN_REGISTERED_PCT:.0f} % needed); film one slow full turn with"
            f" the whole plant in view, or try --set frames.count={2 * len(names)}"
        )


def require_agreement(contradicted_pct: float | None) -> None:
    """Check after the reconstruction that the cameras agree with what their images have in common.

    Raises:
        CaptureFailed: too many pairs of images are contradicted.
    """
    if contradicted_pct is not None and contradicted_pct > MAX_CONTRADICTED_PCT:
        raise CaptureFailed(
            f"the cameras contradict {contradicted_pct:.0f} % of what images have in common"
            f" ({MAX_CONTRADICTED_PCT:.0f} % at most): something moved while filming, or too much of the scene looks"
            " alike; film one slow full turn with everything but you at rest, and with things on or around the table"
            " that differ from each other"
        )


def decide_distortion(model: Any, option: str) -> tuple[Any, LensDecision]:
    """The model with or without lens distortion, as the evidence or the option decides, and the evidence."""
    if option == "on":
        return model, LensDecision("on", on=True)
    straight, evidence = adjust_without_distortion(model)
    on = option == "auto" and evidence.on
    return model if on else straight, LensDecision(option, on, evidence.rise_pct, NEEDLESS_RISE_PCT, evidence.corner_px)


def describe_cameras(
    models: Sequence[Any], names: Sequence[str], cameras: Sequence[Camera], lens: LensDecision
) -> SfmInfo:
    """The quality of the first model, for all images `names`, and what it lacks.

    Args:
        models: as pycolmap has them.
        cameras: of the first, undistorted.
    Raises:
        CaptureFailed: the cameras saw the plant from one side only, or have next to nothing in common.
    """
    model = models[0]
    seen = model.compute_mean_observations_per_reg_image()
    if not seen >= MIN_OBSERVATIONS:
        raise CaptureFailed(
            f"an image shows {seen:.1f} points that others show, too ({MIN_OBSERVATIONS:.0f} needed); film one slow"
            " full turn, walking around the plant"
        )
    orbit = fit_orbit(cameras)
    if not orbit.coverage_deg >= MIN_COVERAGE_DEG:
        raise CaptureFailed(
            f"the camera went {orbit.coverage_deg:.0f} degrees around what it saw ({MIN_COVERAGE_DEG:.0f} needed); film"
            " one slow full turn, walking around the plant"
        )
    registered = [camera.name for camera in cameras]
    camera = next(iter(model.cameras.values()))
    return SfmInfo(
        n_frames=len(names),
        registered=tuple(registered),
        registered_pct=100 * len(registered) / len(names),
        unregistered=tuple(sorted(set(names) - set(registered))),
        n_models=len(models),
        n_points=model.num_points3D(),
        mean_reprojection_error_px=model.compute_mean_reprojection_error(),
        mean_track_length=model.compute_mean_track_length(),
        mean_observations=seen,
        camera_model=camera.model_name,
        camera_params=tuple(camera.params.tolist()),
        focal_length_px=camera.mean_focal_length(),
        orbit_coverage_deg=orbit.coverage_deg,
        orbit_largest_gap_deg=orbit.largest_gap_deg,
        orbit_radius_su=orbit.distance,
        orbit_axis=tuple(orbit.axis.tolist()),
        orbit_target=tuple(orbit.centre.tolist()),
        distortion=lens,
        plant_out_of_view=tuple(find_out_of_view(orbit.centre, cameras)),
    )


def outcome_of(info: SfmInfo) -> StageOutcome:
    """Summary, flags and warnings of the stage."""
    flags, warnings = [], []
    if info.registered_pct < FEW_REGISTERED_PCT:
        flags.append("few_frames_registered")
        warnings.append(
            f"{len(info.registered)} of {info.n_frames} frames registered; walk more slowly, or film with more light"
        )
    if info.orbit_largest_gap_deg > MAX_GAP_DEG:
        flags.append("orbit_gap")
        warnings.append(f"no view for {info.orbit_largest_gap_deg:.0f} degrees around the plant; film a full turn")
    if info.contradicted_pct is not None and info.contradicted_pct > CONTRADICTED_PCT:
        flags.append("cameras_contradicted")
        warnings.append(
            f"the cameras contradict {info.contradicted_pct:.0f} % of what images have in common; something moved while"
            " filming, or much of the scene looks alike: film again with everything but you at rest"
        )
    lost = info.plant_out_of_view
    if lost:
        flags.append("plant_out_of_view")
        warnings.append(f"the plant has left the frame in {len(lost)} images, e.g. {lost[0]}; keep it in the middle")
    keys = ("registered_pct", "n_points", "mean_reprojection_error_px", "orbit_coverage_deg")
    summary: dict[str, Any] = {key: round(getattr(info, key), 3) for key in keys}
    if info.rescue:
        summary["rescue"] = ", ".join(f"{step.name}: {step.placed_before} -> {step.placed}" for step in info.rescue)
    return StageOutcome(summary, tuple(flags), tuple(warnings))
