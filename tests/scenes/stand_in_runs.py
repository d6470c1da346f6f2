# SPDX-License-Identifier: Apache-2.0
"""Plants whose runs are made by a stand-in that does what the plant's `behaviour` file says."""

import csv
import sys
import time
from collections.abc import Callable
from pathlib import Path

from cotton3dg.batch import TABLE
from cotton3dg.io.tables import BOLLS, TRAITS, csv_text, is_number

STAND_IN = """
import os, pathlib, signal, sys, time
signal.signal(signal.SIGINT, signal.SIG_DFL)
plant = pathlib.Path(sys.argv[1])
(plant / "arguments").write_text(" ".join(sys.argv[2:]))
tries = plant / "tries"
tries.write_text(str(int(tries.read_text()) + 1 if tries.exists() else 1))
what, _, rest = (plant / "behaviour").read_text().partition(" ")
if what == "fail":
    print("frames: starts\\n" + plant.name + ": " + rest, file=sys.stderr)
    sys.exit(4)
if what == "die":
    os.kill(os.getpid(), signal.SIGKILL)
if what == "flaky" and tries.read_text() == "1":
    print(plant.name + ": a fault; try again", file=sys.stderr)
    sys.exit(1)
if what == "sleep":
    (plant / "awake").touch()
    time.sleep(float(rest))
(plant / "traits").mkdir(exist_ok=True)
for name in ("traits", "bolls"):
    (plant / "traits" / (name + ".csv")).write_bytes((plant / (name + ".template")).read_bytes())
"""


def stand_in_command(folder: Path) -> list[str]:
    """The stand-in as a command, its script in a folder."""
    script = folder / "stand_in.py"
    script.write_text(STAND_IN)
    return [sys.executable, str(script)]


def make_plant(folder: Path, name: str, behaviour: str = "ok") -> Path:
    """A plant's folder with its behaviour, and the tables that the stand-in makes of it."""
    plant = folder / name
    plant.mkdir(parents=True)
    (plant / "walk.mp4").touch()
    (plant / "behaviour").write_text(behaviour)
    row = {column.name: 1.5 if column.digits is not None else 7 if column.unit else "" for column in TRAITS}
    row |= {"plant_id": "=" + plant.name, "seconds": 90.04}
    boll = {column.name: -2.5 if column.digits is not None else 3 if is_number(column) else "007" for column in BOLLS}
    (plant / "traits.template").write_text(csv_text(TRAITS, [row], excel=True), newline="")
    (plant / "bolls.template").write_text(csv_text(BOLLS, [boll] * 2), newline="")
    return plant


def table(folder: Path, name: str = TABLE) -> list[dict[str, str]]:
    """Rows of a table in a folder, of the batch if none is named."""
    with (folder / name).open(newline="") as file:
        return list(csv.DictReader(file))


def until(condition: Callable[[], bool]) -> None:
    """Wait for something, a minute at most."""
    limit = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < limit
        time.sleep(0.05)
