"""Where the time of a stage goes."""

from __future__ import annotations

import time


class Stopwatch:
    """Seconds since its creation or its last lap, by the name of the part."""

    def __init__(self) -> None:
        self.parts_s: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, part: str) -> None:
        """Add the time since the last lap to this part; parts of one name add up."""
        now = time.perf_counter()
        self.parts_s[part] = round(self.parts_s.get(part, 0.0) + now - self._last, 3)
        self._last = now
