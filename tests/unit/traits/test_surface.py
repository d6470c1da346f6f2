# SPDX-License-Identifier: Apache-2.0
"""From Gaussians to points on the surface of a body."""

from dataclasses import replace

import numpy as np
import pytest
from scenes.table_scene import gaussians_at, joined

from cotton3dg.core.scene import Camera, Gaussians
from cotton3dg.gaussians.rasterizer import render
from cotton3dg.geometry.boxes import fibonacci_directions
from cotton3dg.geometry.convex_measures import convex_volume
from cotton3dg.traits.surface import (
    DILATION_PX2,
    dilate_gaussians,
    sample_surface,
    sample_visible_surface,
    surface_rows,
)

BALL_CM = 2.5 * fibonacci_directions(500)


def test_points_lie_on_the_ellipsoids():
    turn = np.array([[np.cos(0.4), 0, 0, np.sin(0.4)]], np.float32) * 3
    one = Gaussians(
        np.array([[1, 2, 3]], np.float32), turn, np.log(np.array([[3, 2, 1]], np.float32)), np.zeros(1, np.float32),
        np.zeros((1, 1, 3), np.float32),
    )  # fmt: skip
    points = sample_surface(one, 2.0, 500) - [1, 2, 3]
    c, s = np.cos(0.8), np.sin(0.8)
    own = points @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    assert np.linalg.norm(own / [6, 4, 2], axis=1) == pytest.approx(np.ones(500), rel=1e-5)


def test_a_body_of_gaussians_has_the_volume_of_its_surface():
    body = gaussians_at(BALL_CM, 0.2)
    points = sample_surface(body[surface_rows(body)], 1.0) * 37.0
    assert convex_volume(points).value == pytest.approx(4 / 3 * np.pi * 2.7**3, rel=0.02)


def test_haze_strays_and_giants_are_left_out():
    body = gaussians_at(BALL_CM, 0.2)
    haze = gaussians_at(BALL_CM[:20] * 1.5, 0.2, opacity=0.05)
    stray = gaussians_at(np.array([[9.0, 0, 0], [0, -7, 0]]), 0.2)
    giant = gaussians_at(BALL_CM[:3], 3.0)
    rows = surface_rows(joined(body, haze, stray, giant))
    assert rows[:500].all()
    assert not rows[500:].any()


def test_nothing_left_is_no_error():
    body = gaussians_at(BALL_CM, 0.2, opacity=0.01)
    assert not surface_rows(body).any()
    assert sample_surface(body[:0], 1.0).shape == (0, 3)


def test_the_visible_surface_lies_where_the_opacity_falls_to_the_limit():
    solid = gaussians_at(np.zeros((1, 3)), 1.0, opacity=0.9)
    points = sample_visible_surface(joined(solid, gaussians_at(np.ones((1, 3)), 1.0, opacity=0.2)), 0.3)
    distances = np.linalg.norm(points - solid.means[0], axis=1) * 37.0
    assert len(points) == 32
    assert 0.9 * np.exp(-(distances**2) / 2) == pytest.approx(np.full(32, 0.3), rel=1e-4)


def test_gaussians_are_as_wide_as_the_renderer_draws_them():
    """A Gaussian far thinner than a pixel is drawn with the variance of the renderer's dilation, and so is measured."""
    pose = np.eye(3, 4)
    pose[2, 3] = 2.0
    camera = Camera("front", 33, 33, 40.0, 40.0, 16.5, 16.5, pose)
    thin = replace(gaussians_at(np.zeros((1, 3)), 1e-4, opacity=0.9), means=np.zeros((1, 3), np.float32))
    pixel_su = 2.0 / camera.fx
    light = 1 - render(thin, camera).transmittance
    row = light[camera.height // 2].astype(np.float64)
    x = np.arange(camera.width) + 0.5
    variance_px2 = (row * (x - camera.cx) ** 2).sum() / row.sum()
    assert variance_px2 == pytest.approx(DILATION_PX2, rel=0.1)
    assert dilate_gaussians(thin, pixel_su).scales == pytest.approx(
        np.full((1, 3), np.sqrt(variance_px2) * pixel_su), rel=0.06
    )


def test_without_pixels_nothing_is_wider():
    body = gaussians_at(BALL_CM, 0.2)
    assert dilate_gaussians(body, 0.0).log_scales == pytest.approx(body.log_scales, abs=1e-6)
