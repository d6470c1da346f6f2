# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from scenes.orbit_scene import orbit

from cotton3dg.geometry.camera_orbit import fit_orbit, within_orbit
from cotton3dg.segment.lift import RIM_ID, ViewWeights, lift, mark_rim, resize_ids, rim_width_px


def view(name, total, entries):
    rows, ids, weights = (np.array(column) for column in zip(*entries, strict=True)) if entries else np.zeros((3, 0))
    return ViewWeights(
        name, np.array(total, np.float32), rows.astype(np.int64), ids.astype(np.uint16), weights.astype(np.float32)
    )


def test_weights_become_selections_without_the_rim():
    first = view("b.jpg", [4, 4, 4, 0], [(0, 7, 3.0), (0, RIM_ID, 1.0), (1, 2, 1.5), (2, 7, 0.5)])
    second = view("a.jpg", [2, 2, 2, 2], [(0, 1, 2.0), (1, 1, 0.5)])
    lifted = lift([first, second], np.ones(4, bool), "sha")
    assert lifted.views == ("a.jpg", "b.jpg")
    # 0: 5 of 5 px, 1: 2 of 6, 2: 0.5 of 6, 3: none.
    assert lifted.candidates.tolist() == [0, 1]
    assert lifted.foreground == pytest.approx([1.0, 2 / 6])
    assert lifted.seen.tolist() == [[2, 2], [3, 4]]
    found = [(s.view, s.mask_id, s.indices.tolist(), s.weights.tolist()) for s in lifted.selections]
    assert found == [("a.jpg", 1, [0, 1], [2.0, 0.5]), ("b.jpg", 2, [1], [1.5]), ("b.jpg", 7, [0], [3.0])]


def test_the_order_of_views_is_of_no_consequence():
    views = [view(f"{k}.jpg", [2, 3], [(0, 1, 1.5 + k / 8), (1, 2, 2.0)]) for k in range(4)]
    forward, backward = (lift(order, np.ones(2, bool), "") for order in (views, views[::-1]))
    assert forward.views == backward.views
    assert np.array_equal(forward.seen, backward.seen)
    assert [s.mask_id for s in forward.selections] == [s.mask_id for s in backward.selections]


def test_gaussians_that_are_not_allowed_are_no_candidates():
    lifted = lift([view("a.jpg", [2, 2], [(0, 1, 2.0), (1, 1, 2.0)])], np.array([False, True]), "")
    assert lifted.candidates.tolist() == [1]
    assert lifted.selections[0].indices.tolist() == [1]


@pytest.mark.parametrize("views", [[], [view("a.jpg", [1.0, 2.0], [])]])
def test_no_masks_are_a_valid_answer(views):
    lifted = lift(views, np.ones(2, bool), "")
    assert lifted.selections == () and len(lifted.candidates) == 0
    assert lifted.seen.shape == (len(views), 0)


def test_the_rim_lies_on_both_sides_of_every_edge():
    ids = np.zeros((7, 9), np.uint16)
    ids[:, 3:6], ids[:, 6:] = 1, 2
    assert mark_rim(ids, 1)[0].tolist() == [0, 0, RIM_ID, RIM_ID, 1, RIM_ID, RIM_ID, 2, 2]
    assert mark_rim(ids, 2)[0].tolist() == [0, *[RIM_ID] * 7, 2]
    assert (mark_rim(np.full((4, 5), 3, np.uint16), 2) == 3).all()


@pytest.mark.parametrize(("side", "expected"), [(None, 1), (10, 1), (36, 2), (200, 3)])
def test_the_rim_grows_with_the_masks(side, expected):
    ids = np.zeros((220, 220), np.uint16)
    if side:
        ids[5 : 5 + side, 5 : 5 + side] = 4
    assert rim_width_px([ids]) == expected
    assert rim_width_px([]) == 1


def test_ids_are_resized_without_new_values():
    ids = np.arange(1, 13, dtype=np.uint16).reshape(3, 4)
    assert resize_ids(ids, 8, 6).tolist() == np.kron(ids, np.ones((2, 2), int)).tolist()
    assert np.array_equal(resize_ids(resize_ids(ids, 8, 6), 4, 3), ids)


def test_only_what_stands_inside_the_orbit_can_be_a_boll():
    cameras = orbit(12)
    points = np.array([[0, 0, 30], [20, 5, 50], [0, 200, 40], [-109, 0, 60]], np.float32)
    assert within_orbit(points, cameras, fit_orbit(cameras)).tolist() == [True, True, False, False]
    outwards = [replace(view, cam_from_scene=np.diag([-1.0, 1, -1]) @ view.cam_from_scene) for view in cameras]
    assert within_orbit(points, outwards, fit_orbit(outwards)).all(), "no point that the cameras look at"
