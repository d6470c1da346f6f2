# SPDX-License-Identifier: Apache-2.0
"""How much of a line in photos something of a known colour covers: pixels by hand."""

import numpy as np
import pytest

from cotton3dg.core.scene import Camera
from cotton3dg.plant_map.photo_lines import COLOUR_SHARE, NOISE, PhotoLines

AHEAD = Camera("a", 60, 40, 50.0, 50.0, 30.0, 20.0, np.eye(4)[:3])
"""Shows z = 1 at 50 px a unit."""
WOOD, WALL = np.array([60.0, 50, 40]), np.array([160.0, 150, 140])


def place(x_px: float, y_px: float) -> np.ndarray:
    """The place at z = 1 whose pixel, counted as OpenCV does, this is."""
    return np.array([(x_px + 0.5 - 30) / 50, (y_px + 0.5 - 20) / 50, 1.0])


def striped(covered: float, column: int = 25) -> np.ndarray:
    photo = np.tile(WALL, (40, 60, 1))
    photo[:, column] = covered * WOOD + (1 - covered) * WALL
    return photo.astype(np.uint8)


def lines(*photos: np.ndarray, hidden: np.ndarray | None = None) -> PhotoLines:
    nothing = np.zeros((40, 60), bool) if hidden is None else hidden
    return PhotoLines([AHEAD] * len(photos), photos, [nothing] * len(photos))


UPWARDS, SIDEWAYS = np.array([[0.0, 1, 0]]), np.array([[1.0, 0, 0]])


@pytest.mark.parametrize("covered", [0.0, 0.3, 1.0])
def test_the_quotient_is_the_share_that_is_covered(covered):
    above, below = lines(striped(covered)).evidence(place(25, 20)[None], UPWARDS, WOOD[None])
    power = 3 * 100.0**2
    assert below[0, 0] == pytest.approx(power / (NOISE**2 + COLOUR_SHARE**2 * power / 3), rel=0.02)
    assert above[0, 0] / below[0, 0] == pytest.approx(covered, abs=0.01)


def test_a_line_across_the_stripe_or_beside_it_is_not_covered():
    seen = lines(striped(1.0))
    above, below = seen.evidence(np.array([place(31, 20), place(33, 10)]), np.repeat(UPWARDS, 2, axis=0), WOOD[None])
    assert above[0] / below[0] == pytest.approx([0, 0], abs=0.01)
    # Across it, both sides show what the middle shows: nothing to tell the wood from.
    above, below = seen.evidence(place(25, 20)[None], SIDEWAYS, WOOD[None])
    assert above[0, 0] == pytest.approx(0, abs=0.01) and below[0, 0] == pytest.approx(0, abs=0.01)


def test_wood_before_what_has_its_colour_tells_nothing():
    photo = np.tile(WOOD, (40, 60, 1)).astype(np.uint8)
    assert lines(photo).evidence(place(25, 20)[None], UPWARDS, WOOD[None])[1][0, 0] == 0


def test_texture_counts_less_than_an_even_wall():
    rough = striped(0.5)
    rough[:, 22], rough[:, 28] = WALL + 60, WALL - 60
    above, below = lines(rough).evidence(place(25, 20)[None], UPWARDS, WOOD[None])
    _, of_even = lines(striped(0.5)).evidence(place(25, 20)[None], UPWARDS, WOOD[None])
    assert above[0, 0] > 0 and 0 < below[0, 0] < 0.9 * of_even[0, 0]


def test_hidden_outside_and_behind_are_not_judged():
    hidden = np.zeros((40, 60), bool)
    hidden[:, 22] = True
    places = np.array([place(25, 20), place(35, 20), place(-5, 20), -place(25, 20)])
    _, below = lines(striped(0.5), hidden=hidden).evidence(places, np.repeat(UPWARDS, 4, axis=0), WOOD[None])
    assert (below[0] > 0).tolist() == [False, True, False, False]


def test_each_photo_has_its_own_word():
    above, below = lines(striped(0.2), striped(0.8)).evidence(place(25, 20)[None], UPWARDS, np.array([WOOD, WOOD]))
    assert above[:, 0] / below[:, 0] == pytest.approx([0.2, 0.8], abs=0.02)


def test_colours_are_medians_over_places():
    places = np.array([place(25, y) for y in range(5, 35)] + [place(40, 20)] * 5)
    assert lines(striped(1.0)).colours(places) == pytest.approx(WOOD[None], abs=1)


def test_what_no_photo_shows_has_no_colour():
    places = np.array([place(25, 20), place(-50, 20), -place(25, 20)])
    assert lines(striped(1.0)).colours(places) == pytest.approx(WOOD[None], abs=1)
    assert lines(striped(1.0)).colours(places[1:]).tolist() == [[0, 0, 0]]


def test_many_places_at_once():
    places = np.repeat(place(25, 20)[None], 20000, axis=0)
    above, below = lines(striped(0.5)).evidence(places, np.repeat(UPWARDS, 20000, axis=0), WOOD[None])
    assert np.ptp(above) == 0 and np.ptp(below) == 0
