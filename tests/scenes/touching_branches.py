# SPDX-License-Identifier: Apache-2.0
"""Two branches of a stem that touch, and what has to come of them."""

import numpy as np
import pytest

from cotton3dg.geometry.polylines import length_of, nearest_on

from .branch_scene import line

STEM = line((0, 0, 0), (0, 0, 60), spacing=0.25)
ONE = line((0, 0, 20), (16, 0, 28), spacing=0.25)
"""Two branches that touch at 10 of 16 cm from the stem, one below the other there."""
OTHER = line((0, 8, 30), (10, 0.3, 25.3), (16, -4.3, 22.5), spacing=0.25)
MEETS = int(np.argmin(nearest_on(OTHER, ONE)[0]))
MEETS_OTHER = int(np.argmin(nearest_on(ONE, OTHER)[0]))


def assert_straight(ways):
    """Some way is the one branch, some the other, each for itself."""
    for true in (ONE, OTHER):
        (own,) = [way for way in ways[1:] if np.linalg.norm(way.curve[0] - true[0]) < 0.5]
        assert nearest_on(true, own.curve)[0].max() < 0.6
        assert length_of(own.curve) == pytest.approx(length_of(true), abs=0.5)
