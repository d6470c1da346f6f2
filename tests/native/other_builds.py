# SPDX-License-Identifier: Apache-2.0
"""Images and gradients of another build of the core, by another compiler or for another machine, beside this one's.

    python tests/native/other_builds.py write here.npz       # with one build
    python tests/native/other_builds.py compare here.npz     # with the other; exit code 1: more than 1e-5

Needs numpy and scipy only, so that it runs in an emulator. A difference is relative to the largest value of its kind.
"""

from __future__ import annotations

import platform
import sys
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1]))

from scenes.differentiation import loss_and_gradients
from scenes.splat_scenes import NEAR, camera_at, scene, target_of

from cotton3dg import _native
from cotton3dg.gaussians import rasterizer

TOLERANCE = 1e-5


def results() -> dict[str, np.ndarray]:
    """Images and gradients of three scenes."""
    found = {}
    for seed, count in ((1, 50), (2, 1000), (3, 5000)):
        gaussians, camera = scene(count, seed), camera_at(150, 110, angle=seed)
        found[f"{seed} image"] = rasterizer.render(gaussians, camera, near_su=NEAR).image
        gradients = loss_and_gradients(gaussians, camera, target_of(camera), near_su=NEAR)
        assert gradients.finite
        for name in ("v_means", "v_quats", "v_log_scales", "v_opacity_logits", "v_sh"):
            found[f"{seed} {name}"] = getattr(gradients, name)
    return found


def main() -> None:
    task, file = sys.argv[1:]
    print(f"{platform.machine()}, {_native.instruction_set()} of {', '.join(_native.instruction_sets())}")
    found = results()
    if task == "write":
        np.savez(file, **found)
        return
    worst = 0.0
    with np.load(file) as other:
        for name, values in found.items():
            difference = float(np.abs(values - other[name]).max() / np.abs(other[name]).max())
            worst = max(worst, difference)
            print(f"{name:<20} {difference:.1e}")
    print(f"worst {worst:.1e}, {TOLERANCE:.0e} allowed")
    sys.exit(worst > TOLERANCE)


if __name__ == "__main__":
    main()
