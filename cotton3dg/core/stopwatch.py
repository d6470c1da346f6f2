"""Where the time of a stage goes."""

from __future__ import annotations

import time


class Stopwatch:
    """Seconds since it was made or last asked, by the name of what was done meanwhile."""

    def __init__(self) -> None:
        self.parts_s: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, part: str) -> None:
        """What was done since the last lap was this part; parts of one name add up."""
        now = time.perf_counter()
        self.parts_s[part] = round(self.parts_s.get(part, 0.0) + now - self._last, 3)
        self._last = now
