# SPDX-License-Identifier: Apache-2.0
"""One turn around the plant with a camera held by hand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..command_options import SimulateOptions
from ..core.scene import Camera, Float64
from .mesh import unit

FOCAL: Final = 0.82
"""Focal length in image widths: the main camera of a phone, about 26 mm in 35 mm terms with a video's crop."""
HURRIES: Final = 2
"""How often an uneven walk slows down and hurries."""


LOCAL_RADIUS_M: Final = 0.55
"""Radius of the orbit for local shots: a third to a half of the plant is in view."""


@dataclass(frozen=True)
class Orbit:
    """A smooth path of the camera, defined between the frames too."""

    centre: Float64
    """(3,) m, the point the camera circles at its own height."""
    radius: float
    height: float
    """m above the table, on average."""
    rises: Float64
    """(L,) m by which position and aim are higher in each of L turns."""
    turn: float
    """rad of one turn."""
    start: float
    """rad."""
    sway: Float64
    """(K, 7) of small motions: amplitude in radius, angle, height (m, rad, m), aim x, y, z (m), roll (rad)."""
    cycles: Float64
    """(K,) of each small motion during the turn."""
    phases: Float64
    """(K, 7) rad."""
    frames: int
    width: int
    height_px: int
    uneven: float = 0.0
    """Share by which the pace rises and falls."""

    def at(self, frame: float) -> Camera:
        """The camera at a frame; fractions lie between frames."""
        t = frame / max(self.frames - 1, 1)
        t -= self.uneven * np.sin(2 * np.pi * HURRIES * t) / (2 * np.pi * HURRIES)
        sway = (self.sway * np.sin(2 * np.pi * self.cycles[:, None] * t + self.phases)).sum(axis=0)
        done = len(self.rises) * t
        # The last tenth of a turn leads to the height of the next.
        rise = (0, 0, float(np.interp(done, *_steps(self.rises))))
        angle = self.start + self.turn * done + sway[1]
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        position = self.centre * (1, 1, 0) + (self.radius + sway[0]) * out + (0, 0, self.height + sway[2]) + rise
        forward = unit(self.centre + rise + sway[3:6] - position)
        level = unit(np.cross(forward, (0, 0, 1.0)))
        right = np.cos(sway[6]) * level + np.sin(sway[6]) * np.cross(forward, level)
        rotation = np.stack([right, np.cross(forward, right), forward])
        f = FOCAL * self.width
        return Camera(
            name=f"frame_{round(frame):04d}",
            width=self.width,
            height=self.height_px,
            fx=f,
            fy=f,
            cx=0.5 * self.width,
            cy=0.5 * self.height_px,
            cam_from_scene=np.column_stack([rotation, -rotation @ position]),
        )

    def cameras(self) -> list[Camera]:
        return [self.at(frame) for frame in range(self.frames)]


def _steps(rises: Float64) -> tuple[Float64, Float64]:
    """Turns done and the rise there: level, but for the last tenth of every turn before another one."""
    turns = np.arange(len(rises))
    return np.stack([turns, turns + 0.9], 1).ravel(), np.repeat(rises, 2)


def orbit(options: SimulateOptions, vertices: Float64) -> Orbit:
    """The path of a seed: as near as 1.1 m, or as far as it takes to keep the whole plant in view.

    Local shots, as Table 4 of Cotton3DGaussians has them, make a turn each at the lower, middle and upper third of the
    plant, 0.55 m from it.

    Args:
        options: `seed`, `walk`, `frames`, `width`, `height`, `shot`, `turn_deg`, `uneven`, `cut`, `farther`.
        vertices: (V, 3) m of the plant.
    """
    rng = np.random.default_rng([options.seed, 3, *([options.walk] if options.walk else [])])
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    centre = 0.5 * (low + high)
    # Walking: slow drifts of centimetres, steps (about 12 a turn) of millimetres.
    cycles = np.array([1.0, 2.3, 12.0]) * rng.uniform(0.9, 1.1, 3)
    sway = np.array(
        [
            [0.030, 0.03, 0.060, 0.008, 0.008, 0.010, 0.010],
            [0.015, 0.01, 0.030, 0.006, 0.006, 0.008, 0.008],
            [0.004, 0.00, 0.006, 0.003, 0.003, 0.003, 0.003],
        ]
    )
    height = centre[2] + rng.uniform(0.08, 0.30)
    turn = np.deg2rad(rng.uniform(366, 376)) * rng.choice([-1, 1])
    if options.turn_deg:
        turn = np.sign(turn) * np.deg2rad(options.turn_deg)
    start, phases = rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi, (3, 7))
    probe = vertices[:: max(1, len(vertices) // 4000)]
    probe = np.concatenate([probe, vertices[np.argmin(vertices, axis=0)], vertices[np.argmax(vertices, axis=0)]])
    thirds = (high[2] - low[2]) / 3 * np.array([-1.0, 0.0, 1.0])
    rises = thirds if options.shot == "local" else np.zeros(1)
    radius = LOCAL_RADIUS_M if options.shot == "local" else 1.10
    while True:
        path = Orbit(
            centre,
            radius,
            height,
            rises,
            turn,
            start,
            sway,
            cycles,
            phases,
            options.frames,
            options.width,
            options.height,
            options.uneven,
        )
        if options.shot == "local":
            return path
        if all(_in_view(camera, probe) for camera in path.cameras()):
            path = replace(path, radius=radius * (1 + options.farther))
            return replace(path, centre=_aim(path, low[2], high[2], options.cut)) if options.cut else path
        radius += 0.02


def _aim(path: Orbit, low: float, high: float, cut: float) -> Float64:
    """(3,) m: the aim at which the frame's upper edge cuts this share of a plant from `low` to `high`."""
    edge = np.arctan2(high - cut * (high - low) - path.height, path.radius)
    half_view = np.arctan(0.5 * path.height_px / (FOCAL * path.width))
    return np.append(path.centre[:2], path.height + path.radius * np.tan(edge - half_view))


def _in_view(camera: Camera, points: Float64) -> bool:
    """Whether all points lie at least 3 % inside the image."""
    pixels, _ = camera.project(points)
    size = np.array([camera.width, camera.height])
    return bool(((pixels > 0.03 * size) & (pixels < 0.97 * size)).all())
