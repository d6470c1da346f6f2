# SPDX-License-Identifier: Apache-2.0
"""Pictures of bare ground in hard sun: sand, gravel, straw, dry leaves, clods. Their bright spots look like lint.

Each is a relief with colours, lit by a low or high sun whose shadows fall along the picture, and by the sky; seen from
above or aslant, in focus or out of it. Relief and lengths are pixels of the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from ..core.scene import Float64
from ..core.srgb import to_srgb
from .textures import Canvas, Image

GROUND_PX: Final = 448
MOST_PIECES: Final = 1500
"""More would be slow to draw, and too small to see."""
SUN: Final = np.array([1.0, 0.94, 0.82], np.float32)
SKY: Final = np.array([0.75, 0.88, 1.0], np.float32)
SOIL: Final = np.array([[0.42, 0.31, 0.20], [0.33, 0.20, 0.12], [0.50, 0.45, 0.38], [0.55, 0.47, 0.34]])
STONE: Final = np.array([[0.45, 0.43, 0.40], [0.65, 0.62, 0.57], [0.40, 0.30, 0.23], [0.75, 0.73, 0.70]])
STRAW: Final = np.array([[0.62, 0.50, 0.25], [0.72, 0.65, 0.45], [0.50, 0.36, 0.18], [0.78, 0.75, 0.66]])
DRY_LEAF: Final = np.array([[0.42, 0.26, 0.12], [0.55, 0.42, 0.24], [0.30, 0.17, 0.08], [0.66, 0.58, 0.43]])
"""(4, 3) linear RGB albedos each, to be drawn from."""
PALE: Final = np.array([0.82, 0.80, 0.76])
"""Colour to which sun, dust and salt bleach them."""


@dataclass(frozen=True)
class _Relief:
    height: Image
    albedo: Image


@dataclass(frozen=True)
class _Pieces:
    """Pieces on the ground, in the order in which they cover each other."""

    outlines: Float64
    """(N, K, 2) x, y."""
    thickness: Float64
    """(N,) from the rim, which is round, to the top."""
    round_px: Float64
    """(N,) width of the round rim; below 0 the rim stands up, as in leaves that curl."""
    rough: float
    """Height of their bumps, relative to their thickness."""


def paint_ground(rng: np.random.Generator) -> Image:
    """(GROUND_PX, GROUND_PX, 3) sRGB, 0..1: one kind of ground at one scale, in the sun."""
    kind, scale = (_sand, _stones, _stones, _straw, _leaves)[int(rng.integers(5))], np.exp(rng.uniform(-0.7, 1.4))
    relief = kind(rng, float(scale))
    light = _focused(rng, _aslant(rng, _sunlit(relief, *rng.uniform((0, 0.3, 0.08), (2 * np.pi, 1.2, 0.5)))))
    # Exposed for the plant, not for the ground: the brightest of it may be white.
    exposed = light * np.float32(rng.uniform(0.5, 1.5) / max(float(np.quantile(light[::4, ::4], 0.97)), 1e-3))
    return to_srgb(exposed.clip(0, 1)).astype(np.float32)


def _draw_colours(rng: np.random.Generator, palette: Float64, count: int) -> Float64:
    """(N, 3) of a mixture of two of the palette, all bleached alike, each a little darker or lighter."""
    first, second = palette[rng.integers(len(palette), size=2)]
    share = rng.random((count, 1))
    colours = share * first + (1 - share) * second
    colours += rng.beta(0.8, 1.2) * (PALE - colours)
    varied: Float64 = colours * np.exp(rng.normal(0, 0.15, (count, 1))).clip(0.5, 1.15)
    return varied


def _sand(rng: np.random.Generator, scale: float) -> _Relief:
    """Grains, hollows, and ripples that the wind made."""
    canvas = Canvas(rng, GROUND_PX, GROUND_PX, 1.0)
    x, y = canvas.metres()
    turn, wave = rng.uniform(0, np.pi), rng.uniform(15, 50) * scale
    phase = 2 * np.pi * (x * np.cos(turn) + y * np.sin(turn)) / wave + 2.5 * canvas.noise(3 * wave, octaves=3)
    ripples = rng.choice([0.0, 0.08]) * wave * np.sin(phase)
    hollows = rng.uniform(1, 6) * scale * canvas.noise(40 * scale, octaves=3)
    height = ripples + hollows + rng.uniform(0.2, 0.8) * scale * canvas.noise(1.5 * scale, octaves=2)
    colour = _draw_colours(rng, SOIL, 1).astype(np.float32)
    tint = 1 + 0.25 * canvas.noise(1.2 * scale + 0.5, octaves=1) + 0.1 * canvas.noise(80, octaves=2)
    return _Relief(height.astype(np.float32), colour * tint[..., None])


def _stones(rng: np.random.Generator, scale: float) -> _Relief:
    """Gravel or, rougher, clods of soil, of many sizes."""
    typical, rough, palette = (5 * scale, 0.15, STONE) if rng.random() < 0.5 else (9 * scale, 0.6, SOIL)
    radius = typical * np.exp(rng.normal(0, 0.6, MOST_PIECES))
    radius = radius[: _count(rng.uniform(0.2, 2.5), float(np.mean(radius**2)) * 3)]
    shape = 1 + rng.uniform(0.05, 0.3) * rng.uniform(-1, 1, (len(radius), 11))
    outlines = _around(rng, radius, shape, rng.uniform(0.6, 1.0))
    return _strewn(rng, _sand(rng, scale), _Pieces(outlines, 0.65 * radius, 0.8 * radius, rough), palette)


def _straw(rng: np.random.Generator, scale: float) -> _Relief:
    """Stalks and blades of dry grass, on soil or on each other."""
    width = 1.2 * scale * np.exp(rng.normal(0, 0.35, MOST_PIECES))
    long = width * rng.uniform(8, 45, MOST_PIECES)
    count = _count(rng.uniform(0.3, 3.0), float(np.mean(width * long)))
    width, long = width[:count], long[:count]
    turn = rng.uniform(0, np.pi) + rng.normal(0, rng.uniform(0.3, 2.0), count)
    along, across = np.stack([np.cos(turn), np.sin(turn)], 1), np.stack([-np.sin(turn), np.cos(turn)], 1)
    bow = rng.normal(0, 0.06, count) * long
    spine = np.stack([s * long[:, None] * along + (1 - 4 * s**2) * bow[:, None] * across for s in (-0.5, 0.0, 0.5)], 1)
    side = 0.5 * width[:, None, None] * across[:, None]
    outlines = np.concatenate([spine + side, spine[:, ::-1] - side], axis=1)
    outlines += rng.uniform(-0.05, 1.05, (count, 1, 2)) * GROUND_PX
    return _strewn(rng, _sand(rng, scale), _Pieces(outlines, width, 0.5 * width, 0.05), STRAW)


def _leaves(rng: np.random.Generator, scale: float) -> _Relief:
    """Lobed or long dry leaves, crumpled and curled at the rim."""
    radius = 14 * scale * np.exp(rng.normal(0, 0.3, MOST_PIECES))
    radius = radius[: _count(rng.uniform(0.3, 2.0), float(np.mean(radius**2)) * 1.5)]
    slim, lobes = rng.uniform(0.3, 1.0), int(rng.integers(1, 4))
    shape = 0.8 + rng.uniform(0.0, 0.3) * np.cos((2 * lobes + 1) * np.linspace(0, 2 * np.pi, 20, endpoint=False))
    outlines = _around(rng, radius, shape * rng.uniform(0.85, 1.15, (len(radius), 20)), slim)
    return _strewn(rng, _sand(rng, scale), _Pieces(outlines, 0.3 * radius, -0.5 * slim * radius, 0.7), DRY_LEAF)


def _count(cover: float, area: float) -> int:
    """Number of pieces of an area that cover the picture `cover` times."""
    return int(np.clip(cover * GROUND_PX**2 / area, 4, MOST_PIECES))


def _around(rng: np.random.Generator, radius: Float64, shape: Float64, slim: float) -> Float64:
    """(N, K, 2) outlines about random middles, of radii (N, K) in `radius`, `slim` times as wide as long."""
    angles = np.linspace(0, 2 * np.pi, shape.shape[1], endpoint=False)
    points = radius[:, None, None] * shape[..., None] * np.stack([np.cos(angles), slim * np.sin(angles)], axis=-1)
    turn = rng.uniform(0, 2 * np.pi, len(radius))
    rotations = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]).transpose(2, 1, 0)
    outlines: Float64 = points @ rotations + rng.uniform(-0.05, 1.05, (len(radius), 1, 2)) * GROUND_PX
    return outlines


def _strewn(rng: np.random.Generator, ground: _Relief, pieces: _Pieces, palette: Float64) -> _Relief:
    """The ground with pieces on it, each of its own colour and slope."""
    canvas = Canvas(rng, GROUND_PX, GROUND_PX, 1.0)
    x, y = canvas.metres()
    owners = np.zeros(canvas.shape, np.int32)
    for number, outline in enumerate(np.round(pieces.outlines).astype(np.int32), start=1):
        cv2.fillPoly(owners, [outline], number)
    inner = np.ones(canvas.shape, np.uint8)
    inner[:, 1:] &= owners[:, 1:] == owners[:, :-1]
    inner[1:] &= owners[1:] == owners[:-1]
    from_rim = cv2.distanceTransform(inner, cv2.DIST_L2, 3) + np.float32(0.5)

    def each(values: Float64) -> Image:
        """A value of each piece (N, ...) where it lies, 0 elsewhere."""
        return np.concatenate([np.zeros((1, *values.shape[1:])), values]).astype(np.float32)[owners]

    rim = each(pieces.round_px)
    outside = 1 - (from_rim / np.maximum(np.abs(rim), 0.5)).clip(0, 1)
    profile = np.where(rim < 0, 0.4 + 0.6 * outside**2, np.sqrt(1 - outside**2))
    bumps = 1 + pieces.rough * canvas.noise(max(2.0, 1.5 * float(np.median(pieces.thickness))), octaves=3)
    slopes, middles = rng.normal(0, 0.12, (len(pieces.outlines), 2)), pieces.outlines.mean(axis=1)
    tilt = each(slopes[:, 0]) * x + each(slopes[:, 1]) * y - each((slopes * middles).sum(axis=1))
    height = np.where(owners > 0, each(pieces.thickness) * profile * bumps + tilt + 0.5, 0.3 * ground.height)
    colours = each(_draw_colours(rng, palette, len(slopes))) * (1 + 0.12 * canvas.noise(4, octaves=2))[..., None]
    return _Relief(height.astype(np.float32), np.where(owners[..., None] > 0, colours, ground.albedo))


def _sunlit(relief: _Relief, azimuth: float, elevation: float, sky: float) -> Image:
    """Linear light (H, W, 3) of a relief: the sun where no higher ground is in its way, the sky, less in hollows."""
    towards = np.array([np.cos(azimuth), np.sin(azimuth)], np.float32)
    rise, height = np.tan(elevation), relief.height
    down, right = np.gradient(height)
    cosines = np.float32(rise) - towards[0] * right - towards[1] * down
    cosines /= np.float32(np.hypot(1, rise)) * np.sqrt(1 + right**2 + down**2)
    highest = height.copy()
    low, high = np.quantile(height[::4, ::4], (0.02, 0.98))
    for step in np.linspace(1, max((high - low) / rise, 2), 14):
        nearer = np.column_stack([np.eye(2), step * towards])
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        shifted = cv2.warpAffine(height, nearer, height.shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE)
        np.maximum(highest, shifted - np.float32(step * rise), out=highest)
    sun = cosines.clip(0) * (highest - height < 0.3)
    hollow = cv2.GaussianBlur(height, (0, 0), 5) - height
    open_sky = np.exp(-hollow.clip(0) / (1 + height.std())) * np.float32(sky)
    lit: Image = relief.albedo * (sun[..., None] * SUN + open_sky[..., None] * SKY)
    return lit


def _aslant(rng: np.random.Generator, image: Image) -> Image:
    """The ground as a camera sees it that looks down on it or, so that its upper part is farther away, at a slope."""
    size, last = GROUND_PX, GROUND_PX * rng.uniform(0.5, 1.0)
    margin = rng.uniform(0, 0.15) * last
    seen = np.array([[0, 0], [size, 0], [size - margin, last], [margin, last]], np.float32)
    corners = np.array([[0, 0], [size, 0], [size, size], [0, size]], np.float32)
    aslant: Image = cv2.warpPerspective(image, cv2.getPerspectiveTransform(seen, corners), (size, size))
    return aslant


def _focused(rng: np.random.Generator, light: Image) -> Image:
    """In focus half of the time; else every bright spot is a disc, as the lens' aperture has it."""
    if rng.random() < 0.5:
        sharp: Image = cv2.GaussianBlur(light, (0, 0), 0.6)
        return sharp
    radius = np.exp(rng.uniform(np.log(1.2), np.log(9.0)))
    y, x = np.mgrid[-9:10, -9:10]
    disc = (radius + 0.5 - np.hypot(x, y)).clip(0, 1).astype(np.float32)
    blurred: Image = cv2.filter2D(light, -1, disc / disc.sum())
    return blurred
