# SPDX-License-Identifier: Apache-2.0
"""How many threads the core takes when nobody says a number."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

COUNT = """
import os, sys, threading, time
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from scenes.splat_scenes import camera_at, scene
from cotton3dg.gaussians import rasterizer
rasterizer.render(scene(500, seed=0, coefficients=1), camera_at(64, 48))
print(len(os.listdir("/proc/self/task")))
"""


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system does not bind processes to cores")
def test_the_core_takes_no_more_threads_than_cores_are_left_to_the_process():
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", COUNT], capture_output=True, text=True, check=True, env=environment)
    assert int(done.stdout) == 1


FAILING = """
#include <cstdio>
#include <stdexcept>
#include "threads.h"

int main() {
    for (int round = 0; round < 200; ++round) {
        try {
            cotton::parallel_for(64, 4, [&](int64_t i) {
                if (i % 16 == round % 16) throw std::runtime_error("task");
            });
            return 1;
        } catch (const std::runtime_error&) {
        }
        int64_t done[64] = {};
        cotton::parallel_for(64, 4, [&](int64_t i) { done[i] += i; });
        for (int64_t i = 0; i < 64; ++i)
            if (done[i] != i) return 2;
    }
    std::puts("well");
}
"""
WELL = """
#include <cstdio>
#include "threads.h"

int main() {
    int64_t done[64] = {};
    cotton::parallel_for(64, 16, [&](int64_t i) { done[i] += i; });
    for (int64_t i = 0; i < 64; ++i)
        if (done[i] != i) return 2;
    std::puts("well");
}
"""
CRAMPED = "ulimit -s 100000 -v 300000; exec"
"""A thread's stack is as large as the limit of stacks: two of them, at most, fit into the memory."""


@pytest.mark.skipif(not shutil.which("g++"), reason="no compiler")
@pytest.mark.parametrize(
    ("program", "limits"), [(FAILING, "exec"), (WELL, CRAMPED)], ids=["a failing task", "no room for threads"]
)
def test_the_pool_survives(program, limits, tmp_path):
    source, threads = tmp_path / "main.cpp", Path(__file__).parents[2] / "native" / "src" / "threads.cpp"
    source.write_text(program)
    command = ["g++", "-std=c++20", "-O1", "-pthread", f"-I{threads.parent}", source, threads, "-o", tmp_path / "main"]
    subprocess.run(command, check=True)
    command = ["bash", "-c", f"{limits} ./main"]
    # A sanitizer that is loaded before everything needs more room than there is here.
    bare = {name: value for name, value in os.environ.items() if name != "LD_PRELOAD"}
    done = subprocess.run(command, cwd=tmp_path, env=bare, capture_output=True, text=True, check=True)
    assert done.stdout == "well\n"
