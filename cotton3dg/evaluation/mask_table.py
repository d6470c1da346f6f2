# SPDX-License-Identifier: Apache-2.0
"""masks.csv: the accuracy of masks of many plants and back ends, per image, per plant and pooled over all plants.

An evaluation replaces the rows of its plant and back end and keeps all others, so that a loop over plants and back
ends fills one table.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from ..core.columns import Column
from ..io.saving import explain_disk_errors, write_text_atomically
from ..io.tables import csv_text, parse_number, read_rows, refuse_other_table
from .masks import THRESHOLDS, MaskCounts

ALL: Final = "all"
"""In place of an image: all images of a plant; in place of a plant: all plants of a back end."""
SUFFIXES: Final = tuple(f"{round(100 * threshold)}" for threshold in THRESHOLDS)

COLUMNS: Final = (
    Column("plant_id", "", "name of the plant; all = every plant of this table"),
    Column("backend", "", "who found the bolls in the images"),
    Column("image", "", "name of the image; all = every judged image"),
    Column("n_true", "1", "true masks"),
    Column("n_found", "1", "found masks"),
    *(Column(f"hits_{s}", "1", f"pairs with an IoU of 0.{s} or more") for s in SUFFIXES),
    *(
        Column(f"{name}_{s}", "1", f"{meaning}, at an IoU of 0.{s}", 4)
        for s in SUFFIXES
        for name, meaning in (("precision", "hits by found masks"), ("recall", "hits by true masks"), ("f1", "F1"))
    ),
    Column("miou_hits", "1", "mean IoU of the pairs at 0.5, as Table 5 of Cotton3DGaussians is read", 4),
    Column("miou_all", "1", "mean IoU over all true masks, missed ones with 0", 4),
)


def add_to_table(path: Path, plant_id: str, backend: str, images: Mapping[str, MaskCounts]) -> None:
    """Put a plant's images into the table, in place of the rows of this plant and back end.

    Raises:
        BadInput: the existing table cannot be read, or is another table.
    """
    refuse_other_table(path, COLUMNS)
    known = read_rows(path) if path.is_file() else []
    kept = {
        (row["plant_id"], row["backend"], row["image"]): _counts_of(row)
        for row in known
        if ALL not in (row["plant_id"], row["image"]) and (row["plant_id"], row["backend"]) != (plant_id, backend)
    }
    kept |= {(plant_id, backend, image): counts for image, counts in images.items()}
    with explain_disk_errors(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text_atomically(path, csv_text(COLUMNS, [_row_of(*key, counts) for key, counts in _pooled(kept)]))


def _pooled(
    images: Mapping[tuple[str, str, str], MaskCounts],
) -> Iterable[tuple[tuple[str, str, str], MaskCounts]]:
    """The images of each back end and plant, all of a plant, and all plants of a back end."""
    for backend in dict.fromkeys(key[1] for key in images):
        own = {key: counts for key, counts in images.items() if key[1] == backend}
        for plant_id in dict.fromkeys(key[0] for key in own):
            mine = {key: counts for key, counts in own.items() if key[0] == plant_id}
            yield from mine.items()
            yield (plant_id, backend, ALL), sum(mine.values(), MaskCounts())
        yield (ALL, backend, ALL), sum(own.values(), MaskCounts())


def _row_of(plant_id: str, backend: str, image: str, counts: MaskCounts) -> dict[str, Any]:
    row: dict[str, Any] = {"plant_id": plant_id, "backend": backend, "image": image}
    row |= {"n_true": counts.n_true, "n_found": counts.n_found}
    for suffix, hits, score in zip(SUFFIXES, counts.hits, counts.scores, strict=True):
        row |= {f"hits_{suffix}": hits, f"precision_{suffix}": score.precision}
        row |= {f"recall_{suffix}": score.recall, f"f1_{suffix}": score.f1}
    return row | {"miou_hits": counts.miou_hits, "miou_all": counts.miou_all}


def _counts_of(row: Mapping[str, str]) -> MaskCounts:
    """The counts behind a row, to the digits that it has."""

    def number(name: str) -> float:
        value = parse_number(row[name])
        return value if math.isfinite(value) else 0.0  # blank for an image without masks

    n_true, hits = int(number("n_true")), tuple(int(number(f"hits_{suffix}")) for suffix in SUFFIXES)
    at_half = hits[THRESHOLDS.index(0.5)]
    return MaskCounts(n_true, int(number("n_found")), hits, number("miou_hits") * at_half, number("miou_all") * n_true)
