# SPDX-License-Identifier: Apache-2.0
"""Effects of the camera, one by one: exposure, blur, a rolling shutter."""

from dataclasses import replace

import numpy as np
import pytest
from scenes.simulated_plant import SMALL, small

from cotton3dg.simulate.camera_effects import exposure_ev, film, film_ids
from cotton3dg.simulate.render import develop, instance_ids, render


def test_effects_that_are_off_change_no_pixel():
    _, scene, path = small()
    plain = develop(render(scene, path.at(3), supersampling=SMALL.supersampling))
    assert np.array_equal(film(scene, path, 3, SMALL), plain)
    assert np.array_equal(film_ids(scene, path, 3, SMALL), instance_ids(scene, path.at(3)))
    for effect in ({"blur": 0.5}, {"exposure": 0.5}, {"distortion": -0.05}, {"noise": 3.0}, {"rolling_shutter": 0.5}):
        assert not np.array_equal(film(scene, path, 3, replace(SMALL, **effect)), plain)


def test_exposure_multiplies_the_light_by_powers_of_two():
    light = np.full((2, 2, 3), 0.2, np.float32)
    assert np.array_equal(develop(light, exposure_ev=1.0), develop(2 * light))
    drift = [exposure_ev(frame, replace(SMALL, exposure=0.4)) for frame in range(SMALL.frames)]
    assert 0.3 < max(map(abs, drift)) <= 0.4
    assert np.ptp(drift) > 0.4
    assert exposure_ev(3, SMALL) == 0.0


def test_blur_is_the_mean_of_the_light_while_the_shutter_is_open():
    _, scene, path = small()
    blurred = film(scene, path, 8, replace(SMALL, blur=0.1)).astype(float)
    exact = develop(np.mean([render(scene, path.at(8 + 0.1 * t)) for t in np.linspace(-0.5, 0.5, 25)], axis=0))
    sharp = film(scene, path, 8, SMALL)
    errors = [np.sqrt(((blurred - image) ** 2).mean()) for image in (exact, sharp)]
    assert errors[0] < 6
    assert errors[0] < 0.5 * errors[1]


def test_much_blur_is_no_row_of_sharp_edges():
    _, scene, path = small()
    blurred = film(scene, path, 8, replace(SMALL, blur=1.0)).astype(float)
    exact = develop(np.mean([render(scene, path.at(8 + t)) for t in np.linspace(-0.5, 0.5, 121)], axis=0))
    assert np.sqrt(((blurred - exact) ** 2).mean()) < 3  # grey levels; with 8 renders it is 6


def test_a_rolling_shutter_reads_each_row_at_its_own_time():
    _, scene, path = small()
    options = replace(SMALL, rolling_shutter=0.5)
    rolled, ids = film(scene, path, 8, options).astype(float), film_ids(scene, path, 8, options)
    still = film(scene, path, 8, SMALL)
    for row in (0, 52, 104):
        camera = path.at(8 + 0.5 * ((row + 2) / 108 - 0.5))
        rows = slice(row, row + 4)
        error = np.abs(rolled[rows] - develop(render(scene, camera))[rows]).mean()
        assert error < 0.5
        assert row == 52 or error < 0.1 * np.abs(rolled[rows] - still[rows]).mean()
        assert np.array_equal(ids[rows], instance_ids(scene, camera)[rows])
    assert not np.array_equal(ids, instance_ids(scene, path.at(8)))


def test_a_dark_film_is_that_many_stops_darker():
    dark = replace(SMALL, dark=2.0, exposure=0.5)
    for frame in range(SMALL.frames):
        assert exposure_ev(frame, dark) == pytest.approx(exposure_ev(frame, replace(dark, dark=0.0)) - 2)
    assert exposure_ev(0, replace(SMALL, dark=1.5)) == -1.5
