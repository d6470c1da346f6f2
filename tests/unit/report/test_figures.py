# SPDX-License-Identifier: Apache-2.0
"""Drawing on photos for the page."""

import numpy as np

from cotton3dg.core.scene import Camera
from cotton3dg.report.figures import number_bolls


def camera() -> Camera:
    return Camera("a.jpg", 200, 160, 100.0, 100.0, 100.0, 80.0, np.column_stack([np.eye(3), np.zeros(3)]))


def drawn_px(centres: dict[int, list[float]]) -> int:
    photo = np.full((160, 200, 3), 90, np.uint8)
    places = {boll: np.array(centre) for boll, centre in centres.items()}
    return int((number_bolls(photo, camera(), places, set(places), 200, 5.0) != photo).any(axis=2).sum())


def test_numbers_of_bolls_that_are_close_stand_below_each_other() -> None:
    apart = {1: [-0.5, -0.5, 1.0], 2: [0.0, 0.3, 1.0], 3: [0.5, -0.5, 1.0]}
    for close in (
        {1: [0, 0, 1.0], 2: [0, 0, 1.0], 3: [0, 0, 1.0]},
        {1: [0, 0, 1.0], 2: [0.03, 0.04, 1.0], 3: [-0.03, 0.02, 1.0]},
        {1: [0, 0.1, 1.0], 2: [0, -0.1, 1.0], 3: [0.02, 0.02, 1.0]},
    ):
        assert drawn_px(close) == drawn_px(apart)


def test_bolls_behind_the_camera_have_no_number() -> None:
    assert drawn_px({1: [0, 0, -1.0]}) == 0
