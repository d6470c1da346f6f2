# SPDX-License-Identifier: Apache-2.0
"""Starting Gaussians and dense points."""

import cv2
import numpy as np
import pytest
from scenes.training_scene import orbit_camera

from cotton3dg.core.scene import Camera
from cotton3dg.errors import CaptureFailed
from cotton3dg.gaussians.views import View
from cotton3dg.options import TrainOptions
from cotton3dg.train.flow_points import find_dense_points, find_neighbouring_pairs
from cotton3dg.train.initialise import (
    FILL_OPACITY,
    FILL_REACH,
    LARGEST_SCALE,
    START_OPACITY,
    fill,
    place_gaussians,
    start_gaussians,
    starting_scales,
)
from cotton3dg.train.schedule import image_order


def grey(n: int) -> np.ndarray:
    return np.full((n, 3), 128, np.uint8)


def test_scale_is_the_root_mean_square_distance_to_three_neighbours() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3], [-4, 0, 0]])
    assert starting_scales(points)[0] == pytest.approx(np.sqrt((1 + 4 + 9) / 3))


def test_a_gaussian_a_point_and_no_more_where_that_is_asked_for() -> None:
    """The points of structure from motion, faint as in Kerbl et al.; no dense points, no filling."""
    points = np.random.default_rng(2).normal(size=(30, 3))
    views = [View(orbit_camera(k), np.zeros((48, 64, 3), np.uint8)) for k in range(3)]
    gaussians = start_gaussians(points, grey(30), views, TrainOptions(start="points", max_gaussians=1000))
    np.testing.assert_allclose(gaussians.means, points, rtol=1e-6)
    np.testing.assert_allclose(gaussians.opacities, 0.1, rtol=1e-5)
    np.testing.assert_allclose(gaussians.scales[:, 0], starting_scales(points), rtol=1e-5)


def test_colour_opacity_and_rotation_of_the_start() -> None:
    colours = np.random.default_rng(0).integers(0, 256, (20, 3)).astype(np.uint8)
    gaussians = place_gaussians(np.random.default_rng(1).normal(size=(20, 3)), colours, 2, 100, 0)
    np.testing.assert_allclose(gaussians.colours * 255, colours, atol=1e-3)
    np.testing.assert_allclose(gaussians.opacities, START_OPACITY, rtol=1e-6)
    np.testing.assert_array_equal(gaussians.quats, np.tile([1, 0, 0, 0], (20, 1)))
    assert gaussians.sh.shape == (20, 9, 3)
    assert not gaussians.sh[:, 1:].any()


@pytest.mark.parametrize("where", [0.0, 1.0, -1e6])
def test_identical_points_have_finite_scales(where: float) -> None:
    gaussians = place_gaussians(np.full((100, 3), where), grey(100), 0, 1000, 0)
    assert gaussians.finite_rows.all()
    assert (gaussians.scales > 0).all()


def test_duplicates_and_outliers_among_good_points_keep_to_the_typical_scale() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(5.0)] * 3), axis=-1).reshape(-1, 3)
    points = np.concatenate([grid, np.tile(grid[0], (10, 1)), [[1e7, 0, 0]]])
    scales = starting_scales(points)
    assert np.isfinite(scales).all()
    assert scales.min() >= 1e-5
    assert scales[-1] == pytest.approx(LARGEST_SCALE * np.median(scales[scales > 0]))


def test_scales_follow_the_scene_size() -> None:
    points = np.random.default_rng(2).normal(size=(50, 3))
    np.testing.assert_allclose(starting_scales(points * 1e-3), starting_scales(points) * 1e-3, rtol=1e-9)


def test_points_that_are_not_finite_are_left_out_and_too_few_are_refused() -> None:
    points = np.random.default_rng(3).normal(size=(6, 3))
    points[0, 1], points[1, 2] = np.nan, np.inf
    assert len(place_gaussians(points, grey(6), 0, 100, 0)) == 4
    points[2, 0] = np.nan
    with pytest.raises(CaptureFailed, match="3 usable points"):
        place_gaussians(points, grey(6), 0, 100, 0)


def test_budget_holds_and_the_choice_is_seeded() -> None:
    points = np.random.default_rng(4).normal(size=(500, 3))
    first, again, other = (place_gaussians(points, grey(500), 0, 60, seed) for seed in (1, 1, 2))
    assert len(first) == 60
    assert first.sha256() == again.sha256() != other.sha256()


def views_of_a_plane(n_views: int) -> list[View]:
    """Views of the textured plane z = 0 by cameras 10 su in front of it, side by side, 0.5 su apart."""
    rough = cv2.GaussianBlur(np.random.default_rng(5).uniform(0, 255, (160, 640)), (0, 0), 2.0)
    texture = np.clip((rough - 127) * 6 + 127, 0, 255).astype(np.uint8)
    views = []
    for i in range(n_views):
        # A focal length of 200 px makes 0.5 su on the plane 10 px of the image.
        pose = np.concatenate([np.eye(3), [[-0.5 * i], [0.0], [10.0]]], axis=1)
        camera = Camera(f"{i}", 240, 160, 200.0, 200.0, 120.0, 80.0, pose)
        views.append(View(camera, np.repeat(texture[:, 10 * i : 10 * i + 240, None], 3, axis=2)))
    return views


def test_dense_points_lie_on_the_surface_and_have_its_colour() -> None:
    views = views_of_a_plane(5)
    points, colours = find_dense_points(views, np.zeros((4, 3)), 2000, 0)
    assert 1000 < len(points) <= 2000
    assert np.quantile(np.abs(points[:, 2]), 0.95) < 0.3
    pixels, _ = views[2].camera.project(points)
    inside = ((pixels > 1) & (pixels < (239, 159))).all(axis=1)
    columns, rows = pixels[inside].astype(int).T
    assert np.abs(views[2].image[rows, columns, 0].astype(float) - colours[inside, 0]).mean() < 12


def test_each_part_of_a_training_draws_numbers_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the same ones the filling, say, would follow the order of the images."""
    views, points = views_of_a_plane(5), np.random.default_rng(4).normal(size=(500, 3))
    honest, drawn = np.random.default_rng, []

    def open_generator(seed):
        drawn.append(honest(seed).random())
        return honest(seed)

    monkeypatch.setattr(np.random, "default_rng", open_generator)
    find_dense_points(views, np.zeros((4, 3)), 50, seed=0)
    place_gaussians(points, grey(500), 0, 60, seed=0)
    fill([orbit_camera(angle) for angle in (0.0, 2.0, 4.0)], 10, 0, seed=0)
    image_order(len(views), 10, seed=0)
    assert len(drawn) == len(set(drawn)) == 4


def test_flat_or_single_images_give_no_dense_points() -> None:
    views = views_of_a_plane(3)
    assert len(find_dense_points(views[:1], np.zeros((4, 3)), 100, 0)[0]) == 0
    assert len(find_dense_points(views, np.zeros((0, 3)), 100, 0)[0]) == 0
    tiny = [View(view.camera.resized(12, 8), np.zeros((8, 12, 3), np.uint8)) for view in views]
    assert len(find_dense_points(tiny, np.zeros((4, 3)), 100, 0)[0]) == 0


def test_cameras_are_paired_by_parallax() -> None:
    cameras = [view.camera for view in views_of_a_plane(30)]
    pairs = find_neighbouring_pairs(cameras, np.zeros((4, 3)))
    distances = [j - i for i, j in pairs]
    # 6 degrees at 10 su are 1.05 su, two cameras on.
    assert min(distances) >= 1
    assert max(distances) <= 4
    assert distances.count(2) == 28


def test_the_filling_is_even_faint_and_where_the_cameras_look() -> None:
    cameras = []
    for angle in np.arange(0, 2 * np.pi, 0.5):
        forward = -np.array([np.cos(angle), np.sin(angle), 0])
        rotation = np.stack([np.cross([0, 0, -1], forward), [0, 0, -1], forward])
        centre = np.array([5.0, 0, 0]) - 2 * forward
        pose = np.column_stack([rotation, -rotation @ centre])
        cameras.append(Camera(f"{angle:.1f}", 64, 48, 60, 60, 32, 24, pose))
    gaussians = fill(cameras, 4000, 1, seed=3)
    distances = np.linalg.norm(gaussians.means - (5, 0, 0), axis=1)
    assert distances.max() <= FILL_REACH * 2 * 1.001
    # Evenly: half of the radius holds an eighth of the volume.
    assert np.mean(distances < FILL_REACH) == pytest.approx(1 / 8, abs=0.02)
    np.testing.assert_allclose(gaussians.opacities, FILL_OPACITY, rtol=1e-5)
    np.testing.assert_array_equal(gaussians.means, fill(cameras, 4000, 1, seed=3).means)
    assert len(fill(cameras, 0, 1, seed=3)) == 0
