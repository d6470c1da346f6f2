# SPDX-License-Identifier: Apache-2.0
"""The convex body that Gaussians show."""

import numpy as np
import pytest
from scenes.table_scene import gaussians_at, joined

from cotton3dg.geometry.boxes import fibonacci_directions
from cotton3dg.geometry.convex_measures import calliper_diameter, convex_volume
from cotton3dg.traits.silhouette_hull import OPAQUE, VIEWS, opaque_hull
from cotton3dg.traits.surface import sample_surface, sample_surface_of_volume

BALL_CM3 = 4 / 3 * np.pi


def size_cm(gaussians):
    """Radius of the ball of equal volume."""
    return (convex_volume(opaque_hull(gaussians)).value / BALL_CM3) ** (1 / 3) * 37.0


def test_one_gaussian_ends_where_its_opacity_falls_below_the_limit():
    one = gaussians_at(np.zeros((1, 3)), 1.0, opacity=0.9)
    assert size_cm(one) == pytest.approx(np.sqrt(2 * np.log(0.9 / OPAQUE)), rel=0.02)


def test_few_large_gaussians_and_many_small_ones_of_one_body_are_as_large():
    # Shells whose silhouettes end at 2.5, as training would lay them: larger Gaussians lie deeper.
    fine = gaussians_at(2.24 * fibonacci_directions(600), 0.15)
    coarse = gaussians_at(1.72 * fibonacci_directions(60), 0.5)
    sizes = [size_cm(fine), size_cm(coarse)]
    assert sizes[0] == pytest.approx(sizes[1], rel=0.06)
    centres = [convex_volume(sample_surface(g, 0.0)).value for g in (fine, coarse)]
    assert centres[0] > 2 * centres[1]


def test_size_and_place_do_not_matter():
    points = 2.0 * fibonacci_directions(200) * [1.0, 0.7, 0.5]
    near = convex_volume(opaque_hull(gaussians_at(points, 0.2))).value
    far = convex_volume(opaque_hull(gaussians_at(points + [400.0, -300.0, 100.0], 0.2))).value
    assert far == pytest.approx(near, rel=2e-3)


def test_an_elongated_body_keeps_its_shape():
    long = gaussians_at(fibonacci_directions(600) * [4.0, 2.0, 2.0], 0.2)
    extents = np.ptp(opaque_hull(long) @ np.linalg.svd(long.means - long.means.mean(0))[2].T, axis=0) * 37.0
    # The rim of such a shell lies about two sigma outside.
    assert extents == pytest.approx([8.8, 4.8, 4.8], rel=0.05)


def test_haze_and_a_faint_stray_do_not_enlarge_it():
    body = gaussians_at(2.2 * fibonacci_directions(400), 0.2)
    haze = gaussians_at(np.array([[6.0, 0, 0], [0, 4.0, 0]]), 0.4, opacity=0.3)
    assert size_cm(joined(body, haze)) == pytest.approx(size_cm(body), rel=0.02)


def test_nothing_opaque_has_no_body():
    assert opaque_hull(gaussians_at(np.zeros((0, 3)), 0.2)).shape == (0, 3)
    faint = opaque_hull(gaussians_at(fibonacci_directions(30), 0.2, opacity=0.05))
    assert convex_volume(faint).reason == "too_few_points"


def test_ellipsoids_are_blown_up_to_a_volume():
    body = gaussians_at(2.2 * fibonacci_directions(400), 0.2)
    wanted = convex_volume(opaque_hull(body)).value
    assert convex_volume(sample_surface_of_volume(body, wanted)).value == pytest.approx(wanted, rel=0.02)
    assert calliper_diameter(sample_surface_of_volume(body, wanted)).value * 37 == pytest.approx(
        2 * size_cm(body), rel=0.02
    )


def test_views_are_on_one_side_only():
    """An opposite view shows the same silhouette; all would cost twice the time."""
    sides = fibonacci_directions(2 * VIEWS)[:VIEWS]
    assert (sides[:, 2] > 0).all()
