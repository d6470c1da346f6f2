# SPDX-License-Identifier: Apache-2.0
"""Things that may look like open bolls, as most of them are white: balls, mugs, labels, cloths, boxes, and, beside
plants in pots and stands, pots, clamps and hands.

Lengths are metres; each is made about the origin.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from ..core.scene import Float64
from .mesh import Mesh, SolidNoise, icosphere, merge, rotation_to, sheet, smooth_curve, tube, unit
from .organs import weather

Shape = Callable[[np.random.Generator, SolidNoise, Float64], Mesh]
NEAREST: Final = 0.10
FARTHEST: Final = 0.50
"""m from the plant's foot to the middle of a thing on the table."""
APART: Final = 0.01
"""m, least distance of the boxes around two things, and from the plant's foot."""
ABOVE: Final = 0.0005
"""m over the table: two surfaces in one place would flicker."""


def draw_thing(rng: np.random.Generator) -> tuple[Shape, Float64]:
    """The function that makes a thing, and its colour (3,), linear."""
    shapes: list[Shape] = [_ball, _mug, _tag, _cloth, _tubes, _box]
    shape = shapes[int(rng.integers(len(shapes)))]
    white = rng.uniform(0.5, 0.92) * rng.uniform(0.93, 1.0, 3)
    return shape, white if rng.random() < 0.7 else rng.uniform(0.03, 0.8, 3)


def draw_handling(rng: np.random.Generator) -> tuple[Shape, Float64]:
    """As `draw_thing`, for things that hold plants; they never lie on a simulated table."""
    shapes: list[Shape] = [_pot, _clamp, _hand]
    white = rng.uniform(0.5, 0.92) * rng.uniform(0.93, 1.0, 3)
    colour = white if rng.random() < 0.6 else rng.uniform(0.03, 0.8, 3)
    return shapes[int(rng.integers(len(shapes)))], colour


def things_on_table(rng: np.random.Generator, count: int, foot: Float64, length: float, width: float) -> list[Mesh]:
    """`count` things, or fewer if there is not enough room, that lie or stand on a table around a plant.

    Args:
        foot: (3,) of the plant; the table's middle is the origin, its top z = 0.
        length, width: m, of the table along x and y.
    """
    noise, rim = SolidNoise(rng), 0.5 * np.array([length, width])
    meshes: list[Mesh] = []
    boxes = [(foot[:2], foot[:2])]
    for _ in range(20 * count):
        if len(meshes) == count:
            break
        shape, colour = draw_thing(rng)
        lies = rotation_to(rng.normal(0, 1, 3), rng.uniform(0, 2 * np.pi)) if shape in (_cloth, _tag) else np.eye(3)
        mesh = weather(shape(rng, noise, colour).moved(lies, np.zeros(3)), noise, rng.uniform(0, 0.15))
        angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(NEAREST, FARTHEST)
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        # Its middle goes there, and its lowest point on the table.
        middle = np.array([*(0.5 * (low + high)[:2]), low[2] - ABOVE])
        place = foot + away * np.array([np.cos(angle), np.sin(angle), 0.0]) - middle
        low, high = (low + place)[:2], (high + place)[:2]
        free = all((low > other[1] + APART).any() or (high < other[0] - APART).any() for other in boxes)
        if free and (np.maximum(-low, high) < rim).all():
            meshes.append(mesh.moved(np.eye(3), place))
            boxes.append((low, high))
    return meshes


def _ball(rng: np.random.Generator, noise: SolidNoise, colour: Float64) -> Mesh:
    sphere, triangles = icosphere(4)
    rough = 1 + rng.choice([0, 0.03]) * noise(sphere * 0.03, 0.01)
    return Mesh(sphere * rng.uniform(0.012, 0.05) * rough[:, None], triangles, np.tile(colour, (len(sphere), 1)))


def _mug(rng: np.random.Generator, _: SolidNoise, colour: Float64) -> Mesh:
    height, radius = rng.uniform(0.05, 0.12), rng.uniform(0.02, 0.045)
    axis = np.linspace(0, height, 12)[:, None] * (0, 0, 1.0)
    body = tube(axis, np.full(12, radius), np.tile(colour, (12, 1)), 32)
    turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 12)
    bow = np.stack(
        [radius + 0.4 * height * np.cos(turn) * 0.6, 0 * turn, 0.5 * height * (1 + 0.7 * np.sin(turn))], axis=1
    )
    handle = tube(bow, np.full(12, 0.004), np.tile(colour, (12, 1)), 10)
    return merge([body, handle])


def _tag(rng: np.random.Generator, noise: SolidNoise, colour: Float64) -> Mesh:
    """A paper tag, label or sheet, with print on it."""
    width, height = rng.uniform(0.015, 0.12), rng.uniform(0.02, 0.15)
    s, t = np.meshgrid(np.linspace(-0.5, 0.5, 48), np.linspace(-0.5, 0.5, 48), indexing="ij")
    bend = rng.uniform(-0.3, 0.3) * width * (4 * s**2)
    surface = np.stack([width * s, bend, height * t], axis=-1)
    paper = np.tile(colour, (*s.shape, 1))
    lines = rng.integers(0, 8)
    for _ in range(lines):
        row, start, length = rng.integers(4, 44), rng.integers(4, 20), rng.integers(6, 24)
        paper[start : start + length, row : row + rng.integers(1, 4)] *= rng.uniform(0.05, 0.5)
    return sheet(surface, paper, 0.0008)


def _cloth(rng: np.random.Generator, noise: SolidNoise, colour: Float64) -> Mesh:
    """A crumpled cloth or a wad of paper."""
    size = rng.uniform(0.04, 0.2)
    s, t = np.meshgrid(np.linspace(-0.5, 0.5, 56), np.linspace(-0.5, 0.5, 56), indexing="ij")
    flat = np.stack([size * s, 0 * s, size * t], axis=-1)
    where = flat.reshape(-1, 3) + rng.uniform(0, 1, 3)
    for axis in range(3):
        folds = noise(where + axis, 0.6 * size) + 0.5 * noise(where - axis, 0.25 * size)
        flat[..., axis] += rng.uniform(0.05, 0.25) * size * folds.reshape(s.shape)
    return sheet(flat, np.tile(colour, (*s.shape, 1)), 0.001)


def _tubes(rng: np.random.Generator, _: SolidNoise, colour: Float64) -> Mesh:
    length = rng.uniform(0.05, 0.4)
    axis = np.linspace(-0.5 * length, 0.5 * length, 20)[:, None] * (0, 0, 1.0)
    bend = rng.uniform(0, 0.1) * length * np.cos(np.linspace(0, np.pi, 20))[:, None] * (1, 0, 0)
    return tube(axis + bend, np.full(20, rng.uniform(0.002, 0.03)), np.tile(colour, (20, 1)), 24)


def _box(rng: np.random.Generator, _: SolidNoise, colour: Float64) -> Mesh:
    """A carton, book or polystyrene block; its faces are fine enough to take shadows."""
    sphere, triangles = icosphere(4)
    cube = sphere / np.abs(sphere).max(axis=1, keepdims=True)
    return Mesh(cube * rng.uniform(0.01, 0.06, 3), triangles, np.tile(colour, (len(sphere), 1)))


def _pot(rng: np.random.Generator, _: SolidNoise, colour: Float64) -> Mesh:
    """A plastic pot that widens to its rim, with soil in it."""
    height, foot = rng.uniform(0.06, 0.2), rng.uniform(0.03, 0.07)
    up = np.linspace(0, 1, 14)
    radii = foot * (1 + rng.uniform(0.1, 0.5) * up) * np.where(up > 0.88, 1.07, 1.0)
    body = tube((height * up)[:, None] * (0, 0, 1.0), radii, np.tile(colour, (14, 1)), 40)
    soil = np.array([[0, 0, height], [0, 0, height + 0.001]])
    return merge([body, tube(soil, np.full(2, 0.9 * radii[-1]), np.tile((0.09, 0.06, 0.04), (2, 1)), 40)])


def _clamp(rng: np.random.Generator, _: SolidNoise, colour: Float64) -> Mesh:
    """A stand's rod, the boss on it, and two jaws that reach out from it."""

    def bar(points: list[tuple[float, float, float]], radius: float, tint: Float64) -> Mesh:
        curve = smooth_curve(points, 0.005)
        return tube(curve, np.full(len(curve), radius), np.tile(tint, (len(curve), 1)), 14)

    steel = np.full(3, rng.uniform(0.25, 0.7))
    reach, wide = rng.uniform(0.04, 0.12), rng.uniform(0.008, 0.03)
    rod = bar([(0, 0, -rng.uniform(0.05, 0.3)), (0, 0, 0), (0, 0, rng.uniform(0.03, 0.2))], 0.006, steel)
    boss = bar([(-0.015, 0, 0), (0.02, 0, 0)], rng.uniform(0.009, 0.014), colour)
    shank = bar([(0.02, 0, 0), (reach, 0, 0)], 0.004, steel)
    jaws = [
        bar([(reach, 0, 0), (reach + 0.02, side * wide, 0), (reach + 0.05, 0.6 * side * wide, 0)], 0.004, colour)
        for side in (-1, 1)
    ]
    return merge([rod, boss, shank, *jaws])


def _hand(rng: np.random.Generator, noise: SolidNoise, colour: Float64) -> Mesh:
    """Arm, palm and bent fingers, bare or in a glove of the colour."""
    light, dark = np.array([0.72, 0.46, 0.34]), np.array([0.13, 0.07, 0.045])
    share = rng.random()
    skin = colour if rng.random() < 0.25 else share * light + (1 - share) * dark
    sphere, triangles = icosphere(4)
    palm = Mesh(sphere * (0.042, 0.017, 0.05), triangles, np.tile(skin, (len(sphere), 1)))
    bend, parts = rng.uniform(0, 1.2), [palm]
    for across, length in zip((-0.031, -0.011, 0.010, 0.029, 0.048), (0.058, 0.072, 0.078, 0.068, 0.05), strict=True):
        thumb = across > 0.04
        foot = np.array([across, 0, -0.005 if thumb else 0.036])
        out = unit(np.array([0.9 if thumb else 2.5 * across, 0, 0.7 if thumb else 1]) + rng.normal(0, 0.06, 3))
        turns = rng.uniform(0.6, 1.2) * bend * np.linspace(0, 1, 4)[1:].cumsum()
        steps = [np.cos(turn) * out + np.sin(turn) * np.array([0, 1.0, 0]) for turn in turns]
        curve = smooth_curve([foot, *(foot + length / 3 * np.cumsum(steps, axis=0))], 0.004)
        radii = rng.uniform(0.007, 0.0095) * np.linspace(1.05, 0.75, len(curve))
        parts.append(tube(curve, radii, np.tile(skin, (len(curve), 1)), 14))
    elbow = [*rng.normal(0, 0.02, 2), -0.25]
    arm = smooth_curve([[0, 0, -0.03], [0, 0, -0.1], elbow], 0.01)
    parts.append(tube(arm, np.linspace(0.025, 0.04, len(arm)), np.tile(skin, (len(arm), 1)), 20))
    whole = merge(parts)
    return Mesh(whole.vertices, whole.triangles, whole.colours * (1 + 0.1 * noise(whole.vertices, 0.03))[:, None])
