# SPDX-License-Identifier: Apache-2.0
"""scale/ of a plant: the metric scale of the scene with its evidence, and the grey patches of its card."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

import numpy as np

from ..core.measurements import Scale
from ..errors import BadInput
from .document import Document

NO_SOURCE: Final = "none"
_ARRAYS: Final = {"up": (3,), "plane": (4,), "corners": (4, 3)}
"""Fields of a scale that are arrays, with their shapes."""


@dataclass(frozen=True)
class ScaleInfo(Document):
    """What the stage scale found: a scale and its evidence, or the reason why there is none."""

    REMEDY = "run `cotton3dg scale --force`"

    source: str
    """The references that gave the scale, joined by +; `none` without one."""
    reason: str | None = None
    """The reason for a missing scale."""
    cm_per_su: float | None = None
    relative_error: float | None = None
    up: tuple[float, ...] | None = None
    plane: tuple[float, ...] | None = None
    corners: tuple[tuple[float, ...], ...] | None = None
    evidence: dict[str, Any] | None = None
    """Evidence of the surest reference, from its method."""
    references: tuple[dict[str, Any], ...] | None = None
    """The facts of each reference: source, cm_per_su, relative_error and its evidence."""
    refused: dict[str, str] | None = None
    """Reference -> why it gave no scale."""
    table_cm: tuple[float, ...] | None = None
    """Long and short side of the table, if the scale depends on it."""
    table_assumed: bool = False
    """Whether the table is assumed to have the usual size, because no size was given."""
    found: ScaleInfo | None = None
    """The scale without the corners that a person moved; None if no corner was moved."""

    @property
    def moved_corners(self) -> int:
        """Number of corners that a person moved."""
        return len((self.evidence or {}).get("moved_corners", ())) if self.found else 0

    @property
    def table_words(self) -> str:
        """The size of the table on which the scale depends, in words; empty if it does not depend on a table."""
        if not self.table_cm:
            return ""
        length_cm, width_cm = self.table_cm
        return f"table {'taken as' if self.table_assumed else 'of'} {length_cm:g} x {width_cm:g} cm"

    @classmethod
    def of_scale(cls, scale: Scale, **evidence: Any) -> Self:
        """The document of a scale.

        Args:
            evidence: the fields evidence, references, refused, table_cm and table_assumed.
        """
        return cls(
            source=scale.source,
            cm_per_su=scale.cm_per_su,
            relative_error=scale.relative_error,
            up=tuple(scale.up.tolist()),
            plane=tuple(scale.plane.tolist()),
            corners=tuple(tuple(corner) for corner in scale.corners.tolist()),
            **evidence,
        )

    @property
    def scale(self) -> Scale | None:
        """The scale; None when none was found.

        Raises:
            BadInput: it is zero, negative, not finite or not complete.
        """
        if self.source == NO_SOURCE:
            return None
        try:
            arrays = [np.array(getattr(self, name), np.float64) for name in _ARRAYS]
        except ValueError:  # rows of different length
            arrays = []
        numbers = np.array([self.cm_per_su, self.relative_error], np.float64)
        complete = [array.shape for array in arrays] == list(_ARRAYS.values())
        if not (complete and numbers[0] > 0 and all(np.isfinite(array).all() for array in (numbers, *arrays))):
            raise BadInput(f"scale.json holds no usable scale; {self.REMEDY}")
        return Scale(float(numbers[0]), float(numbers[1]), self.source, *arrays)


def read_scale(path: Path) -> Scale | None:
    """The scale that `scale` saved; None when it found none.

    Raises:
        BadInput: the file is damaged or holds no usable scale.
    """
    return ScaleInfo.load(path).scale


@dataclass(frozen=True)
class PatchesInfo(Document):
    """scale/patches.json: the grey patches of the plant's card in each photo that shows them, from white to black."""

    REMEDY = "run `cotton3dg scale --force`"

    reflectances: tuple[float, ...]
    """0..1."""
    views: dict[str, tuple[tuple[float, ...], ...]]
    """Image -> RGB, 0..255, of each level; null where burnt out."""
