# SPDX-License-Identifier: Apache-2.0
"""A plant on the table of table_scene, measured in one call."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cotton3dg.core.bolls import BollInstance
from cotton3dg.core.measurements import Scale
from cotton3dg.core.scene import Gaussians
from cotton3dg.traits.error_model import USUAL_CONDITIONS, Conditions
from cotton3dg.traits.measure import Measured, measure_parts, measure_whole
from scenes.table_scene import POSE

UP = POSE.rotation[:, 2]
CORNERS = POSE.scene(np.array([[-60, -30, 0], [60, -30, 0], [60, 30, 0], [-60, 30, 0.0]]))
SCALE = Scale(POSE.cm_per_su, 0.002, "table", UP, np.append(UP, -UP @ CORNERS[0]), CORNERS)


def bolls_of(gaussians: Gaussians, labels: NDArray) -> list[BollInstance]:
    """The bolls 1, 2, ... that Gaussians are labelled with."""
    return [
        BollInstance(k, np.flatnonzero(labels == k), ("a", "b"), gaussians.means[labels == k].mean(0).astype(float),
                     0.1, 0.9)
        for k in range(1, labels.max() + 1)
    ]  # fmt: skip


def measure_plant(
    gaussians: Gaussians,
    bolls: Sequence[BollInstance],
    scale: Scale | None,
    pixel_su: float,
    clamp_cm: float,
    conditions: Conditions = USUAL_CONDITIONS,
    thin_ends: Sequence[NDArray] = (),
) -> Measured:
    parts = measure_parts(gaussians, bolls, scale, pixel_su, clamp_cm, conditions=conditions)
    return measure_whole(parts, thin_ends=thin_ends)
