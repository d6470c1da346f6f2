# SPDX-License-Identifier: Apache-2.0
"""What stands about a plant and is none."""

import numpy as np
import pytest

from cotton3dg.simulate import distractors
from cotton3dg.simulate.mesh import SolidNoise


@pytest.mark.parametrize("shape", [distractors._pot, distractors._clamp, distractors._hand])
def test_what_holds_plants_is_closed_and_of_its_size(shape):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        mesh = shape(rng, SolidNoise(rng), np.full(3, 0.8))
        assert 0.06 < np.ptp(mesh.vertices, axis=0).max() < 0.6
        edges = np.sort(mesh.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}
        assert (mesh.colours > 0).all() and (mesh.colours < 1).all()
