# SPDX-License-Identifier: Apache-2.0
"""Which masks show which boll, on a few Gaussians whose weights are added up by hand."""

import numpy as np

from cotton3dg.cluster.view_objects import assign_masks
from cotton3dg.core.bolls import BollInstance, BollSelection, LiftedMasks

LABELS = np.array([0, 0, 1, 1, 2, 2, 3], np.int32)


def selection(view, mask_id, indices, weights):
    return BollSelection(view, mask_id, np.array(indices), np.array(weights, np.float32))


def bolls():
    return [BollInstance(k, np.flatnonzero(k == LABELS), ("a", "b"), np.zeros(3), 0.1, 1.0) for k in (1, 2, 3)]


def lifted(*selections):
    nothing = np.zeros(0)
    return LiftedMasks("", ("a", "b"), nothing, nothing, np.zeros((2, 0)), selections)


def test_a_mask_belongs_to_the_boll_with_most_weight_in_it():
    found = assign_masks(
        bolls(),
        lifted(
            selection("a", 3, [2, 3], [2, 2]),
            selection("a", 4, [2, 4, 5], [1, 2, 2]),  # touching bolls in one mask
            selection("b", 7, [0, 1, 3], [3, 3, 2]),  # mostly what is no boll
            selection("b", 8, [0, 3], [2, 2]),
        ),
        LABELS,
    )
    assert [boll.masks for boll in found] == [(("a", 3), ("b", 8)), (("a", 4),), ()]
    assert [boll.boll_id for boll in found] == [1, 2, 3]


def test_without_bolls_no_mask_belongs_to_any():
    assert assign_masks([], lifted(selection("a", 1, [0, 1], [1, 1])), np.zeros(7, np.int32)) == []
