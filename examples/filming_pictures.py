# SPDX-License-Identifier: Apache-2.0
"""The pictures of docs/filming.md: one simulated plant, filmed as it should be and as it should not.

python examples/filming_pictures.py docs/filming
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from cotton3dg.options import SimulateOptions
from cotton3dg.simulate.camera import Orbit, orbit
from cotton3dg.simulate.plant import grow_plant
from cotton3dg.simulate.render import RenderScene, develop, light_scene, render
from cotton3dg.simulate.room import build_room

Picture = NDArray[np.uint8]

WIDTH, HEIGHT = 480, 270
FRAME = 32
QUALITY = 82


def filmed_scene(options: SimulateOptions) -> tuple[RenderScene, Orbit]:
    plant = grow_plant(options)
    return light_scene(plant, build_room(options, plant.stem_base)), orbit(options, plant.vertices)


def pictures(options: SimulateOptions) -> Iterator[tuple[str, Picture]]:
    """Names and pictures."""
    scene, path = filmed_scene(options)

    def light(frame: float = FRAME, zoom: float = 0.72, of: RenderScene = scene) -> NDArray[np.float32]:
        camera = path.at(frame)
        return render(of, replace(camera, fx=camera.fx * zoom, fy=camera.fy * zoom))

    yield "good", develop(light())
    yield "too_close", develop(light(zoom=2.4))
    yield "too_far", develop(light(zoom=0.3))
    yield "too_fast", develop(np.mean([light(time) for time in np.linspace(FRAME - 0.4, FRAME + 0.4, 24)], axis=0))
    yield "too_dark", develop(light(), exposure_ev=-3.0, noise=14.0, rng=np.random.default_rng(0))
    yield "burnt_out", develop(light(), exposure_ev=2.0)
    yield "table_hidden", develop(light(of=filmed_scene(replace(options, hidden=0.45))[0]))
    yield "full_turn", walk(360)
    yield "half_turn", walk(190)


def walk(degrees: int) -> Picture:
    """The walk seen from above: table, plant and where the camera was."""
    large = 4
    image = np.full((HEIGHT * large, WIDTH * large, 3), 250, np.uint8)
    middle = np.array([WIDTH, HEIGHT]) * large // 2

    def place(angle: float, radius: float) -> tuple[int, int]:
        x, y = middle + radius * large * np.array([np.cos(angle), np.sin(angle)])
        return round(x), round(y)

    half = np.array([60, 30]) * large
    cv2.rectangle(image, tuple(middle - half), tuple(middle + half), (196, 164, 120), -1, cv2.LINE_AA)
    cv2.circle(image, tuple(middle), 14 * large, (110, 80, 50), -1, cv2.LINE_AA)
    for angle in np.deg2rad(np.arange(20, 20 + degrees, 10)):
        cv2.circle(image, place(angle, 108), 4 * large, (30, 80, 150), -1, cv2.LINE_AA)
    return cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.uint8)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, picture in pictures(SimulateOptions(seed=11, bolls=12, frames=40, width=WIDTH, height=HEIGHT)):
        file = str(folder / f"{name}.jpg")
        cv2.imwrite(file, cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
