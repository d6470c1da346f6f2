# SPDX-License-Identifier: Apache-2.0
"""Twigs that the model lacks, followed in photos that show them, and nothing where there is none."""

import cv2
import numpy as np
import pytest
from scenes.documents import table_scale
from scenes.table_scene import FOOT_CM, POSE, gaussians_at, joined, orbit

from cotton3dg.core.plant_map import Axis, PlantMap
from cotton3dg.core.scene import Gaussians
from cotton3dg.geometry.polylines import nearest_on, resampled
from cotton3dg.plant_map.photo_lines import PhotoLines
from cotton3dg.plant_map.thin_twigs import Trail, follow_thin_twigs

SCALE = table_scale().scale
FOOT = POSE.scene(FOOT_CM[None])[0]
TWIG = resampled(np.array([[0, 0, 30.0], [9, 2, 34], [18, 5, 35], [24, 9, 34]]), 0.25)
"""cm from the foot; a turn of some degrees at each knot."""
MODELLED_CM = 10.0
WOOD = (70, 55, 45)
CAMERAS = orbit(40)


def in_scene(places_cm: np.ndarray) -> np.ndarray:
    return FOOT + places_cm @ SCALE.table_frame / SCALE.cm_per_su


def photo_of(curves_px: list[np.ndarray], width_px: float, number: int) -> np.ndarray:
    """Thin lines before a blotchy wall, with noise."""
    rng = np.random.default_rng(number)
    wall = cv2.GaussianBlur(rng.normal(0, 1, (270, 480, 3)), (0, 0), 6)
    wall = 150 + 25 * wall / wall.std()
    cover = np.zeros((8 * 270, 8 * 480), np.uint8)
    for curve in curves_px:
        cv2.polylines(cover, [np.round(8 * curve).astype(np.int32)[:, None]], False, 255, max(1, round(8 * width_px)))
    covered = cv2.resize(cover, (480, 270), interpolation=cv2.INTER_AREA)[..., None] / 255
    return np.clip(covered * WOOD + (1 - covered) * wall + rng.normal(0, 4, wall.shape), 0, 255).astype(np.uint8)


def photos(*curves: np.ndarray, width_px: float = 0.8) -> dict[str, np.ndarray]:
    return {
        camera.name: photo_of([camera.project(in_scene(curve))[0] for curve in curves], width_px, number)
        for number, camera in enumerate(CAMERAS)
    }


def modelled(curve: np.ndarray, size_cm: float = 0.25) -> Gaussians:
    return gaussians_at(in_scene_cm(curve), size_cm)


def in_scene_cm(curve: np.ndarray) -> np.ndarray:
    """In the table's own frame, which `gaussians_at` takes."""
    return POSE.cm(in_scene(curve))


def map_of(*curves: np.ndarray) -> PlantMap:
    """Each curve as the axis of its rank."""
    return PlantMap(
        tuple(
            Axis(k, "fruiting" if k else "stem", k - 1, curve, np.full(len(curve), 0.1), 1.0)
            for k, curve in enumerate(curves)
        ),
        (),
    )


def followed(seen: dict[str, np.ndarray], curve: np.ndarray, *more: np.ndarray) -> list[Trail]:
    model = joined(*(modelled(one) for one in (curve, *more)))
    return follow_thin_twigs(map_of(curve), model, SCALE, FOOT, CAMERAS, seen.__getitem__)


SHOWN = TWIG[: int(MODELLED_CM / 0.25)]
"""What the model has of it."""


@pytest.mark.parametrize("width_px", [0.5, 0.8, 1.5])
def test_a_lost_twig_is_followed_to_its_end(width_px):
    (end,) = followed(photos(TWIG, width_px=width_px), SHOWN)
    assert not end.meets_model
    assert end.places[0] == pytest.approx(SHOWN[-1])
    assert nearest_on(TWIG, end.places)[0].max() < 0.8
    assert np.linalg.norm(end.places[-1] - TWIG[-1]) < 1.5


def test_where_a_twig_ends_nothing_is_followed():
    assert followed(photos(SHOWN), SHOWN) == []


def test_a_gap_before_what_the_model_has_is_no_end():
    rest = TWIG[int(18 / 0.25) :]
    (gap,) = followed(photos(TWIG), SHOWN, rest)
    assert gap.meets_model
    assert np.linalg.norm(gap.places[-1] - rest[0]) < 3


def test_another_twig_that_crosses_is_not_followed():
    across = SHOWN[-1] + np.linspace([0, -12, -9], [0, 12, 9], 80)
    assert followed(photos(SHOWN, across), SHOWN) == []


def test_a_faint_end_is_measured_to_where_the_photos_show_it():
    """The map follows faint Gaussians farther than the twig goes."""
    axis = np.vstack([SHOWN, SHOWN[-1] + np.linspace([0.25, 0.1, 0], [20, 6, 0], 60)])
    twig = TWIG[: int(18 / 0.25)]
    seen = photos(twig)
    (end,) = follow_thin_twigs(map_of(axis), modelled(SHOWN), SCALE, FOOT, CAMERAS, seen.__getitem__)
    assert np.linalg.norm(end.places[0] - SHOWN[-1]) < 1
    assert np.linalg.norm(end.places[-1] - twig[-1]) < 1.5


def test_a_speck_that_bends_an_axis_hides_no_twig():
    """The axis turns to a speck beside the twig, so that nothing goes on from its end, but from before."""
    bent = resampled(np.vstack([SHOWN[:-5], SHOWN[-1] + [0, -1.2, -0.8]]), 0.25)
    seen = photos(TWIG)
    (end,) = follow_thin_twigs(map_of(bent), modelled(bent), SCALE, FOOT, CAMERAS, seen.__getitem__)
    assert np.linalg.norm(end.places[-1] - TWIG[-1]) < 1.5


def test_without_a_map_or_photos_there_are_no_ends():
    assert follow_thin_twigs(PlantMap((), ()), modelled(SHOWN), SCALE, FOOT, CAMERAS, {}.__getitem__) == []
    assert follow_thin_twigs(map_of(SHOWN), modelled(SHOWN), SCALE, FOOT, [], {}.__getitem__) == []


def test_lines_are_in_the_plant_frame():
    """The camera that took the photo and the one that the lines are judged with see a place in the same pixel."""
    seen: list[PhotoLines] = []

    class Kept(PhotoLines):
        def __init__(self, *given):
            super().__init__(*given)
            seen.append(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cotton3dg.plant_map.thin_twigs.PhotoLines", Kept)
        followed(photos(SHOWN), SHOWN)
    for own, camera in zip(seen[0].cameras, CAMERAS, strict=True):
        assert own.project(TWIG)[0] == pytest.approx(camera.project(in_scene(TWIG))[0], abs=1e-6)
