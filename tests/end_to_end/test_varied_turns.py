# SPDX-License-Identifier: Apache-2.0
"""The turns around varied plants that judge masks in space: kept, and judged as they are."""

import numpy as np
import pytest
import varied_turns

pytestmark = pytest.mark.slow
SEED = 3


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """The folder of a small turn, and the turn."""
    small = {"VIEWS": 6, "WIDTH": 256, "HEIGHT": 144, "FOCAL_PX": 0.95 * 256, "SUPERSAMPLING": 1, "LEAST_PX": 5.0}
    training = {"steps": "60", "max_gaussians": "5000", "holdout": "0"}
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {**small, "TRAINING": training}.items():
            patch.setattr(varied_turns, name, value)
        folder = tmp_path_factory.mktemp("turns")
        yield folder, varied_turns.open_turn(folder, SEED)


def test_a_turn_is_filmed_once_and_shows_its_bolls(kept, monkeypatch):
    folder, turn = kept
    lint, rest = turn.images[turn.ids > 0], turn.images[turn.ids == 0]
    assert len(np.unique(turn.ids[turn.ids > 0])) >= 8
    assert np.ptp(lint.mean(axis=0)) < np.ptp(lint) / 2, "lint is nearly grey"
    assert len(rest) > len(lint)
    assert 0 < len(turn.gaussians) <= 5000
    monkeypatch.delattr(varied_turns, "film")
    again = varied_turns.open_turn(folder, SEED)
    assert np.array_equal(again.images, turn.images)
    assert np.array_equal(again.cameras[3].cam_from_scene, turn.cameras[3].cam_from_scene)


def test_what_is_far_away_stands_where_it_is():
    around = np.random.default_rng(0).uniform(0, 1, (40, 80, 3)).astype(np.float32)
    place = varied_turns.FAR_M * np.array([0.6, -0.64, 0.48])
    eyes = np.array([[0, 0, 0], [1.6, 0.4, 0.5], [-1.2, -1.1, 0.3]])
    first, *others = (
        varied_turns._background(around, eye, 0.3 * (place - eye)[None, None].astype(np.float32)) for eye in eyes
    )
    for other in others:
        np.testing.assert_allclose(other, first, atol=1e-4)


def test_true_masks_are_right_and_one_that_joins_two_bolls_is_not(kept):
    _, turn = kept
    sizes = np.bincount(turn.ids.ravel())[1:]
    first, second = np.argsort(-sizes)[:2] + 1

    def said(join):
        ids = np.where(turn.ids == second, first, turn.ids) if join else turn.ids
        return varied_turns.score(turn, ids.astype(np.uint16))

    exact, joined = said(join=False), said(join=True)
    assert exact["true"] == exact["bolls"] == (sizes > 0).sum() and exact["false"] == 0
    assert exact["mIoU"] == exact["lint found"] == 1 and exact["lint false"] == exact["larger"] == 0
    assert joined["bolls"] == exact["bolls"] and joined["true"] < exact["true"] and joined["lint found"] == 1
