"""Colour of lint, as columns of traits.csv and bolls.csv."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from .columns import column

NO_PATCHES: Final = "fewer than three views show the grey patches of a card (`scale.method` card or all)"


@dataclass(frozen=True)
class LintColour:
    """Colour of lint relative to a matt surface beside the card; NaN = not known."""

    lint_cie_l: float = column("1", "lightness L* of the lint (CIELAB, D65)", 1, blank_when=NO_PATCHES, later=True)
    lint_cie_a: float = column("1", "a* of the lint, red above 0", 1, blank_when=NO_PATCHES, later=True)
    lint_cie_b: float = column("1", "b* of the lint, yellow above 0", 1, blank_when=NO_PATCHES, later=True)
    lint_rd_pct: float = column(
        "%", "Rd of the lint, by the formula of cotton grading (Hunter 1958)", 1, blank_when=NO_PATCHES, later=True
    )
    lint_plus_b: float = column(
        "1", "+b of the lint, yellowness by the formula of cotton grading", 1, blank_when=NO_PATCHES, later=True
    )


@dataclass(frozen=True)
class BollColour(LintColour):
    """Colour of one boll's lint."""

    lint_colour_views: int | None = column(
        "1", "views that these rest on", blank_when=NO_PATCHES, later=True, default=None
    )
