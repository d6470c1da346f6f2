# SPDX-License-Identifier: Apache-2.0
"""The cost of accuracy in time: the settings worth choosing, and durations in words."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from statistics import median
from typing import Final

from ..errors import BadUsage

_UNITS_S: Final = {"s": 1.0, "m": 60.0, "h": 3600.0}


def pareto_front(seconds: Sequence[float], losses: Sequence[float]) -> list[int]:
    """Indices of the settings that no other setting beats, the fastest first.

    A setting beats another if it is at most as slow and at most as bad, and better in one of the two; of equal settings
    the first stays. Settings with a value that is not finite are never on the front.
    """
    order = sorted(range(len(seconds)), key=lambda i: (seconds[i], losses[i], i))
    front: list[int] = []
    for i in order:
        if not (math.isfinite(seconds[i]) and math.isfinite(losses[i])):
            continue
        if not front or losses[i] < losses[front[-1]]:
            front.append(i)
    return front


def typical_ratio(pairs: Iterable[tuple[float, float]]) -> float:
    """Median of measured over predicted seconds; 1 without measurements."""
    ratios = [measured / predicted for measured, predicted in pairs if measured > 0 and predicted > 0]
    return median(ratios) if ratios else 1.0


def parse_duration(text: str) -> float:
    """Seconds of a duration such as 90s, 5m, 1h30m.

    Raises:
        BadUsage: the text is not a duration, lacks a unit, or is not above 0.
    """
    parts = re.findall(r"(\d+(?:\.\d+)?)([smh])", text)
    whole = "".join(number + unit for number, unit in parts)
    total = sum(float(number) * _UNITS_S[unit] for number, unit in parts)
    if re.fullmatch(r"\d+(\.\d+)?", text):
        raise BadUsage(f"time budget {text!r} has no unit; write {text}s for seconds, {text}m for minutes")
    if whole != text or total <= 0:
        raise BadUsage(f"time budget {text!r} cannot be used; write it as 90s, 5m or 1h30m")
    return total


def format_duration(seconds: float) -> str:
    """Seconds in words."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.1f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
