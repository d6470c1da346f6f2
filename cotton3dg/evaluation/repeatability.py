# SPDX-License-Identifier: Apache-2.0
"""Films of unchanged plants: how far their traits and single bolls scatter, and whether one film is biased."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.columns import column
from ..core.scene import Float64
from ..errors import BadInput, BadUsage, Cotton3dgError
from ..io.listing import folders_in, is_there
from ..workspace import Workspace
from .change_detection import REACH_CM, compare_films
from .match import match_bolls
from .measured_plant import Filmed, comparable_traits, read_filmed

FEWEST: Final = 3
"""Least number of pairs for a test of bias."""
BOLL_TRAITS: Final = {"boll volume": "cm3", "boll diameter": "cm"}
NOT_ALL: Final = "in one film only; no volume"


@dataclass(frozen=True)
class BollRepeat:
    """One row of repeat_bolls.csv: a boll and the films that found it."""

    plant_id: str = column("", "name of the plant in its first film")
    boll: int = column("", "1, 2, ...: those of the first film in its order, then those that only later films found")
    n_films: int = column("1", "films that found it")
    boll_ids: tuple[str, ...] = column("", "its boll_id in each film, by vertical bars; - = not found")
    place_sd_cm: float = column(
        "cm", "root mean square distance of its centres from their mean, n - 1", 2, blank_when="in one film only"
    )
    volume_mean_cm3: float = column("cm3", "mean of its volumes", 2, blank_when="no volume")
    volume_sd_cm3: float = column("cm3", "standard deviation of its volumes", 2, blank_when=NOT_ALL)
    volume_cv_pct: float = column("%", "coefficient of variation of its volumes", 2, blank_when=NOT_ALL)
    volume_error_cm3: float = column("cm3", "stated standard error of its volume, root mean square", 2,
                                     blank_when="no volume")  # fmt: skip


@dataclass(frozen=True)
class TraitRepeat:
    """One row of repeat_traits.csv."""

    trait: str = column("", "column of traits.csv; boll volume, boll diameter: of single bolls found in all films")
    unit: str = column("", "its unit")
    n: int = column("1", "plants, or bolls, that have it in all films")
    mean: float = column("trait", "mean over plants and films", 3)
    sd: float = column("trait", "standard deviation within a plant (pooled variance of its films)", 4)
    cv_pct: float = column("%", "the same in per cent of the mean", 2, blank_when="mean is 0")
    error: float = column("trait", "stated standard error, root mean square", 4,
                          blank_when="the trait has no stated error")  # fmt: skip


@dataclass(frozen=True)
class Bias:
    """One row of repeat_bias.csv: a film against the first, paired over plants or bolls."""

    film: str = column("", "the film that is compared with the first")
    trait: str = column("", "column of traits.csv, paired over plants; boll volume, boll diameter: over bolls")
    unit: str = column("", "its unit")
    n: int = column("1", "pairs")
    bias: float = column("trait", "mean difference, film minus first", 4)
    bias_pct: float = column("%", "the same in per cent of the first film's mean", 2, blank_when="that mean is 0")
    low: float = column("trait", "lower end of its 95 % confidence interval", 4)
    high: float = column("trait", "upper end", 4)
    t: float = column("1", "paired t", 3, blank_when="all differences are equal")
    p: float = column("1", "probability of so large a t without bias", 4, blank_when="all differences are equal")
    agreement_low: float = column("trait", "lower limit of agreement, bias - 1.96 SD (Bland and Altman 1986)", 4)
    agreement_high: float = column("trait", "upper limit of agreement", 4)


@dataclass(frozen=True)
class PlantFilms:
    """The films of one plant, with one row for each boll."""

    films: tuple[Filmed, ...]
    rows: NDArray[np.int64]
    """(R, F) row of each boll in each film; -1 = not found."""
    places_cm: Float64
    """(R, F, 3) in the first film's plant frame; NaN if not found."""

    def values(self, name: str) -> Float64:
        """(R, F) of an array of `Filmed`, e.g. `volumes_cm3`; NaN where not found."""
        columns = [
            np.append(getattr(film, name), np.nan)[rows] for film, rows in zip(self.films, self.rows.T, strict=True)
        ]
        return np.stack(columns, axis=1)


@dataclass(frozen=True)
class Repeats:
    """The results of repeated films."""

    plants: list[PlantFilms]
    refused: tuple[str, ...]
    """Plants of fields whose films cannot be aligned, and why."""
    bolls: list[BollRepeat]
    traits: list[TraitRepeat]
    bias: list[Bias]

    @property
    def n_films(self) -> int:
        return len(self.plants[0].films)

    @property
    def reported_traits(self) -> list[TraitRepeat]:
        """Traits with a stated error, and those of single bolls."""
        return [row for row in self.traits if math.isfinite(row.error) or row.trait in BOLL_TRAITS]


def repeat(folders: Sequence[Path], reach_cm: float = REACH_CM, turn_deg: float | None = None) -> Repeats:
    """Compare films of one plant, or of a field's plants that were filmed several times, one field for each time.

    Args:
        folders: those of plants, or of fields whose plants have the same names.
        turn_deg: turn of the plants between the films; None = find it from bolls and branches.
    Raises:
        BadUsage: fewer than two folders, a folder twice, or plants beside fields.
        BadInput: no plant is in all fields, or none of them can be aligned.
    """
    if len(folders) < 2 or len({folder.resolve() for folder in folders}) < len(folders):
        raise BadUsage("give two folders or more, each once")
    are_plants = [Workspace(folder).traits_csv.is_file() for folder in folders]
    if all(are_plants):
        return _summarise([_plant_films([read_filmed(folder) for folder in folders], reach_cm, turn_deg)], ())
    if any(are_plants):
        raise BadUsage("some of the folders are plants and some are not; give plants, or fields of plants")
    fields = [_plants_of(folder) for folder in folders]
    common = [plant_id for plant_id in fields[0] if all(plant_id in field for field in fields)]
    if not common:
        raise BadInput("no plant is finished in all of these folders; plants belong together by their plant_id")
    plants, refused = [], []
    for plant_id in common:
        try:
            plants.append(_plant_films([read_filmed(field[plant_id]) for field in fields], reach_cm, turn_deg))
        except BadInput as error:
            refused.append(f"{plant_id}: {error}")
    if not plants:
        raise BadInput(f"no plant can be compared; {refused[0]}")
    return _summarise(plants, tuple(refused))


def _plants_of(field: Path) -> dict[str, Path]:
    """Name of each finished plant of a field -> its folder."""
    found = {}
    for folder in folders_in(field):
        with suppress(Cotton3dgError):  # a folder that cannot be used has no results
            plant = Workspace(folder)
            if is_there(plant.traits_csv):
                found[plant.plant_id] = folder
    return found


def _plant_films(films: Sequence[Filmed], reach_cm: float, turn_deg: float | None) -> PlantFilms:
    """Align all films with the first and find which bolls are the same."""
    first = films[0]
    rows = [np.arange(len(first.ids))[:, None]]
    places = [first.centres_cm[:, None]]
    for number, film in enumerate(films[1:], start=1):
        placed = compare_films(first, film, reach_cm, turn_deg).alignment.apply(film.centres_cm)
        known_rows, known_places = np.vstack(rows), np.vstack(places)
        middles = np.array(
            [np.nanmean(place, axis=0) if np.isfinite(place).any() else place[0] for place in known_places]
        )
        pairs = match_bolls(middles.reshape(-1, 3), placed, reach_cm)
        own = np.full((len(known_rows), 1), -1)
        own[pairs[:, 0], 0] = pairs[:, 1]
        alone = np.setdiff1d(np.arange(len(film.ids)), pairs[:, 1])
        later = np.full((len(alone), number + 1), -1)
        later[:, -1] = alone
        padded = np.vstack([placed, np.full(3, np.nan)])
        rows = [np.hstack([known_rows, own]), later]
        nowhere = np.full((len(alone), number, 3), np.nan)
        places = [
            np.concatenate([known_places, padded[own]], axis=1),
            np.concatenate([nowhere, padded[alone][:, None]], axis=1),
        ]
    return PlantFilms(tuple(films), np.vstack(rows), np.vstack(places))


def _summarise(plants: list[PlantFilms], refused: tuple[str, ...]) -> Repeats:
    values: dict[tuple[str, str], tuple[Float64, Float64]] = {}
    for trait in comparable_traits():
        found = np.array([[film.value(trait.name) for film in plant.films] for plant in plants])
        errors = np.array([[film.error(trait.name) for film in plant.films] for plant in plants])
        values[trait.name, trait.unit] = found, errors
    bolls = {
        "boll volume": [(plant.values("volumes_cm3"), plant.values("volume_errors_cm3")) for plant in plants],
        "boll diameter": [(plant.values("diameters_cm"), plant.values("diameters_cm") * np.nan) for plant in plants],
    }
    for name, unit in BOLL_TRAITS.items():
        values[name, unit] = tuple(np.vstack(part) for part in zip(*bolls[name], strict=True))  # type: ignore[assignment]
    traits, bias = [], []
    for (name, unit), (found, errors) in values.items():
        both = np.isfinite(found).all(axis=1)
        if both.any():
            traits.append(_scatter(name, unit, found[both], errors[both]))
        for number, film in enumerate(plants[0].films[1:], start=1):
            paired = np.isfinite(found[:, [0, number]]).all(axis=1)
            if paired.sum() >= FEWEST:
                bias.append(find_bias(film.name, name, unit, found[paired, 0], found[paired, number]))
    return Repeats(plants, refused, [row for plant in plants for row in _boll_rows(plant)], traits, bias)


def _scatter(name: str, unit: str, values: Float64, errors: Float64) -> TraitRepeat:
    """Scatter of (N, F) values; each row belongs to one thing."""
    mean, sd = float(values.mean()), float(np.sqrt(values.var(axis=1, ddof=1).mean()))
    cv = 100 * sd / abs(mean) if mean else math.nan
    return TraitRepeat(name, unit, len(values), mean, sd, cv, float(np.sqrt((errors**2).mean())))


def find_bias(film: str, trait: str, unit: str, first: Float64, other: Float64) -> Bias:
    """Paired t test of N pairs, N > 2, and the limits of agreement."""
    from scipy.stats import t as t_distribution

    difference = np.asarray(other, np.float64) - np.asarray(first, np.float64)
    n, mean, sd = len(difference), float(difference.mean()), float(difference.std(ddof=1))
    error = sd / math.sqrt(n)
    half = float(t_distribution.ppf(0.975, n - 1)) * error
    t = mean / error if error > 0 else math.nan
    p = 2 * float(t_distribution.sf(abs(t), n - 1)) if error > 0 else math.nan
    of_mean = 100 * mean / abs(float(np.mean(first))) if np.mean(first) else math.nan
    return Bias(film, trait, unit, n, mean, of_mean, mean - half, mean + half, t, p, mean - 1.96 * sd, mean + 1.96 * sd)


def _boll_rows(plant: PlantFilms) -> list[BollRepeat]:
    volumes, errors = plant.values("volumes_cm3"), plant.values("volume_errors_cm3")
    rows = []
    for number, (own, places) in enumerate(zip(plant.rows, plant.places_cm, strict=True)):
        known = volumes[number][np.isfinite(volumes[number])]
        stated = errors[number][np.isfinite(errors[number])]
        mean = float(known.mean()) if len(known) else math.nan
        sd = float(known.std(ddof=1)) if len(known) > 1 else math.nan
        seen = places[np.isfinite(places).all(axis=1)]
        spread = math.sqrt(((seen - seen.mean(axis=0)) ** 2).sum() / (len(seen) - 1)) if len(seen) > 1 else math.nan
        rows.append(
            BollRepeat(
                plant.films[0].traits.get("plant_id", ""),
                number + 1,
                int((own >= 0).sum()),
                tuple(str(film.ids[row]) if row >= 0 else "-" for film, row in zip(plant.films, own, strict=True)),
                spread,
                mean,
                sd,
                100 * sd / mean,
                float(np.sqrt((stated**2).mean())) if len(stated) else math.nan,
            )
        )
    return rows


def repeats_text(repeats: Repeats) -> str:
    """How many bolls all films found, and the scatter of each trait with an error, and of single bolls."""
    n = repeats.n_films
    whole = sum(row.n_films == n for row in repeats.bolls)
    lines = [
        f"{n} films of {len(repeats.plants)} plant{'s' * (len(repeats.plants) > 1)}; "
        f"{whole} of {len(repeats.bolls)} bolls found in all films",
        f"{'trait':<34}{'n':>5}{'mean':>10}{'SD':>9}{'CV %':>8}{'stated':>9}",
    ]
    lines += [
        f"{row.trait:<34}{row.n:>5}{row.mean:>10.2f}{row.sd:>9.3f}{row.cv_pct:>8.2f}"
        + (f"{row.error:>9.3f}" if math.isfinite(row.error) else "")
        for row in repeats.reported_traits
    ]
    lines += [
        f"{row.film}: {row.trait} {row.bias_pct:+.2f} % against the first film (n = {row.n}, p = {row.p:.3f})"
        for row in repeats.bias
        if row.p < 0.05
    ]
    return "\n".join([*lines, *(f"left out: {reason}" for reason in repeats.refused)])
