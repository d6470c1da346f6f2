# SPDX-License-Identifier: Apache-2.0
"""A furnished room around the table: textured rectangles ("panels") and the lamps that light them.

Metres, z up, z = 0 at the table top, x along the table's long side, origin at its centre; the floor is 0.75 m lower.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import ArrayLike

from ..command_options import SimulateOptions
from ..core.scene import Float64
from .distractors import things_on_table
from .mesh import Mesh
from .textures import Canvas, Image, bare, brushed, cardboard, masonry, planks, plaster, poster, shaded, spine, terrazzo

TABLE_HEIGHT: Final = 0.75
TABLE_THICKNESS: Final = 0.035
TUBE: Final = 0.04
Painter = Callable[[Canvas], Image]
ONE_SIDED_AMBIENT: Final = 0.12
"""Ambient light of a room with one window and dark walls."""


@dataclass(frozen=True)
class Panel:
    """A textured rectangle: image column 0, row 0 lies at `corner`, columns run along `across`, rows along `down`."""

    corner: Float64
    across: Float64
    down: Float64
    image: Image
    """(H, W, 3) sRGB in 0..1."""
    turns: bool = False
    """Whether it turns with a turntable."""


@dataclass(frozen=True)
class Lamp:
    """A rectangle that shines to the side of across x down."""

    corner: Float64
    across: Float64
    down: Float64
    power: Float64
    """(3,) linear RGB."""


@dataclass(frozen=True)
class Room:
    panels: tuple[Panel, ...]
    lamps: tuple[Lamp, ...]
    ambient: float = 0.55
    """Light that comes from all around, relative to that of a lamp of power 1 at 1 m."""
    things: tuple[Mesh, ...] = ()
    """Things on the table."""


class _Builder:
    """Collects panels; sizes are given in m, textures are painted to fit."""

    def __init__(self, rng: np.random.Generator, density: float):
        self.rng, self.density = rng, density
        self.panels: list[Panel] = []

    def panel(self, corner: ArrayLike, across: ArrayLike, down: ArrayLike, paint: Painter, finer: float = 1.0) -> None:
        a, d = np.asarray(across, float), np.asarray(down, float)
        canvas = Canvas(self.rng, float(np.linalg.norm(a)), float(np.linalg.norm(d)), self.density * finer)
        self.panels.append(Panel(np.asarray(corner, float), a, d, paint(canvas)))

    def box(
        self, low: ArrayLike, size: ArrayLike, turn: float, paint: Painter, top: Painter | None = None, finer: float = 1
    ) -> None:
        """A cuboid without a bottom that stands on `low` (middle of its foot), turned about z."""
        w, d, h = np.asarray(size, float)
        x = np.array([np.cos(turn), np.sin(turn), 0.0])
        y = np.array([-x[1], x[0], 0.0])
        foot, up = np.asarray(low, float), np.array([0, 0, h])
        for side, length, depth in ((x, w, d), (y, d, w), (-x, w, d), (-y, d, w)):
            outwards = np.array([side[1], -side[0], 0.0])
            self.panel(foot + 0.5 * depth * outwards - 0.5 * length * side + up, length * side, -up, paint, finer)
        self.panel(foot - 0.5 * w * x + 0.5 * d * y + up, w * x, -d * y, top or paint, finer)


def build_room(options: SimulateOptions, stem_base: Float64, card: Image | None = None) -> Room:
    """The room of a seed: four walls of different make, a floor, furniture, and the table with the clamp.

    Args:
        options: `seed`, `light`, `one_sided`, the table's size and presence, the `things` on it; `width` sets
            how finely textures are painted.
        stem_base: (3,) m, where the clamp holds the stem.
        card: (H, W, 3) sRGB in 0..1, a printed sheet of A4 that lies on the table.
    """
    rng = np.random.default_rng([options.seed, 2])
    # A texel is about half a pixel on the far wall of a 640 px video.
    build = _Builder(rng, 360 * float(np.clip(options.width / 640, 0.3, 1.5)))
    half = np.array([rng.uniform(2.4, 2.8), rng.uniform(2.3, 2.7)])
    floor = -TABLE_HEIGHT
    if options.white_room:
        _bare_walls(build, half, floor, 3.0)
    else:
        build.panel((-half[0], half[1], floor), (2 * half[0], 0, 0), (0, -2 * half[1], 0), _floor(rng))
        _walls(build, half, floor, 3.0)
        _shelf(build, half, floor, int(rng.integers(4)))
        for _ in range(int(rng.integers(5, 9))):
            _floor_box(build, half, floor)
    if options.table:
        _table(build, 0.01 * options.table_length_cm, 0.01 * options.table_width_cm, options.pale_table)
    before = len(build.panels)
    _clamp(build, stem_base)
    build.panels[before:] = [replace(panel, turns=True) for panel in build.panels[before:]]
    # Drawn last and with other random numbers, so that a seed gives the same room with and without them.
    build.rng = np.random.default_rng([options.seed, 3])
    _markers(build, options)
    if card is not None:
        _card(build, options, card)
    if options.hidden:
        _box_on_table(build, options)
    if options.second_table:
        _side_table(build)
    of_light = np.random.default_rng([options.seed, 6, options.light]) if options.light else rng
    room = Room(tuple(build.panels), _lamps(of_light, half))
    if options.one_sided:
        room = replace(room, lamps=(_side_window(of_light, half),), ambient=ONE_SIDED_AMBIENT)
    if options.things and options.table:
        of_things = np.random.default_rng([options.seed, 8])
        size = 0.01 * options.table_length_cm, 0.01 * options.table_width_cm
        room = replace(room, things=tuple(things_on_table(of_things, options.things, stem_base, *size)))
    return room


def _floor(rng: np.random.Generator) -> Painter:
    shade = rng.uniform(0.25, 0.65) * rng.uniform(0.85, 1.1, 3)
    if rng.random() < 0.5:
        return lambda canvas: terrazzo(canvas, shade, tile=float(rng.choice([0.3, 0.45, 0.6])))
    wood = np.array([0.60, 0.45, 0.31]) * rng.uniform(0.6, 1.2)
    return lambda canvas: planks(canvas, wood, plank=0.14)


def _bare_walls(build: _Builder, half: Float64, floor: float, height: float) -> None:
    """A white laboratory: four walls and a floor with hardly a speck on them."""
    white, grey = np.full(3, build.rng.uniform(0.80, 0.92)), np.full(3, build.rng.uniform(0.6, 0.75))
    build.panel((-half[0], half[1], floor), (2 * half[0], 0, 0), (0, -2 * half[1], 0), lambda c: bare(c, grey))
    for wall in range(4):
        x, inwards, corner = _wall(half, floor, height, wall)
        build.panel(corner, x * 2 * half[wall % 2], (0, 0, -height), lambda c: bare(c, white))
        door = corner + x * half[wall % 2] * build.rng.uniform(0.4, 1.2) - (0, 0, height - 2.05) + 0.004 * inwards
        build.panel(door, 0.9 * x, (0, 0, -2.05), lambda c: bare(c, 0.9 * white))


def _wall(half: Float64, floor: float, height: float, number: int) -> tuple[Float64, Float64, Float64]:
    """Along it, into the room, and its upper corner. Walls turn clockwise seen from above, so that their pictures read
    from inside the room."""
    x = np.array([[1, 0, 0], [0, -1, 0], [-1, 0, 0], [0, 1, 0]][number], float)
    inwards = np.array([x[1], -x[0], 0.0])
    return x, inwards, -inwards * np.append(half, 0) - x * np.append(half, 0) + (0, 0, floor + height)


def _walls(build: _Builder, half: Float64, floor: float, height: float) -> None:
    rng = build.rng
    red, grey = np.array([0.60, 0.27, 0.19]), np.full(3, rng.uniform(0.35, 0.75))
    paint_colour = rng.uniform(0.35, 0.85) * rng.uniform(0.8, 1.1, 3)
    wood = np.array([0.55, 0.40, 0.27]) * rng.uniform(0.6, 1.3)
    painters: list[Painter] = [
        lambda canvas: masonry(canvas, red * rng.uniform(0.8, 1.3), (0.24, 0.08), 0.012, 1.0),
        lambda canvas: masonry(canvas, grey, (0.40, 0.20), 0.010, 0.7),
        lambda canvas: plaster(canvas, paint_colour),
        lambda canvas: planks(canvas, wood, plank=float(rng.uniform(0.09, 0.2))),
    ]
    rng.shuffle(painters)
    for wall, paint in enumerate(painters):
        x, inwards, corner = _wall(half, floor, height, wall)
        length = 2 * half[wall % 2]
        build.panel(corner, x * length, (0, 0, -height), paint)
        for layer in range(int(rng.integers(4, 8))):
            size = rng.uniform((0.25, 0.25), (0.85, 0.75))
            along, down = rng.uniform((0.1, 0.3), (length - 0.1 - size[0], height - 1.0 - 0.3 * size[1]))
            place = corner + x * along - (0, 0, down) + (0.006 + 0.003 * layer) * inwards
            tilt = rng.normal(0, 0.02)
            across = x * np.cos(tilt) + np.array([0, 0, np.sin(tilt)])
            downwards = x * np.sin(tilt) - np.array([0, 0, np.cos(tilt)])
            build.panel(place, across * size[0], downwards * size[1], poster, 1.5)


def _shelf(build: _Builder, half: Float64, floor: float, wall: int) -> None:
    """Boards along one wall with books and boxes on them."""
    rng = build.rng
    x = np.array([[1, 0, 0], [0, -1, 0], [-1, 0, 0], [0, 1, 0]][wall], float)
    inwards = np.array([x[1], -x[0], 0.0])
    turn = float(np.arctan2(x[1], x[0]))
    depth, width = 0.30, rng.uniform(1.1, 1.7)
    side = rng.uniform(-0.5, 0.5)
    middle = -inwards * (np.append(half, 0) - 0.5 * depth - 0.02) + x * side + (0, 0, floor)
    wood = np.array([0.55, 0.42, 0.28]) * rng.uniform(0.7, 1.3)

    def board(canvas: Canvas) -> Image:
        return planks(canvas, wood, plank=1.0)

    rows = int(rng.integers(3, 5))
    for edge in (-0.5, 0.5):
        build.box(middle + x * edge * width, (0.025, depth, 0.36 * rows + 0.03), turn, board)
    for row in range(rows + 1):
        build.box(middle + np.array([0, 0, 0.36 * row]), (width - 0.03, depth, 0.025), turn, board)
        at = -0.5 * width + 0.03
        while row < rows and at < 0.5 * width - 0.33:
            if rng.random() < 0.12:
                size = rng.uniform((0.18, 0.18, 0.12), (0.30, 0.26, 0.28))
                paint = cardboard
            else:
                size = rng.uniform((0.02, 0.15, 0.18), (0.06, 0.24, 0.30))
                paint = spine
            place = middle + x * (at + 0.5 * size[0]) + (0, 0, 0.36 * row + 0.025)
            build.box(place + inwards * 0.5 * (depth - size[1] - 0.02), size, turn, paint)
            at += size[0] + rng.uniform(0.001, 0.012)


def _floor_box(build: _Builder, half: Float64, floor: float) -> None:
    rng = build.rng
    size = rng.uniform((0.3, 0.25, 0.2), (0.6, 0.5, 0.55))
    angle = rng.uniform(0, 2 * np.pi)
    direction = np.array([np.cos(angle), np.sin(angle)])
    reach = ((half - 0.4) / np.abs(direction)).min()
    build.box((*(direction * reach), floor), size, rng.uniform(0, np.pi), cardboard)


def _table(build: _Builder, length: float, width: float, pale: bool) -> None:
    rng = build.rng
    wood = np.array([0.72, 0.55, 0.37]) * rng.uniform(0.65, 1.15)
    dark = np.full(3, rng.uniform(0.08, 0.3))
    white = np.full(3, 0.86)

    def top(canvas: Canvas) -> Image:
        if pale:
            return bare(canvas, white)
        image = planks(canvas, wood, plank=float(rng.uniform(0.08, 0.2)), gap=0.0015)
        return shaded(image, -np.clip(2 * canvas.noise(0.12) - 1, 0, 1), 0.25)

    def edge(canvas: Canvas) -> Image:
        return bare(canvas, 0.8 * white) if pale else planks(canvas, 0.85 * wood, plank=1.0)

    build.box((0, 0, -TABLE_THICKNESS), (length, width, TABLE_THICKNESS), 0.0, edge, top, finer=3.0)
    for x in (-1, 1):
        for y in (-1, 1):
            foot = (x * (0.5 * length - 0.06), y * (0.5 * width - 0.06), -TABLE_HEIGHT)
            build.box(foot, (0.05, 0.05, TABLE_HEIGHT - TABLE_THICKNESS), 0.0, lambda c: brushed(c, dark))
    size = rng.uniform((0.10, 0.07), (0.16, 0.12))
    corner = np.array([rng.uniform(-0.45, 0.25) * length, rng.choice([-0.26, 0.40]) * width, 0.0008])
    build.panel(corner, (size[0], 0, 0), (0, -size[1], 0), poster, 4.0)


def _markers(build: _Builder, options: SimulateOptions) -> None:
    """ArUco markers 0, 1, ... (4x4_50) on sheets of paper, at both ends of the table."""
    side, half = 0.01 * options.marker_cm, 0.005 * np.array([options.table_length_cm, options.table_width_cm])
    for number in range(options.markers):
        picture = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), number, 600)
        paper = np.pad(picture, 100, constant_values=255)
        sheet = np.repeat((0.06 + 0.86 * paper[..., None] / 255).astype(np.float32), 3, axis=2)
        end, row = (-1) ** number, number // 2
        middle = np.array([end * (half[0] - 0.9 * side), (row - 1) * 1.45 * side + 0.1 * side, 0.0012])
        turn = build.rng.uniform(-0.15, 0.15)
        across = np.array([np.cos(turn), np.sin(turn), 0.0]) * side * 8 / 6
        down = np.array([across[1], -across[0], 0.0])
        build.panels.append(Panel(middle - 0.5 * (across + down), across, down, sheet))


def _card(build: _Builder, options: SimulateOptions, sheet: Image) -> None:
    """A sheet of A4 at one end of the table, a little askew."""
    turn = build.rng.uniform(-0.12, 0.12)
    across = 0.21 * np.array([np.cos(turn), np.sin(turn), 0.0])
    down = 0.297 * np.array([np.sin(turn), -np.cos(turn), 0.0])
    middle = np.array([0.005 * options.table_length_cm - 0.16, 0.0, 0.0016])
    build.panels.append(Panel(middle - 0.5 * (across + down), across, down, sheet))


def _box_on_table(build: _Builder, options: SimulateOptions) -> None:
    """A box over one end of the table, a little wider than it."""
    length, width = 0.01 * options.table_length_cm, 0.01 * options.table_width_cm
    size = (options.hidden * length + 0.03, width + 0.06, 0.2)
    build.box((0.5 * length + 0.03 - 0.5 * size[0], 0.0, 0.002), size, 0.0, cardboard)


def _side_table(build: _Builder) -> None:
    """A square table of the same height."""
    wood = np.array([0.60, 0.45, 0.31]) * build.rng.uniform(0.7, 1.3)
    foot = (0.1, 0.86, -TABLE_THICKNESS)
    build.box(foot, (0.7, 0.7, TABLE_THICKNESS), 0.0, lambda canvas: planks(canvas, wood, plank=0.12), finer=2.0)


def _clamp(build: _Builder, stem_base: Float64) -> None:
    """Two square tubes, one on either side of the stem."""
    length = build.rng.uniform(0.30, 0.40)
    along = stem_base[0] + build.rng.uniform(-0.05, 0.05)
    metal = np.full(3, build.rng.uniform(0.55, 0.75))
    for side in (-1, 1):
        middle = (along, stem_base[1] + side * (0.5 * TUBE + 0.0085), 0.0)
        build.box(middle, (length, TUBE, TUBE), 0.0, lambda canvas: brushed(canvas, metal), finer=3.0)


def _lamps(rng: np.random.Generator, half: Float64) -> tuple[Lamp, ...]:
    """Two warm ceiling lamps and a bluish window high in one wall."""
    warm, cool = np.array([1.0, 0.93, 0.82]), np.array([0.86, 0.94, 1.0])
    lamps = []
    for x in (-0.45, 0.45):
        middle = np.array([x * half[0] + rng.uniform(-0.3, 0.3), rng.uniform(-0.5, 0.5) * half[1], 1.9])
        size = rng.uniform(0.5, 1.1, 2)
        across, down = np.array([size[0], 0, 0]), np.array([0, size[1], 0])
        lamps.append(Lamp(middle - 0.5 * (across - down), across, -down, warm * rng.uniform(0.7, 1.3)))
    side = rng.choice([-1, 1])
    corner = np.array([-0.8 * side, side * (half[1] - 0.05), 0.9])
    window = Lamp(corner, np.array([1.6 * side, 0, 0]), np.array([0, 0, 0.9]), cool * rng.uniform(0.3, 1.2))
    return (*lamps, window)


def _side_window(rng: np.random.Generator, half: Float64) -> Lamp:
    """A bright window in any of the walls."""
    x, inwards, corner = _wall(half, -TABLE_HEIGHT, 3.0, int(rng.integers(4)))
    length = 2 * float(np.abs(x[:2]) @ half)
    width, height = rng.uniform(0.8, 1.6), rng.uniform(0.8, 1.4)
    right = corner + x * (width + rng.uniform(0.2, 0.8) * (length - width)) + 0.05 * inwards
    right -= (0, 0, rng.uniform(0.5, 0.9))
    return Lamp(right, -width * x, np.array([0, 0, -height]), np.array([0.92, 0.97, 1.0]) * rng.uniform(1.5, 3.0))
