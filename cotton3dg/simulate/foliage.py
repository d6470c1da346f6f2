# SPDX-License-Identifier: Apache-2.0
"""Leaves, closed bolls, flowers, empty bracts and wisps of lint: what a network must not take for open bolls.

Lengths are metres; each grows along z from the origin.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ..core.scene import Float64
from .mesh import Mesh, SolidNoise, icosphere, merge, sheet, smooth_curve, tube
from .organs import LEAF, LINT, weather

GREEN: Final = np.array([0.10, 0.19, 0.04])
STRAW: Final = np.array([0.48, 0.40, 0.22])
SHEEN: Final = np.array([0.55, 0.60, 0.55])
"""Colour of the light that a leaf's wax reflects: paler than the leaf and hardly coloured."""


def palmate_leaf(rng: np.random.Generator, noise: SolidNoise) -> Mesh:
    """A flat blade of three to five lobes with pale veins, on its stalk: green, yellow or straw, dull or shining."""
    length = rng.uniform(0.04, 0.13)
    lobes = int(rng.choice([3, 5]))
    angle, radius = np.meshgrid(np.linspace(-0.8 * np.pi, 0.8 * np.pi, 61), np.linspace(0.02, 1, 22), indexing="ij")
    wave = np.cos(lobes * angle / 1.6)
    rim = length * (0.72 + rng.uniform(0.1, 0.3) * wave) * (1 - 0.35 * (angle / np.pi) ** 2)
    flat = np.stack([rim * radius * np.sin(angle), 0 * angle, rim * radius * np.cos(angle)], axis=-1)
    # Cupped or hanging, waved at the rim, folded a little along the veins.
    flat[..., 1] += length * radius**2 * rng.uniform(-0.35, 0.35)
    flat[..., 1] += length * rng.uniform(0, 0.08) * radius * np.abs(wave)
    flat[..., 1] += (
        0.12 * length * radius * noise(flat.reshape(-1, 3) + rng.uniform(0, 1, 3), 0.05).reshape(radius.shape)
    )
    vein = np.exp(-(((1 - wave) * radius / rng.uniform(0.01, 0.04)) ** 2))
    age = rng.beta(0.7, 1.2)
    colour = (1 - age) * GREEN * rng.uniform(0.5, 2.2) + age * (STRAW if rng.random() < 0.5 else np.array(LEAF))
    colour = colour * rng.uniform(0.7, 1.4) * rng.uniform(0.85, 1.15, 3)
    patches = (0.5 + noise(flat.reshape(-1, 3) + 5.0, 0.06).reshape(radius.shape)).clip(0, 1)
    shine = (rng.choice([0.0, rng.uniform(0.1, 0.9)]) * patches)[..., None]
    colours = (1 - shine) * colour + shine * SHEEN * rng.uniform(0.6, 1.4)
    colours = colours * (1 + rng.uniform(0.1, 1.2) * vein)[..., None]
    blade = sheet(flat + (0, 0, 0.3 * length), colours.clip(0, 0.85), 0.0006)
    stalk = np.linspace(0, 0.3 * length, 6)[:, None] * (0, 0, 1.0)
    return merge([weather(blade, noise, 0.25), tube(stalk, np.full(6, 0.001), np.tile(colour * 1.2, (6, 1)), 8)])


def bracted_boll(rng: np.random.Generator, noise: SolidNoise, diameter: float) -> Mesh:
    """A boll that has not opened, or a bud, wrapped from its foot in three bracts that end in long teeth; green to
    straw, often paler than all around.

    Args:
        diameter: m, of the plant's open bolls; a closed one is smaller.
    """
    radius = 0.5 * diameter * rng.uniform(0.3, 0.95)
    length = radius * rng.uniform(2.0, 3.0)
    ripe = rng.random()
    colour = (1 - ripe) * np.array([0.20, 0.28, 0.09]) + ripe * np.array([0.18, 0.11, 0.06])
    sphere, triangles = icosphere(3)
    tip = 1 - rng.uniform(0.1, 0.45) * sphere[:, 2:].clip(0) ** 2
    shape = sphere * (0.8 * radius, 0.8 * radius, 0.45 * length) * tip + (0, 0, 0.47 * length)
    body = Mesh(shape, triangles, np.tile(colour * rng.uniform(0.6, 1.6), (len(sphere), 1)))
    # Shut around the boll, or bent away from it as they dry.
    bracts = _bracts(rng, noise, (radius, length), rng.beta(0.8, 2.0), rng.random())
    return weather(merge([body, *bracts]), noise, 0.3)


def empty_bracts(rng: np.random.Generator, noise: SolidNoise, diameter: float) -> Mesh:
    """The remains of a shed boll: three dry bracts, bent back so far that their pale insides are outside.

    Args:
        diameter: m, of the plant's open bolls.
    """
    radius = 0.5 * diameter * rng.uniform(0.3, 0.8)
    size = (radius, radius * rng.uniform(2.0, 3.0))
    return weather(merge(_bracts(rng, noise, size, rng.uniform(1.0, 2.2), rng.uniform(0.5, 1.3))), noise, 0.3)


def _bracts(
    rng: np.random.Generator, noise: SolidNoise, size: tuple[float, float], opened: float, pale: float
) -> list[Mesh]:
    """Three of one colour: green at 0, straw at 1, bleached beyond."""
    green = (1 - pale) * np.array([0.18, 0.26, 0.08]) + pale * np.array([0.54, 0.55, 0.38])
    green = green * rng.uniform(0.6, 1.5)
    teeth = int(rng.integers(6, 12))
    turns = 2 * np.pi * (np.arange(3) + rng.uniform(0, 1)) / 3
    return [_bract(rng, noise, float(turn), size, opened, teeth, green) for turn in turns]


def _bract(
    rng: np.random.Generator,
    noise: SolidNoise,
    turn: float,
    size: tuple[float, float],
    opened: float,
    teeth: int,
    colour: Float64,
) -> Mesh:
    """A heart-shaped blade on the boll, with a vein to the tip of each of its teeth.

    Args:
        size: m, radius and length of the egg that the bracts wrap.
    """
    radius, length = size
    radius *= rng.uniform(0.98, 1.08)
    up, w = np.meshgrid(np.linspace(0, 1, 26), np.linspace(-1, 1, 10 * teeth + 1), indexing="ij")
    tooth = np.abs(np.cos(np.pi * 0.5 * teeth * w)) ** rng.uniform(1.5, 4.0)
    longest = rng.uniform(0.2, 0.7) * (1 - 0.6 * w**2)
    # Each side of a tooth has a length of its own.
    longest = longest * (1 + 0.3 * rng.normal(0, 1, 2 * teeth + 1)).repeat(5)[: w.shape[1]]
    # Along the blade, 1 is where the egg would end; teeth go on from 0.6 of that.
    along = up * (0.62 + 0.1 * (1 - w**2) + longest.clip(0.05) * tooth)
    egg = radius * np.sin(np.pi * along.clip(0, 0.93) ** 0.75) ** 0.8
    over = (along - 0.6).clip(0)
    curl = rng.uniform(-0.3, 0.5)
    away = egg * (1 + opened * along) + radius * over * (0.5 + 1.6 * opened + curl * over)
    around = w * (1.25 - 0.35 * along.clip(0, 1)) * rng.uniform(0.8, 1.05)
    surface = np.stack(
        [away * np.cos(around), away * np.sin(around), length * along * (1 - 0.35 * opened * along)], axis=-1
    )
    bumps = noise(surface.reshape(-1, 3) + rng.uniform(0, 1, 3), 0.5 * radius + 0.004).reshape(along.shape)
    surface += 0.16 * radius * (along * bumps)[..., None] * (np.cos(around)[..., None] * (1, 0, 0.5) + (0, 0, 0.3))
    cos, sin = np.cos(turn), np.sin(turn)
    surface = surface @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    vein = np.abs(np.cos(np.pi * 0.5 * teeth * w)) ** 6
    shade = 1 + rng.uniform(0.0, 0.6) * vein + rng.uniform(-0.3, 0.5) * along.clip(0, 1)
    return sheet(surface, (colour * shade[..., None]).clip(0, 0.85), 0.0006)


def lint_wisps(rng: np.random.Generator, noise: SolidNoise) -> Mesh:
    """Thin strands of lint that wind and rain left on a twig. They hang from the origin, or cling around it."""
    strands = []
    for _ in range(int(rng.integers(1, 7))):
        length, steps = rng.uniform(0.01, 0.09), 8
        way = rng.normal(0, 1, 3) * (0.5, 0.5, 0.2) - (0, 0, rng.uniform(0, 1))
        path = np.linspace(0, length, steps)[:, None] * way
        path += length * np.cumsum(rng.normal(0, 0.09, (steps, 3)), axis=0)
        curve = smooth_curve(path, 0.003)
        ends = np.sin(np.linspace(0.15, np.pi - 0.05, len(curve)))
        lumps = 1 + 0.6 * noise(curve + rng.uniform(0, 1, 3), 0.008)
        radii = rng.uniform(0.0003, 0.0018) * ends * lumps
        shade = np.array(LINT) * rng.uniform(0.75, 1.05)
        strands.append(tube(curve, radii.clip(0.0001), np.tile(shade, (len(curve), 1)), 8))
    return merge(strands)


def flower(rng: np.random.Generator, noise: SolidNoise) -> Mesh:
    """Five crumpled petals, cream, pink or withered to mauve."""
    tints = np.array([[0.85, 0.82, 0.62], [0.8, 0.45, 0.5], [0.45, 0.3, 0.42], [0.85, 0.8, 0.78]])
    colour = tints[int(rng.integers(len(tints)))] * rng.uniform(0.6, 1.05)
    length, opened = rng.uniform(0.02, 0.05), rng.uniform(0.1, 1.0)
    petals = []
    for turn in 2 * np.pi * (np.arange(5) + rng.uniform(0, 1)) / 5:
        s, w = np.meshgrid(np.linspace(0, 1, 14), np.linspace(-1, 1, 15), indexing="ij")
        width = 0.55 * length * np.sqrt(s) * w
        away = length * opened * s**1.5 * 0.8
        surface = np.stack([away + 0.003, width, length * s * (1 - 0.4 * opened * s)], axis=-1)
        surface += (
            0.15 * length * s[..., None] * noise(surface.reshape(-1, 3) + turn, 0.012).reshape(s.shape)[..., None]
        )
        cos, sin = np.cos(turn), np.sin(turn)
        petals.append(
            sheet(
                surface @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]), np.tile(colour, (*s.shape, 1)), 0.0006
            )
        )
    return weather(merge(petals), noise, 0.2)
