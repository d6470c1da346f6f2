# SPDX-License-Identifier: Apache-2.0
"""Balls of Gaussians and the masks that views have of them, lifted."""

from __future__ import annotations

import numpy as np

from cotton3dg.core.bolls import BollSelection, LiftedMasks

UP = np.array([0, 0, 1.0])


def ball(rng, n, centre):
    directions = rng.normal(size=(n, 3))
    return np.array(centre) + directions / np.linalg.norm(directions, axis=1, keepdims=True)


def lifted_balls(balls, views):
    """One mask a ball in every view that lists it; each view sees all Gaussians with 1 px."""
    rows = np.split(np.arange(sum(map(len, balls))), np.cumsum([len(b) for b in balls])[:-1])
    names = tuple(f"{k}.jpg" for k in range(len(views)))
    selections = tuple(
        BollSelection(
            name, mask, np.concatenate([rows[k] for k in group]), np.ones(sum(len(rows[k]) for k in group), np.float32)
        )
        for name, groups in zip(names, views, strict=True)
        for mask, group in enumerate(groups, 1)
    )
    means = np.concatenate(balls).astype(np.float32)
    n = len(means)
    return means, LiftedMasks(
        "", names, np.arange(n), np.ones(n, np.float32), np.ones((len(views), n), np.float32), selections
    )
