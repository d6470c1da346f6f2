# SPDX-License-Identifier: Apache-2.0
"""A finished plant from its tables and its map, for comparison with another film."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.columns import Column, columns_of
from ..core.map_measurements import MapTraits
from ..core.measurements import LintColour, PlantTraits, is_counted
from ..core.plant_map import PlantMap
from ..errors import BadInput, Cotton3dgError
from ..io.tables import flags_of, parse_number, read_rows
from ..plants import plant_at
from ..schemas.skeleton import SkeletonInfo, read_map
from .align import Layout

NO_TRAIT: Final = ("corrections", "boll_count_odd", "boll_count_even")
NO_TRAIT_WORDS: Final = {"low", "high", "original"}
"""Words in the names of columns that hold an end of an interval, or a value before corrections."""


@dataclass(frozen=True)
class Filmed:
    """One film of a plant; (B,) and (B, 3) arrays are of its bolls, in the order of bolls.csv."""

    name: str
    """Its folder as the user gave it."""
    traits: Mapping[str, str]
    """Its row of traits.csv."""
    ids: tuple[int, ...]
    centres_cm: NDArray[np.float64]
    volumes_cm3: NDArray[np.float64]
    volume_errors_cm3: NDArray[np.float64]
    diameters_cm: NDArray[np.float64]
    flags: tuple[list[str], ...]
    """Quality flags of each boll."""
    plant_map: PlantMap
    film_sha256: str = ""
    """SHA-256 of the video, or of all photos; empty if it is not known."""

    @property
    def layout(self) -> Layout:
        branch = {boll.boll_id: boll.branch for boll in self.plant_map.bolls}
        return Layout(self.centres_cm, tuple(branch.get(boll_id, 0) for boll_id in self.ids), self.plant_map)

    def value(self, trait: str) -> float:
        """The value of a trait; NaN if it was not measured."""
        return parse_number(self.traits.get(trait))

    def error(self, trait: str) -> float:
        """Stated standard error of a trait; NaN if there is none."""
        name = error_column(trait)
        return self.value(name) if name else float("nan")


def read_filmed(folder: Path) -> Filmed:
    """Read a finished plant.

    Raises:
        MissingInput: the stage traits has not run.
        BadInput: the plant has no scale, so that its bolls have no places.
    """
    try:
        workspace = plant_at(folder)
        traits_csv = workspace.require(workspace.traits_csv, "run")
    except Cotton3dgError as error:
        raise type(error)(f"{folder}: {error}") from error
    traits = read_rows(traits_csv)[0]
    if traits.get("scale_source") == "none":
        raise BadInput(f"{folder} has no scale, so its bolls have no places; see docs/scale.md")
    bolls = read_rows(workspace.require(workspace.bolls_csv, "traits"))
    rows = [row for row in bolls if is_counted(flags_of(row))]
    frames = workspace.read_record("frames")

    def numbers(name: str) -> NDArray[np.float64]:
        return np.array([parse_number(row.get(name)) for row in rows], np.float64)

    return Filmed(
        str(folder),
        traits,
        tuple(int(row["boll_id"]) for row in rows),
        np.column_stack([numbers(f"{axis}_cm") for axis in "xyz"]),
        numbers("volume_cm3"),
        numbers("volume_error_cm3"),
        numbers("diameter_cm"),
        tuple(flags_of(row) for row in rows),
        read_map(SkeletonInfo.load(workspace.require(workspace.skeleton_json, "traits"))),
        ";".join(sorted(frames.inputs.values())) if frames else "",
    )


def find_same_films(films: Sequence[Filmed]) -> list[str]:
    """A remark on each film that is the same as another one, in any folder."""
    first: dict[str, Filmed] = {}
    remarks = []
    for film in films:
        other = first.setdefault(film.film_sha256, film)
        if film.film_sha256 and other is not film:
            remarks.append(f"{film.name} is the same film as {other.name}; what differs is not the plant's")
    return remarks


def comparable_traits() -> list[Column]:
    """Columns of traits.csv with values that are measured on the plant."""
    return [
        column
        for column in columns_of(PlantTraits, MapTraits, LintColour)
        if column.unit
        and column.name not in (*NO_TRAIT, *_errors().values())
        and not NO_TRAIT_WORDS & set(column.name.split("_"))
    ]


def error_column(trait: str) -> str:
    """Column with the standard error of a trait; empty if there is none."""
    return _errors().get(trait, "")


def _errors() -> dict[str, str]:
    """Trait -> column of its standard error: `x_error` of x, `x_error_cm` of `x_cm`."""
    names = {column.name for column in columns_of(PlantTraits, MapTraits)}
    found = {}
    for name in names:
        body, _, unit = name.rpartition("_")
        error = next((each for each in (f"{name}_error", f"{body}_error_{unit}") if each in names), "")
        if error:
            found[name] = error
    return found
