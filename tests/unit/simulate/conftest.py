# SPDX-License-Identifier: Apache-2.0
"""What tests of plates and of pictures made of them share."""

import pytest

from cotton3dg.simulate import plates as plates_module
from cotton3dg.simulate.plates import render_plates


@pytest.fixture(scope="module")
def few_plates():
    """Small ones, in little light, so that a test does not wait."""
    patch = pytest.MonkeyPatch()
    patch.setattr(plates_module, "PLATE_PX", 96)
    patch.setattr(plates_module, "HEMISPHERE_RAYS", 4)
    patch.setattr("cotton3dg.simulate.compositing.PLATE_PX", 96)
    yield render_plates(5, 6)
    patch.undo()
