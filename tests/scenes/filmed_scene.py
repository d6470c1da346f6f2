# SPDX-License-Identifier: Apache-2.0
"""A plant of known bolls and branches in its plant frame, moved as another film has it, and saved as a folder."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from cotton3dg.core.columns import cells_of
from cotton3dg.core.map_measurements import BollMapTraits
from cotton3dg.core.measurements import BollColour, BollTraits
from cotton3dg.core.plant_map import Axis, BollOnMap, PlantMap
from cotton3dg.evaluation.align import Layout, about_vertical
from cotton3dg.io.tables import BOLLS, TRAITS, csv_text
from cotton3dg.schemas.skeleton import describe_map
from cotton3dg.workspace import OWNER_MARK

NO_MAP = PlantMap((), (), "no_map")


def grown(n=10, seed=0, branches=True, step=2.36):
    """Layout of a plant with a branch for each boll, `step` radians apart, the boll at its tip."""
    rng = np.random.default_rng(seed)
    up = np.linspace(0, 65, 30)
    stem = np.column_stack([2 * (up / 65) ** 2, np.zeros(30), up])
    axes, bolls, centres = [Axis(0, "stem", -1, stem, np.full(30, 0.5), 1.0)], [], []
    azimuth = rng.uniform(0, 2 * np.pi)
    for number in range(n):
        height = 18 + 45 * number / n
        azimuth += step + rng.normal(0, 0.25)
        length = rng.uniform(7, 18)
        foot = np.array([np.interp(height, up, stem[:, 0]), 0, height])
        curve = foot + np.linspace(0, 1, 20)[:, None] * length * np.array([np.cos(azimuth), np.sin(azimuth), 0.6])
        axes.append(Axis(number + 1, "fruiting", 0, curve, np.full(20, 0.2), 1.0, (number + 1,)))
        bolls.append(BollOnMap(number + 1, number + 1, 1, curve[-1:], length, 1, 1.0, 1.0))
        centres.append(curve[-1] + (0, 0, 2))
    plant_map = PlantMap(tuple(axes), tuple(bolls)) if branches else NO_MAP
    return Layout(np.array(centres), tuple(range(1, n + 1)) if branches else (0,) * n, plant_map)


def leaning(turn_deg, lean_deg=0.0, towards_deg=0.0):
    """(3, 3): a lean towards a side, then a turn about the vertical."""
    side, angle = np.radians(towards_deg), np.radians(lean_deg)
    tilt = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return about_vertical(np.radians(turn_deg)) @ about_vertical(side) @ tilt @ about_vertical(-side)


def filmed_again(layout, rotation, shift=(0, 0, 0), kept=None, noise_cm=0.0, seed=0):
    """The layout as a film sees it whose frame is another; `kept`: rows of the bolls that are left."""
    rng = np.random.default_rng(seed)
    kept = np.arange(len(layout.centres_cm)) if kept is None else np.asarray(kept, int)

    def seen(points, noise):
        return points @ rotation.T + np.asarray(shift, float) + rng.normal(0, noise, points.shape)

    plant_map = layout.plant_map
    if plant_map.axes:
        axes = tuple(replace(axis, curve=seen(axis.curve, noise_cm / 2), bolls=()) for axis in plant_map.axes)
        bolls = tuple(boll for boll in plant_map.bolls if boll.boll_id - 1 in kept)
        plant_map = PlantMap(axes, bolls)
    return Layout(seen(layout.centres_cm[kept], noise_cm), tuple(layout.branch_of[row] for row in kept), plant_map)


def save_film(folder: Path, layout, volumes_cm3, ids=None, error_pct=5.0, traits=None):
    """A plant's folder with the tables and the map of a finished plant, and nothing else.

    Args:
        traits: cells of traits.csv besides count and volume.
    """
    out = folder / "traits"
    out.mkdir(parents=True)
    (out / OWNER_MARK).touch()
    ids = list(range(1, len(layout.centres_cm) + 1)) if ids is None else list(ids)
    volumes = np.asarray(volumes_cm3, float)
    rows = []
    for boll_id, centre, volume in zip(ids, layout.centres_cm, volumes, strict=True):
        boll = BollTraits(boll_id, centre, volume, volume, (6 * volume / np.pi) ** (1 / 3), 100, 20, 0.99,
                          volume_error_cm3=volume * error_pct / 100)  # fmt: skip
        rows.append({"plant_id": folder.name} | cells_of(boll, BollMapTraits(), BollColour()))
    row = dict.fromkeys(column.name for column in TRAITS) | {
        "plant_id": folder.name, "scale_source": "table", "seconds": 1.0, "version": "test",
        "boll_count": len(ids), "boll_count_error": 0.3,
        "boll_volume_cm3": float(volumes.sum()), "boll_volume_error_cm3": float(volumes.sum()) * error_pct / 100,
    }  # fmt: skip
    (out / "traits.csv").write_text(csv_text(TRAITS, [row | (traits or {})]), newline="")
    (out / "bolls.csv").write_text(csv_text(BOLLS, rows), newline="")
    plant_map = replace(
        layout.plant_map,
        bolls=tuple(replace(boll, boll_id=boll_id) for boll, boll_id in zip(layout.plant_map.bolls, ids, strict=False)),
    )
    describe_map(plant_map).save(out / "skeleton.json")
    return folder
