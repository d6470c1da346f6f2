# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/csv.md and docs/compare.md, from where columns and flags are defined: `make doc-tables`.

A table stands below the comment `<!-- table: NAME -->` with a name of `TABLES`; everything else on a page is written by
hand.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from cotton3dg.core.columns import Column, columns_of
from cotton3dg.core.map_measurements import MapTraits
from cotton3dg.core.measurements import LintColour, PlantEvidence, PlantTraits
from cotton3dg.evaluation.change_detection import BollChange, TraitChange
from cotton3dg.evaluation.repeatability import Bias, BollRepeat, TraitRepeat
from cotton3dg.io.tables import BOLLS, BRANCHES, TRAITS
from cotton3dg.report.advice import BOLL_FLAGS, FLAGS

DOCS = Path(__file__).parents[1] / "docs"
PAGES = (DOCS / "csv.md", DOCS / "compare.md")
MARKED = re.compile(r"<!-- table: (?P<name>.+) -->\n(?:\n(?:\|.*\n)+)?")


def markdown(*rows: Sequence[str]) -> str:
    """A table, the first row its header."""
    lines = ["| " + " | ".join(cell.replace("|", r"\|") for cell in row) + " |" for row in rows]
    return "\n".join([lines[0], "|" + len(rows[0]) * "---|", *lines[1:], ""])


def column_table(columns: Iterable[Column]) -> str:
    """A row for each column."""
    terms = ((column, f" ({column.ontology})" if column.ontology else "") for column in columns)
    rows = [(f"`{c.name}`", c.unit, f"{c.description}{term}", c.blank_when) for c, term in terms]
    return markdown(("column", "unit", "what it is", "blank when"), *rows)


LEADING = TRAITS[: [column.name for column in TRAITS].index("qc_flags") + 1]


def further_table(kind: type) -> str:
    """The columns of traits.csv behind the leading ones that a class has."""
    return column_table(column for column in columns_of(kind) if column not in LEADING)


TABLES = {
    "traits.csv, first columns": column_table(LEADING),
    "traits.csv, plant and bolls": further_table(PlantTraits),
    "traits.csv, branches": further_table(MapTraits),
    "traits.csv, colour": further_table(LintColour),
    "traits.csv, evidence": further_table(PlantEvidence),
    "bolls.csv": column_table(BOLLS),
    "branches.csv": column_table(BRANCHES),
    "flags": markdown(
        ("flag", "what it means", "what to do"),
        *((f"`{name}`", f"{flag.title}. {flag.meaning}", flag.action) for name, flag in FLAGS.items()),
    ),
    "flags of a boll": markdown(
        ("flag of a boll", "what it means"), *((f"`{name}`", meaning) for name, meaning in BOLL_FLAGS.items())
    ),
    "boll_changes.csv": column_table(columns_of(BollChange)),
    "trait_changes.csv": column_table(columns_of(TraitChange)),
    "repeat_traits.csv": column_table(columns_of(TraitRepeat)),
    "repeat_bolls.csv": column_table(columns_of(BollRepeat)),
    "repeat_bias.csv": column_table(columns_of(Bias)),
}
"""Name in a comment -> the table below it."""


def with_tables(text: str) -> str:
    """A page with its tables as they are defined now.

    Raises:
        KeyError: a comment names no table.
    """
    return MARKED.sub(lambda found: f"<!-- table: {found['name']} -->\n\n{TABLES[found['name']]}", text)


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(with_tables(page.read_text(encoding="utf-8")), encoding="utf-8")
