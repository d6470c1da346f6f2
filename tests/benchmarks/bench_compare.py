# SPDX-License-Identifier: Apache-2.0
"""Parts of a training step of the working tree against those of an earlier commit, measured in turn.

python tests/benchmarks/bench_compare.py [BASE] [--rounds 5]

The earlier commit is built in a temporary worktree with this tree's bench_parts, so both are measured alike. A ratio
below 1 means that the working tree is faster; times are the smallest of all rounds, in ms of processor time.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import tempfile
from pathlib import Path

import native_parts
from bench_kernels import ball_scene

from cotton3dg import _native


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("base", nargs="?", default="HEAD~1")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--repeats", type=int, default=5, help="steps in each round")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--gaussians", type=int, default=200_000)
    options = parser.parse_args()
    git = ["git", "-C", str(native_parts.ROOT)]
    with tempfile.TemporaryDirectory() as folder:
        tree, scene = Path(folder) / "base", Path(folder) / "scene.bin"
        subprocess.run([*git, "worktree", "add", "--quiet", "--detach", tree, options.base], check=True)
        try:
            for name in ("native/CMakeLists.txt", "tests/benchmarks/bench_parts.cpp"):
                shutil.copy(native_parts.ROOT / name, tree / name)
            programs = {"base": native_parts.build(tree), "now": native_parts.build()}
            native_parts.write_scene(scene, *ball_scene(options.gaussians, 960, 540))
            smallest: dict[str, dict[str, float]] = {name: {} for name in programs}
            for _ in range(options.rounds):
                for name, program in programs.items():
                    result = native_parts.measure(
                        program, scene, _native.instruction_set(), options.threads, options.repeats
                    )
                    times = result["parts_cpu_ms"] | {"step": result["cpu_ms"], "step, wall clock": result["wall_ms"]}
                    for part, ms in times.items():
                        smallest[name][part] = min(ms, smallest[name].get(part, ms))
        finally:
            subprocess.run([*git, "worktree", "remove", "--force", tree], check=True)
    print(f"{'':18}{options.base:>10}{'now':>10}{'ratio':>8}")
    for part, base_ms in smallest["base"].items():
        now_ms = smallest["now"][part]
        print(f"{part:18}{base_ms:10.1f}{now_ms:10.1f}{now_ms / base_ms:8.2f}")


if __name__ == "__main__":
    main()
