"""Films as people make them, simulated: half a turn, an uneven pace, a cut plant, bare rooms, a turntable, bolls of
other kinds, white things on the table, light from one side."""

from __future__ import annotations

import numpy as np
import pytest

from cotton3dg.commands.simulate import _stage
from cotton3dg.options import SimulateOptions
from cotton3dg.simulate.camera import orbit
from cotton3dg.simulate.camera_effects import film, film_ids
from cotton3dg.simulate.plant import PlantMeshes, grow_plant
from cotton3dg.simulate.room import build_room
from cotton3dg.simulate.truth import plant_truth

SMALL = {"seed": 3, "bolls": 4, "frames": 24, "width": 128, "height": 72, "supersampling": 1}


@pytest.fixture(scope="module")
def plant() -> PlantMeshes:
    return grow_plant(SimulateOptions(**SMALL))


def path_of(plant: PlantMeshes, **options):
    return orbit(SimulateOptions(**SMALL, **options), plant.vertices)


def test_part_of_a_turn(plant: PlantMeshes) -> None:
    assert abs(path_of(plant).turn) > np.radians(360)
    half = path_of(plant, turn_deg=180.0)
    assert abs(half.turn) == pytest.approx(np.pi)
    assert np.sign(half.turn) == np.sign(path_of(plant).turn)


def test_an_uneven_pace_goes_the_same_way(plant: PlantMeshes) -> None:
    even, uneven = path_of(plant), path_of(plant, uneven=0.9)
    for frame in (0, 23):
        a, b = (path.at(frame).centre[:2] / np.linalg.norm(path.at(frame).centre[:2]) for path in (even, uneven))
        np.testing.assert_allclose(a, b, atol=0.01)
    steps = np.linalg.norm(np.diff([camera.centre for camera in uneven.cameras()], axis=0), axis=1)
    assert steps.max() > 5 * steps.min()


@pytest.mark.parametrize("cut", [0.2, 0.5])
def test_the_frame_cuts_the_plant_at_the_top(plant: PlantMeshes, cut: float) -> None:
    low, high = plant.vertices[:, 2].min(), plant.vertices[:, 2].max()
    middle = plant.vertices.mean(axis=0) * (1, 1, 0)
    for camera in path_of(plant, cut=cut).cameras()[::6]:
        places = middle + np.array([[0, 0, high - (cut + d) * (high - low)] for d in (-0.12, 0.12)])
        above, below = camera.project(places)[0][:, 1]
        assert above < 0 < below


def test_a_white_room_is_bare_and_a_pale_table_is_pale(plant: PlantMeshes) -> None:
    pictures = {}
    for name in ("white_room", "pale_table", "seed"):
        options = SimulateOptions(**SMALL | ({name: True} if name != "seed" else {}))
        path = orbit(options, plant.vertices)
        scene, behind = _stage(plant, path, options)
        assert behind is None
        pictures[name] = film(scene, path, 0, options).astype(float)
    assert (
        np.abs(np.diff(pictures["white_room"][:30, :40], axis=1)).mean()
        < 0.4 * np.abs(np.diff(pictures["seed"][:30, :40], axis=1)).mean()
    )
    assert pictures["pale_table"][60:, 40:90].mean() > pictures["seed"][60:, 40:90].mean() + 20


def test_before_a_still_camera_only_the_plant_turns(plant: PlantMeshes) -> None:
    options = SimulateOptions(**SMALL, turntable=True)
    path = orbit(options, plant.vertices)
    scene, behind = _stage(plant, path, options)
    pictures = np.stack([film(scene, path, frame, options, behind) for frame in (0, 6, 12)]).astype(int)
    still = (np.abs(pictures - pictures[0]).max(axis=(0, 3))) == 0
    assert 0.6 < still.mean() < 0.98
    assert still[:, :20].all()
    assert still[:, -20:].all()


@pytest.mark.parametrize("kind", ["usual", "separate", "tight", "fluffy", "drooping", "hanging", "torn", "half_open"])
def test_a_kind_of_boll_changes_the_bolls_and_nothing_else(plant: PlantMeshes, kind: str) -> None:
    options = SimulateOptions(**SMALL, boll_kind=kind)
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
        options = SimulateOptions(**SMALL, boll_kind=kind)
        bolls = plant_truth(grow_plant(options), options)["bolls"]
        lengths[kind] = np.median([boll["max_diameter_cm"] / boll["diameter_cm"] for boll in bolls])
    assert lengths["hanging"] > 1.05 * lengths["tight"]


def test_a_share_of_the_bolls_of_separate_locks_lets_some_hang() -> None:
    lowest = {}
    for share in (0.0, 1.0):
        options = SimulateOptions(**SMALL | {"bolls": 12}, boll_kind="separate", hanging=share)
        plant = grow_plant(options)
        feet = [boll.bur.vertices[:, 2].min() for boll in plant.bolls]
        lints = [boll.lint.vertices[:, 2].min() for boll in plant.bolls]
        lowest[share] = np.mean(np.subtract(feet, lints))
    assert lowest[1.0] > lowest[0.0] + 0.005


def test_things_stand_on_the_table_clear_of_the_plant_and_of_each_other(plant: PlantMeshes) -> None:
    options = SimulateOptions(**SMALL, things=8)
    room = build_room(options, plant.stem_base)
    plain = build_room(SimulateOptions(**SMALL), plant.stem_base)
    assert plain.things == ()
    assert [panel.corner.tolist() for panel in room.panels] == [panel.corner.tolist() for panel in plain.panels]
    assert 4 <= len(room.things) <= 8
    boxes = [(mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)) for mesh in room.things]
    for number, (low, high) in enumerate(boxes):
        assert 0 <= low[2] < 0.002
        assert (low[:2] > (-0.6, -0.3)).all()
        assert (high[:2] < (0.6, 0.3)).all()
        assert ((low > plant.stem_base)[:2] | (high < plant.stem_base)[:2]).any()
        for other_low, other_high in boxes[:number]:
            assert (low[:2] > other_high[:2]).any() or (high[:2] < other_low[:2]).any()
    assert build_room(SimulateOptions(**SMALL, things=8, table=False), plant.stem_base).things == ()


def test_things_are_seen_and_are_no_bolls(plant: PlantMeshes) -> None:
    shown = {}
    for things in (0, 8):
        options = SimulateOptions(**SMALL, things=things)
        path = orbit(options, plant.vertices)
        scene, _ = _stage(plant, path, options)
        shown[things] = film(scene, path, 0, options).astype(int), film_ids(scene, path, 0, options)
    changed = np.abs(shown[8][0] - shown[0][0]).max(axis=2) > 20
    assert changed[45:].mean() > 0.02
    assert (shown[8][1] > 0).any()
    # A thing may hide lint, and shows none.
    assert not ((shown[8][1] > 0) & (shown[0][1] == 0)).any()


def test_beside_a_turning_plant_things_stand_still(plant: PlantMeshes) -> None:
    options = SimulateOptions(**SMALL, turntable=True, things=8)
    path = orbit(options, plant.vertices)
    scene, behind = _stage(plant, path, options)
    bare, empty = _stage(plant, path, SimulateOptions(**SMALL, turntable=True))
    assert behind is not None
    assert empty is not None
    assert (np.abs(behind - empty).max(axis=2) > 0.05).mean() > 0.01
    assert (scene.rays.cast(*rays_of(path)).meshes == bare.rays.cast(*rays_of(path)).meshes).all()


def rays_of(path):
    camera = path.at(0)
    y, x = np.mgrid[:72, :128].reshape(2, -1) + 0.5
    towards = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones(x.size)], axis=1)
    directions = (towards @ camera.rotation).astype(np.float32)
    return np.tile(camera.centre.astype(np.float32), (x.size, 1)), directions


def test_light_from_one_side_leaves_the_other_in_the_dark(plant: PlantMeshes) -> None:
    """Lint around the plant as cameras see it: with one window, one side of it is much darker than the other."""
    spans = {}
    for one_sided in (False, True):
        options = SimulateOptions(**SMALL, one_sided=one_sided)
        path = orbit(options, plant.vertices)
        scene, _ = _stage(plant, path, options)
        assert len(build_room(options, plant.stem_base).lamps) == (1 if one_sided else 3)
        views = []
        for frame in range(0, 24, 4):
            lint = film_ids(scene, path, frame, options) > 0
            views.append(film(scene, path, frame, options)[lint].mean())
        spans[one_sided] = max(views) / min(views)
    assert spans[True] > 1.4
    assert spans[False] < 0.85 * spans[True]
