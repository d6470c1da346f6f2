"""index.html of a batch: every plant in a table that sorts, failures on top, and how the traits are distributed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from .. import __version__
from ..core.state import State
from ..errors import Cotton3dgError
from ..files.images import read_image
from ..files.tables import parse_number
from ..workspace import Workspace
from .figures import jpeg_uri
from .page import TEMPLATES, fill_template

SHOWN = {
    "boll_count": ("Bolls", "", 0),
    "boll_volume_cm3": ("Volume", "cm³", 0),
    "plant_height_cm": ("Height", "cm", 1),
    "canopy_size_cm": ("Canopy", "cm", 1),
}
"""Trait -> name, unit, digits."""
OUTLYING = 3.5
"""Robust z-score beyond which a value is flagged (Iglewicz and Hoaglin 1993)."""
FEWEST = 5
"""With fewer plants nothing is an outlier."""
BINS = 10
THUMBNAIL_PX = 160


def index_page(name: str, folder: Path, rows: Sequence[Mapping[str, Any]]) -> str:
    """The page as HTML.

    Args:
        name: of the batch. folder: of the batch. rows: those of batch.csv, in its order.
    """
    values = {trait: np.array([_value(row, trait) for row in rows], np.float64) for trait in SHOWN}
    scores = {trait: robust_z(found) for trait, found in values.items()}
    plants = [_describe_plant(folder, row, {trait: scores[trait][i] for trait in SHOWN}) for i, row in enumerate(rows)]
    content = {
        "name": name,
        "plants": plants,
        "counts": {state: sum(row["state"] == state for row in rows) for state in State},
        "n_outliers": sum(bool(plant["outliers"]) for plant in plants),
        "shown": SHOWN,
        "histograms": [_histogram(trait, values[trait]) for trait in SHOWN],
        "version": __version__,
    }
    scripts = [(TEMPLATES / name).read_text("utf-8") for name in ("table.js", "index.js")]
    return fill_template("index.html", scripts, content)


def robust_z(values: np.ndarray) -> np.ndarray:
    """Distance of each value from the median in robust standard deviations (MAD); NaN where that says nothing."""
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
    return {
        **row,
        "link": quote(f"{row['folder']}/report.html") if (own / "report.html").is_file() else "",
        "thumbnail": _read_thumbnail(own),
        "outliers": outliers,
        "flags": [flag for flag in str(row.get("qc_flags") or "").split(";") if flag],
    }


def _read_thumbnail(plant: Path) -> str:
    """A small photo of the plant; nothing where there is none."""
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
    """Kept, for the page is written again after every plant."""
    return jpeg_uri(read_image(path), THUMBNAIL_PX, 75)


def _histogram(trait: str, values: np.ndarray) -> dict[str, Any]:
    """Columns of a histogram in a box of 200 x 90."""
    known = values[np.isfinite(values)]
    name, unit, digits = SHOWN[trait]
    told: dict[str, Any] = {"name": name, "unit": unit, "n": len(known), "columns": [], "text": "no values yet"}
    if not len(known):
        return told
    counts, edges = np.histogram(known, bins=min(BINS, max(1, len(known))))
    told["columns"] = [
        {
            "x": 200 * i / len(counts),
            "width": 200 / len(counts) - 1,
            "height": 70 * count / counts.max(),
            "title": f"{count} plants from {edges[i]:.{digits}f} to {edges[i + 1]:.{digits}f} {unit}",
        }
        for i, count in enumerate(counts)
    ]
    told["low"], told["high"] = f"{edges[0]:.{digits}f}", f"{edges[-1]:.{digits}f}"
    told["text"] = f"median {np.median(known):.{digits}f} {unit}".strip() + f", {len(known)} plants"
    return told
