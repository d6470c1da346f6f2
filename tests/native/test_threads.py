"""How many threads the core takes when nobody says a number."""

import os
import subprocess
import sys

import pytest

COUNT = """
import os, sys, threading, time
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from splat_scenes import camera_at, scene
from cotton3dg.splat import ops
ops.render(scene(500, seed=0, coefficients=1), camera_at(64, 48))
print(len(os.listdir("/proc/self/task")))
"""


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system does not bind processes to cores")
def test_the_core_takes_no_more_threads_than_cores_are_left_to_the_process():
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", COUNT], capture_output=True, text=True, check=True, env=environment)
    assert int(done.stdout) == 1
