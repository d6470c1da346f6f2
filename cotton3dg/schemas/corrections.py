# SPDX-License-Identifier: Apache-2.0
"""corrections.json of a plant: a person's corrections of its bolls and its table, and lengths that a person measured.

The report's page or `cotton3dg correct` writes it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from ..errors import unknown
from .document import Document

BOLLS_NEEDED: Final = {"merge": 2, "split": 1, "delete": 1, "branch": 1, "add": 0, "corner": 0, "ruler": 0}
"""Kind of correction -> number of bolls that it needs; a merge may have more."""
OF_BOLLS: Final = ("merge", "split", "delete", "branch", "add")
CORNER: Final = "corner"
RULER: Final = "ruler"
ENDS: Final = ("a", "b")
"""Names of a ruler's ends."""


@dataclass(frozen=True)
class Place:
    """Where a boll or a ruler's end is; a boll's number may change, so it is found again by its centre."""

    boll_id: int = 0
    """Number of the boll at the time of the correction; 0 = no boll."""
    centre_cm: tuple[float, ...] | None = None
    """(3,) in the plant's frame, by the scale as it was found."""
    centre_su: tuple[float, ...] | None = None
    """(3,) in the scene of `model`; it is valid there only."""


@dataclass(frozen=True)
class Pick:
    """A place in an undistorted image."""

    image: str
    x_px: float
    y_px: float
    end: str = ""
    """End of a ruler: a or b."""
    sha256: str = ""
    """SHA-256 of the image's file, because another run may give the name to another image."""


@dataclass(frozen=True)
class Correction:
    """One change, or one measured length."""

    kind: str
    """merge: two or more bolls are one; split: one boll is two; delete: it is not a boll; branch: the same, because it
    is a branch; add: there is a boll at a place, which two or more picks give; corner: the table's nearest corner is
    where the picks meet; ruler: a length between two places, which does not change anything."""
    bolls: tuple[Place, ...] = ()
    picks: tuple[Pick, ...] = ()
    model: str = ""
    """`Gaussians.sha256()` of the corrected model."""

    def problem(self) -> str:
        """The reason why the correction is not valid, in a few words; empty if it is valid."""
        if self.kind not in BOLLS_NEEDED:
            return str(unknown(repr(self.kind), self.kind, BOLLS_NEEDED))
        needed = BOLLS_NEEDED[self.kind]
        places = [place for boll in self.bolls for place in (boll.centre_cm, boll.centre_su) if place is not None]
        places += [(pick.x_px, pick.y_px, 0.0) for pick in self.picks]
        faults = {
            f"{self.kind} needs {needed} boll{'s' if needed > 1 else ''}": len(self.bolls) < needed
            or (needed == 1 and len(self.bolls) > 1),
            "add needs its place in two images": self.kind == "add" and not self.bolls and len(self.picks) < 2,
            "corner needs its place in two images": self.kind == CORNER and len(self.picks) < 2,
            "ruler needs both its ends in two images each": self.kind == RULER
            and len(self.bolls) != 2
            and any(len(self.of_end(end)) < 2 for end in ENDS),
            "a place needs three finite numbers, a pick two": any(
                len(place) != 3 or not all(map(math.isfinite, place)) for place in places
            ),
        }
        return next((fault for fault, found in faults.items() if found), "")

    def of_end(self, end: str) -> tuple[Pick, ...]:
        """The picks of a ruler's end."""
        return tuple(pick for pick in self.picks if pick.end == end)

    @property
    def summary(self) -> str:
        """The correction in a few words."""
        return f"{self.kind} {' + '.join(str(place.boll_id) for place in self.bolls if place.boll_id)}".strip()


@dataclass(frozen=True)
class Corrections(Document):
    """All corrections of a plant, in the order in which they apply."""

    REMEDY = "delete it, or save it again from the plant's report"

    corrections: tuple[Correction, ...] = ()

    def of(self, *kinds: str) -> tuple[Correction, ...]:
        """The corrections of some kinds."""
        return tuple(correction for correction in self.corrections if correction.kind in kinds)
