# SPDX-License-Identifier: Apache-2.0
"""Tables of figures as Markdown."""

from __future__ import annotations

import pandas as pd


def markdown(table: pd.DataFrame, digits: int = 2) -> str:
    """Rows of text, numbers with so many decimals, whole ones with none, blank where there is none."""
    whole = {name: (values.dropna() % 1 == 0).all() for name, values in table.select_dtypes("number").items()}

    def cell(name: str, value: object) -> str:
        if pd.isna(value):
            return ""
        return f"{value:.{0 if whole[name] else digits}f}" if name in whole else str(value)

    lines = ["| " + " | ".join(table.columns) + " |", "|" + "---|" * len(table.columns)]
    for values in table.itertuples(index=False):
        lines.append("| " + " | ".join(cell(n, v) for n, v in zip(table.columns, values, strict=True)) + " |")
    return "\n".join(lines) + "\n"
