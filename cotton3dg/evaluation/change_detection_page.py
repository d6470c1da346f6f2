# SPDX-License-Identifier: Apache-2.0
"""Saves what changed between films of a plant: tables, pictures and a page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..core.columns import cells_of, columns_of
from ..io.saving import explain_disk_errors, write_text_atomically
from ..io.tables import csv_text
from ..report.figures import png_uri
from ..report.page import fill_template, write_page
from .change_detection import GONE, NEW, SAME, BollChange, Comparison, TraitChange

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS: Final = {SAME: "#1f5fa8", GONE: "#c0392b", NEW: "#2e8b57"}
WOOD: Final = "0.75"


def write_comparisons(folder: Path, comparisons: Sequence[Comparison]) -> None:
    """Save boll_changes.csv, trait_changes.csv, a picture for each film (changes_<n>.png) and comparison.html."""
    with explain_disk_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        bolls = [cells_of(change) for each in comparisons for change in each.bolls]
        traits = [cells_of(change) for each in comparisons for change in each.traits]
        write_text_atomically(folder / "boll_changes.csv", csv_text(columns_of(BollChange), bolls))
        write_text_atomically(folder / "trait_changes.csv", csv_text(columns_of(TraitChange), traits))
        pictures = [folder / f"changes_{number}.png" for number in range(1, len(comparisons) + 1)]
        for each, picture in zip(comparisons, pictures, strict=True):
            write_changes_plot(picture, each)
        write_page(folder / "comparison.html", comparison_page(comparisons, pictures))


def comparison_page(comparisons: Sequence[Comparison], pictures: Sequence[Path]) -> str:
    """One file that opens without a network: the pictures and both tables."""
    content = {
        "first": comparisons[0].first.name,
        "plant_id": comparisons[0].first.traits.get("plant_id", ""),
        "films": [_described(each, picture) for each, picture in zip(comparisons, pictures, strict=True)],
        "version": __version__,
    }
    return fill_template("comparison.html", [], content)


def _described(comparison: Comparison, picture: Path) -> dict[str, Any]:
    return {
        "name": comparison.other.name,
        "alignment": comparison.alignment,
        "by_chance": math.isfinite(comparison.alignment.chance),
        "counts": {state: comparison.count(state) for state in COLOURS},
        "moved_cm": comparison.median_moved_cm,
        "picture": png_uri(picture),
        "bolls": [cells_of(boll) for boll in comparison.bolls],
        "traits": comparison.traits,
    }


def write_changes_plot(path: Path, comparison: Comparison) -> None:
    """Save the plant from the side and from above with the changes of its bolls, and their volumes in both films."""
    from matplotlib.figure import Figure  # without pyplot, which would look for a screen

    figure = Figure((15, 5.6), layout="constrained")
    side, top, volumes = figure.subplots(1, 3)
    for axes, (x, y), title in ((side, (0, 2), "from the side"), (top, (0, 1), "from above")):
        _draw_plants(axes, comparison, x, y)
        axes.set(title=title, xlabel=f"{'xyz'[x]}, cm", ylabel=f"{'xyz'[y]}, cm", aspect="equal")
    handles, labels = side.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc="outside lower left", ncols=3, fontsize=9, frameon=False)
    _draw_volumes(volumes, comparison)
    figure.suptitle(f"{comparison.first.name} (first) and {comparison.other.name} (other)")
    figure.savefig(path, format="png", dpi=110)


def _draw_plants(axes: Axes, comparison: Comparison, x: int, y: int) -> None:
    """Wood of both films, and each boll at its place with its number."""
    align = comparison.alignment.apply
    plants: list[tuple[Any, str, Any]] = [
        (comparison.first.plant_map, "-", lambda curve: curve),
        (comparison.other.plant_map, ":", align),
    ]
    for plant_map, style, placed in plants:
        for axis in plant_map.axes:
            curve = placed(axis.curve)
            axes.plot(curve[:, x], curve[:, y], style, color=WOOD, linewidth=2.2 if axis.rank == 0 else 1.1, zorder=1)
    first = {boll_id: row for row, boll_id in enumerate(comparison.first.ids)}
    other = {boll_id: row for row, boll_id in enumerate(comparison.other.ids)}
    placed_other = align(comparison.other.centres_cm)
    for boll in comparison.bolls:
        a = None if boll.boll_first is None else comparison.first.centres_cm[first[boll.boll_first]]
        b = None if boll.boll_other is None else placed_other[other[boll.boll_other]]
        at = np.array([place for place in (a, b) if place is not None])[:, [x, y]]
        diameter = boll.diameter_first_cm if math.isfinite(boll.diameter_first_cm) else boll.diameter_other_cm
        axes.plot(at[:, 0], at[:, 1], "-", color=COLOURS[boll.state], linewidth=1.2, zorder=3)
        if boll.state == SAME:
            axes.plot(at[-1:, 0], at[-1:, 1], ".", color=COLOURS[boll.state], markersize=4, zorder=3)
        _circle(axes, at[0], 0.5 * diameter if math.isfinite(diameter) else 2.0, boll.state)
        name = boll.boll_first if boll.boll_first is not None else boll.boll_other
        axes.annotate(str(name), (at[0, 0], at[0, 1]), xytext=(3, 3), textcoords="offset points", fontsize=7, zorder=4)
    axes.autoscale_view()
    axes.grid(color="0.93")
    axes.set_axisbelow(True)


def _circle(axes: Axes, middle: NDArray[np.float64], radius: float, state: str) -> None:
    from matplotlib.patches import Circle

    style = "--" if state == GONE else "-"
    fill = (*_rgb(COLOURS[state]), 0.0 if state == GONE else 0.18)
    axes.add_patch(
        Circle(tuple(middle), radius, edgecolor=COLOURS[state], facecolor=fill, linestyle=style, label=_WORDS[state])
    )


_WORDS: Final = {SAME: "same (number of the first film)", GONE: "gone", NEW: "new (number of the other film)"}


def _rgb(text: str) -> tuple[float, float, float]:
    red, green, blue = (int(text[at : at + 2], 16) / 255 for at in (1, 3, 5))
    return red, green, blue


def _draw_volumes(axes: Axes, comparison: Comparison) -> None:
    """Volumes of the bolls that are the same, with their standard errors, around the line of no change."""
    a, b = comparison.pairs.T
    x, y = comparison.first.volumes_cm3[a], comparison.other.volumes_cm3[b]
    errors = comparison.first.volume_errors_cm3[a], comparison.other.volume_errors_cm3[b]
    known = np.isfinite(np.stack([x, y, *errors])).all(axis=0)
    axes.set(
        title=f"volumes of {known.sum()} bolls with standard errors",
        xlabel="volume in the first film, cm³",
        ylabel="volume in the other film, cm³",
    )
    axes.grid(color="0.93")
    axes.set_axisbelow(True)
    if not known.any():
        return
    axes.errorbar(x[known], y[known], errors[1][known], errors[0][known], fmt="o", color=COLOURS[SAME], ecolor="0.6",
                  markersize=4, linewidth=1)  # fmt: skip
    for row in np.flatnonzero(known):
        axes.annotate(str(comparison.first.ids[a[row]]), (x[row], y[row]), xytext=(4, 4), textcoords="offset points",
                      fontsize=7)  # fmt: skip
    values, halves = np.stack([x, y])[:, known], np.stack(errors)[:, known]
    low, high = float((values - halves).min()), float((values + halves).max())
    margin = 0.03 * (high - low or 1.0)
    limits = low - margin, high + margin
    axes.plot(limits, limits, color="0.5", linewidth=1)
    axes.set(xlim=limits, ylim=limits, aspect="equal")
