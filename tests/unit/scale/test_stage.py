# SPDX-License-Identifier: Apache-2.0
"""Reflectances of the card's patches as the stage takes them."""

import pytest

from cotton3dg.errors import BadUsage
from cotton3dg.scale import stage as scale


@pytest.mark.parametrize("text", ["86,53", "4,6,14,29,53,86", "white", "860,53,29,14,6,4", "86,53,29,14,6,-1"])
def test_reflectances_that_are_none(text):
    with pytest.raises(BadUsage, match="falling reflectances"):
        scale._reflectances(text)


def test_reflectances_as_measured_and_usual():
    assert scale._reflectances("86,53,29,14,6,4") == pytest.approx((0.86, 0.53, 0.29, 0.14, 0.06, 0.04))
    assert scale._reflectances("")[0] == pytest.approx(0.86)
