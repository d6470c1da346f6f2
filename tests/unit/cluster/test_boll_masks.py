"""Which masks show which boll, on a few Gaussians whose weights are added up by hand."""

from dataclasses import replace

import numpy as np
import pytest

from cotton3dg.cluster.boll_masks import assign_masks, weigh_scores
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


def test_bolls_that_images_told_apart_together_are_as_sure_as_these_are_of_each():
    masks = [(("a", 1), ("b", 1)), (("a", 2), ("b", 2)), ()]
    told = [replace(boll, masks=own) for boll, own in zip(bolls(), masks, strict=True)]
    weighed = weigh_scores(told, {("a", 1): 0.9, ("b", 1): 0.9, ("a", 2): 0.3, ("b", 2): 0.3})
    assert [boll.confidence for boll in weighed] == pytest.approx([0.9, 0.3, 1.0])
    assert [boll.flags for boll in weighed] == [(), ("disputed",), ()]
    assert weighed[2] == told[2]  # no mask says anything of it


def test_without_bolls_no_mask_belongs_to_any():
    assert assign_masks([], lifted(selection("a", 1, [0, 1], [1, 1])), np.zeros(7, np.int32)) == []
