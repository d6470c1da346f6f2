# SPDX-License-Identifier: Apache-2.0
"""Features of images and their matches."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from cotton3dg.sfm import matching
from cotton3dg.sfm.features import ROOT_SIFT_NORM, Features, FeatureSettings, find_features, root_sift
from cotton3dg.sfm.matching import find_similar_pairs, match, match_descriptors, verify

WIDTH, HEIGHT = 480, 360


@pytest.fixture(scope="module")
def texture():
    """Smooth noise of many scales, (H, W) grey."""
    rng = np.random.default_rng(0)
    layers = [
        cv2.resize(
            rng.uniform(0, 255, (HEIGHT // s, WIDTH // s)).astype(np.float32),
            (WIDTH, HEIGHT),
            interpolation=cv2.INTER_CUBIC,
        )
        for s in (4, 8, 20)
    ]
    return np.mean(layers, axis=0).clip(0, 255).astype(np.uint8)


def moved(image, matrix):
    """The image after a movement of COLMAP's coordinates (first corner at 0), which OpenCV counts from its middle."""
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    return cv2.warpPerspective(image, np.linalg.inv(half) @ matrix @ half, image.shape[::-1], flags=cv2.INTER_CUBIC)


@pytest.mark.parametrize("far_apart", [False, True])
@pytest.mark.parametrize("max_side", [480, 960])
def test_places_are_counted_from_the_corner_of_the_first_pixel(texture, max_side, far_apart) -> None:
    """A turned and enlarged image has its features where the movement takes them, without a shift."""
    matrix = np.array([[1.1, -0.2, 20.0], [0.2, 1.1, -40.0], [0, 0, 1]])
    first = find_features(texture, FeatureSettings(1000, max_side, far_apart))
    second = find_features(moved(texture, matrix), FeatureSettings(1000, max_side, far_apart))
    rows = match_descriptors(first.descriptors, second.descriptors)
    assert len(rows) > 50
    expected = first.places_px[rows[:, 0]] @ matrix[:2, :2].T + matrix[:2, 2]
    error = second.places_px[rows[:, 1]] - expected
    near = np.linalg.norm(error, axis=1) < 3
    assert near.mean() > 0.9
    assert np.abs(np.median(error[near], axis=0)).max() < 0.1


def test_the_largest_come_first_and_the_limit_holds(texture) -> None:
    few = find_features(texture, FeatureSettings(100, 480, far_apart=True))
    assert len(few.places_px) == len(few.descriptors) == 100
    many = find_features(texture, FeatureSettings(5000, 480, far_apart=True))
    assert len(many.places_px) == len(many.descriptors) > 300
    assert (many.places_px >= 0).all() and (many.places_px <= (WIDTH, HEIGHT)).all()


def test_low_contrast_still_gives_features(texture) -> None:
    """A dark room: a tenth of the light."""
    assert (
        len(find_features((texture // 10).astype(np.uint8), FeatureSettings(2048, 480, far_apart=False)).places_px)
        > 200
    )


@pytest.mark.parametrize("shape", [(1, 1), (3, 200), (40, 30)])
def test_an_image_of_nothing_has_no_features(shape) -> None:
    found = find_features(np.full(shape, 90, np.uint8), FeatureSettings(100, 480, far_apart=True))
    assert found.places_px.shape == (0, 2) and found.descriptors.shape == (0, 128)


def test_root_sift_is_the_hellinger_kernel() -> None:
    given = np.random.default_rng(0).uniform(0, 100, (4, 128)).astype(np.float32)
    rooted = root_sift(given).astype(float) / ROOT_SIFT_NORM
    shares = given / given.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(rooted @ rooted.T, np.sqrt(shares) @ np.sqrt(shares).T, atol=0.01)
    assert (root_sift(np.zeros((1, 128), np.float32)) == 0).all()


def test_a_match_is_mutual_and_distinct() -> None:
    rng = np.random.default_rng(1)
    first = root_sift(rng.exponential(1, (20, 128)).astype(np.float32))
    order = rng.permutation(20)
    assert (match_descriptors(first, first[order])[:, 1] == np.argsort(order)).all()
    twice = np.concatenate([first, first[:5]])  # what is there twice is not distinct
    assert set(match_descriptors(first, twice)[:, 0]) == set(range(5, 20))
    assert set(match_descriptors(twice, first)[:, 1]) == set(range(5, 20))
    assert len(match_descriptors(first, first[:0])) == 0


def test_matches_of_no_one_movement_are_left_out() -> None:
    """Points in space from two places; a fifth of the matches are wrong."""
    rng = np.random.default_rng(2)
    points = rng.uniform((-1, -1, 3), (1, 1, 6), (200, 3))
    places = []
    for shift, turn in ((0.0, 0.0), (0.5, 0.1)):
        seen = points @ cv2.Rodrigues(np.array([0, turn, 0]))[0].T + (shift, 0, 0)
        places.append((500 * seen[:, :2] / seen[:, 2:] + 400).astype(np.float32))
    rows = np.column_stack([np.arange(200)] * 2).astype(np.uint32)
    rows[:40, 1] = rng.permutation(40)
    wrong = np.linalg.norm(places[1][rows[:, 1]] - places[1][rows[:, 0]], axis=1) > 20
    found = verify(*places, rows)
    assert found is not None
    kept = np.isin(np.arange(200), found.rows[:, 0])
    assert kept[~wrong].mean() > 0.98 and kept[wrong].mean() < 0.3
    assert np.array_equal(verify(*places, rows).rows, found.rows)  # the same each time


@pytest.mark.parametrize("count", [0, 14, 200])
def test_what_does_not_fit_together_is_none(count) -> None:
    rng = np.random.default_rng(3)
    places = rng.uniform(0, 1000, (2, 200, 2)).astype(np.float32)
    rows = np.column_stack([np.arange(count), rng.permutation(count)]).astype(np.uint32)
    found = verify(*places, rows)
    assert found is None or len(found.rows) < 0.3 * count


def test_features_in_one_place_and_none_at_all_do_not_stop_it() -> None:
    same, rows = np.full((200, 2), 5.0, np.float32), np.column_stack([np.arange(200)] * 2).astype(np.uint32)
    found = verify(same, same, rows)
    assert found is None or len(found.rows) <= 200
    nothing = Features(np.zeros((0, 2), np.float32), np.zeros((0, 128), np.uint8))
    assert match(nothing, nothing) is None
    assert match(nothing, Features(same, np.zeros((200, 128), np.uint8))) is None


def described(rng, count):
    return root_sift(rng.exponential(1, (count, 128)).astype(np.float32))


def test_images_are_matched_with_those_like_them_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten images in a ring that share features with two neighbours on each side; one more shows something else."""
    rng = np.random.default_rng(5)
    parts = [described(rng, 60) for _ in range(10)]
    images = [np.concatenate([parts[(i + k) % 10] for k in range(3)]) for i in range(10)]
    images.append(described(rng, 180))
    features = [Features(np.zeros((len(each), 2), np.float32), each) for each in images]
    pairs = [(i, j) for i in range(11) for j in range(i + 1, 11)]
    assert find_similar_pairs(features, pairs, most=8) == pairs  # so few are all matched
    monkeypatch.setattr(matching, "ALL_PAIRS", 0)
    near = {(i, j) for i, j in pairs if j < 10 and min(j - i, 10 - j + i) <= 2}
    # The stranger is like none: it is matched with all, as the quick look may have missed what they share.
    assert find_similar_pairs(features, pairs, most=8) == sorted(near | {pair for pair in pairs if 10 in pair})


def test_alike_images_beyond_the_most_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matching, "ALL_PAIRS", 0)
    rng = np.random.default_rng(6)
    common = described(rng, 100)
    features = [
        Features(np.zeros((100, 2), np.float32), np.concatenate([common[: 40 + 5 * i], described(rng, 60 - 5 * i)]))
        for i in range(8)
    ]
    pairs = [(i, j) for i in range(8) for j in range(i + 1, 8)]
    kept = find_similar_pairs(features, pairs, most=3)
    assert (6, 7) in kept and (0, 1) not in kept
    degree = [sum(i in pair for pair in kept) for i in range(8)]
    assert min(degree) == 3
    assert find_similar_pairs(features, pairs, most=7) == pairs
