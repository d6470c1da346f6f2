# SPDX-License-Identifier: Apache-2.0
"""Procedural pictures for the surfaces of a room, rich at every scale from a metre to the pixel.

A `Canvas` has the size of the surface and the fineness of the paint; every painter returns (H, W, 3) float32 sRGB in
0..1. Image rows run along the surface's height.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float64

Image = NDArray[np.float32]


@dataclass(frozen=True)
class Canvas:
    """A surface of `width` x `height` m, with `density` texels a metre and the random numbers for its paint."""

    rng: np.random.Generator
    width: float
    height: float
    density: float

    @property
    def shape(self) -> tuple[int, int]:
        return max(4, round(self.height * self.density)), max(4, round(self.width * self.density))

    def px(self, metres: float) -> int:
        """A length in texels, at least one."""
        return max(1, round(metres * self.density))

    def noise(self, grain: float, stretch: float = 1.0, octaves: int = 4) -> Image:
        """(H, W) fractal value noise, mean 0, about -1..1; the coarsest cells are `grain` m high, `stretch` wider."""
        rows, columns = self.shape
        total = np.zeros((rows, columns), np.float32)
        for octave in range(octaves):
            cell = grain / 2**octave * self.density
            if cell < 0.7 and octave:
                break
            grid = self.rng.uniform(-1, 1, (int(rows / cell) + 4, int(columns / (cell * stretch)) + 4))
            fine = cv2.resize(
                grid.astype(np.float32),
                (max(columns, round(grid.shape[1] * cell * stretch)), max(rows, round(grid.shape[0] * cell))),
                interpolation=cv2.INTER_CUBIC,
            )
            total += 0.62**octave * fine[:rows, :columns]
        return total

    def filled(self, colour: Float64 | tuple[float, float, float]) -> Image:
        return np.broadcast_to(np.asarray(colour, np.float32), (*self.shape, 3)).copy()

    def metres(self) -> tuple[Image, Image]:
        """x (1, W) and y (H, 1) of the texel centres, m."""
        rows, columns = self.shape
        x = (np.arange(columns, dtype=np.float32) + 0.5) / self.density
        return x[None], ((np.arange(rows, dtype=np.float32) + 0.5) / self.density)[:, None]


def shaded(image: Image, noise: Image, strength: float) -> Image:
    """The picture darkened and lightened by a (H, W) noise."""
    return (image * (1 + strength * noise)[..., None]).clip(0, 1).astype(np.float32)


def _drawable(image: Image) -> NDArray[np.uint8]:
    """The picture in 8 bits, because OpenCV draws smooth edges in these only."""
    return np.round(255 * image.clip(0, 1)).astype(np.uint8)


def _paint(drawing: NDArray[np.uint8]) -> Image:
    return drawing.astype(np.float32) / np.float32(255)


def _ink(colour: Float64) -> list[float]:
    ink: list[float] = (255 * np.clip(colour, 0, 1)).tolist()
    return ink


def _tints(rng: np.random.Generator, shape: tuple[int, ...], spread: float) -> Image:
    """(*shape, 3) factors that vary in brightness, and a little in hue."""
    factors = 1 + spread * (rng.normal(0, 1, (*shape, 1)) + rng.normal(0, 0.22, (*shape, 3)))
    return factors.clip(0.1, None).astype(np.float32)


def masonry(canvas: Canvas, colour: Float64, brick: tuple[float, float], joint: float, contrast: float) -> Image:
    """Bricks or blocks in running bond, each with its own tint, some of them much darker."""
    x, y = canvas.metres()
    row = np.floor(y / brick[1]).astype(int)
    along = x / brick[0] + 0.5 * (row % 2)
    column = np.floor(along).astype(int)
    bricks = (row.max() + 1, column.max() + 1)
    dark = canvas.rng.random((*bricks, 1)) < 0.10
    tints = _tints(canvas.rng, bricks, 0.16 * contrast) * (1 - 0.5 * contrast * dark)
    image = np.asarray(colour, np.float32) * tints[row, column]
    wobble = 0.3 * joint * canvas.noise(0.02, octaves=2)
    from_edge = np.minimum(
        np.minimum(along % 1, 1 - along % 1) * brick[0], np.minimum(y / brick[1] % 1, 1 - y / brick[1] % 1) * brick[1]
    )
    mortar = np.clip((joint / 2 - from_edge + wobble) * canvas.density + 0.5, 0, 1)[..., None]
    image = image * (1 - mortar) + 0.62 * mortar
    return shaded(shaded(image, canvas.noise(0.35), 0.18 * contrast), canvas.noise(0.03, octaves=4), 0.28 * contrast)


def plaster(canvas: Canvas, colour: Float64) -> Image:
    """Old paint with stains, specks, chips and cracks."""
    image = shaded(canvas.filled(colour), canvas.noise(0.6), 0.16)
    stains = np.clip(canvas.noise(0.25) * 1.6 - 0.5, 0, 1)
    image = shaded(image, -stains, 0.35)
    image = shaded(image, canvas.noise(0.02, octaves=3), 0.12)
    area = canvas.width * canvas.height
    drawing = _drawable(image)
    for _ in range(int(5 * area)):
        start = canvas.rng.uniform(0, 1, 2) * canvas.shape[::-1]
        steps = np.cumsum(canvas.rng.normal(0, canvas.px(0.025), (12, 2)), axis=0)
        cv2.polylines(drawing, [np.int32(start + steps)], False, _ink(0.4 * colour), 1, cv2.LINE_AA)
    return speckled(
        canvas, _paint(drawing), int(160 * area), (0.003, 0.018), [colour * 0.45, colour * 0.7, colour * 1.35]
    )


def bare(canvas: Canvas, colour: Float64) -> Image:
    """Smooth paint, with the dust and the roller's marks that a camera just sees."""
    image = shaded(shaded(canvas.filled(colour), canvas.noise(0.5), 0.015), canvas.noise(0.012, octaves=2), 0.012)
    return speckled(canvas, image, int(6 * canvas.width * canvas.height), (0.002, 0.006), [colour * 0.8])


def speckled(
    canvas: Canvas, image: Image, count: int, sizes: tuple[float, float], colours: list[Float64] | Float64
) -> Image:
    """The picture with random angular chips of `sizes` m."""
    rows, columns = canvas.shape
    centres = canvas.rng.uniform(0, 1, (count, 2)) * (columns, rows)
    radii = canvas.rng.uniform(*sizes, (count, 1)) * canvas.density / 2
    angles = np.sort(canvas.rng.uniform(0, 2 * np.pi, (count, 6)), axis=1)
    corners = centres[:, None] + radii[..., None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    picks = canvas.rng.integers(len(colours), size=count)
    drawing = _drawable(image)
    for polygon, pick in zip(np.round(corners * 16).astype(np.int32), picks, strict=True):
        cv2.fillPoly(drawing, [polygon], _ink(colours[pick]), cv2.LINE_AA, 4)
    return _paint(drawing)


def planks(canvas: Canvas, colour: Float64, plank: float, gap: float = 0.003) -> Image:
    """Boards along the width, with grain, knots and scratches."""
    _, y = canvas.metres()
    row = np.floor(y / plank).astype(int)[:, 0]
    tints = _tints(canvas.rng, (row.max() + 1,), 0.13)
    image = canvas.filled(colour) * tints[row][:, None]
    image = shaded(image, canvas.noise(0.012, stretch=14, octaves=4), 0.22)
    image = shaded(image, canvas.noise(0.08, stretch=3, octaves=3), 0.12)
    image = shaded(image, -np.clip((gap - (y % plank)) / gap, 0, 1) + np.zeros(canvas.shape, np.float32), 0.7)
    drawing, mean = _drawable(image), image.mean(axis=(0, 1))
    area = canvas.width * canvas.height
    for _ in range(int(5 * area) + 3):
        centre = np.int32(canvas.rng.uniform(0, 1, 2) * canvas.shape[::-1])
        size = canvas.rng.uniform(0.003, 0.013)
        axes = (canvas.px(canvas.rng.uniform(1.0, 3.0) * size), canvas.px(size))
        turn = canvas.rng.normal(0, 10)
        cv2.ellipse(drawing, centre, axes, turn, 0, 360, _ink(canvas.rng.uniform(0.3, 0.6) * mean), -1, cv2.LINE_AA)
        cv2.ellipse(drawing, centre, (2 * axes[0], 2 * axes[1]), turn, 0, 360, _ink(0.7 * mean), 1, cv2.LINE_AA)
    for _ in range(int(25 * area) + 4):
        start = canvas.rng.uniform(0, 1, 2) * canvas.shape[::-1]
        end = start + canvas.rng.normal(0, canvas.px(0.06), 2)
        cv2.line(drawing, np.int32(start), np.int32(end), _ink(mean * canvas.rng.choice([0.5, 1.35])), 1, cv2.LINE_AA)
    image = _paint(drawing)
    return shaded(image, canvas.noise(0.004, octaves=2), 0.07)


def terrazzo(canvas: Canvas, colour: Float64, tile: float) -> Image:
    """Tiles with chips of stone of many colours."""
    image = shaded(canvas.filled(colour), canvas.noise(0.3), 0.15)
    stones = canvas.rng.uniform(0.05, 0.95, (24, 1)) * _tints(canvas.rng, (24,), 0.3)
    area = canvas.width * canvas.height
    image = speckled(canvas, image, int(900 * area), (0.008, 0.05), stones)
    x, y = canvas.metres()
    for position in (x, y):
        joint = np.clip(((0.008 - position % tile) * canvas.density), 0, 1)
        image = shaded(image, -np.broadcast_to(joint, canvas.shape).astype(np.float32), 0.75)
    return shaded(image, canvas.noise(0.01, octaves=3), 0.10)


def poster(canvas: Canvas) -> Image:
    """A notice: a title, lines of letters, blocks of colour and a small picture."""
    rng = canvas.rng
    ground = rng.uniform(0.6, 0.97, 3) if rng.random() < 0.6 else rng.uniform(0.05, 0.5, 3)
    tone = _ink((0.06 if ground.mean() > 0.5 else 0.94) + rng.uniform(-0.05, 0.05, 3))
    image = canvas.filled(ground)
    rows, columns = canvas.shape
    for _ in range(int(rng.integers(3, 7))):
        corner = rng.uniform(0.05, 0.8, 2) * (columns, rows)
        size = rng.uniform(0.08, 0.4, 2) * (columns, rows)
        colour = rng.uniform(0, 1, 3).tolist()
        if rng.random() < 0.5:
            cv2.rectangle(image, np.int32(corner), np.int32(corner + size), colour, -1)
        else:
            cv2.circle(image, np.int32(corner), int(size.min() / 2), colour, -1, cv2.LINE_AA)
    picture = shaded(canvas.filled(rng.uniform(0.3, 0.9, 3)), canvas.noise(canvas.height / 6), 0.7)
    top, left = int(rng.uniform(0.3, 0.6) * rows), int(rng.uniform(0.1, 0.6) * columns)
    image[top : top + rows // 4, left : left + columns // 3] = picture[
        top : top + rows // 4, left : left + columns // 3
    ]
    drawing = _drawable(image)
    line = max(5, rows // int(rng.integers(14, 24)))
    for k, baseline in enumerate(range(2 * line, rows - line // 2, int(1.5 * line))):
        letters = "".join(rng.choice(list("abcdefghik lmnoprstuvwxyz 0123456789"), int(rng.integers(6, 30))))
        scale = line / 22 * (1.7 if k == 0 else 1.0)
        thickness = max(1, round(scale * (2.4 if k == 0 else 1.4)))
        text = letters.upper()[:10] if k == 0 else letters
        cv2.putText(
            drawing, text, (columns // 14, baseline), cv2.FONT_HERSHEY_SIMPLEX, scale, tone, thickness, cv2.LINE_AA
        )
    cv2.rectangle(drawing, (0, 0), (columns - 1, rows - 1), tone, max(1, rows // 90))
    return shaded(_paint(drawing), canvas.noise(0.1), 0.05)


def cardboard(canvas: Canvas) -> Image:
    """The side of a box: corrugation, tape, a printed label."""
    rng = canvas.rng
    image = shaded(canvas.filled(np.array([0.66, 0.51, 0.36]) * rng.uniform(0.8, 1.1)), canvas.noise(0.05), 0.12)
    image = shaded(image, canvas.noise(0.003, stretch=12, octaves=2), 0.08)
    rows, columns = canvas.shape
    tape = int(rng.uniform(0.35, 0.6) * columns)
    image[:, tape : tape + max(2, columns // 9)] *= (1.12, 1.1, 1.0)
    label = Canvas(rng, 0.4 * canvas.width, 0.35 * canvas.height, canvas.density)
    top, left = (int(rng.uniform(0.1, 0.5) * n) for n in (rows, columns))
    image[top : top + label.shape[0], left : left + label.shape[1]] = poster(label)[: rows - top, : columns - left]
    return image.clip(0, 1)


def spine(canvas: Canvas) -> Image:
    """The back of a book."""
    colour = canvas.rng.uniform(0.1, 0.95) * canvas.rng.uniform(0.3, 1.0, 3)
    image = shaded(canvas.filled(colour), canvas.noise(0.03), 0.2)
    rows, columns = canvas.shape
    for _ in range(int(canvas.rng.integers(2, 6))):
        top = int(canvas.rng.uniform(0.03, 0.9) * rows)
        image[top : top + max(1, int(canvas.rng.uniform(0.01, 0.15) * rows)), columns // 8 : columns - columns // 8] = (
            canvas.rng.uniform(0, 1, 3)
        )
    return image


def brushed(canvas: Canvas, colour: Float64) -> Image:
    """Metal drawn along the width, with dents and spots."""
    image = shaded(canvas.filled(colour), canvas.noise(0.004, stretch=40, octaves=3), 0.07)
    image = shaded(image, canvas.noise(0.03, stretch=3), 0.10)
    return speckled(canvas, image, int(2500 * canvas.width * canvas.height), (0.002, 0.006), [image.mean((0, 1)) * 0.6])
