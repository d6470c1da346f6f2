# SPDX-License-Identifier: Apache-2.0
"""index.html of a batch: every plant in a table that sorts, failures on top, and how the traits are distributed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import numpy as np

from .. import __version__
from ..core.runs import State
from ..errors import Cotton3dgError
from ..field.genotypes import Fit, Mean, Trial
from ..io.images import read_image
from ..io.tables import flags_of, parse_number, read_rows
from ..schemas.check import GREEN, RED, VERDICTS, YELLOW
from ..workspace import Workspace
from .checklist import to_film
from .figures import jpeg_uri
from .page import TEMPLATES, fill_template
from .verdicts import SURENESS, USUAL_PCT, interval_of, of_row, rounded, sureness_of

SHOWN: Final = {
    "boll_count": ("Bolls", "", 0),
    "boll_volume_cm3": ("Volume", "cm³", 0),
    "plant_height_cm": ("Height", "cm", 1),
    "canopy_size_cm": ("Canopy", "cm", 1),
}
"""Trait -> name, unit, digits."""
OUTLYING: Final = 3.5
"""Robust z-score beyond which a value is flagged (Iglewicz and Hoaglin 1993)."""
FEWEST: Final = 5
"""With fewer plants nothing is an outlier."""
BINS: Final = 10
THUMBNAIL_PX: Final = 160
MOST_CHOICES: Final = 40
"""A column of the field book with more values, or with only one, is not a filter."""
MOST_GENOTYPES: Final = 40


def index_page(name: str, folder: Path, rows: Sequence[Mapping[str, Any]], trial: Trial | None = None) -> str:
    """The page as HTML.

    Args:
        name: of the batch. folder: of the batch. rows: those of batch.csv, in its order.
        trial: what the field book adds.
    """
    trial = trial or Trial()
    values = {trait: np.array([_value(row, trait) for row in rows], np.float64) for trait in SHOWN}
    scores = {trait: robust_z(found) for trait, found in values.items()}
    plants = [_describe_plant(folder, row, {trait: scores[trait][i] for trait in SHOWN}) for i, row in enumerate(rows)]
    content = {
        "name": name,
        "plants": plants,
        "verdict": max((plant["verdict"] for plant in plants), key=VERDICTS.index, default=GREEN),
        "n_yellow": sum(plant["state"] == State.DONE and plant["verdict"] == YELLOW for plant in plants),
        "counts": {state: sum(row["state"] == state for row in rows) for state in State},
        "n_outliers": sum(bool(plant["outliers"]) for plant in plants),
        "shown": SHOWN,
        "sureness": SURENESS,
        "filters": _filters(rows, trial.columns),
        "genotypes": [
            _genotype_plot(fit, [mean for mean in trial.means if mean.trait == fit.trait]) for fit in trial.fits
        ],
        "checklist": to_film(folder, plants, trial),
        "histograms": [_histogram(trait, values[trait]) for trait in SHOWN],
        "version": __version__,
    }
    scripts = [(TEMPLATES / name).read_text("utf-8") for name in ("table.js", "index.js")]
    return fill_template("index.html", scripts, content)


def _filters(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> list[dict[str, Any]]:
    """Columns of the field book whose values can select plants."""
    found = []
    for column in columns:
        values = sorted({str(row.get(column, "")) for row in rows} - {""}, key=lambda text: (len(text), text))
        if 1 < len(values) <= MOST_CHOICES:
            found.append({"column": column, "values": values})
    return found


def _genotype_plot(fit: Fit, means: Sequence[Mean]) -> dict[str, Any]:
    """Adjusted means with their errors, the largest first, in a box of 320 wide with a line of 16 for each.

    The axis is at least as long as the 95 % interval of one plant, so that a smaller difference does not look large.
    """
    name, unit, digits = (SHOWN | {"boll_volume_mean_cm3": ("Volume of a boll", "cm³", 1)})[fit.trait]
    shown = sorted(means, key=lambda mean: -mean.adjusted_mean)[:MOST_GENOTYPES]
    errors = [mean.standard_error if np.isfinite(mean.standard_error) else 0.0 for mean in shown]
    low = min(mean.adjusted_mean - error for mean, error in zip(shown, errors, strict=True))
    high = max(mean.adjusted_mean + error for mean, error in zip(shown, errors, strict=True))
    lacking = max(2 * USUAL_PCT[fit.trait] / 100 * (low + high) / 2 - (high - low), 0.0)
    low, high = low - lacking / 2, high + lacking / 2
    per = 170 / (high - low or 1)
    lines = [
        {
            "genotype": mean.genotype,
            "x": 120 + per * (mean.adjusted_mean - low),
            "left": 120 + per * (mean.adjusted_mean - error - low),
            "right": 120 + per * (mean.adjusted_mean + error - low),
            "title": f"{mean.genotype}: {mean.adjusted_mean:.{digits}f} ± {error:.{digits + 1}f} {unit}, "
            f"{mean.plants} plants",
        }
        for mean, error in zip(shown, errors, strict=True)
    ]
    statistics = [f"{fit.genotypes} genotypes, {fit.plants} plants"]
    statistics += [f"F {fit.f_genotype:.2f}, p {fit.p_genotype:.3g}"] if np.isfinite(fit.p_genotype) else []
    statistics += [f"heritability {fit.heritability:.2f}"] if np.isfinite(fit.heritability) else []
    return {
        "name": name, "unit": unit, "lines": lines, "height": 16 * len(lines) + 22,
        "low": f"{low:.{digits}f}", "high": f"{high:.{digits}f}",
        "text": "; ".join(statistics), "left_out": len(means) - len(shown),
    }  # fmt: skip


def robust_z(values: np.ndarray) -> np.ndarray:
    """Distance of each value from the median in robust standard deviations (MAD); NaN where that has no meaning."""
    known = values[np.isfinite(values)]
    if len(known) < FEWEST:
        return np.full(len(values), np.nan)
    spread = 1.4826 * float(np.median(np.abs(known - np.median(known))))
    return (values - np.median(known)) / spread if spread > 0 else np.full(len(values), np.nan)


def _value(row: Mapping[str, Any], trait: str) -> float:
    return parse_number(row.get(trait)) if row["state"] == State.DONE else np.nan


def _describe_plant(folder: Path, row: Mapping[str, Any], scores: dict[str, float]) -> dict[str, Any]:
    own = folder / str(row["folder"])
    outliers = {
        trait: f"{SHOWN[trait][0].lower()} far {'above' if z > 0 else 'below'} the others (robust z {z:+.1f})"
        for trait, z in scores.items()
        if abs(z) > OUTLYING
    }
    flags = flags_of(row)
    verdict, why = {State.FAILED: (RED, "No result"), State.WAITING: (YELLOW, "No result yet")}.get(
        row["state"]
    ) or of_row(flags, _count_doubtful(own), row)
    return {
        **row,
        "verdict": verdict,
        "why": why,
        "link": quote(f"{row['folder']}/report.html") if (own / "report.html").is_file() else "",
        "thumbnail": _read_thumbnail(own),
        "outliers": outliers,
        "flags": flags,
        "sure": {trait: sureness_of(row, trait) or "" for trait in SHOWN},
        "intervals": {trait: interval_text(row, trait) for trait in SHOWN},
    }


def interval_text(row: Mapping[str, Any], trait: str) -> str:
    """`12 to 14`; empty where the trait has no interval."""
    _, low, high = interval_of(row, trait)
    digits = SHOWN[trait][2]
    return f"{rounded(low, digits)} to {rounded(high, digits)}" if np.isfinite(low + high) else ""


def _count_doubtful(plant: Path) -> int:
    """Number of bolls of a plant that have flags of their own."""
    try:
        table = Workspace(plant).bolls_csv
        return _count_flagged(table, table.stat().st_mtime_ns)
    except (Cotton3dgError, OSError):
        return 0


@lru_cache(maxsize=1024)
def _count_flagged(table: Path, _changed_ns: int) -> int:
    """Cached, as thumbnails are."""
    return sum(bool(flags_of(row)) for row in read_rows(table))


def _read_thumbnail(plant: Path) -> str:
    """A small photo of the plant; empty if there is none."""
    try:
        images = Workspace(plant).frame_images()
        if not images:
            return ""
        chosen = images[len(images) // 8]
        return _small(chosen, chosen.stat().st_mtime_ns)
    except (Cotton3dgError, OSError):
        return ""


@lru_cache(maxsize=1024)
def _small(path: Path, _changed_ns: int) -> str:
    """Cached, because the page is written again after every plant."""
    return jpeg_uri(read_image(path), THUMBNAIL_PX, 75)


def _histogram(trait: str, values: np.ndarray) -> dict[str, Any]:
    """Columns of a histogram in a box of 200 x 90."""
    known = values[np.isfinite(values)]
    name, unit, digits = SHOWN[trait]
    chart: dict[str, Any] = {"name": name, "unit": unit, "n": len(known), "columns": [], "text": "no values yet"}
    if not len(known):
        return chart
    counts, edges = np.histogram(known, bins=min(BINS, max(1, len(known))))
    chart["columns"] = [
        {
            "x": 200 * i / len(counts),
            "width": 200 / len(counts) - 1,
            "height": 70 * count / counts.max(),
            "title": f"{count} plants from {edges[i]:.{digits}f} to {edges[i + 1]:.{digits}f} {unit}",
        }
        for i, count in enumerate(counts)
    ]
    chart["low"], chart["high"] = f"{edges[0]:.{digits}f}", f"{edges[-1]:.{digits}f}"
    chart["text"] = f"median {np.median(known):.{digits}f} {unit}".strip() + f", {len(known)} plants"
    return chart
