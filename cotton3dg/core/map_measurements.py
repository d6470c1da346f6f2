# SPDX-License-Identifier: Apache-2.0
"""What is measured on the map of a plant, with its units: rows of branches.csv, columns of bolls.csv and traits.csv."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import Final

from .columns import column, columns
from .measurements import NO_SCALE

NO_MAP: Final = f"{NO_SCALE}; no plant on the table; no stem to map (flagged)"
NO_BRANCH: Final = f"{NO_MAP}; no branch"
NO_FRUITING: Final = f"{NO_MAP}; no fruiting branch"
NO_SITE: Final = f"{NO_MAP}; nothing connects the boll with the stem"


@dataclass(frozen=True)
class BranchTraits:
    """One row of branches.csv."""

    branch: int = column("", "rank of the branch by the height of its foot, 1 = lowest")
    kind: str = column("", "fruiting (sympodial) or vegetative (monopodial: low, upright and branching)")
    parent: int = column("", "branch that it grows on; 0 = the stem")
    height_cm: float = column("cm", "height of its foot above the table top", 2)
    azimuth_deg: float = column(
        "deg", "its direction seen from above, from the table's long side, counter-clockwise", 1
    )
    angle_deg: float = column("deg", "angle of its first 3 cm to the stem, or to the branch that it grows on", 1)
    length_cm: float = column(
        "cm", "along the curve, from the stem's centre to its tip or to the foot of its last boll", 2
    )
    reach_cm: float = column("cm", "straight distance of these two ends", 2)
    diameter_mm: float = column(
        "mm", "median width of its first 5 cm", 2, blank_when="too thin or hidden to have a silhouette"
    )
    n_bolls: int = column("1", "bolls on it")
    boll_ids: tuple[int, ...] = column("", "boll_id of its bolls, outwards, by vertical bars", blank_when="no bolls")
    confidence: float = column("1", "share of its length along which wood was seen; the rest was bridged", 3)


@dataclass(frozen=True)
class BollMapTraits:
    """Where a boll sits; None and NaN = not known."""

    branch: int | None = column(
        "1", "rank of its branch in branches.csv; 0 = on the stem itself", blank_when=NO_SITE, default=None
    )
    branch_confidence: float = column(
        "1",
        "how much nearer to the boll's foot its branch is than the next one; a third less where its branch passes "
        "within 1.6 cm of another one on the way there, and may go on as that",
        3,
        blank_when=NO_SITE,
        default=nan,
    )
    rank_on_branch: int | None = column(
        "1",
        "1 = nearest to the stem of the bolls on that branch (measured)",
        blank_when=NO_SITE,
        default=None,
    )
    path_from_stem_cm: float = column(
        "cm",
        "along the branch from the stem's centre to the boll's node; 0 on the stem",
        2,
        blank_when=NO_SITE,
        default=nan,
    )
    fruiting_position: int | None = column(
        "1",
        "fruiting position on its branch, 3 = third or beyond (inferred from bends and lengths: empty sites are too "
        "small to be seen)",
        blank_when=f"{NO_SITE}; not on a fruiting branch",
        default=None,
    )
    fruiting_position_confidence: float = column(
        "1",
        "probability of that position among all rows of nodes that would explain the branch",
        3,
        blank_when=f"{NO_SITE}; not on a fruiting branch",
        default=nan,
    )


@dataclass(frozen=True)
class MapTraits:
    """The map's part of a row of traits.csv."""

    stem_length_cm: float = column(
        "cm", "along the stem's curve, from the table top to its tip", 2, blank_when=NO_MAP, default=nan
    )
    stem_length_error_cm: float = column(
        "cm",
        "standard error of stem_length_cm, of the scale and two pixels, and of 2 cm where a boll sits on the stem",
        2,
        blank_when=NO_MAP,
        default=nan,
    )
    stem_diameter_mm: float = column(
        "mm",
        "median width of the stem's silhouettes 5 cm above the clamp",
        2,
        blank_when=f"{NO_MAP}; hidden there",
        default=nan,
    )
    stem_diameter_error_mm: float = column(
        "mm",
        "standard error of stem_diameter_mm, of the scale and 0.3 of a pixel",
        2,
        blank_when=f"{NO_MAP}; hidden there",
        default=nan,
    )
    stem_lean_deg: float = column(
        "deg", "angle of the line from the stem's foot to its tip to the vertical", 1, blank_when=NO_MAP, default=nan
    )
    branch_count: int | None = column(
        "1", "branches of at least 2.5 cm, those of branches included", blank_when=NO_MAP, default=None
    )
    branch_count_error: float = column(
        "1",
        "standard error of branch_count: one branch in eleven is missing or none, besides those of little confidence",
        2,
        blank_when=NO_MAP,
        default=nan,
    )
    fruiting_branch_count: int | None = column("1", "fruiting ones of them", blank_when=NO_MAP, default=None)
    bearing_branch_count: int | None = column("1", "branches with bolls", blank_when=NO_MAP, default=None)
    first_fruiting_branch_height_cm: float = column(
        "cm", "height of the foot of the lowest fruiting branch on the stem", 2, blank_when=NO_FRUITING, default=nan
    )
    first_fruiting_branch_height_error_cm: float = column(
        "cm", "standard error of that height, of the scale, a pixel and 4 mm", 2, blank_when=NO_FRUITING, default=nan
    )
    internode_mean_cm: float = column(
        "cm",
        "mean distance along the stem between the feet of its successive branches",
        2,
        blank_when=f"{NO_MAP}; fewer than two branches",
        default=nan,
    )
    internode_mean_error_cm: float = column(
        "cm",
        "standard error of internode_mean_cm, of a branch more or less, of the scale and a pixel at either end",
        2,
        blank_when=f"{NO_MAP}; fewer than two branches",
        default=nan,
    )
    branch_angle_mean_deg: float = column(
        "deg", "mean of angle_deg over the stem's branches", 1, blank_when=NO_BRANCH, default=nan
    )
    branch_angle_mean_error_deg: float = column(
        "deg",
        "standard error of that mean, of 9 degrees and a pixel across 3 cm of each",
        1,
        blank_when=NO_BRANCH,
        default=nan,
    )
    branch_length_mean_cm: float = column(
        "cm", "mean of length_cm over the branches", 2, blank_when=NO_BRANCH, default=nan
    )
    branch_length_mean_error_cm: float = column(
        "cm",
        "standard error of that mean, of the scale, and of each a fifth and half a centimetre at its tip",
        2,
        blank_when=NO_BRANCH,
        default=nan,
    )
    branch_density: tuple[float, float, float] | None = columns(
        {
            f"branch_density_{third}": f"length of branches per length of stem in its {third} third, by their feet"
            for third in ("lower", "middle", "upper")
        },
        "cm/cm",
        2,
        blank_when=NO_MAP,
        default=None,
    )
    bolls_by_branch: tuple[int, ...] | None = column(
        "", "bolls on branch 1, 2, ..., by vertical bars", blank_when=NO_BRANCH, default=None
    )
    bolls_by_position: tuple[int, int, int] | None = columns(
        {
            f"bolls_position_{position}": f"bolls at fruiting position {what} (inferred)"
            for position, what in ((1, "1"), (2, "2"), (3, "3 and beyond"))
        },
        "1",
        blank_when=NO_MAP,
        default=None,
    )
    first_position_share_pct: float = column(
        "%",
        "share of first positions among the bolls that have one",
        1,
        blank_when=f"{NO_MAP}; no bolls; no boll has a position",
        default=nan,
    )
