# SPDX-License-Identifier: Apache-2.0
"""Saves the results of repeated films: tables, a picture and a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import __version__
from ..core.columns import cells_of, columns_of
from ..errors import Cotton3dgError
from ..io.saving import explain_disk_errors, write_text_atomically
from ..io.tables import csv_text
from ..report.facts import read_facts
from ..report.figures import png_uri
from ..report.page import fill_template, write_page
from ..report.pictures import Pictures
from ..workspace import Workspace
from .measured_plant import Filmed
from .repeatability import Bias, BollRepeat, PlantFilms, Repeats, TraitRepeat

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def write_repeats(folder: Path, repeats: Repeats) -> None:
    """Save repeat_traits.csv, repeat_bolls.csv, repeat_bias.csv, repeat.png and repeat.html."""
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
        write_page(folder / "repeat.html", repeats_page(repeats, folder / "repeat.png"))


def repeats_page(repeats: Repeats, picture: Path) -> str:
    """One file that opens without a network: the picture, the scatter, and each boll in every film.

    Photos of the bolls are for films of a single plant; a field's page would grow too large with them.
    """
    several = len(repeats.plants) > 1
    matched = [films for plant in repeats.plants for films in _boll_films(plant, with_photos=not several)]
    content = {
        "title": f"{len(repeats.plants)} plants" if several else repeats.plants[0].films[0].traits.get("plant_id", ""),
        "films": [str(Path(film.name).parent) if several else film.name for film in repeats.plants[0].films],
        "several": several,
        "picture": png_uri(picture),
        "traits": repeats.reported_traits,
        "bias": repeats.bias,
        "refused": repeats.refused,
        "bolls": [{"row": row, "films": films} for row, films in zip(repeats.bolls, matched, strict=True)],
        "n_whole": sum(row.n_films == repeats.n_films for row in repeats.bolls),
        "version": __version__,
    }
    return fill_template("repeat.html", [], content)


def _boll_films(plant: PlantFilms, *, with_photos: bool) -> list[list[dict[str, Any]]]:
    """The cells of each film, for each boll."""
    photos = [_photos(film) if with_photos else {} for film in plant.films]
    volumes = plant.values("volumes_cm3")
    found = []
    for own_rows, own_volumes in zip(plant.rows, volumes, strict=True):
        ids = [film.ids[row] if row >= 0 else None for film, row in zip(plant.films, own_rows, strict=True)]
        found.append(
            [
                {"id": "–" if number is None else number, "volume_cm3": volume, "photo": own.get(number, "")}
                for number, volume, own in zip(ids, own_volumes, photos, strict=True)
            ]
        )
    return found


def _photos(film: Filmed) -> dict[int | None, str]:
    """Boll -> a photo of it; empty if the film's images were cleaned away."""
    workspace = Workspace(film.name)
    try:
        cut_outs = Pictures(workspace, read_facts(workspace)).cut_outs()
    except Cotton3dgError:
        return {}
    return {boll: cuts[0]["src"] for boll, cuts in cut_outs.items()}


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
    shown = [row for row in repeats.reported_traits if np.isfinite(row.cv_pct)]
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
