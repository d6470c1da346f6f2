# SPDX-License-Identifier: Apache-2.0
"""What is kept of a film's keyframes is what was found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from cotton3dg.errors import BadInput
from cotton3dg.sfm.features import Features
from cotton3dg.sfm.keyframes import (
    MODEL,
    Keyframes,
    first_keyframes,
    has_enough_images,
    images_between,
    keyframe_spacing,
    pairs_of_keyframes,
)
from cotton3dg.sfm.matching import PairMatches


@pytest.fixture
def keyframes(tmp_path: Path) -> Keyframes:
    rng = np.random.default_rng(0)
    features = {
        i: Features(rng.random((5 + i, 2), np.float32), rng.integers(0, 255, (5 + i, 128), np.uint8)) for i in (0, 2, 4)
    }
    matches = {
        (0, 2): PairMatches(rng.random((3, 3)), rng.integers(0, 5, (4, 2)).astype(np.uint32)),
        (2, 4): PairMatches(rng.random((3, 3)), rng.integers(0, 5, (0, 2)).astype(np.uint32)),
    }
    return Keyframes((0, 2, 4), features, matches, tmp_path)


def test_all_comes_back(keyframes: Keyframes) -> None:
    keyframes.save()
    loaded = Keyframes.load(keyframes.folder)
    assert loaded.images == (0, 2, 4)
    assert list(loaded.features) == [0, 2, 4]
    assert list(loaded.matches) == [(0, 2), (2, 4)]
    for i in (0, 2, 4):
        np.testing.assert_array_equal(loaded.features[i].places_px, keyframes.features[i].places_px)
        np.testing.assert_array_equal(loaded.features[i].descriptors, keyframes.features[i].descriptors)
    for pair in ((0, 2), (2, 4)):
        np.testing.assert_array_equal(loaded.matches[pair].fundamental, keyframes.matches[pair].fundamental)
        np.testing.assert_array_equal(loaded.matches[pair].rows, keyframes.matches[pair].rows)


def test_without_a_model_there_is_none_and_with_one_it_is_read(keyframes: Keyframes) -> None:
    assert keyframes.read_model() is None
    assert not has_enough_images(None, 3)
    what = pycolmap.SyntheticDatasetOptions()
    what.num_rigs, what.num_frames_per_rig, what.num_points3D = 1, 6, 50
    (keyframes.folder / MODEL).mkdir()
    pycolmap.synthesize_dataset(what).write_binary(keyframes.folder / MODEL)
    model = keyframes.read_model()
    assert model.num_reg_images() == 6
    assert has_enough_images(model, 6)
    assert not has_enough_images(model, 7)


def test_a_damaged_file_is_told(keyframes: Keyframes) -> None:
    keyframes.save()
    (keyframes.folder / "matches.npz").write_bytes(b"nonsense")
    with pytest.raises(BadInput):
        Keyframes.load(keyframes.folder)


def test_films_have_at_least_thirty() -> None:
    assert [keyframe_spacing(n) for n in (10, 59, 60, 96, 100, 150, 400)] == [1, 1, 2, 3, 3, 5, 13]


def test_the_last_image_is_one_of_them() -> None:
    assert first_keyframes(96) == [*range(0, 96, 3), 95]
    assert first_keyframes(97) == list(range(0, 97, 3))
    assert first_keyframes(40) == list(range(40))


def with_in_common(n: int) -> PairMatches:
    return PairMatches(np.eye(3), np.zeros((n, 2), np.uint32))


@pytest.mark.parametrize(
    ("common", "between"),
    [
        ((600, 650, 700), []),
        ((600, 120, 700), [4, 5]),  # a leap
        ((600, 250, 700), []),
        ((130, 140, 110), []),  # a bare room
        ((130, 140, 60), [7, 8]),
        ((80, 70, 60), [1, 2, 4, 5, 7, 8]),
    ],
)
def test_where_neighbours_have_too_little_in_common_what_is_between_becomes_keyframes(
    common: tuple[int, ...], between: list[int]
) -> None:
    matches = {(3 * k, 3 * k + 3): with_in_common(n) for k, n in enumerate(common)}
    assert images_between((0, 3, 6, 9), matches) == between
    del matches[3, 6]
    assert set(images_between((0, 3, 6, 9), matches)) == {*between, 4, 5}


def test_nothing_is_between_images_that_follow_each_other() -> None:
    assert images_between((0, 1, 2), {}) == []
    assert images_between((0,), {}) == []


def test_neighbours_are_matched_however_far_apart_and_no_pair_twice() -> None:
    pairs = [(0, 6), (1, 2), (0, 18), (6, 18)]
    assert pairs_of_keyframes((0, 6, 12, 18), (0, 6, 12, 18), pairs) == [
        (0, 6),
        (0, 12),
        (0, 18),
        (6, 12),
        (6, 18),
        (12, 18),
    ]
    assert pairs_of_keyframes((0, 3, 6, 12, 18), (3,), pairs) == [(0, 3), (3, 6), (3, 12)]
