"""Twelve simulated plants, made, run and compared with their truth.

    python tests/accuracy/study_set.py FOLDER [--preset draft] [--jobs 2] [--only NAME ...]

Whatever is up to date is skipped: the same command continues after an interruption, and measures again after a change.
Prints a table, with the mean absolute errors of all plants and of each kind, and keeps it as FOLDER/study.csv.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pandas as pd

from cotton3dg.evaluate import evaluate
from cotton3dg.options import STAGE_OPTIONS
from cotton3dg.workspace import Workspace

PLANTS: dict[str, str] = {
    "plain-1": "--seed 101 --bolls 8",
    "plain-2": "--seed 102 --bolls 14",
    "plain-3": "--seed 103 --bolls 20",
    "plain-4": "--seed 104 --bolls 30",
    "plain-5": "--seed 105 --bolls 12",
    "clustered-1": "--seed 106 --bolls 12 --clustered 0.5",
    "clustered-2": "--seed 107 --bolls 18 --clustered 0.5",
    "clustered-3": "--seed 108 --bolls 24 --clustered 0.4",
    "effects-1": "--seed 109 --bolls 15 --blur 0.5 --noise 4",
    "effects-2": "--seed 110 --bolls 10 --exposure 0.5 --noise 4",
    "effects-3": "--seed 111 --bolls 16 --distortion -0.08 --noise 4",
    "effects-4": "--seed 112 --bolls 13 --blur 0.4 --exposure 0.4 --distortion 0.06 --noise 6",
}
"""Name -> options of `cotton3dg simulate`. The name without its number is the kind."""


def made_and_run(folder: Path, name: str, preset: str) -> int:
    """Exit code of the first command that failed, or 0; what they print goes to NAME.log."""
    plant = folder / name
    tool = Path(sys.executable).with_name("cotton3dg")
    folder.mkdir(parents=True, exist_ok=True)
    commands = [["run", str(plant), "--preset", preset]]
    if not (plant / "truth.json").is_file():
        commands.insert(0, ["simulate", str(plant), "--mask-interval", "1", *PLANTS[name].split()])
    with (folder / f"{name}.log").open("a", encoding="utf-8") as log:
        for command in commands:
            code = subprocess.run([tool, *command], check=False, stdout=log, stderr=subprocess.STDOUT).returncode
            if code:
                return code
    return 0


def row(folder: Path, name: str) -> dict[str, float | str]:
    """One plant's errors, %, and what became of its bolls."""
    errors, bolls = evaluate(Workspace(folder / name), folder / name / "truth.json")
    f1 = 2 * bolls.n_matched / (bolls.n_true + bolls.n_measured)
    return {
        "plant": name,
        "bolls": bolls.n_true,
        "found": bolls.n_matched,
        "false": bolls.n_measured - bolls.n_matched,
        "f1": f1,
        **{f"{error.trait.removeprefix('plant_').rsplit('_', 1)[0]}_pct": error.error_pct for error in errors},
        "one_boll_volume_pct": bolls.median_volume_error_pct,
        "cpu_s": run_cpu_s(Workspace(folder / name)),
    }


def run_cpu_s(workspace: Workspace) -> float:
    """Processor time of all stages."""
    return sum((workspace.read_record(stage) or {}).get("cpu_seconds", math.nan) for stage in STAGE_OPTIONS)


def means(rows: pd.DataFrame) -> pd.DataFrame:
    """Mean absolute errors of each kind of plant, and of all."""
    kinds = rows["plant"].str.rsplit("-", n=1).str[0]
    sizes = rows.drop(columns="plant").abs()
    return pd.concat([sizes.groupby(kinds).mean(), sizes.mean().to_frame("all").T])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--preset", default="draft")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", nargs="*", choices=PLANTS)
    wanted = parser.parse_args()
    names = wanted.only or list(PLANTS)
    with ThreadPoolExecutor(wanted.jobs) as pool:
        codes = list(pool.map(lambda name: made_and_run(wanted.folder, name, wanted.preset), names))
    failed = {name: code for name, code in zip(names, codes, strict=True) if code}
    rows = pd.DataFrame([row(wanted.folder, name) for name in names if name not in failed])
    if len(rows):
        rows.to_csv(wanted.folder / "study.csv", index=False)
        print(rows.to_string(index=False, float_format="{:.2f}".format))
        print("\nMean absolute values:\n")
        print(means(rows).to_string(float_format="{:.2f}".format))
    for name, code in failed.items():
        print(f"{name}: exit {code}; see {wanted.folder / f'{name}.log'}", file=sys.stderr)
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
