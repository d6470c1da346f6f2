# SPDX-License-Identifier: Apache-2.0
"""What `make same-boll` fits, on examples whose answer is known."""

import numpy as np
import pytest
from same_boll import fit_deviation

from cotton3dg.cluster.same_boll import logistic


@pytest.mark.parametrize("true", [0.0, 1.0])
def test_the_deviation_between_plants_is_found(true):
    rng = np.random.default_rng(3)
    plants = []
    for _ in range(400):
        shift = rng.normal(0, true)
        odds = rng.normal(1.5, 1, 15)
        one = rng.random(15) < [logistic(value + shift) for value in odds]
        plants.append([(logistic(value), int(so)) for value, so in zip(odds, one, strict=True)])
    assert fit_deviation(plants) == pytest.approx(true, abs=0.2)


def test_bolls_that_are_certain_say_nothing_of_it():
    assert fit_deviation([[(1.0, 1)] * 9, []]) == 0
