# SPDX-License-Identifier: Apache-2.0
"""Pictures of everything but a plant, to lay plates over: rooms, walls, curtains, boards, fields, skies, soil."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..command_options import SimulateOptions
from ..core.scene import Camera
from .grounds import GROUND_PX, paint_ground
from .mesh import unit
from .plant import grow_plant
from .render import develop, light_scene, render
from .room import build_room
from .textures import Canvas, Image, brushed, cardboard, masonry, planks, plaster, poster, spine, terrazzo

BACKGROUND_PX: Final = GROUND_PX
ROOM_VIEWS: Final = 6
GROUNDS: Final = 8


def paint_backgrounds(seed: int) -> NDArray[np.uint8]:
    """(B, BACKGROUND_PX, BACKGROUND_PX, 3) sRGB: views of one room, and pictures of other kinds."""
    rng = np.random.default_rng([seed, 13])
    kinds: Sequence[Callable[[np.random.Generator], Image]] = (
        _wall,
        _wall,
        _field,
        _field,
        _field,
        _thicket,
        _thicket,
        _curtain,
        _clutter,
        _board,
        _soft,
        *[paint_ground] * GROUNDS,
    )
    pictures = [_eight_bits(kind(rng)) for kind in kinds]
    return np.stack([*_room_views(seed, rng), *pictures])


def _room_views(seed: int, rng: np.random.Generator) -> list[NDArray[np.uint8]]:
    """Looks from the middle of a simulated room at its walls and furniture, over the plant's head."""
    options = SimulateOptions(seed=seed, bolls=1, width=640, frames=2)
    scene = light_scene(grow_plant(options), build_room(options, np.zeros(3)))
    views = []
    for _ in range(ROOM_VIEWS):
        azimuth, slope = rng.uniform(0, 2 * np.pi), rng.normal(-0.25, 0.25)
        forward = np.array([np.cos(azimuth) * np.cos(slope), np.sin(azimuth) * np.cos(slope), np.sin(slope)])
        right = unit(np.cross(forward, (0, 0, 1.0)))
        rotation = np.stack([right, np.cross(forward, right), forward])
        centre = np.array([0, 0, 0.9]) + 0.4 * forward * (1, 1, 0)
        size = BACKGROUND_PX
        f = size * rng.uniform(0.6, 2.5)
        camera = Camera("view", size, size, f, f, size / 2, size / 2, np.column_stack([rotation, -rotation @ centre]))
        views.append(develop(render(scene, camera, supersampling=1)))
    return views


def _canvas(rng: np.random.Generator) -> Canvas:
    width = rng.uniform(0.3, 2.0)
    return Canvas(rng, width, width, BACKGROUND_PX / width)


def _fit(image: Image) -> Image:
    fitted: Image = cv2.resize(image, (BACKGROUND_PX, BACKGROUND_PX), interpolation=cv2.INTER_AREA)
    return fitted


def _colour(rng: np.random.Generator) -> NDArray[Any]:
    """Pale and hardly coloured half of the time."""
    if rng.random() < 0.5:
        return rng.uniform(0.6, 0.97) * rng.uniform(0.93, 1.0, 3)
    return rng.uniform(0.05, 0.95) * rng.uniform(0.4, 1.0, 3)


def _wall(rng: np.random.Generator) -> Image:
    canvas, colour = _canvas(rng), _colour(rng)
    walls: Sequence[Callable[[], Image]] = (
        lambda: masonry(canvas, colour, (rng.uniform(0.1, 0.4), rng.uniform(0.05, 0.2)), 0.01, rng.uniform(0.2, 1)),
        lambda: planks(canvas, colour, plank=rng.uniform(0.05, 0.25)),
        lambda: terrazzo(canvas, colour, tile=rng.uniform(0.1, 0.6)),
        lambda: poster(canvas),
        lambda: cardboard(canvas),
        lambda: brushed(canvas, colour),
        lambda: plaster(canvas, colour),
    )
    return _fit(walls[int(rng.integers(len(walls)))]())


def _soft(rng: np.random.Generator) -> Image:
    """A plain surface in uneven light."""
    canvas = _canvas(rng)
    shade = 1 + rng.uniform(0, 0.35) * canvas.noise(canvas.width, octaves=2)
    grain = 1 + rng.uniform(0, 0.08) * canvas.noise(0.02, octaves=2)
    return _fit(_colour(rng) * (shade * grain)[..., None])


def _curtain(rng: np.random.Generator) -> Image:
    """Folds of cloth, or stripes."""
    canvas = _canvas(rng)
    x, y = canvas.metres()
    phase = 0.4 * canvas.noise(0.5, octaves=2) + 2 * np.pi * x / rng.uniform(0.03, 0.25) + rng.normal(0, 2) * y
    folds = 0.5 + 0.5 * np.sin(phase)
    if rng.random() < 0.4:
        folds = (folds > 0.5).astype(np.float32)
    low = rng.uniform(0.1, 0.8)
    image = _colour(rng) * (low + (1 - low) * folds + 0.05 * canvas.noise(0.02, octaves=2))[..., None]
    return _fit(np.rot90(image).copy() if rng.random() < 0.3 else image)


def _board(rng: np.random.Generator) -> Image:
    """Markers, a chessboard or print on white, seen at an angle."""
    cells = int(rng.integers(4, 24))
    if rng.random() < 0.5:
        pattern = np.indices((cells, cells)).sum(axis=0) % 2 * 1.0
    else:
        pattern = (rng.random((cells, cells)) < rng.uniform(0.3, 0.9)) * 1.0
    board = cv2.resize(pattern, (512, 512), interpolation=cv2.INTER_NEAREST)[..., None]
    ink, paper = rng.uniform(0, 0.3, 3), rng.uniform(0.6, 0.97) * rng.uniform(0.95, 1, 3)
    picture = (paper * board + ink * (1 - board)).astype(np.float32)
    size = BACKGROUND_PX
    corners = np.array([[0, 0], [512, 0], [512, 512], [0, 512]], np.float32)
    seen = corners * size / 512 + rng.normal(0, 0.18 * size, (4, 2)).astype(np.float32)
    surface = _soft(rng)
    warped: Image = cv2.warpPerspective(
        picture,
        cv2.getPerspectiveTransform(corners, seen),
        (size, size),
        flags=cv2.INTER_AREA,
        dst=surface.astype(np.float32).copy(),
        borderMode=cv2.BORDER_TRANSPARENT,
    )
    return warped


def _clutter(rng: np.random.Generator) -> Image:
    """Books, cartons, and pale shapes with shading: what stands on shelves and tables."""
    canvas = _canvas(rng)
    image = _soft(rng)
    size = BACKGROUND_PX
    for _ in range(int(rng.integers(5, 50))):
        w, h = (int(s) for s in np.exp(rng.uniform(np.log(8), np.log(160), 2)))
        x, y = int(rng.integers(-w // 2, size - w // 2)), int(rng.integers(-h // 2, size - h // 2))
        x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + w, size), min(y + h, size)
        if x1 <= x0 or y1 <= y0:
            continue
        s = np.linspace(-1, 1, w)[None, x0 - x : x1 - x]
        t = np.linspace(-1, 1, h)[y0 - y : y1 - y, None]
        inside = (s**2 + t**2 < 1) if rng.random() < 0.4 else np.ones((y1 - y0, x1 - x0), bool)
        shade = 1 + rng.uniform(-0.5, 0.5) * s + rng.uniform(-0.5, 0.5) * t - rng.uniform(0, 0.4) * (s**2 + t**2)
        patch = _colour(rng) * shade[..., None]
        if rng.random() < 0.2:
            book = spine(Canvas(rng, 0.05, 0.2, 1000))
            patch = cv2.resize(book, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA)
        image[y0:y1, x0:x1] = np.where(inside[..., None], patch, image[y0:y1, x0:x1])
    cluttered: Image = image.clip(0, 1) * (1 + 0.05 * cv2.resize(canvas.noise(0.1), (size, size))[..., None])
    return cluttered


def _field(rng: np.random.Generator) -> Image:
    """Sky above, soil, stalks and leaves below, all of it out of focus more or less."""
    size = BACKGROUND_PX
    canvas = Canvas(rng, 1.0, 1.0, size)
    sky_blue = rng.uniform(0.3, 1.0) * np.array([0.35, 0.6, 0.95]) + rng.uniform(0, 0.3)
    clouds = (canvas.noise(0.5, stretch=2) * rng.uniform(0.3, 1.5) + rng.uniform(-0.8, 1.2)).clip(0, 1)[..., None]
    sky = (1 - clouds) * sky_blue + clouds * rng.uniform(0.5, 1.0) * rng.uniform(0.95, 1, 3)
    sky = sky * np.linspace(rng.uniform(0.6, 1.1), 1.0, size)[:, None, None]
    soil = rng.uniform(0.1, 0.6) * np.array([1.0, 0.8, 0.6]) * (1 + 0.4 * canvas.noise(0.2))[..., None]
    horizon = rng.uniform(-0.3, 1.3) * size
    y = np.arange(size)[:, None] - horizon + 20 * canvas.noise(0.3, octaves=2)
    image = np.where((y > 0)[..., None], soil, sky).clip(0, 1).astype(np.float32)
    drawing = np.round(255 * image).astype(np.uint8)
    top = int(np.clip(horizon - 0.3 * size, 0, size - 2))
    for _ in range(int(rng.integers(0, 250))):
        middle = np.array([rng.uniform(0, size), rng.uniform(top, size)])
        colour = rng.choice(
            [[0.25, 0.35, 0.1], [0.3, 0.2, 0.1], [0.45, 0.35, 0.15], [0.15, 0.1, 0.07], [0.4, 0.15, 0.1]]
        )
        ink = (255 * (colour * rng.uniform(0.4, 1.8)).clip(0, 1)).tolist()
        if rng.random() < 0.5:
            end = middle + rng.normal(0, 0.12, 2) * size * (0.6, 1.5)
            cv2.line(drawing, np.int32(middle), np.int32(end), ink, int(rng.integers(1, 6)), cv2.LINE_AA)
        else:
            angles = np.sort(rng.uniform(0, 2 * np.pi, 9))
            radii = rng.uniform(0.4, 1, 9) * rng.uniform(4, 50)
            outline = middle + radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], 1)
            cv2.fillPoly(drawing, [np.int32(outline)], ink, cv2.LINE_AA)
    if rng.random() < 0.6:  # cotton that is too far away to be counted
        white = np.array([255, 255, 255]) * rng.uniform(0.5, 1.0) * rng.uniform(0.9, 1.0, 3)
        for _ in range(int(rng.integers(20, 400))):
            middle = np.array([rng.uniform(0, size), np.clip(horizon, 0, size - 2) + size * rng.beta(1, 3)])
            ink = (white * rng.uniform(0.5, 1.0)).tolist()
            cv2.circle(drawing, np.int32(middle), int(rng.integers(1, 5)), ink, -1, cv2.LINE_AA)
    blurred = cv2.GaussianBlur(drawing, (0, 0), float(rng.choice([0.5, 1.5, 4, 8])))
    field: Image = blurred.astype(np.float32) / 255
    return field


def _thicket(rng: np.random.Generator) -> Image:
    """Twigs and leaves, dense and dark, with specks of bright sky, pale soil or litter between them."""
    size = BACKGROUND_PX
    canvas = Canvas(rng, 1.0, 1.0, size)
    pale = rng.uniform(0.5, 1.0) * rng.uniform(0.85, 1.0, 3) * (1 + 0.15 * canvas.noise(0.3))[..., None]
    drawing = np.round(255 * pale.clip(0, 1)).astype(np.uint8)
    base = rng.uniform(0.02, 0.35) * np.array([1.0, rng.uniform(0.6, 1.3), rng.uniform(0.3, 0.8)])
    fine = np.exp(rng.uniform(np.log(1.0), np.log(5.0)))
    for _ in range(int(rng.uniform(300, 4000) / fine**1.3)):
        ink = (255 * (base * np.exp(rng.normal(0, 0.4) + rng.normal(0, 0.12, 3))).clip(0, 1)).tolist()
        middle = rng.uniform(0, size, 2)
        if rng.random() < 0.6:
            end = middle + rng.normal(0, 0.08, 2) * size
            cv2.line(
                drawing, np.int32(middle), np.int32(end), ink, max(1, int(fine * rng.uniform(0.5, 2))), cv2.LINE_AA
            )
        else:
            angles = np.sort(rng.uniform(0, 2 * np.pi, 8))
            radii = rng.uniform(0.4, 1, 8) * fine * rng.uniform(2, 14)
            outline = middle + radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], 1)
            cv2.fillPoly(drawing, [np.int32(outline)], ink, cv2.LINE_AA)
    blurred: Image = cv2.GaussianBlur(drawing, (0, 0), float(rng.choice([0.5, 1.0, 3.0]))).astype(np.float32) / 255
    return blurred


def _eight_bits(image: Image) -> NDArray[np.uint8]:
    return np.round(255 * np.asarray(image).clip(0, 1)).astype(np.uint8)
