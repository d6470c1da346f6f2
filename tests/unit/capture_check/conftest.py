# SPDX-License-Identifier: Apache-2.0
"""What tests of a first look share."""

import pytest
from scenes.walked_film import walked

from cotton3dg.core.scene import Camera


@pytest.fixture
def cameras() -> list[Camera]:
    return walked()
