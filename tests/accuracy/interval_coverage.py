# SPDX-License-Identifier: Apache-2.0
"""Whether what a row states of its own errors is true: 24 simulated plants, each filmed five times, and judged.

    python tests/accuracy/interval_coverage.py FOLDER [--preset draft] [--jobs 2] [--from 0] [--also RUN:TRUTH ...]
        [--judge]

The films of a plant differ in walk, lamps, distance, darkness, blur, exposure and lens. Whatever is up to date is
skipped: the same command goes on where it ended; --judge only judges what is there. Constants of
cotton3dg/traits/error_model.py may be fitted to the plants of even number ("fitted"); those of odd number and --also
are only judged, and so are all plants of another hundred: `--from 1000` films plain-1000 to pale-1001, of which no
constant knows. Writes FOLDER/coverage.csv, a row for each film, and prints, also into coverage.md:

- how often the 95 % intervals hold the truth, and their middle half-width, %
- films that are off, a count by more than one boll or another trait by more than 5 %, and whether a flag says so
- clean films of plain plants with a flag that needs none
- how far the three ordinary films of a plain plant differ: coefficient of variation, %
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markdown_tables import markdown
from numpy.typing import NDArray
from simulated_runs import film_and_run, side_by_side

from cotton3dg.evaluation.match import MATCH_DISTANCE_CM, match_bolls
from cotton3dg.io.saving import write_text_atomically
from cotton3dg.io.tables import flags_of, parse_number, read_rows
from cotton3dg.options import PRESET_VALUES
from cotton3dg.schemas.truth import Truth
from cotton3dg.traits.error_model import COVERED
from cotton3dg.workspace import Workspace

NATURAL = "--architecture natural --barren 0.2"
KINDS = {
    "plain": [
        (800, f"--bolls {bolls} --stem-cm {stem_cm}")
        for bolls, stem_cm in (
            (8, 48), (10, 56), (12, 70), (14, 60), (16, 84), (18, 66), (20, 74), (24, 80), (12, 96), (28, 88)
        )
    ],
    "close": [(820, f"--bolls {bolls} --clustered 0.5") for bolls in (12, 14, 16, 18, 22)],
    "touching": [(840, f"--bolls {bolls} --clustered 0.85 --contact 0.72") for bolls in (12, 16, 20, 24)],
    "natural": [(860, f"--bolls {bolls} {NATURAL}") for bolls in (12, 18, 24)],
    "pale": [(880, f"--bolls 14 {room}") for room in ("--white-room", "--pale-table")],
}  # fmt: skip
"""Kind -> for each plant, from what its seed counts and options of `cotton3dg simulate`."""

FILMS = {
    "clean": "--walk 1",
    "again": "--walk 2 --light 1",
    "farther": "--walk 3 --light 2 --farther 0.25",
    "dim": "--walk 4 --light 3 --dark 2 --noise 5",
    "effects": "--walk 5 --light 4 --blur 0.5 --exposure 0.5 --noise 4 --distortion -0.05",
}
FITTED_BELOW = 100
"""Plants of even number below it are those that constants may be fitted to."""
ORDINARY = ("clean", "again", "farther")

TRAITS = {
    "count": ("boll_count", "boll_count", "boll_count_{}"),
    "volume": ("boll_volume_cm3", "total_boll_convex_volume_cm3", "boll_volume_{}_cm3"),
    "height": ("plant_height_cm", "plant_height_cm", "plant_height_{}_cm"),
    "canopy": ("canopy_size_cm", "canopy_size_cm", "canopy_size_{}_cm"),
}
"""Trait -> column of its value, key of its truth, columns of its interval."""
OFF_PCT, OFF_BOLLS = 5.0, 1
SAYS_NOTHING = frozenset(("no_map", "no_stem", "touching_bolls"))
"""Flags that do not say that a trait may be off: of the map, and of every plant whose bolls touch."""


def plants(first: int) -> dict[str, str]:
    """Name -> options of `cotton3dg simulate`; the name is the kind and a number, which counts from `first` in each."""
    return {
        f"{kind}-{number}": f"--seed {seed + number} {options}"
        for kind, some in KINDS.items()
        for number, (seed, options) in enumerate(some, first)
    }


def judged(run: Workspace, truth_json: Path) -> dict[str, Any]:
    """One film: each trait with its truth and interval, and of how many bolls the volume lies in its interval."""
    truth, row = Truth.load(truth_json), read_rows(run.traits_csv)[0]
    result: dict[str, Any] = {"flags": row["qc_flags"]}
    for trait, (column, key, ends) in TRAITS.items():
        result[trait], result[f"true_{trait}"] = parse_number(row[column]), float(getattr(truth, key))
        for end in ("low", "high"):
            result[f"{trait}_{end}"] = parse_number(row[ends.format(end)])
    share = boll_errors(read_rows(run.bolls_csv), truth)
    result |= {"bolls_matched": len(share), "bolls_held": int((np.abs(share) <= COVERED).sum())}
    return result | {"bolls_rms": float(np.sqrt((share**2).mean())) if len(share) else np.nan}


def boll_errors(bolls: Sequence[dict[str, str]], truth: Truth) -> NDArray[np.float64]:
    """(M,) error of each matched boll's volume, in standard errors as stated."""
    centres = np.array([[parse_number(boll[f"{axis}_cm"]) for axis in "xyz"] for boll in bolls]).reshape(-1, 3)
    true = 100 * (np.array([boll.centre_xyz_m for boll in truth.bolls]).reshape(-1, 3) - truth.stem_base_xyz_m)
    # The table looks the same after half a turn.
    turns = (centres, centres * (-1, -1, 1))
    mine, theirs = max((match_bolls(turned, true, MATCH_DISTANCE_CM) for turned in turns), key=len).T
    volumes = np.array([parse_number(boll["volume_cm3"]) for boll in bolls])[mine]
    stated = np.array([parse_number(boll["volume_error_cm3"]) for boll in bolls])[mine]
    share = (volumes - np.array([boll.convex_volume_cm3 for boll in truth.bolls])[theirs]) / stated
    return share[np.isfinite(share)]


def holds(rows: pd.DataFrame, trait: str) -> pd.Series:
    """Whether the interval holds the truth; rows that state one only."""
    known = rows[rows[f"{trait}_low"].notna()]
    return (known[f"{trait}_low"] <= known[f"true_{trait}"]) & (known[f"true_{trait}"] <= known[f"{trait}_high"])


def cover(rows: pd.DataFrame) -> pd.DataFrame:
    """How often intervals hold the truth, and how wide they are."""
    found = []
    for trait in TRAITS:
        half_pct = 50 * (rows[f"{trait}_high"] - rows[f"{trait}_low"]) / rows[trait]
        error_pct = (100 * (rows[trait] / rows[f"true_{trait}"] - 1)).dropna()
        held = holds(rows, trait)
        found.append(
            {"trait": trait, "films": len(held), "held, %": 100 * held.mean(), "half-width, %": half_pct.median(),
             "mean error, %": error_pct.mean(), "mean absolute, %": error_pct.abs().mean()}
        )  # fmt: skip
    n = rows["bolls_matched"].sum()
    return pd.DataFrame(
        [*found, {"trait": "a boll's volume", "films": n, "held, %": 100 * rows["bolls_held"].sum() / max(n, 1)}]
    )


def off(rows: pd.DataFrame) -> pd.DataFrame:
    """Films with a trait that is off, and by how much."""
    found = []
    for _, row in rows.iterrows():
        wrong = []
        for trait in TRAITS:
            error = row[trait] - row[f"true_{trait}"]
            if trait == "count" and abs(error) > OFF_BOLLS:
                wrong.append(f"count {row[trait]:.0f} for {row['true_count']:.0f}")
            elif trait != "count" and abs(error) > OFF_PCT / 100 * row[f"true_{trait}"]:
                wrong.append(f"{trait} {100 * error / row[f'true_{trait}']:+.1f} %")
        if wrong:
            found.append(
                {"film": row["film"], "off": ", ".join(wrong), "flags": row["flags"] or "none", "said": bool(says(row))}
            )
    return pd.DataFrame(found)


def says(row: pd.Series) -> set[str]:
    """Flags of a film that say that something may be off."""
    return set(flags_of({"qc_flags": row["flags"]})) - SAYS_NOTHING


def repeated(rows: pd.DataFrame) -> pd.DataFrame:
    """Coefficient of variation over the ordinary films of each plain plant, and its mean over plants."""
    plain = rows[(rows["kind"] == "plain") & rows["film"].str.endswith(ORDINARY)]
    by_plant = plain.groupby("plant")[list(TRAITS)]
    cv = 100 * by_plant.std(ddof=1) / by_plant.mean()
    return pd.concat([cv, cv.mean().to_frame("mean").T]).rename_axis("plant").reset_index()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--preset", choices=PRESET_VALUES, default="draft")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--from", type=int, default=0, dest="first", metavar="NUMBER")
    parser.add_argument("--also", nargs="*", default=[], metavar="RUN[:TRUTH]")
    parser.add_argument("--judge", action="store_true")
    wanted = parser.parse_args()
    wanted.folder.mkdir(parents=True, exist_ok=True)
    # A film of every plant before the next, of all kinds in turn: what is there after an hour is a fair sample.
    words_of, kinds = plants(wanted.first), list(FILMS)
    names = sorted(words_of, key=lambda name: int(name.rsplit("-", 1)[1]))
    films = [(plant, kinds[(i + k) % len(kinds)]) for k in range(len(kinds)) for i, plant in enumerate(names)]

    def film_one(of: tuple[str, str]) -> int:
        plant, film = of
        words = f"{words_of[plant]} {FILMS[film]} --frames 66 --mask-interval 40"
        return film_and_run(wanted.folder / f"{plant}_{film}", words, wanted.preset)

    if not wanted.judge:
        side_by_side(wanted.jobs, film_one, films)
    rows, failed = [], []
    for plant, film in films:
        root, (kind, number) = wanted.folder / f"{plant}_{film}", plant.rsplit("-", 1)
        if not (root / "truth.json").is_file():
            continue
        run = Workspace(root)
        if run.traits_csv.is_file():
            half = "fitted" if int(number) < FITTED_BELOW and int(number) % 2 == 0 else "judged"
            rows.append({"film": root.name, "plant": plant, "kind": kind, "half": half} | judged(run, run.truth_json))
        else:
            failed.append(root.name)
    for also in wanted.also:
        folder, _, truth = also.partition(":")
        run, where = Workspace(Path(folder)), Path(truth or folder) / "truth.json"
        rows.append(
            {"film": run.root.name, "plant": run.root.name, "kind": "also", "half": "judged"} | judged(run, where)
        )
    report(wanted.folder, pd.DataFrame(rows), failed)


def report(folder: Path, table: pd.DataFrame, failed: Sequence[str]) -> None:
    """Print the tables and keep them."""
    parts = []
    for half, some in [*table.groupby("half"), *(table[table["half"] == "judged"].groupby("kind"))]:
        parts.append(f"{half}, {len(some)} films\n\n{markdown(cover(some).round(2))}")
    wrong = off(table)
    if len(wrong):
        parts.append(f"{len(wrong)} films are off, {wrong['said'].sum()} with a flag that says so\n\n{markdown(wrong)}")
    plain = table[(table["kind"] == "plain") & table["film"].str.endswith(ORDINARY)]
    good = plain[~plain["film"].isin(wrong["film"] if len(wrong) else [])]
    flagged = good[np.array([bool(says(row)) for _, row in good.iterrows()], bool)]
    title = f"{len(flagged)} of {len(good)} ordinary films of plain plants, right, have a flag"
    parts.append(f"{title}\n\n{markdown(flagged[['film', 'flags']])}")
    if len(plain):
        title = "coefficient of variation, %, of the ordinary films of a plain plant"
        parts.append(f"{title}\n\n{markdown(repeated(table).round(2))}")
    parts.append(f"without a row: {', '.join(failed) or 'none'}")
    text = "\n\n".join(parts)
    write_text_atomically(folder / "coverage.csv", table.to_csv(index=False))
    write_text_atomically(folder / "coverage.md", text + "\n")
    print(text)


if __name__ == "__main__":
    main()
