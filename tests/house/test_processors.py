# SPDX-License-Identifier: Apache-2.0
"""The tools that look at a machine as if it had another processor."""

import math
import subprocess
import sys
from pathlib import Path

import processors
import pytest
from stress.other_processors import CHOOSERS, SINGLE, WHOLE, environment_of, failures, flags_of

STRESS = Path(__file__).parents[1] / "stress"


def test_a_plant_without_bolls_is_compared_too():
    assert processors.change_pct(3.0, 2.0) == pytest.approx(50)
    assert math.isnan(processors.change_pct(0.0, 0.0)) and math.isnan(processors.change_pct(1.0, math.nan))


def test_each_variant_differs_from_the_base_in_what_it_says():
    around = dict.fromkeys(CHOOSERS, "set") | {"HOME": "/home", "OMP_NUM_THREADS": "8", "PYTHONPATH": "/mine"}
    variants = (*WHOLE, *SINGLE)
    base, *others = (environment_of(variant, around) for variant in variants)
    assert base == {"HOME": "/home", "OMP_NUM_THREADS": "1", "PYTHONPATH": "/mine"}
    for variant, environment in zip(variants[1:], others, strict=True):
        changed = {name for name in environment if environment[name] != base.get(name)}
        assert changed == set(variant.environment) and (changed or variant.cores), variant
        assert environment["PYTHONPATH"].endswith("/mine")


def test_each_single_change_of_the_environment_is_part_of_a_machine():
    """So that the machines leave nothing out, and a failure on one of them has a cause that can be named."""
    for single in SINGLE:
        assert single.cores or any(single.environment.items() <= machine.environment.items() for machine in WHOLE)
        assert single.needs <= frozenset().union(*(machine.needs for machine in WHOLE))


def test_what_a_processor_has_and_what_failed_is_read():
    assert flags_of("processor : 0\nflags\t\t: fpu avx avx2\nbugs : x\n") == {"fpu", "avx", "avx2"}
    assert flags_of("Processor : ARM") == set()
    said = "..F\nFAILED tests/a.py::test_x[1-2] - assert 0\nERROR tests/b.py::test_y\n1 failed, 2 passed, 1 error in 2s"
    assert failures(said) == ["tests/a.py::test_x[1-2]", "tests/b.py::test_y"]


@pytest.mark.slow
def test_a_failing_test_fails_the_whole_and_its_cause_is_named(tmp_path):
    (tmp_path / "test_it.py").write_text(
        "import os\ndef test_isa(): assert os.environ.get('COTTON3DG_ISA') != 'baseline'\n"
    )
    command = [sys.executable, STRESS / "other_processors.py", tmp_path / "logs", "--jobs", "1"]
    command += ["--only", "base", "of-2008", "--pytest", tmp_path / "test_it.py"]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 1
    base, old = (line for line in done.stdout.splitlines() if line.startswith(("| base", "| of-2008")))
    assert "1 passed" in base and base.endswith("|  |")
    assert "1 failed" in old and "test_isa" in old and "with one change alone: cotton3dg-of-2008 |" in old


def test_opencv_loses_its_optimised_paths():
    environment = {"PYTHONPATH": str(STRESS / "plain_opencv"), "PATH": ""}
    command = [sys.executable, "-c", "import cv2; print(cv2.useOptimized())"]
    for variables, optimised in (({}, True), (environment, False)):
        done = subprocess.run(command, check=True, capture_output=True, text=True, env=variables)
        assert done.stdout == f"{optimised}\n"
