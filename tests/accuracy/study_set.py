# SPDX-License-Identifier: Apache-2.0
"""Simulated plants, made, run and compared with their truth: the twelve of the study set, twelve of touching bolls,
twelve of other kinds of bolls in bad light, and twelve whose bolls have separate locks.

    python tests/accuracy/study_set.py FOLDER [--preset draft] [--jobs 2] [--touching] [--odd]
        [--locks] [--natural [--from 13]] [--only NAME ...] [--also ...]

The jobs share the cores that this process may use. Whatever is up to date is skipped: the same command continues after
an interruption, and measures again after a change. A plant whose options below change needs another name.

Prints a row a plant, and for each kind of plant and all of them the mean absolute errors beside what they should be;
keeps both as FOLDER/study_PRESET.csv and .md. --touching takes the other twelve, most of whose bolls stand in groups
of two to four; --odd those with bolls of other kinds, white things about them, light from one side or too little of
it; --locks those whose bolls have 3 to 5 separate locks; --natural takes twelve for the plant map, --from N those with
the numbers N and on. Plants that were run before (--also RUN:TRUTH, with the folder of `truth.json` and `cameras.json`
after a colon if it is another) are a kind of their own and not among all.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from markdown_tables import markdown
from simulated_runs import film_and_run, side_by_side
from true_scene import TruePlant, true_plant, true_scale

from cotton3dg.evaluation.plant import evaluate
from cotton3dg.evaluation.plant_map import MapScores, evaluate_map
from cotton3dg.io.saving import write_text_atomically
from cotton3dg.options import PRESET_VALUES
from cotton3dg.schemas.scale import read_scale
from cotton3dg.stage import STAGES

PLANTS: dict[str, str] = {
    "plain-1": "--seed 101 --bolls 8 --stem-cm 44",
    "plain-2": "--seed 102 --bolls 14",
    "plain-3": "--seed 103 --bolls 20 --stem-cm 60",
    "plain-4": "--seed 104 --bolls 30",
    "plain-5": "--seed 105 --bolls 12 --stem-cm 98",
    "clustered-1": "--seed 106 --bolls 12 --clustered 0.5",
    "clustered-2": "--seed 107 --bolls 18 --clustered 0.5",
    "clustered-3": "--seed 108 --bolls 24 --clustered 0.4",
    "effects-1": "--seed 109 --bolls 15 --blur 0.5 --noise 4",
    "effects-2": "--seed 110 --bolls 10 --exposure 0.5 --noise 4 --stem-cm 48",
    "effects-3": "--seed 111 --bolls 16 --distortion -0.08 --noise 4 --stem-cm 90",
    "effects-4": "--seed 112 --bolls 13 --blur 0.4 --exposure 0.4 --distortion 0.06 --noise 6",
}
"""Name -> options of `cotton3dg simulate`. The name without its number is the kind."""

LARGE = "--width 1280 --height 720"
TOUCHING = {
    f"touching-{number}": f"--seed {600 + number} --bolls {bolls} --clustered 0.85 --contact 0.72 {LARGE}"
    for number, bolls in enumerate((12, 14, 16, 18, 20, 20, 20, 22, 22, 24, 26, 28), start=1)
}
"""As hard as bolls grow: 85 % touch others, and lie in each other down to 0.72 diameters from middle to middle. Filmed
at twice the size of the others, where a boll is some 25 px wide, as in a phone's video."""

ODD = {
    "odd-1": f"--seed 821 --bolls 14 --boll-kind usual --things 6 {LARGE}",
    "odd-2": f"--seed 822 --bolls 12 --boll-kind fluffy --one-sided {LARGE}",
    "odd-3": f"--seed 823 --bolls 16 --boll-kind drooping --one-sided --things 8 {LARGE}",
    "odd-4": f"--seed 824 --bolls 12 --boll-kind hanging {LARGE}",
    "odd-5": f"--seed 825 --bolls 15 --boll-kind torn --one-sided --things 6 --noise 4 {LARGE}",
    "odd-6": f"--seed 826 --bolls 18 --boll-kind half_open --things 10 {LARGE}",
    "odd-7": f"--seed 827 --bolls 14 --boll-kind tight --one-sided --dark 1 {LARGE}",
    "odd-8": f"--seed 828 --bolls 16 --boll-kind fluffy --clustered 0.6 --contact 0.8 --things 6 {LARGE}",
    "odd-9": f"--seed 829 --bolls 14 --boll-kind usual --white-room --pale-table --things 6 {LARGE}",
    "odd-10": f"--seed 830 --bolls 14 --boll-kind drooping --clustered 0.5 --contact 0.85 --one-sided {LARGE}",
    "odd-11": f"--seed 831 --bolls 13 --boll-kind torn --dark 1.5 --noise 4 --things 8 {LARGE}",
    "odd-12": f"--seed 832 --bolls 12 --boll-kind hanging --one-sided --things 8 --noise 3 {LARGE}",
}
"""Bolls of the kinds that the network learns from, one kind to a plant, filmed as a user films: table, walls, white
things about, light from one window, too short exposures."""


SEPARATE = "--boll-kind separate"
HALF_TOUCH = "--clustered 0.6 --contact 0.8"
LOCKS = {
    "locks-1": f"--seed 7401 --bolls 14 {SEPARATE} {LARGE}",
    "locks-2": f"--seed 7402 --bolls 18 {SEPARATE} {HALF_TOUCH} {LARGE}",
    "locks-3": f"--seed 7403 --bolls 12 {SEPARATE} --one-sided --things 8 {LARGE}",
    "locks-4": f"--seed 7404 --bolls 16 {SEPARATE} {HALF_TOUCH} --one-sided {LARGE}",
    "locks-5": f"--seed 7405 --bolls 15 {SEPARATE} --hanging 0 --one-sided {LARGE}",
    "locks-6": f"--seed 7406 --bolls 20 {SEPARATE} {HALF_TOUCH} --things 6 {LARGE}",
    "locks-7": f"--seed 7407 --bolls 13 {SEPARATE} --pale-table --things 8 {LARGE}",
    "locks-8": f"--seed 7408 --bolls 18 {SEPARATE} {HALF_TOUCH} --one-sided --things 8 {LARGE}",
    "locks-9": f"--seed 7409 --bolls 14 {SEPARATE} --blur 0.4 --noise 4 {LARGE}",
    "hung-1": f"--seed 7410 --bolls 16 {SEPARATE} --hanging 0.8 {HALF_TOUCH} --one-sided --things 8 {LARGE}",
    "hung-2": f"--seed 7411 --bolls 14 {SEPARATE} --hanging 0.8 --one-sided --noise 3 {LARGE}",
    "hung-3": f"--seed 7412 --bolls 18 {SEPARATE} --hanging 0.8 {HALF_TOUCH} --things 6 {LARGE}",
}
"""Bolls of 3 to 5 separate locks; on half of the plants, most touch others, on half, light comes from one window. Those
of the kind `hung`, whose bolls mostly let locks hang, judge only: nothing is ever fitted to them."""


def natural(first: int) -> dict[str, str]:
    """Twelve plants with a branch at every node, some barren, vegetative, broken or touching another: for the map."""
    return {
        f"natural-{number}": f"--seed {600 + number} --architecture natural --vegetative {number % 3} --barren 0.25"
        f" --broken 0.15 --crossing {2 * (number % 2)} --lean {4 * (number % 4)} {LARGE}"
        for number in range(first, first + 12)
    }


AIMS_PCT = {"count": 4.6, "canopy": 1.8, "height": 1.2, "volume": 4.0, "one_boll": 8.0, "scale": 0.5}
"""Half of what Cotton3DGaussians errs by, and what that asks of single bolls and of the scale."""
NAMES = {
    "boll_count": "count",
    "boll_volume_cm3": "volume",
    "plant_height_cm": "height",
    "canopy_size_cm": "canopy",
}


def judged(plant: TruePlant) -> dict[str, float | str | tuple[float, ...]]:
    """One plant's errors, %, with their sign, and what became of its bolls."""
    errors, bolls = evaluate(plant.run, plant.truth / "truth.json")
    scale = read_scale(plant.run.scale_json)
    return {
        "plant": plant.run.plant_id,
        "bolls": bolls.n_true,
        "found": bolls.n_matched,
        "false": bolls.n_measured - bolls.n_matched,
        "f1": 2 * bolls.n_matched / (bolls.n_true + bolls.n_measured),
        **{NAMES[error.trait]: error.error_pct for error in errors if error.trait in NAMES},
        "one_boll": bolls.median_volume_error_pct,
        "scale": 100 * (scale.cm_per_su / true_scale(plant).cm_per_su - 1) if scale else math.nan,
        "cpu_s": sum(record.cpu_seconds for record in map(plant.run.read_record, STAGES) if record),
        **map_columns(evaluate_map(plant.run, plant.truth / "truth.json")),
        "each_boll": bolls.volume_errors_pct,
    }


def map_columns(scores: MapScores | None) -> dict[str, float]:
    """How the plant map agrees with the true skeleton; nothing where there is none."""
    if scores is None:
        return {}
    return {
        "branch_f1": scores.f1,
        "angle_deg": scores.angle_error_deg,
        "length_pct": scores.length_error_pct,
        "on_branch_pct": 100 * scores.bolls_on_branch / max(scores.bolls, 1),
        "doubtful": scores.doubtful,
        "doubtful_on_branch": scores.doubtful_on_branch,
        "position_pct": 100 * scores.positions_right / scores.positions if scores.positions else math.nan,
        "first_cm": scores.first_height_error_cm,
        "internode_pct": scores.internode_error_pct,
        "diameter_mm": scores.stem_diameter_error_mm,
    }


def means(rows: pd.DataFrame) -> dict[str, float]:
    """Mean absolute errors of some plants; of the volume of one boll the median over all bolls that were found."""
    whole = rows[list(AIMS_PCT)].notna().all(axis=1)
    each = np.abs([error for errors in rows["each_boll"] for error in errors])
    sizes = rows[["count", "canopy", "height", "volume"]].abs().mean()
    last = {"one_boll": float(np.median(each)) if len(each) else math.nan, "scale": rows["scale"].abs().mean()}
    hits = rows["found"].sum()
    f1 = 2 * hits / (rows["bolls"].sum() + hits + rows["false"].sum())
    counts = {"plants": len(rows), "complete": int(whole.sum())}
    return {**counts, **sizes, **last, "f1": f1, "cpu_s": rows["cpu_s"].mean()}


def by_kind(rows: pd.DataFrame) -> pd.DataFrame:
    """A row of means for each kind, for all that were simulated here, and what they should be."""
    kinds = [{"kind": kind, **means(of_kind)} for kind, of_kind in rows.groupby("kind", sort=False)]
    ours = rows[rows["kind"] != "also"]
    if len(ours):
        kinds.append({"kind": "all", **means(ours)})
    return pd.DataFrame([*kinds, {"kind": "aim, at most", **AIMS_PCT}])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--preset", choices=PRESET_VALUES, default="draft")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--touching", action="store_true")
    parser.add_argument("--odd", action="store_true")
    parser.add_argument("--locks", action="store_true")
    parser.add_argument("--natural", action="store_true")
    parser.add_argument("--from", dest="first", type=int, default=1, help="number of the first natural plant")
    parser.add_argument("--only", nargs="*")
    parser.add_argument("--also", nargs="*", type=true_plant, default=[], metavar="RUN:TRUTH")
    wanted = parser.parse_args()
    sets = {"touching": TOUCHING, "odd": ODD, "locks": LOCKS, "natural": natural(wanted.first)}
    chosen = next((films for name, films in sets.items() if getattr(wanted, name)), PLANTS)
    films = PLANTS | TOUCHING | ODD | LOCKS | sets["natural"]
    names = wanted.only or list(chosen)
    if unknown := [name for name in names if name not in films]:
        parser.error(f"no such plant: {', '.join(unknown)}; there are {', '.join(films)}")

    def film_one(name: str) -> int:
        return film_and_run(wanted.folder / name, f"{films[name]} --mask-interval 1", wanted.preset)

    codes = side_by_side(wanted.jobs, film_one, names)
    failed = {name: code for name, code in zip(names, codes, strict=True) if code}
    done = [name for name in names if name not in failed]
    rows = [{"kind": name.rsplit("-", 1)[0], **judged(true_plant(str(wanted.folder / name)))} for name in done]
    rows += [{"kind": "also", **judged(plant)} for plant in wanted.also]
    if rows:
        plants = pd.DataFrame(rows)
        table = plants.drop(columns=["kind", "each_boll"])
        text = f"Errors, %, and processor seconds:\n\n{markdown(table)}\nMean absolute errors, %, over plants; median "
        text += f"over all bolls found of the volume of one boll:\n\n{markdown(by_kind(plants))}"
        plants["each_boll"] = [json.dumps([round(error, 3) for error in errors]) for errors in plants["each_boll"]]
        write_text_atomically(wanted.folder / f"study_{wanted.preset}.csv", plants.to_csv(index=False))
        write_text_atomically(wanted.folder / f"study_{wanted.preset}.md", text)
        print(text)
    for name, code in failed.items():
        print(f"{name}: exit {code}; see {wanted.folder / f'{name}.log'}", file=sys.stderr)
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
