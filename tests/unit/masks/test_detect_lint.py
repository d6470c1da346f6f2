"""Bolls found in ray-cast images with exact ids."""

import numpy as np
import pytest
from scenes.lint_scene import BOLLS, RADIUS, orbit_cameras, photo, table_points
from scipy import ndimage

from cotton3dg.core.scene import Camera
from cotton3dg.geometry.camera_orbit import fit_orbit
from cotton3dg.masks.detect_lint import detect_lint, draw_overlay, lint_score
from cotton3dg.masks.paint_bolls import divide, lint_pixels, without_specks
from cotton3dg.masks.split_touching import boll_shaped, split_touching, typical_diameter
from cotton3dg.masks.voxel_voting import find_bolls, refine_bolls


def found_share(ids: np.ndarray, truth: np.ndarray) -> tuple[int, int, int]:
    """Matches at IoU 0.5, and the numbers of true and of found masks of at least 30 px."""
    matches = 0
    true = [number for number in np.unique(truth[truth > 0]) if (truth == number).sum() >= 30]
    found = [number for number in np.unique(ids[ids > 0]) if (ids == number).sum() >= 30]
    for number in true:
        inside = truth == number
        matches += any(((ids == other) & inside).sum() > 0.5 * ((ids == other) | inside).sum() for other in found)
    return matches, len(true), len(found)


def names(cameras: list[Camera]) -> list[str]:
    return [camera.name for camera in cameras]


@pytest.fixture(scope="module")
def views():
    cameras = orbit_cameras(24)
    # The exposure drifts by a factor of two on the way.
    photos = [photo(camera, exposure=0.75 + 0.25 * np.sin(k)) for k, camera in enumerate(cameras)]
    return cameras, [image for image, _ in photos], [ids for _, ids in photos]


@pytest.fixture(scope="module")
def masks(views):
    cameras, images, _ = views
    return detect_lint(images, cameras, fit_orbit(cameras), table_points(), names(cameras))


def test_bolls_are_found_and_nothing_else_is(views, masks) -> None:
    cameras, _, truths = views
    matched, true, found = np.sum(
        [found_share(masks.ids[camera.name], truth) for camera, truth in zip(cameras, truths, strict=True)], axis=0
    )
    assert matched / true > 0.95
    assert matched / found > 0.95


def test_the_white_wall_the_posters_and_the_paper_are_no_bolls(views, masks) -> None:
    cameras, _, truths = views
    for camera, truth in zip(cameras, truths, strict=True):
        near = ndimage.binary_dilation(truth > 0, iterations=9)  # half a boll
        assert not masks.ids[camera.name][~near].any()


def test_masks_end_where_bolls_end_before_the_brown_and_the_white_wall(views, masks) -> None:
    cameras, _, truths = views
    for camera, truth in zip(cameras, truths, strict=True):
        found, true = masks.ids[camera.name] > 0, truth > 0
        assert (found & true).sum() > 0.85 * (found | true).sum()


def test_bolls_have_their_place_and_size_in_space(views) -> None:
    cameras, images, _ = views
    volume = find_bolls([lint_score(image) for image in images], cameras, fit_orbit(cameras), np.array([0, 0, 1.0, 0]))
    assert volume.bolls.max() == len(BOLLS)
    for boll in range(1, len(BOLLS) + 1):
        inside = volume.bolls == boll
        away = np.linalg.norm(BOLLS - volume.centres[inside].mean(axis=0), axis=1)
        assert away.min() < 0.3 * RADIUS
        diameter = np.cbrt(6 / np.pi * inside.sum()) * volume.pitch
        assert 0.8 < diameter / (2 * RADIUS) < 1.3
        assert 0.6 < volume.confidence(boll) <= 1


def test_bolls_hidden_from_one_side_are_found(views) -> None:
    """A bur that hides a boll from two fifths of a turn; seen by 60 % of all views it was none."""
    cameras, _, truths = views
    hidden = round(0.4 * len(cameras))
    scores = [((ids > 0) & ((ids != 1) | (k >= hidden))).astype(np.float32) for k, ids in enumerate(truths)]
    volume = find_bolls(scores, cameras, fit_orbit(cameras), np.array([0, 0, 1.0, 0]))
    assert volume.bolls.max() == len(BOLLS)
    centres = np.array([volume.centres[volume.bolls == boll].mean(axis=0) for boll in range(1, len(BOLLS) + 1)])
    assert np.linalg.norm(BOLLS[0] - centres, axis=1).min() < 0.4 * RADIUS


@pytest.mark.parametrize("hidden", [0, 12])
def test_half_a_turn_of_views_is_enough(views, hidden: int) -> None:
    """A video of half a turn has no full arc everywhere; what it shows counts all the same."""
    cameras, _, truths = views
    chosen = slice(hidden, hidden + 12)
    scores = [(ids > 0).astype(np.float32) for ids in truths[chosen]]
    volume = find_bolls(scores, cameras[chosen], fit_orbit(cameras), np.array([0, 0, 1.0, 0]))
    assert volume.bolls.max() == len(BOLLS)


def test_scores_and_masks_belong_together(masks) -> None:
    for name, ids in masks.ids.items():
        assert ids.dtype == np.uint16
        assert set(np.unique(ids[ids > 0]).tolist()) == set(masks.scores[name])
        assert all(0 < score <= 1 for score in masks.scores[name].values())


def test_the_same_images_give_the_same_masks(views, masks) -> None:
    cameras, images, _ = views
    again = detect_lint(images, cameras, fit_orbit(cameras), table_points(), names(cameras))
    for name, ids in masks.ids.items():
        np.testing.assert_array_equal(again.ids[name], ids)


def test_the_unit_of_the_scene_does_not_matter(views, masks) -> None:
    from dataclasses import replace

    cameras, images, _ = views
    scale = 7.3
    larger = [
        replace(camera, cam_from_scene=np.column_stack([camera.rotation, scale * camera.cam_from_scene[:, 3]]))
        for camera in cameras
    ]
    again = detect_lint(images, larger, fit_orbit(larger), scale * table_points(), names(larger))
    differing = np.mean([(again.ids[name] > 0) != (ids > 0) for name, ids in masks.ids.items()])
    assert differing < 1e-3


def test_a_plant_without_bolls_gives_empty_masks() -> None:
    cameras = orbit_cameras(24)
    images = [photo(camera, bolls=np.zeros((0, 3)))[0] for camera in cameras]
    masks = detect_lint(images, cameras, fit_orbit(cameras), table_points(), names(cameras)[::3])
    assert set(masks.ids) == set(names(cameras)[::3])
    assert not any(ids.any() for ids in masks.ids.values())


@pytest.mark.parametrize("value", [0, 128, 255])
def test_flat_images_give_empty_masks(value: int) -> None:
    cameras = orbit_cameras(6)
    images = [np.full((camera.height, camera.width, 3), value, np.uint8) for camera in cameras]
    masks = detect_lint(images, cameras, fit_orbit(cameras), np.zeros((0, 3)), names(cameras))
    assert not any(ids.any() for ids in masks.ids.values())


@pytest.mark.parametrize("exposure", [0.3, 0.6, 1.0])
def test_lint_scores_high_at_any_exposure_and_wood_does_not(exposure: float) -> None:
    image, ids = photo(orbit_cameras(16)[2], exposure=exposure)
    score = lint_score(image)
    assert score.shape == ids.shape and score.min() >= 0 and score.max() <= 1
    assert score[ids > 0].mean() > 0.8
    assert score[220:, 200:280][ids[220:, 200:280] == 0].mean() < 0.1  # the table


def balls(*centres: tuple[float, float, float], radius: float = 5.0, shape: tuple[int, int, int] = (60, 40, 40)):
    places = np.stack(np.meshgrid(*[np.arange(side) for side in shape], indexing="ij"), -1)
    inside = [np.linalg.norm(places - centre, axis=-1) <= radius for centre in centres]
    return np.any(inside, axis=0).astype(np.float32)


def test_touching_balls_are_divided() -> None:
    labels = split_touching(balls((15, 20, 20), (24.5, 20, 20), (45, 20, 20)), 0.6)
    assert labels.max() == 3
    assert len({labels[15, 20, 20], labels[24, 20, 20], labels[45, 20, 20]}) == 3


def test_a_heap_of_bolls_sunk_into_each_other_is_divided() -> None:
    # Four bolls of different size, each 15 % nearer to the next than touching; blurred as votes are.
    places, radii = [(12, 20, 20), (20, 20, 20), (26, 26, 20), (27, 19, 24)], [5.0, 4.5, 5.0, 4.0]
    heap = np.max([balls(place, radius=radius) for place, radius in zip(places, radii, strict=True)], axis=0)
    volume = ndimage.gaussian_filter(np.maximum(heap, balls((48, 20, 20))), 1.0)
    labels = split_touching(volume / volume.max(), 0.6)
    assert labels.max() == 5
    assert len({labels[place] for place in places}) == 4


def test_the_locks_of_one_boll_stay_together() -> None:
    # Four locks of 0.6 boll diameters around a centre, beside two bolls of the same size that are whole.
    locks = balls((12, 17, 20), (12, 23, 20), (18, 17, 20), (18, 23, 20), radius=3.6)
    labels = split_touching(np.maximum(locks, balls((35, 20, 20), (50, 20, 20), radius=6)), 0.6)
    assert labels.max() == 3
    assert len(np.unique(labels[locks > 0])) == 1


def test_sheets_rods_and_specks_are_dropped() -> None:
    volume = balls((15, 20, 20), (45, 20, 20))
    volume[20:40, 10:30, 35:37] = 1
    volume[2:58, 2:4, 2:4] = 1
    volume[30, 30, 10] = 1
    assert split_touching(volume, 0.6).max() == 2


def test_a_flat_cap_of_lint_on_a_bur_is_a_boll() -> None:
    volume = balls((15, 20, 20), (30, 20, 20))
    cap = balls((48, 20, 20), radius=7)
    cap[..., :19] = cap[..., 22:] = 0
    assert split_touching(np.maximum(volume, cap), 0.6).max() == 3


@pytest.mark.parametrize(("apart", "bolls"), [(7, 1), (14, 2)])
def test_a_flat_lock_beside_the_rest_of_its_boll_is_no_boll_of_its_own(apart: int, bolls: int) -> None:
    labels = 2 * balls((40, 20, 20), radius=4).astype(np.int32)
    flat = balls((40 - apart, 20, 20), radius=7) > 0
    flat[..., :19] = flat[..., 22:] = False
    labels[flat & (labels == 0)] = 1
    assert boll_shaped(labels, 10).max() == bolls


def test_weak_contrast_is_no_boll() -> None:
    assert split_touching(0.5 * balls((15, 20, 20)), 0.6).max() == 0


def test_bolls_at_the_border_of_the_volume_are_kept() -> None:
    assert split_touching(balls((3, 4, 4), (30, 20, 20)), 0.6).max() == 2


@pytest.mark.parametrize("shape", [(1, 1, 1), (3, 1, 2), (10, 10, 10)])
def test_empty_volumes_have_no_bolls(shape: tuple[int, int, int]) -> None:
    labels = split_touching(np.zeros(shape, np.float32), 0.6)
    assert labels.shape == shape and labels.max() == 0


def test_typical_diameter_is_that_of_most_parts() -> None:
    volume = balls((12, 20, 20), (30, 20, 20), (48, 20, 20))
    assert typical_diameter(volume) == pytest.approx(10, rel=0.08)


def shaded_ball(darkest: float) -> tuple[np.ndarray, np.ndarray]:
    """A ball of lint before brown, darker and warmer downwards: RGB and its exact mask."""
    y, x = np.mgrid[:120, :120] - 60.0
    ball = np.hypot(x, y) < 18
    light = np.interp(y, [-2, 18], [0.9, darkest])[..., None]
    linear = np.where(
        ball[..., None],
        light * np.stack([np.ones_like(y), light[..., 0] ** 0.3, light[..., 0] ** 0.6], -1),
        [0.1, 0.07, 0.04],
    )
    noise = np.random.default_rng(3).normal(0, 2, linear.shape)
    return np.clip(255 * linear ** (1 / 2.2) + noise, 0, 255).astype(np.uint8), ball


def test_lint_goes_on_into_its_own_shade() -> None:
    image, ball = shaded_ball(0.2)
    lit = np.flatnonzero(ball.any(axis=1))[:24]
    expected = np.zeros(ball.shape, np.uint16)
    expected[lit] = ball[lit]
    lint = lint_pixels(image, lint_score(image), expected, 5.0)
    assert (lint & ball).sum() > 0.95 * (lint | ball).sum()


def test_what_is_far_away_does_not_pass_for_lint_nor_lint_for_it() -> None:
    image, ball = shaded_ball(0.2)
    wall = ~ball & (np.arange(120) > 60)  # of the ball's colour in each line
    image[wall] = image[:, 60:61].repeat(120, axis=1)[wall]
    lit = np.flatnonzero(ball.any(axis=1))[:24]
    expected = np.zeros(ball.shape, np.uint16)
    expected[lit] = ball[lit]
    near = ndimage.binary_dilation(ball | (np.abs(np.arange(120)[:, None] - 80) < 2))  # with a branch below
    overlaps = []
    for known in (None, near):
        lint = lint_pixels(image, lint_score(image), expected, 5.0, known)
        overlaps.append((lint & ball).sum() / (lint | ball).sum())
    assert overlaps[0] < 0.85
    assert overlaps[1] > 0.93


def test_what_shows_little_of_itself_is_kept() -> None:
    image, ball = shaded_ball(0.9)
    strip = ball & (np.abs(np.arange(120) - 60) < 3)  # behind two branches
    image[ball & ~strip] = image[0, 0]
    lint = lint_pixels(image, lint_score(image), strip.astype(np.uint16), 5.0)
    assert (lint & strip).sum() > 0.8 * (lint | strip).sum()


def test_the_crease_divides_two_bolls_not_the_first_guess() -> None:
    y, x = np.mgrid[:80, :120]
    lint = (np.hypot(x - 40, y - 40) < 18) | (np.hypot(x - 74, y - 40) < 18)
    image = np.where(lint[..., None], 230, 40).astype(np.uint8).repeat(3, 2)
    image[:, 57:58] = np.minimum(image[:, 57:58], 150)
    owners = np.where(lint, np.where(x < 60, 1, 2), 0).astype(np.uint16)  # three pixels too far to the right
    ids = divide(image, owners, 4.0)
    assert (ids[lint] > 0).all() and not ids[~lint].any()
    wrong = lint & (ids != np.where(x < 57, 1, 2)) & (abs(x - 57) > 1)
    assert wrong.sum() < 0.2 * (lint & (x > 57) & (x < 60)).sum()


def test_masks_give_bolls_their_shape_and_keep_their_number(views) -> None:
    cameras, images, truths = views
    table = np.array([0, 0, 1.0, 0])
    volume = find_bolls([lint_score(image) for image in images], cameras, fit_orbit(cameras), table)
    refined = refine_bolls(volume, truths, cameras)
    assert set(refined.bolls) == set(volume.bolls)
    for boll in np.unique(refined.bolls):
        centres = refined.centres[refined.bolls == boll]
        away = np.linalg.norm(BOLLS - centres.mean(axis=0), axis=1)
        assert away.min() < 0.15 * RADIUS
        diameter = np.cbrt(6 / np.pi * len(centres)) * refined.pitch
        assert 0.95 < diameter / (2 * RADIUS) < 1.35


def test_specks_are_removed_and_pieces_behind_a_branch_kept() -> None:
    ids = np.zeros((40, 40), np.uint16)
    ids[5:20, 5:12] = ids[5:20, 14:20] = 3  # two halves of one boll beside a branch
    ids[30, 30:33] = 3
    cleaned = without_specks(ids)
    assert not cleaned[30].any()
    np.testing.assert_array_equal(cleaned[:25], ids[:25])


def test_overlay_tints_masks_only() -> None:
    image = np.full((30, 30, 3), 100, np.uint8)
    ids = np.zeros((30, 30), np.uint16)
    ids[5:10, 5:10], ids[15:25, 15:25] = 1, 7
    drawn = draw_overlay(image, ids)
    assert (drawn[ids == 0] == 100).all() and (image == 100).all()
    assert (drawn[ids > 0] != 100).any(axis=1).all()
    assert (drawn[7, 7] != drawn[20, 20]).any()
