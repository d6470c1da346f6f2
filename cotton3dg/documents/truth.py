"""truth.json: what is known of a plant, simulated or measured by hand; no stage reads it."""

from __future__ import annotations

from dataclasses import dataclass

from .document import Document


@dataclass(frozen=True)
class TrueBoll:
    """One boll; metres, origin at the table's centre, z up."""

    centre_xyz_m: tuple[float, ...]
    convex_volume_cm3: float


@dataclass(frozen=True)
class Truth(Document):
    """What results are compared with. `cotton3dg simulate` writes more, which nothing else reads."""

    REMEDY = "`cotton3dg simulate` writes a complete one"

    boll_count: float
    total_boll_convex_volume_cm3: float
    plant_height_cm: float
    canopy_size_cm: float
    stem_base_xyz_m: tuple[float, ...]
    """Where the stem meets the table."""
    bolls: tuple[TrueBoll, ...]
