# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/results.md and README's table of accuracy, from docs/results/*.csv: `make results-page`.

A table stands below the comment `<!-- results: NAME -->`: a computed one of `COMPUTED`, or the file NAME.csv as it is.
Everything else on the page is written by hand. A column `volume [%]` of a file is shown as `volume`, with the unit in
its cells.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pandas as pd
from markdown_tables import markdown

ROOT: Final = Path(__file__).parents[2]
SAVED: Final = ROOT / "docs" / "results"
PAGE: Final = ROOT / "docs" / "results.md"
README: Final = ROOT / "README.md"
MARKED: Final = re.compile(r"<!-- results: (?P<name>\w+) -->\n(?:\n(?:\|.*\n)+)?")
IN_README: Final = re.compile(r"(?<=<!-- accuracy:begin -->\n).*?(?=<!-- accuracy:end -->)", re.DOTALL)

KEY: Final = ("set", "plant", "preset", "options")
"""What tells the rows of accuracy.csv apart."""
LENGTHS: Final = ("volume", "height", "canopy")
TRAITS: Final = ("count", *LENGTHS)
SETS: Final = {
    "path-traced": "path-traced, full size",
    "study": "simulated",
    "touching": "simulated: most bolls touch",
    "odd": "simulated: hanging, torn and other bolls, bad light, white things on the table",
    "locks": "simulated: bolls of 3 to 5 separate locks",
}
"""Name of a set -> its description."""
README_PLANTS: Final = ("plain-a", "cluster-c", "odd-g")
README_SETS: Final = {
    "touching": "plants of the program's own simulator, most of whose bolls touch",
    "study": "others of the simulator",
}
EARLIER: Final = "earlier: "
STAGES_SHOWN: Final = ("frames", "sfm", "train", "masks", "traits")
"""Stages with a column of their own in the table of speed."""
Tables = dict[str, pd.DataFrame]


def load(folder: Path = SAVED) -> Tables:
    """Name of a file -> its cells, as text, blank where there is nothing."""
    return {file.stem: pd.read_csv(file, dtype=str, keep_default_na=False) for file in sorted(folder.glob("*.csv"))}


def signed(error: str) -> str:
    """An error in %, with its sign unless it is 0."""
    text = f"{float(error):+.1f} %" if error else ""
    return "0.0 %" if text in ("+0.0 %", "-0.0 %") else text


def version(row: pd.Series, newest: str) -> str:
    """Date and version of a row, and whether another version of the program is newer."""
    stated = ", ".join(part for part in (row.get("date", "")[:10], row.get("version", "")) if part)
    return EARLIER + stated if stated and row.get("version") != newest else stated


def newest_version(tables: Tables) -> str:
    """The version of the newest row of accuracy.csv."""
    plants = tables["accuracy"]
    return str(plants.loc[plants["date"] == plants["date"].max(), "version"].iloc[-1])


def found(row: pd.Series) -> str:
    return f"{row['found']} of {row['bolls']} ({row['false']})"


def set_rows(tables: Tables) -> pd.DataFrame:
    """A row of means for each set and preset: of its plants, or of sets.csv where that knows more of them."""
    plants, newest = tables["accuracy"], newest_version(tables)
    saved = {(row["set"], row["preset"]): row for _, row in tables["sets"].iterrows()}
    rows = []
    for (name, preset), some in plants.groupby(["set", "preset"], sort=False):
        kept = saved.get((name, preset))
        if kept is not None and (len(some) < int(kept["plants"]) or set(some["version"]) == {kept["version"]}):
            continue
        saved.pop((name, preset), None)
        of = some[["bolls", "measured", "found", "false"]].astype(int)
        means = {"count": 100 * (of["measured"] / of["bolls"] - 1).abs().mean()}
        means |= {trait: pd.to_numeric(some[trait]).abs().mean() for trait in LENGTHS}
        versions = some.apply(version, axis=1, newest=newest)
        texts = {trait: "" if pd.isna(mean) else f"{mean:.1f}" for trait, mean in means.items()}
        shown = {"version shown": max(versions, key=lambda text: text.startswith(EARLIER))}
        rows.append({"set": name, "preset": preset, "plants": len(some), **of.sum(), **texts, **shown})
    rows += [{**row, "version shown": version(row, newest)} for row in saved.values()]
    order = [*SETS]
    return pd.DataFrame(sorted(rows, key=lambda row: (order.index(row["set"]), row["preset"])))


def sets(tables: Tables) -> str:
    """Mean absolute errors, a row a set and preset."""
    shown = [
        {
            "plants": f"{row['plants']} {SETS[row['set']]}",
            "preset": f"`{row['preset']}`",
            "bolls found (false)": found(row),
        }
        | {trait: f"{row[trait]} %" if row[trait] else "" for trait in TRAITS}
        | {"version": row["version shown"]}
        for _, row in set_rows(tables).iterrows()
    ]
    return markdown(pd.DataFrame(shown))


def plants(tables: Tables) -> str:
    """Errors with their sign, a row a plant and preset."""
    newest = newest_version(tables)
    shown = [
        {
            "set": row["set"],
            "plant": row["plant"],
            "what": row["kind"],
            "preset": f"`{row['preset']}` {row['options']}".strip(),
        }
        | {"bolls found (false)": found(row), **{trait: signed(row[trait]) for trait in LENGTHS}}
        | {"one boll": f"{float(row['one_boll']):.1f} %" if row["one_boll"] else ""}
        | {"time": f"{row['seconds']} s" if row["seconds"] else "", "processor": of_cores(row)}
        | {"version": version(row, newest)}
        for _, row in tables["accuracy"].iterrows()
    ]
    return markdown(pd.DataFrame(shown))


def of_cores(row: pd.Series) -> str:
    spent = [f"{row['cpu_seconds']} s"] if row["cpu_seconds"] else []
    return ", ".join([*spent, *([f"{row['cores']} cores of {row['machine']}"] if row["machine"] else [])])


def intervals(tables: Tables) -> str:
    """How many 95 % intervals hold the truth, and the median of their half widths, by set and preset."""
    rows = []
    for (name, preset), some in tables["accuracy"].groupby(["set", "preset"], sort=False):
        row = {"plants": f"{len(some)} {SETS[name]}", "preset": f"`{preset}`"}
        for trait in TRAITS:
            stated = some[some[f"{trait}_held"] != ""]
            half = pd.to_numeric(stated[f"{trait}_half"]).median()
            width = "" if pd.isna(half) else f" (± {half:.1f} %)"
            row[trait] = f"{(stated[f'{trait}_held'] == 'yes').sum()} of {len(stated)}{width}" if len(stated) else ""
        if any(row[trait] for trait in TRAITS):
            rows.append(row | {"version": max(some.apply(version, axis=1, newest=newest_version(tables)))})
    return markdown(pd.DataFrame(rows))


def as_saved(table: pd.DataFrame, newest: str) -> str:
    """A file's table: units in the cells, and the version last."""

    def with_unit(cell: str, unit: str) -> str:
        sign, _, unit = unit.rpartition(" ")
        return " ".join(part for part in (sign, cell, unit) if part) if cell else ""

    shown = pd.DataFrame(index=table.index)
    for name in table.columns.drop(["date", "version", "source"], errors="ignore"):
        title, _, unit = name.removesuffix("]").partition(" [")
        shown[title] = [with_unit(cell, unit) for cell in table[name]]
    if "version" in table:
        shown["version"] = table.apply(version, axis=1, newest=newest)
    return markdown(shown)


def speed(tables: Tables) -> str:
    """Seconds by stage, with processor seconds in brackets where they are known; measured rows before saved ones."""
    rows = []
    for _, row in tables["accuracy"].query("set == 'path-traced' and stages != ''").iterrows():
        spent = {name: [*map(float, of.split("/"))] for name, of in (part.split("=") for part in row["stages"].split())}
        rest = [of for name, of in spent.items() if name not in STAGES_SHOWN]
        spent["the rest"] = [sum(of) for of in zip(*rest, strict=True)]
        spent["all"] = [float(row["seconds"]), float(row["cpu_seconds"])]
        cells = {
            f"{name} [s]": f"{spent[name][0]:.0f} ({spent[name][1]:.0f})" for name in (*STAGES_SHOWN, "the rest", "all")
        }
        who = {"plant": row["kind"], "preset": row["preset"], "machine": f"{row['cores']} cores of {row['machine']}"}
        rows.append({**who, **cells, "date": row["date"], "version": row["version"]})
    return as_saved(
        pd.concat([pd.DataFrame(rows), tables["speed"]]).reset_index(drop=True).fillna(""), newest_version(tables)
    )


def readme(tables: Tables) -> str:
    """Some path-traced plants with `draft`, one by one, and the means of other sets."""
    plants = tables["accuracy"].query("set == 'path-traced' and preset == 'draft' and options == ''").set_index("plant")
    rows = [
        {"plants": f"path-traced, {row['kind']}", "bolls found (false)": found(row)}
        | {trait: signed(row[trait]) for trait in LENGTHS}
        for row in (plants.loc[name] for name in README_PLANTS)
    ]
    means = set_rows(tables).query("preset == 'draft'").set_index("set")
    for name, what in README_SETS.items():
        row = means.loc[name]
        when = ", by an earlier version" if row["version shown"].startswith(EARLIER) else ""
        label = {"plants": f"{row['plants']} {what}{when}", "bolls found (false)": found(row)}
        rows.append(label | {trait: f"{row[trait]} %" for trait in LENGTHS})
    return markdown(pd.DataFrame(rows))


COMPUTED: Final[dict[str, Callable[[Tables], str]]] = {
    "sets": sets,
    "plants": plants,
    "intervals_of_sets": intervals,
    "speed": speed,
}


def rendered(page: str, tables: Tables) -> str:
    """The page with its tables as they are saved.

    Raises:
        KeyError: a comment names no table.
    """

    def table(match: re.Match[str]) -> str:
        name = match["name"]
        made = COMPUTED[name](tables) if name in COMPUTED else as_saved(tables[name], newest_version(tables))
        return f"<!-- results: {name} -->\n\n{made}"

    return MARKED.sub(table, page)


def rendered_readme(text: str, tables: Tables) -> str:
    return IN_README.sub(lambda _: f"\n{readme(tables)}\n", text)


def write_pages() -> None:
    tables = load()
    for page, made in ((PAGE, rendered), (README, rendered_readme)):
        page.write_text(made(page.read_text(encoding="utf-8"), tables), encoding="utf-8")


if __name__ == "__main__":
    write_pages()
