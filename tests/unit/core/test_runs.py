# SPDX-License-Identifier: Apache-2.0
"""Where the time of a stage goes."""

import time

from cotton3dg.core.runs import Stopwatch


def test_parts_of_one_name_add_up() -> None:
    watch, began = Stopwatch(), time.perf_counter()
    for part in ("matching", "mapping", "matching"):
        time.sleep(0.02)
        watch.lap(part)
    assert list(watch.parts_s) == ["matching", "mapping"]
    assert watch.parts_s["matching"] >= 0.039 and watch.parts_s["mapping"] >= 0.019
    assert sum(watch.parts_s.values()) <= time.perf_counter() - began + 0.003
