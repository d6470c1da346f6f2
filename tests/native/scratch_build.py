# SPDX-License-Identifier: Apache-2.0
"""Builds of the native core other than the installed one: with sanitizers, or with changed sources."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from source_changes import ROOT, Change, apply_change


def build(
    folder: Path,
    flags: str = "-O1",
    isas: str = "baseline",
    optimisation: str = "-O1",
    changes: tuple[Change, ...] = (),
) -> Path:
    """The module in `folder`, compiled from a copy of native/ with `changes` made; only what differs is compiled again.

    Args:
        flags: of everything.
        isas: instruction sets, separated by semicolons.
        optimisation: of the kernels.
    Raises:
        ValueError: the code of a change is not there exactly once.
    """
    import pybind11

    texts = {path: path.read_text() for path in (ROOT / "native").rglob("*") if path.is_file()}
    for change in changes:
        texts[change.path] = apply_change(texts[change.path], change)
    for path, text in texts.items():
        copy = folder / "source" / path.relative_to(ROOT / "native")
        copy.parent.mkdir(parents=True, exist_ok=True)
        if not copy.exists() or copy.read_text() != text:
            copy.write_text(text)
    build_folder = folder / "build"
    cmake = shutil.which("cmake", path=str(Path(sys.executable).parent)) or "cmake"
    configure = [cmake, "-S", str(folder / "source"), "-B", str(build_folder), "-DCMAKE_BUILD_TYPE=None"]
    configure += [f"-DCMAKE_CXX_FLAGS={flags}", f"-DPython_EXECUTABLE={sys.executable}"]
    configure += [f"-DCOTTON_ISAS={isas}", f"-DCOTTON_OPTIMISATION={optimisation}"]
    subprocess.run([*configure, f"-Dpybind11_DIR={pybind11.get_cmake_dir()}"], check=True, stdout=subprocess.DEVNULL)
    subprocess.run([cmake, "--build", str(build_folder), "--parallel", "2"], check=True, stdout=subprocess.DEVNULL)
    return next(build_folder.glob("_native*.so"))
