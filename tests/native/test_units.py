# SPDX-License-Identifier: Apache-2.0
"""What the units of the instruction sets offer to the linker."""

from __future__ import annotations

import platform
import shutil
import subprocess
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[2] / "native" / "src"


@pytest.mark.skipif(shutil.which("g++") is None or shutil.which("nm") is None, reason="needs a compiler")
@pytest.mark.skipif(platform.machine() != "x86_64", reason="there is one instruction set only")
def test_all_that_a_unit_offers_is_in_its_namespace(tmp_path: Path) -> None:
    """Of an inline function that several units have the linker keeps one, perhaps with what the processor lacks.

    Compiled without optimisation, which would hide functions by inlining them.
    """
    flags = ["-std=c++20", "-O0", "-mavx2", "-mfma", "-DCOTTON_ISA=avx2"]
    unit = str(tmp_path / "kernels.o")
    subprocess.run(["g++", *flags, "-c", str(SOURCES / "kernels.cpp"), "-o", unit], check=True, capture_output=True)
    command = ["nm", "--demangle", "--extern-only", "--defined-only", unit]
    listed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    offered = [line.split(maxsplit=2)[2] for line in listed.splitlines()]
    assert any("cotton::avx2::float_kernels" in name for name in offered)
    # The personality of C++ exceptions is data, the same in all.
    assert [name for name in offered if "cotton::avx2::" not in name and not name.startswith("DW.ref.")] == []
