# SPDX-License-Identifier: Apache-2.0
"""Light that is computed once and kept in textures and vertices: all surfaces are matt and nothing moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ..core.scene import Float32
from .rays import Rays
from .room import Lamp

LAMP_SAMPLES: Final = 9
SKY_SAMPLES: Final = 20


def irradiance(
    rays: Rays, points: Float32, normals: Float32, lamps: Sequence[Lamp], ambient: float, reach: float
) -> Float32:
    """Light that arrives at surface points: soft shadows of the lamps plus ambient occlusion.

    Args:
        points, normals: (N, 3) m.
        ambient: light from all around.
        reach: m, how far away a surface still takes ambient light away.
    Returns:
        (N, 3) linear RGB, relative.
    """
    light = np.zeros((len(points), 3), np.float32)
    # Rays start a little off the surface, so that it does not shade itself.
    starts = points + 0.0006 * normals
    for lamp in lamps:
        light += _from_lamp(rays, starts, normals, lamp)[:, None] * lamp.power.astype(np.float32)
    return light + np.float32(ambient) * _ambient(rays, starts, normals, reach)[:, None]


def _from_lamp(rays: Rays, starts: Float32, normals: Float32, lamp: Lamp) -> Float32:
    """(N,) share of the lamp's light that arrives, times the cosine at the receiver."""
    side = int(np.sqrt(LAMP_SAMPLES))
    grid = (np.arange(side) + 0.5) / side
    facing = np.cross(lamp.across, lamp.down)
    facing = (facing / np.linalg.norm(facing)).astype(np.float32)
    total = np.zeros(len(starts), np.float32)
    for u in grid:
        for v in grid:
            towards = (lamp.corner + u * lamp.across + v * lamp.down).astype(np.float32) - starts
            squared = (towards * towards).sum(axis=1)
            cosines = (towards * normals).sum(axis=1).clip(min=0) * -(towards @ facing) / squared
            lit = np.flatnonzero(cosines > 0)
            free = ~rays.blocked(starts[lit], towards[lit], 0.97)
            total[lit] += free * cosines[lit] / squared[lit]
    return total * np.float32(1 / side**2)


def _ambient(rays: Rays, starts: Float32, normals: Float32, reach: float) -> Float32:
    """(N,) cosine-weighted share of directions that are free up to `reach`; light from above counts more."""
    # A Fibonacci spiral of directions around z, turned to each normal.
    k = np.arange(SKY_SAMPLES)
    radius, angle = np.sqrt((k + 0.5) / SKY_SAMPLES), k * np.pi * (3 - np.sqrt(5))
    spiral = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], axis=1)
    helper = np.where(np.abs(normals[:, 1:2]) < 0.9, [[0, 1, 0]], [[1, 0, 0]]).astype(np.float32)
    x = np.cross(helper, normals)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(normals, x)
    total = np.zeros(len(starts), np.float32)
    for a, b, c in spiral.astype(np.float32):
        towards = a * x + b * y + c * normals
        total += ~rays.blocked(starts, towards, reach) * (0.7 + 0.3 * towards[:, 2])
    return total * np.float32(1 / SKY_SAMPLES)
