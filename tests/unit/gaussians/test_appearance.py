# SPDX-License-Identifier: Apache-2.0
"""Colours of bolls and of depth."""

import numpy as np
import pytest
from scenes.table_scene import orbit, plant_scene

from cotton3dg.gaussians.appearance import boll_colours, depth_colours, recolour_bolls
from cotton3dg.gaussians.rasterizer import render, render_values


def test_every_boll_has_a_colour_of_its_own_and_none_is_grey() -> None:
    colours = boll_colours(np.arange(25, dtype=np.int32))
    assert colours.dtype == np.float32 and colours.min() >= 0 and colours.max() <= 1
    assert np.ptp(colours[0]) == 0 and np.ptp(colours[1:], axis=1).min() > 0.5
    assert len(np.unique(colours.round(3), axis=0)) == 25
    assert np.abs(np.diff(colours[1:], axis=0)).max(axis=1).min() > 0.5


@pytest.mark.parametrize("background", [0.0, 1.0])
def test_bolls_stand_out_and_the_rest_fades_towards_the_background(background: float) -> None:
    gaussians, labels = plant_scene()
    gaussians.sh[:] = np.random.default_rng(0).normal(0, 0.5, gaussians.sh.shape)
    camera = orbit(36, width=480, height=270)[3]
    before = render(gaussians, camera, background=(background,) * 3)
    shown = render(recolour_bolls(gaussians, labels, background), camera, background=(background,) * 3)
    np.testing.assert_array_equal(shown.transmittance, before.transmittance)
    shares = render_values(gaussians, camera, (labels[:, None] == np.arange(5)).astype(np.float32)).image
    expected = boll_colours(np.arange(5, dtype=np.int32))
    for boll in range(1, 5):
        inside = shares[..., boll] > 0.99
        assert inside.sum() > 20
        np.testing.assert_allclose(shown.image[inside], np.tile(expected[boll], (inside.sum(), 1)), atol=0.02)
    rest = (shares[..., 1:].sum(axis=2) < 1e-6) & (before.transmittance < 0.01)
    # Colours below 0 are cut off before they are blended; 0.35 of them are not.
    rest &= (before.image > 0.2).all(axis=2) & (before.image < 0.8).all(axis=2)
    assert rest.sum() > 500
    faded = background + 0.35 * (before.image[rest] - background)
    assert np.abs(shown.image[rest] - faded).mean() < 0.03


def test_near_is_red_far_is_blue_and_nothing_is_background() -> None:
    depth = np.array([[0.5, 1.0, 1.5, 2.0, 9.0, 0.0]], np.float32)
    transmittance = np.array([[0, 0, 0, 0, 0, 1]], np.float32)
    for background in (0.0, 1.0):
        near, also_near, middle, far, farther, nothing = depth_colours(depth, transmittance, 1.0, 2.0, background)[0]
        np.testing.assert_array_equal(near, also_near)
        np.testing.assert_array_equal(far, farther)
        assert near.argmax() == 0 and middle.argmax() == 1 and far.argmax() == 2
        np.testing.assert_array_equal(nothing, [background] * 3)
    half = depth_colours(depth[:, 2:3], np.full((1, 1), 0.5, np.float32), 1.0, 2.0, 1.0)[0, 0]
    np.testing.assert_allclose(half, 0.5 * middle + 0.5)
