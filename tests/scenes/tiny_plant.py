# SPDX-License-Identifier: Apache-2.0
"""A tiny simulated plant whose whole run takes half a minute, and commands of the shell on it."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
SEED = int(os.environ.get("COTTON3DG_TINY_SEED", "5"))
"""`make test-processors` takes others, too."""
# A low plant, whose bolls are large in its images: each gets several times the Gaussians that it needs to be found. At
# 384 px the width of its table is found or not, as the processor rounds.
FILM = {"seed": SEED, "bolls": 6, "stem_cm": 40, "frames": 64, "width": 512, "height": 288, "supersampling": 1}
OPTIONS = """\
[frames]
count = 32
[train]
max_side = 384
steps = 400
sh_degree = 1
max_gaussians = 30000
[masks]
views = 16
[segment.probability]
steps = 50
[segment.affinity]
feature_steps = 20
"""


def in_shell(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command that finds this environment's `cotton3dg` and `python` first."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env={**os.environ, "PATH": path, "COLUMNS": "160"},
        capture_output=True,
        text=True,
        check=False,
        timeout=1500,  # a busy machine must not fail what works
    )
