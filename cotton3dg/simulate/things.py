"""Things that may be taken for open bolls, as they are white more often than not: balls, mugs, labels, cloths, boxes.

Lengths are metres; each is made about the origin.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from .mesh import Float64, Mesh, SolidNoise, icosphere, merge, rotation_to, sheet, tube
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
    """What makes it, and its colour (3,), linear."""
    shapes: list[Shape] = [_ball, _mug, _tag, _cloth, _tubes, _box]
    shape = shapes[int(rng.integers(len(shapes)))]
    white = rng.uniform(0.5, 0.92) * rng.uniform(0.93, 1.0, 3)
    return shape, white if rng.random() < 0.7 else rng.uniform(0.03, 0.8, 3)


def things_on_table(rng: np.random.Generator, count: int, foot: Float64, length: float, width: float) -> list[Mesh]:
    """So many things, fewer where there is no room, that lie or stand on a table about a plant.

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
