"""Films as people make them, simulated: half a turn, an uneven pace, a cut plant, bare rooms, a turntable."""

from __future__ import annotations

import numpy as np
import pytest

from cotton3dg.commands.simulate import _stage
from cotton3dg.options import SimulateOptions
from cotton3dg.simulate.camera import orbit
from cotton3dg.simulate.film import film
from cotton3dg.simulate.plant import PlantMeshes, grow_plant

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
