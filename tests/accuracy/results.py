# SPDX-License-Identifier: Apache-2.0
"""Measure what docs/results/accuracy.csv has no row of for the present code, and write docs/results.md and README's
table anew.

    python tests/accuracy/results.py FOLDER [--plants FOLDER] [--sets NAME ...] [--only PLANT ...] [--list]

Plants are measured one at a time, so that seconds are those of a run on all cores. Each row is saved when it is there:
the same command continues after an interruption. A finished run leaves its row and nothing else; films stay in
FOLDER/films and serve later versions, too.

--plants takes a folder of path-traced plants, each with video.mp4 and truth.json; without it their rows stay as saved.
--list says what is missing and how long it takes, and measures nothing. `make results-page` only writes the page.
"""

from __future__ import annotations

import argparse
import hashlib
import math
import platform
import re
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import grimp
import pandas as pd
from interval_coverage import judged
from results_page import KEY, LENGTHS, ROOT, SAVED, SETS, TRAITS, write_pages
from simulated_runs import film_plant, run_plant
from study_set import LOCKS, ODD, PLANTS, TOUCHING

import cotton3dg
from cotton3dg.core.machine import usable_cores
from cotton3dg.evaluation.plant import evaluate
from cotton3dg.io.saving import write_text_atomically
from cotton3dg.stage import STAGES
from cotton3dg.workspace import Workspace

ACCURACY: Final = SAVED / "accuracy.csv"
SIMULATED: Final = {"study": PLANTS, "touching": TOUCHING, "odd": ODD, "locks": LOCKS}
PATH_TRACED: Final = {
    "plain-a": "plain",
    "dark-d": "a dim room",
    "lab-f": "a pale room, processed by the phone",
    "cluster-c": "17 of 20 bolls touch others",
    "wide-e": "full-grown, leaves left",
    "hard-b": "blur, changing exposure, distortion, noise",
    "odd-g": "bolls of 3 to 5 separate locks, white things on the table",
}
"""Name of a path-traced plant -> what is special. Others of a folder are measured under their name."""
PRESETS: Final = {"path-traced": ("draft", "standard")}
"""Presets of a set; the others are measured with `draft` alone."""
RUN_S: Final = {"draft": 120.0, "standard": 240.0}
FILM_CPU_S: Final = {"study": 72.0, "touching": 360.0, "odd": 360.0, "locks": 360.0}
"""First guesses of how long a run and a film take (docs/notes/odd_plants.md); saved rows replace those of runs."""
MEASURE: Final = (
    *(f"cotton3dg.{stage}.stage" for stage in STAGES), "cotton3dg.evaluation.plant", "cotton3dg.simulate.render"
)  # fmt: skip
"""Modules that film, measure and judge a plant: they and all that they import make the version of a row."""
CORE: Final = ("native/CMakeLists.txt", "native/src/*", "native/vision/*")


@dataclass(frozen=True)
class Job:
    """One plant to measure with one preset."""

    set: str
    plant: str
    kind: str
    preset: str
    film: str = ""
    """Options of `cotton3dg simulate`, of a simulated plant."""
    source: Path | None = None
    """Folder with video.mp4 and truth.json, of a path-traced plant."""


def measuring_sources() -> list[Path]:
    """Sources and data files that a row depends on: pages, exports and other commands are not among them."""
    imports = grimp.build_graph("cotton3dg")
    modules = set(MEASURE).union(*(imports.find_upstream_modules(module) for module in MEASURE))
    paths = [ROOT / Path(*module.split(".")) for module in modules]
    files = {file for path in paths for file in (path.with_suffix(".py"), path / "__init__.py")}
    rooms = {file.parent for file in files if file.is_file()} - {ROOT / "cotton3dg"}
    data = {file for room in rooms for file in room.iterdir() if file.suffix not in {".py", ".so"}}
    core = {file for pattern in CORE for file in ROOT.glob(pattern)}
    return sorted(file for file in files | data | core if file.is_file())


def version_of(files: Sequence[Path], root: Path = ROOT) -> str:
    """Version of the package, and the first digits of a hash of the files."""
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes())
    return f"{cotton3dg.__version__}-{digest.hexdigest()[:8]}"


def kind_of(film: str) -> str:
    """What a film's options say of the plant, without its number, size and count."""
    words = re.sub(r"--(seed|width|height|bolls) \S+", "", film).replace("--boll-kind ", "--").replace("_", " ")
    return ", ".join(" ".join(words.split()).removeprefix("--").split(" --")) or "plain"


def all_jobs(plants: Path | None) -> list[Job]:
    """Every plant with every preset of its set; path-traced ones where there is a folder of them."""
    folders = sorted(file.parent for file in plants.glob("*/truth.json")) if plants else []
    jobs = [
        Job("path-traced", folder.name, PATH_TRACED.get(folder.name, folder.name), preset, source=folder)
        for preset in PRESETS["path-traced"]
        for folder in folders
    ]
    for name, films in SIMULATED.items():
        jobs += [
            Job(name, plant, kind_of(film), "draft", f"{film} --mask-interval 40") for plant, film in films.items()
        ]
    return jobs


def missing(jobs: Sequence[Job], rows: pd.DataFrame, version: str) -> list[Job]:
    """The jobs that have no row of this version."""
    of_now = rows[rows["version"] == version]
    done = set(zip(of_now["set"], of_now["plant"], of_now["preset"], strict=True))
    return [job for job in jobs if (job.set, job.plant, job.preset) not in done]


def expected_s(job: Job, rows: pd.DataFrame, filmed: bool) -> float:
    """About how long a job takes: as its like took, or by a first guess."""
    like = rows[(rows["set"] == job.set) & (rows["preset"] == job.preset) & (rows["seconds"] != "")]
    run_s = float(pd.to_numeric(like["seconds"]).mean()) if len(like) else RUN_S[job.preset]
    return run_s + (0.0 if filmed else FILM_CPU_S.get(job.set, 0.0) / len(usable_cores()))


def machine() -> str:
    """The processor's model, as the system names it."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def row_of(job: Job, run: Workspace, truth_json: Path, version: str) -> dict[str, Any]:
    """One line of accuracy.csv: errors and half widths in % of the truth and of the value."""
    _, bolls = evaluate(run, truth_json)
    film = judged(run, truth_json)
    records = {stage: record for stage in STAGES if (record := run.read_record(stage))}
    row: dict[str, Any] = {
        "date": f"{datetime.now():%Y-%m-%d %H:%M}", "version": version, "machine": machine(),
        "cores": len(usable_cores()), "set": job.set, "plant": job.plant, "kind": job.kind, "preset": job.preset,
        "options": "", "bolls": bolls.n_true, "measured": bolls.n_measured, "found": bolls.n_matched,
        "false": bolls.n_measured - bolls.n_matched, "source": "make results",
        "seconds": round(sum(record.seconds for record in records.values())),
        "cpu_seconds": round(sum(record.cpu_seconds for record in records.values())),
        "stages": " ".join(f"{name}={record.seconds:.1f}/{record.cpu_seconds:.1f}" for name, record in records.items()),
    }  # fmt: skip
    if math.isfinite(bolls.mean_volume_error_pct):
        row["one_boll"] = f"{bolls.mean_volume_error_pct:.2f}"
    for trait in TRAITS:
        value, true, low, high = (film[name] for name in (trait, f"true_{trait}", f"{trait}_low", f"{trait}_high"))
        if trait in LENGTHS and math.isfinite(value):
            row[trait] = f"{100 * (value / true - 1):+.2f}"
        if math.isfinite(low) and math.isfinite(high):
            row[f"{trait}_held"] = "yes" if low <= true <= high else "no"
            row[f"{trait}_half"] = f"{50 * (high - low) / value:.2f}"
    return row


def read_rows(file: Path) -> pd.DataFrame:
    return pd.read_csv(file, dtype=str, keep_default_na=False)


def save(row: dict[str, Any], file: Path) -> None:
    """Put a row in the place of the one with its key, among those of its set."""
    rows, new = read_rows(file), pd.DataFrame([{name: str(value) for name, value in row.items()}])
    same = (rows[list(KEY)] == new[list(KEY)].iloc[0]).all(axis=1)
    merged = pd.concat([rows[~same], new], ignore_index=True).fillna("")[list(rows.columns)]
    order = {name: number for number, name in enumerate(SETS)}
    merged = merged.sort_values(
        ["set", "preset", "plant"],
        key=lambda cells: cells.map(order) if cells.name == "set" else cells.map(in_order),
    )
    write_text_atomically(file, merged.to_csv(index=False, lineterminator="\n"))


def in_order(name: str) -> tuple[int, str, int]:
    """Path-traced plants as their table lists them, others by kind and number."""
    kind, _, number = name.rpartition("-")
    known = list(PATH_TRACED).index(name) if name in PATH_TRACED else len(PATH_TRACED)
    return (known, kind, int(number)) if number.isdigit() else (known, name, 0)


def do(job: Job, folder: Path, version: str, file: Path = ACCURACY) -> int:
    """Film and measure one plant, and save its row; the exit code of what failed, or 0."""
    source = job.source or folder / "films" / job.plant
    code = 0 if job.source else film_plant(source, job.film)
    if code:
        return code
    run = folder / version / job.preset / job.plant
    if not (run / "video.mp4").is_file():
        run.mkdir(parents=True, exist_ok=True)
        shutil.copy(source / "video.mp4", run / "video.part")
        (run / "video.part").replace(run / "video.mp4")
    if code := run_plant(run, job.preset):
        return code
    save(row_of(job, Workspace(run), source / "truth.json", version), file)
    shutil.rmtree(run)
    return 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--plants", type=Path, help="folder of path-traced plants")
    parser.add_argument("--sets", nargs="+", choices=list(SETS), default=list(SETS))
    parser.add_argument("--only", nargs="+", metavar="PLANT")
    parser.add_argument("--list", action="store_true")
    wanted = parser.parse_args()
    version, rows = version_of(measuring_sources()), read_rows(ACCURACY)
    jobs = [
        job for job in all_jobs(wanted.plants) if job.set in wanted.sets and job.plant in (wanted.only or [job.plant])
    ]
    todo = missing(jobs, rows, version)
    films = wanted.folder / "films"
    seconds = sum(expected_s(job, rows, (films / job.plant / "video.mp4").is_file()) for job in todo)
    done = f"{len(jobs) - len(todo)} of {len(jobs)} rows are there"
    print(f"{version}: {done}; the others take about {seconds / 60:.0f} min")
    failed = []
    for number, job in enumerate(todo, start=1):
        print(f"{number} of {len(todo)}: {job.plant}, {job.preset}, {job.kind}", flush=True)
        if wanted.list:
            continue
        if code := do(job, wanted.folder, version):
            failed.append(f"{job.plant}: exit {code}; the logs are beside its folders in {wanted.folder}")
    if not wanted.list:
        write_pages()
    sys.exit("\n".join(failed) or None)


if __name__ == "__main__":
    main()
