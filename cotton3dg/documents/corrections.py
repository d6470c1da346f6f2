"""corrections.json of a plant: what a person says of its bolls. Made by the report's page or `cotton3dg correct`."""

from __future__ import annotations

from dataclasses import dataclass

from .document import Document

KINDS = ("merge", "split", "delete", "branch", "add")


@dataclass(frozen=True)
class Place:
    """Where a boll is; its number may change, so it is found again by its centre."""

    boll_id: int = 0
    """Number when it was said; 0 = of none, where one is to be added."""
    centre_cm: tuple[float, ...] | None = None
    """(3,) in the plant's frame."""
    centre_su: tuple[float, ...] | None = None
    """(3,) in the scene of `model`, which alone it is good for."""


@dataclass(frozen=True)
class Pick:
    """A place in an undistorted image."""

    image: str
    x_px: float
    y_px: float


@dataclass(frozen=True)
class Correction:
    """One thing that is to be changed."""

    kind: str
    """merge: two or more bolls are one; split: one is two; delete: one is none; branch: the same, as it is a branch;
    add: there is one at a place, which two picks or more tell."""
    bolls: tuple[Place, ...] = ()
    picks: tuple[Pick, ...] = ()
    model: str = ""
    """`Gaussians.sha256()` of the model that it was said of."""

    def problem(self) -> str:
        """Why it makes no sense, in a few words; empty when it does."""
        if self.kind not in KINDS:
            return f"{self.kind!r} is unknown; use {', '.join(KINDS)}"
        needed = {"merge": 2, "add": 0}.get(self.kind, 1)
        if len(self.bolls) < needed or (self.kind not in ("merge", "add") and len(self.bolls) != 1):
            return f"{self.kind} needs {needed} boll{'s' if needed > 1 else ''}"
        if self.kind == "add" and not (self.bolls or len(self.picks) > 1):
            return "add needs its place in two images"
        return ""

    @property
    def told(self) -> str:
        """In a few words."""
        return f"{self.kind} {' + '.join(str(place.boll_id) for place in self.bolls if place.boll_id)}".strip()


@dataclass(frozen=True)
class Corrections(Document):
    """All corrections of a plant, in the order in which they apply."""

    REMEDY = "delete it, or save it again from the plant's report"

    corrections: tuple[Correction, ...] = ()
