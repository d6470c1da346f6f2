# SPDX-License-Identifier: Apache-2.0
"""The video's images, with the chosen effects; an effect that is off takes no time and changes no pixel."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..command_options import SimulateOptions
from ..core.scene import Camera, Float32
from .camera import Orbit
from .render import RenderScene, develop, instance_ids, render

LEAST_SUBFRAMES: Final = 8
MOST_SUBFRAMES: Final = 64
SUBFRAME_PX: Final = 1.5
"""Largest motion of far things from one sub-frame to the next; with more, blur would be a row of sharp edges."""
BAND_ROWS: Final = 4
"""Rows of a rolling shutter that are read out at once: in a clip of 80 frames a hundredth of the way between two."""


def film(
    scene: RenderScene, path: Orbit, frame: int, options: SimulateOptions, behind: Float32 | None = None
) -> NDArray[np.uint8]:
    """(H, W, 3) sRGB of one frame.

    Args:
        behind: (H, W, 3) linear light of a room that stands still while the scene turns.
    """
    if options.blur:
        # Each sub-frame sees the pixel at another place (Roberts' R2 sequence), so that one ray each suffices.
        n = _subframes(path, frame, options.blur)
        places = (np.arange(1, n + 1)[:, None] * (0.7548776662466927, 0.5698402909980532) + 0.5) % 1 - 0.5
        times = frame + options.blur * ((np.arange(n) + 0.5) / n - 0.5)
        light = np.mean(
            [
                _read_out(
                    scene,
                    path,
                    time,
                    options,
                    supersampling=1,
                    shift=(float(x), float(y)),
                    footprint_px=0.5,
                    behind=behind,
                )
                for time, (x, y) in zip(times, places, strict=True)
            ],
            axis=0,
        )
    else:
        light = _read_out(scene, path, frame, options, supersampling=options.supersampling, behind=behind)
    rng = np.random.default_rng([options.seed, 4, frame]) if options.noise else None
    return develop(light, exposure_ev=exposure_ev(frame, options), noise=options.noise, rng=rng)


def _subframes(path: Orbit, frame: int, open_frames: float) -> int:
    """Number of renders that make the light of a shutter that is open for this share of a frame."""
    first, last = (path.at(frame + side * open_frames / 2) for side in (-1, 1))
    turned_rad = np.arccos(np.clip(first.rotation[2] @ last.rotation[2], -1, 1))
    return int(np.clip(np.ceil(turned_rad * first.fx / SUBFRAME_PX), LEAST_SUBFRAMES, MOST_SUBFRAMES))


def film_ids(scene: RenderScene, path: Orbit, frame: int, options: SimulateOptions) -> NDArray[np.uint16]:
    """(H, W) true boll ids of one frame, bent by lens and rolling shutter as the frame is."""
    bands = _bands(path, frame, options)
    return np.concatenate([instance_ids(scene, camera, k1=options.distortion) for camera in bands])


def exposure_ev(frame: int, options: SimulateOptions) -> float:
    """Stops by which a frame is brighter: `options.dark` too few, drifting slowly by `options.exposure` up and down."""
    if not options.exposure:
        return 0.0 - options.dark
    start = np.random.default_rng([options.seed, 5]).uniform(0, 2 * np.pi)
    return float(options.exposure * np.sin(start + 2 * np.pi * 1.3 * frame / options.frames)) - options.dark


def _read_out(scene: RenderScene, path: Orbit, time: float, options: SimulateOptions, **how: Any) -> Float32:
    """(H, W, 3) linear light; the time (frames) is that of the middle row."""
    bands, top = [], 0
    behind = how.pop("behind")
    for camera in _bands(path, time, options):
        part = None if behind is None else behind[top : top + camera.height]
        bands.append(render(scene, camera, k1=options.distortion, behind=part, **how))
        top += camera.height
    return np.concatenate(bands)


def _bands(path: Orbit, time: float, options: SimulateOptions) -> list[Camera]:
    """The cameras that see the image, each its rows, from top to bottom; a global shutter is one camera."""
    if not options.rolling_shutter:
        return [path.at(time)]
    bands = []
    for top in range(0, options.height, BAND_ROWS):
        rows = min(BAND_ROWS, options.height - top)
        camera = path.at(time + options.rolling_shutter * ((top + rows / 2) / options.height - 0.5))
        bands.append(replace(camera, height=rows, cy=camera.cy - top))
    return bands
