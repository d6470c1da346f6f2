# SPDX-License-Identifier: Apache-2.0
"""Disk and import time of what `pip install cotton3dg` brings, largest first: `python tools/dependency_sizes.py`.

Each dependency is imported three times in a process of its own; the median of its processor time counts, less that of
an empty process. A distribution's disk is that of the files that it lists, with what it brings besides in `others`.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

from cotton3dg.commands.doctor import MODULE_OF


def main() -> None:
    direct = needed("cotton3dg")
    sizes = {name: megabytes(name) for name in closure(direct)}
    empty = import_s("sys")
    print("| library | MB | import, s |\n|---|---|---|")
    for name in sorted(direct, key=lambda item: -sizes[item]):
        print(f"| {name} | {sizes[name]:.0f} | {import_s(MODULE_OF.get(name, name)) - empty:.2f} |")
    others = sum(size for name, size in sizes.items() if name not in direct)
    print(f"| {len(sizes) - len(direct)} others that these need | {others:.0f} | |")
    print(f"| all | {sum(sizes.values()):.0f} | |")


def needed(name: str) -> set[str]:
    """Distributions that one asks for here, extras aside."""
    asked = map(Requirement, metadata.requires(name) or [])
    return {canonical(item.name) for item in asked if item.marker is None or item.marker.evaluate({"extra": ""})}


def closure(names: set[str]) -> set[str]:
    found, new = set(), set(names)
    while new:
        found |= new
        new = {name for item in new for name in needed(item)} - found
    return found


def canonical(name: str) -> str:
    return name.lower().replace("_", "-")


def megabytes(name: str) -> float:
    files = [Path(str(file.locate())) for file in metadata.files(name) or []]
    return sum(file.stat().st_blocks * 512 for file in files if file.is_file()) / 1e6


def import_s(module: str) -> float:
    seconds = []
    for _ in range(3):
        before = os.times()
        subprocess.run([sys.executable, "-c", f"import {module}"], check=False, stderr=subprocess.DEVNULL)
        after = os.times()
        seconds.append(sum(after[2:4]) - sum(before[2:4]))
    return statistics.median(seconds)


if __name__ == "__main__":
    main()
