"""corrections.json of a plant: what a person says of its bolls and its table, and lengths that a person measured.

Made by the report's page or `cotton3dg correct`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from ..errors import unknown
from .document import Document

BOLLS_NEEDED: Final = {"merge": 2, "split": 1, "delete": 1, "branch": 1, "add": 0, "corner": 0, "ruler": 0}
"""Kind of correction -> bolls that it is about; of a merge or more."""
OF_BOLLS: Final = ("merge", "split", "delete", "branch", "add")
CORNER: Final = "corner"
RULER: Final = "ruler"
ENDS: Final = ("a", "b")
"""Names of a ruler's ends."""


@dataclass(frozen=True)
class Place:
    """Where a boll or a ruler's end is; a boll's number may change, so it is found again by its centre."""

    boll_id: int = 0
    """Number when it was said; 0 = of none."""
    centre_cm: tuple[float, ...] | None = None
    """(3,) in the plant's frame, by the scale as it was found."""
    centre_su: tuple[float, ...] | None = None
    """(3,) in the scene of `model`, which alone it is good for."""


@dataclass(frozen=True)
class Pick:
    """A place in an undistorted image."""

    image: str
    x_px: float
    y_px: float
    end: str = ""
    """Of a ruler, which end: a or b."""
    sha256: str = ""
    """Of the image's file, as another run may give the name to another image."""


@dataclass(frozen=True)
class Correction:
    """One thing that is to be changed, or that was measured."""

    kind: str
    """merge: two or more bolls are one; split: one is two; delete: one is none; branch: the same, as it is a branch;
    add: there is one at a place, which two picks or more tell; corner: the table's corner next to where the picks meet
    is there; ruler: a length between two places, which changes nothing."""
    bolls: tuple[Place, ...] = ()
    picks: tuple[Pick, ...] = ()
    model: str = ""
    """`Gaussians.sha256()` of the model that it was said of."""

    def problem(self) -> str:
        """Why it makes no sense, in a few words; empty when it does."""
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
    def told(self) -> str:
        """In a few words."""
        return f"{self.kind} {' + '.join(str(place.boll_id) for place in self.bolls if place.boll_id)}".strip()


@dataclass(frozen=True)
class Corrections(Document):
    """All corrections of a plant, in the order in which they apply."""

    REMEDY = "delete it, or save it again from the plant's report"

    corrections: tuple[Correction, ...] = ()

    def of(self, *kinds: str) -> tuple[Correction, ...]:
        """Those of some kinds."""
        return tuple(correction for correction in self.corrections if correction.kind in kinds)
