"""scale/patches.json: the grey patches of the plant's card in each photo that shows them."""

from __future__ import annotations

from dataclasses import dataclass

from .document import Document


@dataclass(frozen=True)
class PatchesInfo(Document):
    """The levels of the patches, from white to black."""

    REMEDY = "run `cotton3dg scale --force`"

    reflectances: tuple[float, ...]
    """0..1."""
    views: dict[str, tuple[tuple[float, ...], ...]]
    """Image -> RGB, 0..255, of each level; null where burnt out."""
