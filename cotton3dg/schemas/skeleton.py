# SPDX-License-Identifier: Apache-2.0
"""traits/skeleton.json: the map of a plant, its stem, branches and the bolls on them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.plant_map import Axis, BollOnMap, PlantMap
from .document import Document

DIGITS: Final = 4


@dataclass(frozen=True)
class AxisFacts:
    """The stem or a branch; lengths in cm, in the plant frame."""

    rank: int
    """0 of the stem."""
    kind: str
    parent: int
    points_cm: tuple[tuple[float, ...], ...]
    radius_cm: tuple[float, ...]
    """Radius at each point; null where no silhouette shows it."""
    confidence: float
    bolls: tuple[int, ...]


@dataclass(frozen=True)
class BollSite:
    """Where a boll sits."""

    boll_id: int
    branch: int
    rank: int
    stalk_cm: tuple[tuple[float, ...], ...]
    path_cm: float
    position: int
    """0 = not inferred."""
    position_confidence: float
    confidence: float


@dataclass(frozen=True)
class SkeletonInfo(Document):
    """The whole map of a plant."""

    REMEDY = "run `cotton3dg traits --force`"

    axes: tuple[AxisFacts, ...]
    bolls: tuple[BollSite, ...]
    reason: str = ""
    """The reason for a missing map."""


def describe_map(plant_map: PlantMap) -> SkeletonInfo:
    """The document of a map."""
    return SkeletonInfo(
        tuple(
            AxisFacts(
                axis.rank,
                axis.kind,
                axis.parent,
                _rows(axis.curve),
                tuple(round(float(radius), DIGITS) for radius in axis.radii),
                round(axis.confidence, DIGITS),
                axis.bolls,
            )
            for axis in plant_map.axes
        ),
        tuple(
            BollSite(
                boll.boll_id,
                boll.branch,
                boll.rank,
                _rows(boll.stalk),
                round(boll.path_cm, DIGITS),
                boll.position,
                boll.position_confidence if math.isfinite(boll.position_confidence) else math.nan,
                round(boll.confidence, DIGITS),
            )
            for boll in plant_map.bolls
        ),
        plant_map.reason,
    )


def read_map(info: SkeletonInfo) -> PlantMap:
    """The map that a document describes."""
    return PlantMap(
        tuple(
            Axis(
                axis.rank,
                axis.kind,
                axis.parent,
                np.array(axis.points_cm, np.float64).reshape(-1, 3),
                np.array(axis.radius_cm, np.float64),
                axis.confidence,
                axis.bolls,
            )
            for axis in info.axes
        ),
        tuple(
            BollOnMap(
                boll.boll_id,
                boll.branch,
                boll.rank,
                np.array(boll.stalk_cm, np.float64).reshape(-1, 3),
                boll.path_cm,
                boll.position,
                boll.position_confidence,
                boll.confidence,
            )
            for boll in info.bolls
        ),
        info.reason,
    )


def _rows(points: NDArray[Any]) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(round(float(x), DIGITS) for x in point) for point in points)
