# SPDX-License-Identifier: Apache-2.0
"""Open bolls in one image alone: among leaves, faint ones are not believed."""

import numpy as np
import pytest

from cotton3dg.core.network_maps import Maps
from cotton3dg.core.training_picture import CLASSES, LEAF, LINT, OTHER
from cotton3dg.masks.single_image import find_bolls, weigh_evidence
from cotton3dg.masks.test_time_augmentation import mirror

SHAPE = (100, 140)
DIAMETER_PX = 24.0
"""Of the maps."""


class Network:
    """Says the same of every image, mirrored where the right is the brighter side: discs of lint, and leaf from the
    right edge on."""

    def __init__(self, discs: int, lint: float, leaf_share: float):
        y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + np.float32(0.5)
        self.probabilities = np.zeros((len(CLASSES), *SHAPE), np.float32)
        self.votes = np.stack([x, y])
        for number in range(discs):
            cx, cy = 20 + 35 * (number % 3), 25 + 50 * (number // 3)
            inside = (x - cx) ** 2 + (y - cy) ** 2 < DIAMETER_PX**2 / 4
            self.probabilities[LINT][inside] = lint
            self.votes[0][inside], self.votes[1][inside] = cx, cy
        self.probabilities[LEAF][x > SHAPE[1] * (1 - leaf_share)] = 0.9
        self.probabilities[OTHER] = 1 - self.probabilities.sum(axis=0)

    def maps(self, image: np.ndarray, look: float = 1.0) -> Maps:
        nothing = np.zeros(SHAPE, np.float32)
        maps = Maps(self.probabilities, 2 * self.votes, nothing + 2 * DIAMETER_PX, 2.0, image.shape[:2])
        return mirror(maps) if image[:, 0].mean() < image[:, -1].mean() else maps


def found(network: Network) -> int:
    image = np.zeros((2 * SHAPE[0], 2 * SHAPE[1], 3), np.uint8)
    image[:, :10] = 255
    ids, scores = find_bolls(image, network)
    assert set(np.unique(ids[ids > 0])) == set(scores)
    return len(scores)


@pytest.mark.parametrize(
    "discs, lint, leaf_share, wanted",
    [
        (4, 0.45, 0.1, 0),  # faint, among leaves
        (4, 0.95, 0.1, 4),
        (4, 0.45, 0.0, 4),  # no leaf: a defoliated plant in bad light
        (1, 0.95, 0.0, 1),
        (1, 0.95, 0.1, 0),  # a flower could look like it
        (0, 0.0, 0.1, 0),
    ],
)
def test_among_leaves_bolls_have_to_be_sure(discs, lint, leaf_share, wanted):
    assert found(Network(discs, lint, leaf_share)) == wanted


def test_a_boll_seen_whole_without_a_doubt_is_evidence_of_one():
    network = Network(2, 1.0, 0.0)
    maps = network.maps(np.zeros((2 * SHAPE[0], 2 * SHAPE[1], 3), np.uint8))
    ids = np.zeros(maps.image_shape, np.uint16)
    assert weigh_evidence(ids, maps) == 0
    ids[:] = np.where(np.kron(maps.lint, np.ones((2, 2))) > 0.5, 1 + (np.mgrid[:200, :280][1] > 75), 0)
    assert weigh_evidence(ids, maps) == pytest.approx(2, rel=0.06)
    maps.diameters[:] = 1  # ten discs fit into it: no such boll
    assert weigh_evidence(ids, maps) == pytest.approx(2 * 1.5**2)
