# SPDX-License-Identifier: Apache-2.0
"""A bounded run of the fuzz targets. COTTON3DG_FUZZ sets the number of inputs for each; 800 unless told."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from fuzz_readers import targets

N_INPUTS = os.environ.get("COTTON3DG_FUZZ", "800")
SCRIPT = Path(__file__).with_name("fuzz_readers.py")


@pytest.mark.parametrize("target", list(targets()))
def test_mutated_files_end_in_a_result_or_in_our_own_error(target: str, tmp_path: Path) -> None:
    command = [sys.executable, str(SCRIPT), target, "--inputs", N_INPUTS]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr[-3000:]
    assert f"{N_INPUTS} inputs" in done.stdout
