# SPDX-License-Identifier: Apache-2.0
"""Stages that the disk or the memory has no room for."""

import os
import resource
import shutil
import subprocess
import sys

import pytest
from scenes.finished_scene import finished_workspace

from cotton3dg import pipeline, resource_checks
from cotton3dg.errors import OutOfResources
from cotton3dg.options import STAGE_OPTIONS, resolve


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    return finished_workspace(tmp_path_factory.mktemp("finished") / "plant")


@pytest.mark.parametrize("stage", list(STAGE_OPTIONS))
def test_a_stage_that_the_disk_has_no_room_for_does_not_start_and_keeps_its_result(workspace, monkeypatch, stage):
    finished = workspace.read_record(stage)
    written = sum(path.stat().st_size for path in workspace.folder(stage).rglob("*") if path.is_file())
    needed_mib = resource_checks.needed_disk_mib(workspace, stage, resolve(stage))
    assert written / resource_checks.MIB < needed_mib < 1000
    usage = shutil.disk_usage(workspace.root)
    monkeypatch.setattr(
        resource_checks.shutil, "disk_usage", lambda _: usage._replace(free=int((needed_mib - 1) * resource_checks.MIB))
    )
    with pytest.raises(OutOfResources, match=rf"{stage} needs about \d+ MiB of disk and \d+ MiB are free; free some"):
        pipeline.run(workspace, pipeline.stage_options(workspace), (stage,), force=True)
    assert finished.is_ok and workspace.read_record(stage) == finished


@pytest.mark.parametrize(
    ("error", "is_memory"),
    [
        (MemoryError(), True),
        (OSError(12, os.strerror(12)), True),
        (
            RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory: you tried to allocate 8 bytes"),
            True,
        ),
        (RuntimeError("(-4:Insufficient memory) Failed to allocate 100 bytes"), True),
        (RuntimeError("std::bad_alloc"), True),
        (ImportError("libx.so: failed to map segment from shared object"), True),
        (RuntimeError("can't start new thread"), True),
        (ValueError("a shape"), False),
        (OSError(5, os.strerror(5)), False),
    ],
)
def test_running_out_of_memory_is_known_whichever_library_says_it(error, is_memory):
    assert resource_checks.is_out_of_memory(error) == is_memory
    outer = ValueError("something else")
    outer.__cause__ = error
    assert resource_checks.is_out_of_memory(outer) == is_memory


@pytest.mark.parametrize("kind", ["RLIMIT_AS", "RLIMIT_DATA"])
def test_case_55_a_limit_that_is_too_low_for_anything_is_told_before_the_start(tmp_path, kind):
    (tmp_path / "video.mp4").touch()
    limit = resource_checks.LEAST_MEMORY_MIB[getattr(resource, kind)] * resource_checks.MIB - 1
    run = subprocess.run(
        [sys.executable, "-m", "cotton3dg.cli", "run", str(tmp_path)],
        preexec_fn=lambda: resource.setrlimit(getattr(resource, kind), (limit, limit)),
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 7, run.stderr
    assert "MiB of memory and" in run.stderr.splitlines()[-1]
    assert "raise it" in run.stderr.splitlines()[-1]


HUNGRY = """
import sys
from dataclasses import replace
from cotton3dg import pipeline
from cotton3dg.cluster import stage
from cotton3dg.workspace import Workspace
def run(*_):
    {take}
stage.STAGE = replace(stage.STAGE, run=run)
workspace = Workspace(sys.argv[1])
try:
    pipeline.run(workspace, pipeline.stage_options(workspace), ("cluster",), force=True)
except Exception as error:
    print(type(error).__name__, error)
    sys.exit(error.exit_code)
"""


@pytest.mark.parametrize(
    "take",
    [
        "bytearray(10**10)",
        "import numpy; numpy.ones(10**10)",
        "import torch; torch.ones(10**10)",
        "import cv2, numpy; cv2.resize(numpy.ones((9, 9)), (30000, 30000))",
    ],
)
def test_case_55_memory_that_runs_out_in_a_stage_is_told(workspace, take):
    limit = 4000 * resource_checks.MIB
    run = subprocess.run(
        [sys.executable, "-c", HUNGRY.format(take=take), str(workspace.root)],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 7, run.stdout + run.stderr
    assert "OutOfResources cluster ran out of memory; use --preset draft" in run.stdout
    assert workspace.read_record("cluster").exit_code == 7
