# SPDX-License-Identifier: Apache-2.0
"""Simulated plants: as many bolls as asked, as close as asked, of the kind that was asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes.simulated_plant import SMALL, TINY, small, small_plant
from scipy.spatial import ConvexHull

from cotton3dg.options import SimulateOptions
from cotton3dg.simulate.camera import orbit
from cotton3dg.simulate.camera_effects import film
from cotton3dg.simulate.plant import PlantMeshes, grow_plant
from cotton3dg.simulate.render import light_scene
from cotton3dg.simulate.room import build_room
from cotton3dg.simulate.truth import plant_truth

SIX = replace(SMALL, bolls=6)


def lint_spheres(plant: PlantMeshes) -> tuple[np.ndarray, np.ndarray]:
    """(B, 3) middles of the lint and (B,) radii of spheres as large as its hull, m."""
    volumes = np.array([ConvexHull(boll.lint.vertices).volume for boll in plant.bolls])
    return np.array([boll.lint.vertices.mean(axis=0) for boll in plant.bolls]), np.cbrt(0.75 / np.pi * volumes)


def gaps(plant: PlantMeshes) -> np.ndarray:
    """(B,) distance of each boll's centre to its nearest neighbour's, in sums of the two radii."""
    centres, radii = lint_spheres(plant)
    distances = np.linalg.norm(centres[:, None] - centres, axis=2) / (radii[:, None] + radii)
    return np.where(np.eye(len(radii), dtype=bool), np.inf, distances).min(axis=1)


@pytest.mark.parametrize("seed", range(4))
def test_bolls_are_as_many_and_as_close_as_asked(seed):
    spread = grow_plant(SimulateOptions(seed=seed, bolls=14))
    clustered = grow_plant(SimulateOptions(seed=seed, bolls=14, clustered=0.6))
    assert len(spread.bolls) == len(clustered.bolls) == 14
    assert 8 <= len(grow_plant(SimulateOptions(seed=seed)).bolls) <= 20
    assert gaps(spread).min() > 0.95
    assert (gaps(clustered) < 1.1).sum() >= 8
    assert gaps(clustered).min() > 0.7
    for plant in (spread, clustered):
        heights = lint_spheres(plant)[0][:, 2]
        assert heights.min() > 0.1
        assert heights.max() < 1.0


def test_clustered_bolls_hang_higher_than_the_others():
    plant = grow_plant(SimulateOptions(seed=1, bolls=16, clustered=0.5))
    close = gaps(plant) < 1.1
    heights = lint_spheres(plant)[0][:, 2]
    assert heights[close].mean() > heights[~close].mean()


def test_same_seed_same_bytes_and_another_seed_another_plant():
    plant, scene, path = small()
    again = grow_plant(SMALL)
    assert again.vertices.tobytes() == plant.vertices.tobytes()
    repeated = light_scene(again, build_room(SMALL, again.stem_base))
    assert film(repeated, orbit(SMALL, again.vertices), 5, SMALL).tobytes() == film(scene, path, 5, SMALL).tobytes()
    assert grow_plant(replace(SMALL, seed=4)).vertices.shape != plant.vertices.shape or not np.allclose(
        grow_plant(replace(SMALL, seed=4)).vertices, plant.vertices
    )


def test_touching_bolls_lie_in_each_other_as_deep_as_is_asked_for():
    nearest = {}
    for contact in (0.90, 0.72):
        options = SimulateOptions(seed=605, bolls=20, clustered=0.85, contact=contact)
        bolls = plant_truth(grow_plant(options), options)["bolls"]
        centres = np.array([boll["centre_xyz_m"] for boll in bolls])
        widths = np.array([boll["diameter_cm"] for boll in bolls]) / 100
        apart = np.linalg.norm(centres[:, None] - centres, axis=2) / (0.5 * (widths[:, None] + widths))
        nearest[contact] = (apart + 9 * np.eye(len(apart))).min(axis=1)
    assert (nearest[0.90] < 1).sum() >= 15
    assert (nearest[0.72] < 1).sum() >= 15
    assert 0.65 < nearest[0.72].min() < 0.75 < nearest[0.90].min()


@pytest.mark.parametrize("architecture", ["simple", "natural"])
def test_picked_bolls_are_gone_and_all_else_is_the_same(architecture):
    options = replace(SIX, architecture=architecture)
    before, after = grow_plant(options), grow_plant(replace(options, picked=2))
    assert len(after.bolls) == len(before.bolls) - 2
    np.testing.assert_array_equal(after.wood.vertices, before.wood.vertices)
    np.testing.assert_array_equal(after.bolls[-1].lint.vertices, before.bolls[-3].lint.vertices)
    truths = [plant_truth(plant, options) for plant in (before, after)]
    assert truths[1]["boll_count"] == truths[0]["boll_count"] - 2
    assert [axis["boll_id"] for axis in truths[1]["skeleton"] if axis["boll_id"]] == list(
        range(1, len(after.bolls) + 1)
    )
    assert len(grow_plant(replace(options, picked=60)).bolls) == 0


def test_a_turned_plant_is_the_same_plant_turned_about_its_foot():
    before, after = grow_plant(SIX), grow_plant(replace(SIX, turned_deg=90.0))
    foot = before.stem_base
    np.testing.assert_array_equal(after.stem_base, foot)
    for one, other in zip(before.parts, after.parts, strict=True):
        x, y, z = (one.vertices - foot).T
        np.testing.assert_allclose(other.vertices, foot + np.stack([-y, x, z], axis=1), atol=1e-12)
    truths = [plant_truth(plant, SIX) for plant in (before, after)]
    assert truths[0]["total_boll_convex_volume_cm3"] == truths[1]["total_boll_convex_volume_cm3"]


@pytest.mark.parametrize("kind", ["usual", "separate", "tight", "fluffy", "drooping", "hanging", "torn", "half_open"])
def test_a_kind_of_boll_changes_the_bolls_and_nothing_else(kind: str) -> None:
    plant = small_plant()
    options = replace(TINY, boll_kind=kind)
    other = grow_plant(options)
    assert other.wood.vertices.tobytes() == plant.wood.vertices.tobytes()
    assert other.leaves.vertices.tobytes() == plant.leaves.vertices.tobytes()
    truth, plain = (plant_truth(one, options)["bolls"] for one in (other, plant))
    assert len(truth) == len(plain)
    for ours, theirs in zip(truth, plain, strict=True):
        assert ours["convex_volume_cm3"] != theirs["convex_volume_cm3"]
        assert np.linalg.norm(np.subtract(ours["centre_xyz_m"], theirs["centre_xyz_m"])) < 0.1
    again = grow_plant(options)
    assert again.vertices.tobytes() == other.vertices.tobytes()


def test_hanging_bolls_are_longer_than_tight_ones() -> None:
    lengths = {}
    for kind in ("hanging", "tight"):
        options = replace(TINY, boll_kind=kind)
        bolls = plant_truth(grow_plant(options), options)["bolls"]
        lengths[kind] = np.median([boll["max_diameter_cm"] / boll["diameter_cm"] for boll in bolls])
    assert lengths["hanging"] > 1.05 * lengths["tight"]


def test_a_share_of_the_bolls_of_separate_locks_lets_some_hang() -> None:
    lowest = {}
    for share in (0.0, 1.0):
        options = replace(TINY, bolls=12, boll_kind="separate", hanging=share)
        plant = grow_plant(options)
        feet = [boll.bur.vertices[:, 2].min() for boll in plant.bolls]
        lints = [boll.lint.vertices[:, 2].min() for boll in plant.bolls]
        lowest[share] = np.mean(np.subtract(feet, lints))
    assert lowest[1.0] > lowest[0.0] + 0.005
