# SPDX-License-Identifier: Apache-2.0
"""Training pictures: plates in a mixture of light, over each other and over backgrounds, developed as phones do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float32
from ..core.srgb import to_linear
from ..core.training_picture import LINT, UNKNOWN, TrainingPicture
from .plates import LIGHTS, PLATE_PX, Plate

BARE: Final = 0.12
"""Share of the pictures without a plant, because most things that a camera sees are not plants."""

BACKLIT: Final = (1.7, 12.0)
"""Brightness of a background, relative to the lint that is lit best, in pictures taken against the light."""
SUNLIT: Final = (0.45, 1.4)
"""The same where both stand in the same sun, e.g. a plant on pale ground."""
UNEQUAL: Final = (0.04, 1.7)
"""The same anywhere."""
CROWDED: Final = 0.25
"""Share of the pictures in which many plants stand before each other, as in a field."""
SHARP_PX: Final = 1.5
SOFT: Final = 0.05
"""Blur (standard deviation), and its share of a boll's diameter, from which the boll's edge cannot be recognised."""


@dataclass(frozen=True)
class Layer:
    light: Float32
    cover: Float32
    classes: NDArray[np.uint8]
    ids: NDArray[np.uint16]
    centres_px: Float32
    diameters_px: Float32


def compose(
    rng: np.random.Generator, plates: Sequence[Plate], backgrounds: NDArray[np.uint8], size: int
) -> TrainingPicture:
    """A picture made of one to five plates and a background, or of a background alone.

    Args:
        backgrounds: (B, H, W, 3) sRGB.
        size: px, side of the picture.
    """
    power = draw_power(rng)
    bare = rng.random() < BARE
    layers = [] if bare else [_place(rng, _draw_plate(rng, plates), power, size)]
    most, more = (5, 0.75) if rng.random() < CROWDED else (3, 0.3)
    while not bare and len(layers) < most and rng.random() < more:
        layers.append(_place(rng, _draw_plate(rng, plates), power, size))
    behind = _background(rng, backgrounds[int(rng.integers(len(backgrounds)))], size)
    reference = _reference(layers)
    contrast = (BACKLIT, SUNLIT, UNEQUAL)[int(rng.choice(3, p=(0.2, 0.25, 0.55)))]
    brighter = rng.uniform(*np.log(contrast))
    light = behind * (reference * np.exp(brighter) / max(np.quantile(behind, 0.9), 1e-4))
    classes = np.zeros((size, size), np.uint8)
    ids = np.zeros((size, size), np.uint16)
    centres, diameters = [np.zeros((0, 2), np.float32)], [np.zeros(0, np.float32)]
    sharp = rng.random() < 0.6
    for layer in reversed(layers):
        blur = 0.0 if sharp or rng.random() < 0.4 else float(np.exp(rng.uniform(np.log(0.5), np.log(8))))
        light_of, cover = layer.light, layer.cover
        if blur:
            light_of, cover = (cv2.GaussianBlur(a, (0, 0), blur) for a in (light_of, cover))
        light = light * (1 - cover[..., None]) + light_of
        owned = cover > 0.5
        kinds = classes_in_blur(layer, blur)
        classes = np.where(owned, kinds, classes)
        first = sum(len(part) for part in diameters)
        own_ids = np.where((layer.ids > 0) & (kinds == LINT), layer.ids + first, 0)
        ids = np.where(owned, own_ids, ids).astype(np.uint16)
        centres.append(layer.centres_px)
        diameters.append(layer.diameters_px)
    image = _develop(rng, _expose(rng, light, reference))
    return TrainingPicture(image, classes, ids, np.concatenate(centres), np.concatenate(diameters))


def classes_in_blur(layer: Layer, blur_px: float) -> NDArray[np.uint8]:
    """The layer's classes (H, W) when it is out of focus: lint of bolls that are too small for so much blur (standard
    deviation) is `UNKNOWN`."""
    lost = np.concatenate([[False], blur_px > np.maximum(SOFT * layer.diameters_px, SHARP_PX)])
    return np.where((layer.classes == LINT) & lost[layer.ids], UNKNOWN, layer.classes).astype(np.uint8)


def _draw_plate(rng: np.random.Generator, plates: Sequence[Plate]) -> Plate:
    """A plate at random, one without lint less often than one with."""
    plate = plates[int(rng.integers(len(plates)))]
    if rng.random() < 0.75 and (plate.ids > 0).mean() < 0.01:
        plate = plates[int(rng.integers(len(plates)))]
    return plate


def draw_power(rng: np.random.Generator) -> Float32:
    """(LIGHTS, 3) of each light: one lamp alone, soft light, or any mixture, each of its own colour."""
    power = np.exp(rng.normal(0, 0.7, LIGHTS)) * (1.0, 0.6, 0.8, 0.4)
    kind = rng.random()
    shade = np.zeros((LIGHTS, 1))
    if kind < 0.35:  # hard: the sun or one lamp, and little else; out of doors shade is blue
        power *= (1.0, 0.0, rng.uniform(0.05, 0.3), rng.uniform(0.02, 0.15))
        shade[2:] = rng.uniform(0, 0.3)
    elif kind < 0.5:  # soft: overcast or a bright room
        power *= (rng.uniform(0, 0.2), 0.0, 1.0, rng.uniform(0.5, 2))
    warmth = (rng.normal(0, 0.12, (LIGHTS, 1)) - shade) * np.array([1.0, 0.0, -1.0]) + rng.normal(0, 0.02, (LIGHTS, 3))
    tint = np.exp(warmth + rng.normal(0, 0.06) * np.array([1.0, 0.0, -1.0]))
    coloured: Float32 = (power[:, None] * tint).astype(np.float32)
    return coloured


def _place(rng: np.random.Generator, plate: Plate, power: Float32, size: int) -> Layer:
    """A plate lit, mirrored, turned, scaled and moved at random, so that its edge is hardly ever seen."""
    zoom = size / PLATE_PX * np.exp(rng.uniform(np.log(1.0), np.log(1.7)))
    turn = rng.normal(0, 0.2) + (rng.integers(4) * np.pi / 2 if rng.random() < 0.1 else 0.0)
    mirror = rng.choice([-1.0, 1.0])
    matrix = zoom * np.array([[np.cos(turn) * mirror, -np.sin(turn)], [np.sin(turn) * mirror, np.cos(turn)]])
    slack = 0.5 * (zoom * PLATE_PX - size)
    middle = 0.5 * size + rng.uniform(-slack, slack, 2)
    offset = middle - matrix @ (0.5 * PLATE_PX, 0.5 * PLATE_PX)
    affine = np.column_stack([matrix, offset])
    # warpAffine puts pixel centres at whole numbers, all else here at halves.
    shifted = affine.copy()
    shifted[:, 2] += matrix @ (0.5, 0.5) - 0.5

    def warped(array: NDArray[Any], flags: int) -> NDArray[Any]:
        moved: NDArray[Any] = cv2.warpAffine(array, shifted, (size, size), flags=flags)
        return moved

    cover = warped(plate.cover.astype(np.float32) / 255, cv2.INTER_LINEAR)
    return Layer(
        light=plate.lit(power, np.stack([warped(light, cv2.INTER_LINEAR) for light in plate.light])),
        cover=cover,
        classes=warped(plate.classes, cv2.INTER_NEAREST),
        ids=warped(plate.ids, cv2.INTER_NEAREST).astype(np.uint16),
        centres_px=(plate.centres_px @ matrix.T + offset).astype(np.float32),
        diameters_px=(plate.diameters_px * zoom).astype(np.float32),
    )


def _background(rng: np.random.Generator, picture: NDArray[np.uint8], size: int) -> Float32:
    """A piece of a background in linear light, tinted and perhaps out of focus."""
    side = int(rng.uniform(0.35, 1.0) * min(picture.shape[:2]))
    y, x = (int(rng.integers(n - side + 1)) for n in picture.shape[:2])
    piece = cv2.resize(
        picture[y : y + side, x : x + side],
        (size, size),
        interpolation=cv2.INTER_AREA if side > size else cv2.INTER_LINEAR,
    )
    if rng.random() < 0.5:
        piece = piece[:, ::-1]
    light = to_linear(piece.astype(np.float32) / 255) * rng.uniform(0.85, 1.15, 3).astype(np.float32)
    if rng.random() < 0.35:
        grey = light.mean(axis=2, keepdims=True)
        light = grey + (light - grey) * np.float32(rng.uniform(0, 0.6))
    if rng.random() < 0.5:
        light = cv2.GaussianBlur(light, (0, 0), float(np.exp(rng.uniform(np.log(0.5), np.log(8)))))
    if rng.random() < 0.3:
        slope = rng.uniform(-0.7, 0.7, 2)
        t = np.linspace(-1, 1, size, dtype=np.float32)
        light = light * (1 + slope[0] * t[:, None] + slope[1] * t).clip(0.05)[..., None].astype(np.float32)
    return light


def _reference(layers: Sequence[Layer]) -> float:
    """Brightness of the lint that is lit best, or of the layers where there is none."""
    nothing = np.zeros(0, np.float32)
    lint = np.concatenate([nothing, *(layer.light[layer.classes == LINT].mean(axis=1) for layer in layers)])
    if len(lint) < 50:
        lint = np.concatenate([nothing, *(layer.light[layer.cover > 0.5].mean(axis=1) for layer in layers)])
    return max(float(np.quantile(lint, 0.95)), 1e-3) if len(lint) else 0.5


def _expose(rng: np.random.Generator, seen: Float32, reference: float) -> Float32:
    """Light as the sensor has it: exposure, white balance, stray light, dark parts made brighter."""
    exposed = np.exp(rng.normal(np.log(0.6), 0.45) if rng.random() < 0.8 else rng.uniform(np.log(0.06), np.log(2.5)))
    light: Float32 = seen * np.float32(exposed / reference)
    strong = 2.5 if rng.random() < 0.25 else 1.0  # open shade, mixed lamps, a white balance that was misled
    cast = rng.normal(0, 0.10 * strong) * np.array([1, 0, -1]) + rng.normal(0, 0.05 * strong) * np.array([0.5, -1, 0.5])
    light = light * np.exp(cast).astype(np.float32)
    if rng.random() < 0.15:  # a bright sky or lamp that strays in the lens
        tint = light.mean(axis=(0, 1)) / max(float(light.mean()), 1e-4)
        light = light + np.float32(exposed * rng.uniform(0.02, 0.35)) * tint
    if rng.random() < 0.25:  # what phones do against the light
        around = cv2.GaussianBlur(light.mean(axis=2), (0, 0), len(light) * rng.uniform(0.05, 0.2)) + np.float32(0.02)
        light = light * ((around / around.mean()) ** np.float32(-rng.uniform(0.1, 0.7)))[..., None]
    return light


def _develop(rng: np.random.Generator, light: Float32) -> NDArray[np.uint8]:
    """The picture that a phone makes from the light on its sensor: blur, noise, tone, sharpening, compression."""
    size = light.shape[0]
    if rng.random() < 0.35:
        light = cv2.GaussianBlur(light, (0, 0), float(rng.uniform(0.4, 1.6)))
    if rng.random() < 0.2:
        length, angle = rng.uniform(2, 9), rng.uniform(0, np.pi)
        kernel = np.zeros((11, 11), np.float32)
        step = 0.5 * length * np.array([np.cos(angle), np.sin(angle)])
        cv2.line(kernel, np.int32(np.round(5 - step)), np.int32(np.round(5 + step)), 1.0, 1, cv2.LINE_AA)
        light = cv2.filter2D(light, -1, kernel / kernel.sum())
    if rng.random() < 0.6:
        electrons = np.exp(rng.uniform(np.log(150), np.log(8000)))
        sigma = np.sqrt(light.clip(0) / np.float32(electrons) + np.float32(1e-6))
        light = light + (sigma * rng.standard_normal(light.shape, np.float32)).astype(np.float32)
    image = 255 * light.clip(0, 1) ** np.float32(1 / 2.2)
    if rng.random() < 0.5:  # contrast: an S about the middle
        bent = image / 255
        strength = np.float32(rng.uniform(-0.6, 1.2))
        image = (255 * (bent + strength * bent * (1 - bent) * (2 * bent - 1))).astype(np.float32)
    if rng.random() < 0.4:
        grey = image.mean(axis=2, keepdims=True)
        image = grey + (image - grey) * np.float32(rng.uniform(0.2, 2.1))
    picture = np.round(image.clip(0, 255)).astype(np.uint8)
    if rng.random() < 0.2:
        picture = cv2.medianBlur(picture, 3) if rng.random() < 0.4 else cv2.bilateralFilter(picture, 7, 30, 3)
    if rng.random() < 0.25:  # fewer pixels than are shown: a cheap camera, or a piece of a wide picture
        factor = rng.uniform(0.4, 0.85)
        picture = cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    if rng.random() < 0.3:
        soft = cv2.GaussianBlur(picture, (0, 0), 1.2)
        amount = rng.uniform(0.3, 1.5)
        picture = cv2.addWeighted(picture, 1 + amount, soft, -amount, 0)
    if rng.random() < 0.6:
        quality = int(rng.integers(30, 96))
        _, code = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
        picture = np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR))[..., ::-1]
    if len(picture) < size:
        picture = cv2.resize(picture, (size, size), interpolation=cv2.INTER_CUBIC)
    return np.ascontiguousarray(picture)
