# SPDX-License-Identifier: Apache-2.0
"""Two films of one plant side by side: the change of each boll and of each trait."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.columns import column, columns
from ..errors import BadInput, BadUsage
from .align import Alignment, NoAlignment, align
from .match import match_bolls
from .measured_plant import Filmed, comparable_traits, read_filmed

REACH_CM: Final = 3.0
"""The farthest that a boll may move and still count as the same; bolls are farther apart."""
SURE: Final = 1.96
"""Chance gives a change of this many standard errors in one case of twenty."""
SAME: Final = "same"
GONE: Final = "gone"
NEW: Final = "new"
ONE_ONLY: Final = "gone; new"
NO_VOLUME: Final = f"{ONE_ONLY}; a film gives no volume"


@dataclass(frozen=True)
class BollChange:
    """One row of boll_changes.csv; NaN and None = blank."""

    film: str = column("", "the film that is compared with the first")
    state: str = column("", "same: found in both films; gone: in the first only; new: in the other only")
    boll_first: int | None = column("", "boll_id in the first film", blank_when="new")
    boll_other: int | None = column("", "boll_id in the other film", blank_when="gone")
    place_cm: NDArray[np.float64] = columns(
        {f"{axis}_cm": f"{axis} of its centre in the first film's plant frame; of a new boll, after alignment"
         for axis in "xyz"},
        "cm",
        2,
    )  # fmt: skip
    moved_cm: float = column("cm", "distance of its centres after alignment", 2, blank_when=ONE_ONLY)
    volume_first_cm3: float = column("cm3", "volume in the first film", 2, blank_when="new; no volume")
    volume_other_cm3: float = column("cm3", "volume in the other film", 2, blank_when="gone; no volume")
    volume_change_cm3: float = column("cm3", "other minus first", 2, blank_when=NO_VOLUME)
    volume_change_error_cm3: float = column("cm3", "standard error of that, of both films' errors", 2,
                                            blank_when=NO_VOLUME)  # fmt: skip
    diameter_first_cm: float = column("cm", "diameter in the first film", 2, blank_when="new; no volume")
    diameter_other_cm: float = column("cm", "diameter in the other film", 2, blank_when="gone; no volume")
    diameter_change_cm: float = column("cm", "other minus first", 2, blank_when=NO_VOLUME)
    beyond_error: str = column(
        "", "yes: the volume changed by more than 1.96 of its standard errors; no", blank_when=NO_VOLUME
    )
    flags: tuple[str, ...] = column(
        "",
        "quality flags of the boll in either film, separated by vertical bars",
        name="qc_flags",
        blank_when="no flag",
    )


@dataclass(frozen=True)
class TraitChange:
    """One row of trait_changes.csv."""

    film: str = column("", "the film that is compared with the first")
    trait: str = column("", "column of traits.csv")
    unit: str = column("", "its unit")
    first: float = column("trait", "its value in the first film", 3)
    other: float = column("trait", "its value in the other film", 3)
    change: float = column("trait", "other minus first", 3)
    change_pct: float = column("%", "the same in per cent of the first", 1, blank_when="first is 0")
    error: float = column("trait", "standard error of the change, of both films' stated errors", 3,
                          blank_when="the trait has no stated error")  # fmt: skip
    beyond_error: str = column(
        "", "yes: changed by more than 1.96 of its standard errors; no", blank_when="the trait has no stated error"
    )


@dataclass(frozen=True)
class Comparison:
    """The comparison of another film with the first."""

    first: Filmed
    other: Filmed
    alignment: Alignment
    pairs: NDArray[np.int64]
    """(n, 2) rows of the bolls that are the same."""
    bolls: list[BollChange]
    traits: list[TraitChange]

    def count(self, state: str) -> int:
        return sum(boll.state == state for boll in self.bolls)

    @property
    def median_moved_cm(self) -> float:
        """NaN if no boll is the same."""
        moved = [boll.moved_cm for boll in self.bolls if boll.state == SAME]
        return float(np.median(moved)) if moved else math.nan


def compare(folders: Sequence[Path], reach_cm: float = REACH_CM, turn_deg: float | None = None) -> list[Comparison]:
    """Align each film with the first one.

    Args:
        turn_deg: turn of the plant between the films, if it is known; None = find it from bolls and branches.
    Raises:
        BadUsage: fewer than two folders, or a folder twice.
        BadInput: no turn aligns a film with the first.
    """
    if len(folders) < 2 or len({folder.resolve() for folder in folders}) < len(folders):
        raise BadUsage("give two folders or more of finished plants, each once")
    first, *others = map(read_filmed, folders)
    return [compare_films(first, other, reach_cm, turn_deg) for other in others]


def compare_films(first: Filmed, other: Filmed, reach_cm: float, turn_deg: float | None = None) -> Comparison:
    """Align one film with another.

    Raises:
        BadInput: no turn aligns them.
    """
    alignment = align(first.layout, other.layout, reach_cm, turn_deg)
    if isinstance(alignment, NoAlignment):
        hint = "" if turn_deg is not None else "; if it is one plant and you know how far it was turned, add --turn-deg"
        raise BadInput(f"{other.name} cannot be laid on {first.name}: {alignment.reason}{hint}")
    placed = alignment.apply(other.centres_cm)
    pairs = match_bolls(first.centres_cm, placed, reach_cm)
    return Comparison(
        first, other, alignment, pairs, _boll_changes(first, other, placed, pairs), _trait_changes(first, other)
    )


def _boll_changes(
    first: Filmed, other: Filmed, placed: NDArray[np.float64], pairs: NDArray[np.int64]
) -> list[BollChange]:
    """The bolls in both films first, then those that are gone, then new ones."""
    rows: list[tuple[str, int | None, int | None]] = [(SAME, int(a), int(b)) for a, b in pairs]
    rows += [(GONE, a, None) for a in range(len(first.ids)) if a not in pairs[:, 0]]
    rows += [(NEW, None, b) for b in range(len(other.ids)) if b not in pairs[:, 1]]

    def at(values: Sequence[float] | NDArray[np.float64], row: int | None) -> float:
        return math.nan if row is None else float(values[row])

    changes = []
    for state, a, b in rows:
        volumes = at(first.volumes_cm3, a), at(other.volumes_cm3, b)
        error = math.hypot(at(first.volume_errors_cm3, a), at(other.volume_errors_cm3, b))
        diameters = at(first.diameters_cm, a), at(other.diameters_cm, b)
        place = first.centres_cm[a] if a is not None else placed[b]
        flags = [*(first.flags[a] if a is not None else []), *(other.flags[b] if b is not None else [])]
        changes.append(
            BollChange(
                film=other.name,
                state=state,
                boll_first=first.ids[a] if a is not None else None,
                boll_other=other.ids[b] if b is not None else None,
                place_cm=place,
                moved_cm=float(np.linalg.norm(placed[b] - place)) if state == SAME else math.nan,
                volume_first_cm3=volumes[0],
                volume_other_cm3=volumes[1],
                volume_change_cm3=volumes[1] - volumes[0],
                volume_change_error_cm3=error,
                diameter_first_cm=diameters[0],
                diameter_other_cm=diameters[1],
                diameter_change_cm=diameters[1] - diameters[0],
                beyond_error=beyond(volumes[1] - volumes[0], error),
                flags=tuple(dict.fromkeys(flags)),
            )
        )
    return changes


def _trait_changes(first: Filmed, other: Filmed) -> list[TraitChange]:
    """Changes of all traits that both films have."""
    changes = []
    for trait in comparable_traits():
        a, b = first.value(trait.name), other.value(trait.name)
        if not (math.isfinite(a) and math.isfinite(b)):
            continue
        error = math.hypot(first.error(trait.name), other.error(trait.name))
        share = 100 * (b - a) / a if a else math.nan
        changes.append(TraitChange(other.name, trait.name, trait.unit, a, b, b - a, share, error, beyond(b - a, error)))
    return changes


def beyond(change: float, error: float) -> str:
    """Whether a change is larger than its error; blank if one of them is not known."""
    if not (math.isfinite(change) and math.isfinite(error)):
        return ""
    return "yes" if abs(change) > SURE * error else "no"


def comparison_text(comparison: Comparison) -> str:
    """The alignment of the films, the changes of the bolls, and the traits that changed by more than their error."""
    found = comparison.alignment
    chance = "" if math.isnan(found.chance) else f", by chance in {100 * found.chance:.2g} % of cases"
    lines = [
        f"{comparison.other.name}: turned by {found.turn_deg:.1f} degrees, leaning by {found.lean_deg:.1f}; "
        f"{found.support:.1f} of {found.n_items} bolls and branches fit{chance}",
        f"bolls: {comparison.count(SAME)} the same (moved by {comparison.median_moved_cm:.2f} cm, median), "
        f"{comparison.count(GONE)} gone, {comparison.count(NEW)} new",
        f"{'trait':<34}{'first':>10}{'other':>10}{'change':>10}{'error':>9}  larger than its error",
    ]
    lines += [
        f"{row.trait:<34}{row.first:>10.2f}{row.other:>10.2f}{row.change:>+10.2f}{row.error:>9.2f}  {row.beyond_error}"
        for row in comparison.traits
        if row.beyond_error
    ]
    return "\n".join(lines)
