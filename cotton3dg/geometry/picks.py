"""A point in space from places that a person picked by hand in several photos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from ..core.scene import Camera, Float64
from .triangulation import triangulate

PICK_PX: Final = 1.0
"""Standard error of a place picked by hand."""
SLIP_PX: Final = 6.0
"""Largest distance of a pick from the point on which the others agree. A pick farther off is a slip."""


@dataclass(frozen=True)
class PickedPoint:
    """The point where picks meet."""

    point: Float64
    """(3,) su."""
    error_su: float
    """Standard error of its place, mean of three axes."""


def point_of_picks(cameras: Sequence[Camera], pixels: Float64) -> PickedPoint | None:
    """The point that picks show; None where they do not meet in space.

    Args:
        cameras: one a pick. pixels: (P, 2) px.
    """
    sighting = triangulate(cameras, pixels, tolerance_px=SLIP_PX)
    if sighting is None:
        return None
    # Two picks meet by chance, so the error is at least that of a hand, even with smaller residuals.
    return PickedPoint(sighting.point, sighting.su_per_px * max(PICK_PX, sighting.residual_px))
