# SPDX-License-Identifier: Apache-2.0
"""References of known size: the scale of each, its error, and the scale of several together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.measurements import Scale
from ..core.scene import Camera
from ..geometry.camera_orbit import fit_orbit
from ..geometry.planes import level_planes
from .rectangle import Rectangle
from .table import find_first_rectangle, turn_along_long_side

LEAST_ERROR: Final = 1e-3
"""Least relative error: that of paper, printers and rulers."""
TOLERANCE: Final = 0.01
"""Relative difference below which two references never disagree: 1 % is 1.2 cm of a table's length."""


@dataclass(frozen=True)
class Reference:
    """One thing of known size."""

    source: str
    cm_per_su: float
    relative_error: float
    evidence: dict[str, Any] = field(default_factory=dict)
    assumed: bool = False
    """Whether its size is the usual one and was not measured."""


@dataclass(frozen=True)
class NoReference:
    """The reason why a reference gives no scale, in a few words."""

    reason: str


@dataclass(frozen=True)
class Reconciled:
    """The scale from several references."""

    cm_per_su: float
    relative_error: float
    agreeing: tuple[str, ...]
    """Sources of the scale, the surest first."""
    differing: dict[str, float]
    """Source -> relative difference, for the sources that are left out."""
    assumed: bool = False
    """Whether all agreeing references have an assumed size."""


def reconcile(references: Sequence[Reference]) -> Reconciled:
    """The mean of the references that agree with the surest one, weighted by their certainty.

    References agree when they differ by less than three standard errors, or by less than `TOLERANCE`. The error is
    that of the weighted mean, but no less than half of the spread among those that agree. A reference of measured size
    is surer than one of assumed size, whatever their errors.
    """
    ranked = sorted(references, key=lambda reference: (reference.assumed, reference.relative_error))
    surest = ranked[0]
    agreeing, differing = [], {}
    for reference in ranked:
        difference = reference.cm_per_su / surest.cm_per_su - 1.0
        if abs(difference) <= max(TOLERANCE, 3 * float(np.hypot(reference.relative_error, surest.relative_error))):
            agreeing.append(reference)
        else:
            differing[reference.source] = difference
    values = np.array([reference.cm_per_su for reference in agreeing])
    weights = np.array([reference.relative_error for reference in agreeing]) ** -2.0
    mean = float(values @ weights / weights.sum())
    error = max(float(weights.sum() ** -0.5), float(np.ptp(values)) / 2 / mean, LEAST_ERROR)
    sources = tuple(reference.source for reference in agreeing)
    return Reconciled(mean, error, sources, differing, all(reference.assumed for reference in agreeing))


def scale_on(ground: Rectangle, cm_per_su: float, relative_error: float, source: str) -> Scale:
    """A scale with `ground` as its table top, or as the plane in its place."""
    up = ground.axes[2]
    plane = np.append(up, -up @ ground.origin)
    return Scale(cm_per_su, relative_error, source, up, plane, ground.corners)


def find_ground(points: NDArray[Any], cameras: Sequence[Camera], seed: int = 0) -> Rectangle | None:
    """The highest large level plane below the cameras: the table top of any shape, or else the floor.

    Args:
        points: (N, 3) su, of the surfaces in the scene.
    """
    points = np.asarray(points, np.float64)
    points = points[np.isfinite(points).all(axis=1)]
    orbit = fit_orbit(cameras)
    for plane in level_planes(points, orbit, seed):
        rectangle = find_first_rectangle(points, plane, orbit)
        if rectangle is not None:
            return turn_along_long_side(rectangle, cameras)
    return None


def distance_ratios(points_su: NDArray[Any], points_cm: NDArray[Any]) -> NDArray[np.float64]:
    """cm per su of each pair of points of a rigid body that is at least half as long as the longest.

    Args:
        points_su: (N, 3) as measured. points_cm: (N, D) as known.
    """
    first, second = np.triu_indices(len(points_su), 1)
    known = np.linalg.norm(np.asarray(points_cm)[first] - np.asarray(points_cm)[second], axis=1)
    measured = np.linalg.norm(np.asarray(points_su)[first] - np.asarray(points_su)[second], axis=1)
    long = (known >= 0.5 * known.max(initial=0.0)) & (measured > 0)
    ratios: NDArray[np.float64] = known[long] / measured[long]
    return ratios
