# SPDX-License-Identifier: Apache-2.0
"""Forty mistakes and more on finished plants: `make mistakes` (after two minutes for the plants, some seconds a row).

    python tests/stress/forty_mistakes.py results/mistakes [--only REGEX]

Makes a finished plant and a finished field in the folder, once, and each mistake of tests/scenes/forty_mistakes.py in a
copy of them. No command may end in a traceback or change a byte of what is finished, and each says the remedy in one
line. The table is printed and saved as mistakes.md; exit code 1 if a row is not as it should be, whose copy stays.
"""

from __future__ import annotations

import argparse
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))

from scenes.forty_mistakes import MISTAKES
from scenes.mistakes import Outcome, attempt
from scenes.tiny_plant import FILM, OPTIONS

from cotton3dg.commands.simulate import simulate
from cotton3dg.options import resolve

SEEDS = {"plant_1": 9, "plant_2": 7}


def make_plants(folder: Path) -> None:
    """A finished field of two plants, one of them alone, and one that is not begun."""
    field = folder / "field"
    for name, seed in SEEDS.items():
        simulate(field / name, resolve("simulate", FILM | {"seed": seed}))
    (field / "cotton3dg.toml").write_text(OPTIONS)
    subprocess.run([sys.executable, "-m", "cotton3dg.cli", "batch", str(field)], check=True)
    shutil.copytree(field / "plant_1", folder / "plant_1")
    with (folder / "plant_1" / "cotton3dg.toml").open("a") as own:
        own.write(OPTIONS)
    (folder / "fresh").mkdir()
    for copy in (folder, folder / "fresh"):
        shutil.copyfile(field / "plant_2" / "video.mp4", copy / "film.mp4")


def row(number: int, outcome: Outcome) -> str:
    """Of the table."""
    mistake, ended = outcome.mistake, outcome.ended
    result = "; ".join(outcome.faults) or ("as it should be" if ended else "skipped, cannot happen here")
    cells = [number, mistake.name, f"`{mistake.command}`", ended and ended.exit_code, ended and ended.last_line, result]
    shown = ["" if cell is None else " ".join(str(cell).split()).replace("|", "\\|") for cell in cells]
    return f"| {' | '.join(shown)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="", help="names of mistakes, a regular expression")
    wanted = parser.parse_args()
    folder: Path = wanted.folder.resolve()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it, and its children
    made = folder / "made"
    if not made.exists():
        shutil.rmtree(folder / "unfinished", ignore_errors=True)
        make_plants(folder / "unfinished")
        (folder / "unfinished").rename(made)
    lines = ["| | mistake or accident | command | exit code | last line | result |", "|---|---|---|---|---|---|"]
    print("\n".join(lines), flush=True)
    outcomes = []
    began = time.monotonic()
    for number, mistake in enumerate(MISTAKES, 1):
        if re.search(wanted.only, mistake.name):
            outcomes.append(attempt(mistake, made, folder / f"{number:02d}"))
            lines.append(row(number, outcomes[-1]))
            print(lines[-1], flush=True)
    wrong = sum(bool(outcome.faults) for outcome in outcomes)
    skipped = sum(outcome.ended is None and not outcome.faults for outcome in outcomes)
    seconds = time.monotonic() - began
    lines += ["", f"{len(outcomes)} mistakes: {wrong} not as they should be, {skipped} skipped; {seconds:.0f} s"]
    print("\n".join(lines[-2:]))
    (folder / "mistakes.md").write_text("\n".join([*lines, ""]), encoding="utf-8")
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
