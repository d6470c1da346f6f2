"""What repeated films say, saved: tables and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.columns import cells_of, columns_of
from ..files.saving import explain_disk_errors, write_text_atomically
from ..files.tables import csv_text
from .repeats import BOLL_TRAITS, Bias, BollRepeat, Repeats, TraitRepeat

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def write_repeats(folder: Path, repeats: Repeats) -> None:
    """Save repeat_traits.csv, repeat_bolls.csv, repeat_bias.csv and repeat.png."""
    tables: dict[str, tuple[type, Sequence[Any]]] = {
        "repeat_traits.csv": (TraitRepeat, repeats.traits),
        "repeat_bolls.csv": (BollRepeat, repeats.bolls),
        "repeat_bias.csv": (Bias, repeats.bias),
    }
    with explain_disk_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name, (kind, rows) in tables.items():
            write_text_atomically(folder / name, csv_text(columns_of(kind), [cells_of(row) for row in rows]))
        write_repeats_plot(folder / "repeat.png", repeats)


def write_repeats_plot(path: Path, repeats: Repeats) -> None:
    """Save differences of single bolls against their means (Bland and Altman 1986), and the scatter of the traits."""
    from matplotlib.figure import Figure  # without pyplot, which would look for a screen

    figure = Figure((12, 5.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    _draw_agreement(left, repeats)
    _draw_scatter(right, repeats)
    figure.savefig(path, format="png", dpi=110)


def _draw_agreement(axes: Axes, repeats: Repeats) -> None:
    axes.set(
        title="volumes of single bolls",
        xlabel="mean of the first and another film, cm³",
        ylabel="other minus first, cm³",
    )
    axes.axhline(0, color="0.5", linewidth=1)
    for number in range(1, repeats.n_films):
        pairs = np.vstack([plant.values("volumes_cm3")[:, [0, number]] for plant in repeats.plants])
        first, other = pairs[np.isfinite(pairs).all(axis=1)].T
        name = repeats.plants[0].films[number].name
        axes.scatter((first + other) / 2, other - first, s=18, color=f"C{number - 1}", label=name)
        for row in repeats.bias:
            if row.film == name and row.trait == "boll volume":
                axes.axhline(row.bias, color=f"C{number - 1}", linewidth=1)
                for limit in (row.agreement_low, row.agreement_high):
                    axes.axhline(limit, color=f"C{number - 1}", linewidth=1, linestyle="--")
    axes.legend(fontsize=8, title="— bias, -- limits of agreement", title_fontsize=8)
    axes.grid(color="0.93")
    axes.set_axisbelow(True)


def _draw_scatter(axes: Axes, repeats: Repeats) -> None:
    """Coefficient of variation of each trait beside its stated standard error."""
    shown = [
        row
        for row in repeats.traits
        if np.isfinite(row.cv_pct) and (np.isfinite(row.error) or row.trait in BOLL_TRAITS)
    ]
    places = np.arange(len(shown))
    axes.barh(places, [row.cv_pct for row in shown], color="#1f5fa8", label="found: CV within a plant")
    stated = [100 * row.error / abs(row.mean) for row in shown]
    axes.plot(stated, places, "|", color="#c0392b", markersize=14, markeredgewidth=2, label="stated standard error")
    axes.set_yticks(places, [row.trait for row in shown])
    axes.invert_yaxis()
    axes.set(title="scatter of the traits", xlabel="% of the mean")
    axes.legend(fontsize=8)
    axes.grid(color="0.93", axis="x")
    axes.set_axisbelow(True)
