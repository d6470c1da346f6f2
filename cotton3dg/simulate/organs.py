# SPDX-License-Identifier: Apache-2.0
"""The organs on a plant's wood: open bolls in their burs, dry leaves.

Lengths are metres.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..core.scene import Float64
from .mesh import Mesh, SolidNoise, icosphere, merge, rotation_to, sheet, smooth_curve, tube, unit

WOOD: Final = (0.17, 0.095, 0.05)
BUR: Final = (0.15, 0.08, 0.04)
BUR_INSIDE: Final = (0.34, 0.23, 0.13)
LEAF: Final = (0.30, 0.19, 0.08)
LINT: Final = (0.84, 0.81, 0.75)
LINT_CENTRE: Final = 0.50
"""Height of the lint's centre above the foot of the bur, in diameters of the lint."""


@dataclass(frozen=True)
class Boll:
    lint: Mesh
    bur: Mesh


@dataclass(frozen=True)
class Site:
    """Where a boll grows: the node that bears it, the middle and the axis of its lint."""

    node: Float64
    centre: Float64
    axis: Float64
    diameter: float


def open_boll(rng: np.random.Generator, noise: SolidNoise, site: Site) -> Boll:
    """Lint and bur of one boll; the lint's mean diameter is close to the site's, but exact only in the truth."""
    d = site.diameter
    locks = int(rng.choice([4, 5], p=[0.65, 0.35]))
    angles = 2 * np.pi * (np.arange(locks) + rng.normal(0, 0.06, locks)) / locks
    pose = rotation_to(site.axis, rng.uniform(0, 2 * np.pi))
    foot = site.centre - site.axis * LINT_CENTRE * d
    lint = merge([_lock(rng, noise, angle, locks, d) for angle in angles]).moved(pose, foot)
    bur = merge([cup(d), *(carpel(rng, angle, d) for angle in angles)]).moved(pose, foot)
    return Boll(weather(lint, noise, 0.05), weather(bur, noise, 0.5))


def _lock(rng: np.random.Generator, noise: SolidNoise, angle: float, locks: int, d: float) -> Mesh:
    """One lock: an ellipsoid that leans outwards, puffed up over its seeds, frayed at the surface."""
    sphere, triangles = icosphere(4)
    half = np.array([0.245, 0.265 if locks == 4 else 0.225, 0.345]) * d * rng.uniform(0.92, 1.08, 3)
    where = sphere * half + rng.uniform(0, 1, 3)
    puffs = np.abs(noise(where, 0.42 * d))
    fray = 0.035 * noise(where, 0.11 * d) + 0.022 * noise(where, 0.045 * d)
    shape = sphere * half * (0.90 + 0.28 * puffs + fray)[:, None]
    lean = rotation_to((np.sin(rng.uniform(0.15, 0.40)), 0, 1))
    shape = shape @ lean.T + (0.235 * d, 0, LINT_CENTRE * d * rng.uniform(0.96, 1.06))
    cos, sin = np.cos(angle), np.sin(angle)
    shape = shape @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    # Fibres in the creases between the puffs hold dust and shade.
    colours = np.array(LINT) * (0.93 + 0.14 * puffs.clip(0, 0.5) + 0.5 * fray)[:, None]
    return Mesh(shape, triangles, colours)


def carpel(rng: np.random.Generator, angle: float, d: float) -> Mesh:
    """One dry valve of the bur: a pointed, cupped blade that opens outwards and curls at its tip."""
    s, w = np.meshgrid(np.linspace(0, 1, 16), np.linspace(-1, 1, 9), indexing="ij")
    width = d * 0.21 * np.sin(np.pi * s**0.8).clip(0) ** 0.8 + 0.012 * d * (1 - s)
    out = d * (0.04 + 0.48 * np.sin(0.5 * np.pi * s) + 0.12 * s**3)
    up = d * (0.10 * s + rng.uniform(-0.12, 0.18) * s**2 + rng.uniform(-0.15, 0.10) * s**4)
    cup = 0.35 * width * w**2
    twist = rng.normal(0, 0.25) * s * w * width
    surface = np.stack([out - 0.4 * cup, width * w, up + cup + twist], axis=-1)
    cos, sin = np.cos(angle), np.sin(angle)
    surface = surface @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    mesh = sheet(surface, np.zeros((*s.shape, 3)), 0.0012)
    inside = np.arange(len(mesh.vertices)) < s.size
    return replace(mesh, colours=np.where(inside[:, None], BUR_INSIDE, BUR))


def cup(d: float) -> Mesh:
    """The receptacle from which the carpels grow."""
    sphere, triangles = icosphere(2)
    return Mesh(sphere * (0.11 * d, 0.11 * d, 0.07 * d) + (0, 0, 0.03 * d), triangles, np.tile(BUR, (len(sphere), 1)))


def dry_leaves(rng: np.random.Generator, noise: SolidNoise, stem: Float64) -> tuple[Mesh, list[Mesh]]:
    """Two to four curled dry leaves and their petioles."""
    blades, petioles = [], []
    for _ in range(int(rng.integers(2, 5))):
        node = stem[int(rng.uniform(0.25, 0.85) * len(stem))]
        azimuth = rng.uniform(0, 2 * np.pi)
        out = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        reach = rng.uniform(0.04, 0.07)
        foot = node + out * reach + (0, 0, rng.uniform(0.0, 0.03))
        curve = smooth_curve([node, 0.5 * (node + foot) + (0, 0, 0.008), foot], 0.004)
        petioles.append(tube(curve, np.full(len(curve), 0.0012), np.tile(WOOD, (len(curve), 1)), 8))
        blades.append(leaf(rng, noise).moved(rotation_to(unit(out + np.array([0, 0, rng.uniform(-1.4, -0.3)]))), foot))
    return merge(blades), petioles


def leaf(rng: np.random.Generator, noise: SolidNoise) -> Mesh:
    """A lobed blade along z, rolled inwards by drought."""
    length = rng.uniform(0.055, 0.09)
    s, w = np.meshgrid(np.linspace(0, 1, 32), np.linspace(-1, 1, 25), indexing="ij")
    width = 0.48 * length * np.sin(np.pi * s**0.7).clip(0) ** 0.7 * (1 + 0.28 * np.cos(14 * s))
    roll = rng.uniform(1.2, 2.4) * w
    flat = np.stack([width * np.sin(roll) / 1.5, width * (1 - np.cos(roll)) / 1.5, s * length], axis=-1)
    flat[..., 1] += rng.uniform(-0.5, 0.5) * length * s**2
    crumple = noise(flat.reshape(-1, 3) + rng.uniform(0, 1, 3), 0.03).reshape(s.shape) * 0.004 * s
    flat[..., 1] += crumple
    return sheet(flat, np.tile(LEAF, (*s.shape, 1)), 0.0008)


def weather(mesh: Mesh, noise: SolidNoise, strength: float) -> Mesh:
    """Blotches of 15 mm and specks of 3 mm and less in the colour."""
    specks = sum(noise(mesh.vertices, wavelength) for wavelength in (0.015, 0.006, 0.0025)) / 3
    return replace(mesh, colours=(mesh.colours * np.exp(strength * specks)[:, None]).clip(0, 0.9))
