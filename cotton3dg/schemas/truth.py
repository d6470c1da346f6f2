# SPDX-License-Identifier: Apache-2.0
"""truth.json and instances/frames.json: the known truth about a plant; no stage reads it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Self

from .document import Document


@dataclass(frozen=True)
class TrueBoll:
    """One boll; metres, origin at the table's centre, z up."""

    centre_xyz_m: tuple[float, ...]
    convex_volume_cm3: float
    axis: int | None = None
    """Id of the branch that bears it."""
    position: int | None = None
    """Fruiting position, 1 next to the stem; None on the stem itself."""


@dataclass(frozen=True)
class TrueAxis:
    """One axis of wood; metres as for bolls."""

    id: int
    kind: str
    """stem, fruiting, vegetative or peduncle."""
    points_m: tuple[tuple[float, ...], ...]
    """From its foot on its parent's centre line to its tip."""
    radius_mm: tuple[float, ...]
    parent: int | None = None
    boll_id: int | None = None
    """Number of a peduncle's boll, counted from 1."""


@dataclass(frozen=True)
class Truth(Document):
    """The truth for comparison with results. `cotton3dg simulate` writes further keys, which nothing else reads."""

    REMEDY = "`cotton3dg simulate` writes a complete one"

    boll_count: float
    total_boll_convex_volume_cm3: float
    plant_height_cm: float
    canopy_size_cm: float
    stem_base_xyz_m: tuple[float, ...]
    """Where the stem meets the table."""
    bolls: tuple[TrueBoll, ...]
    skeleton: tuple[TrueAxis, ...] = ()
    clamp_tube_height_cm: float = 4.0


@dataclass(frozen=True)
class TruthOrigin(Document):
    """The origin of a truth.json."""

    REMEDY = Truth.REMEDY

    preset: str = ""
    """`simulate` for a simulated plant."""


@dataclass(frozen=True)
class TrueMasks(Document):
    """instances/frames.json: which frames of the video the true masks belong to."""

    REMEDY = "`cotton3dg simulate` writes a complete one"

    note: str = ""
    """What the masks show."""
    frames: dict[str, int] = field(default_factory=dict)
    """File of ids -> index of the video's frame."""

    @classmethod
    def parsed(cls, value: Any) -> Self:
        # Other sets of plants have the table of frames alone.
        return super().parsed(value if not isinstance(value, dict) or "frames" in value else {"frames": value})
