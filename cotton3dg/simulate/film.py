"""The video's images, with the effects that were asked for; one that is off takes no time and changes no pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..options import SimulateOptions
from .camera import Orbit
from .render import RenderScene, developed, render

SUBFRAMES = 8


def filmed(scene: RenderScene, path: Orbit, frame: int, options: SimulateOptions) -> NDArray[np.uint8]:
    """(H, W, 3) sRGB of one frame."""
    k1 = options.distortion
    if options.blur:
        # Each sub-frame sees the pixel at another place (Roberts' R2 sequence), so that one ray each suffices.
        places = (np.arange(1, SUBFRAMES + 1)[:, None] * (0.7548776662466927, 0.5698402909980532) + 0.5) % 1 - 0.5
        times = frame + options.blur * ((np.arange(SUBFRAMES) + 0.5) / SUBFRAMES - 0.5)
        light = np.mean(
            [
                render(scene, path.at(time), supersampling=1, k1=k1, shift=(float(x), float(y)), footprint_px=0.5)
                for time, (x, y) in zip(times, places, strict=True)
            ],
            axis=0,
        )
    else:
        light = render(scene, path.at(frame), supersampling=options.supersampling, k1=k1)
    rng = np.random.default_rng([options.seed, 4, frame]) if options.noise else None
    return developed(light, exposure_ev=exposure_ev(frame, options), noise=options.noise, rng=rng)


def exposure_ev(frame: int, options: SimulateOptions) -> float:
    """Stops by which a frame is brighter, drifting slowly between plus and minus `options.exposure`."""
    if not options.exposure:
        return 0.0
    start = np.random.default_rng([options.seed, 5]).uniform(0, 2 * np.pi)
    return float(options.exposure * np.sin(start + 2 * np.pi * 1.3 * frame / options.frames))
