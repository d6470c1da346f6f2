"""Builds of the native core other than the installed one: with sanitizers, or with changed sources."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
Change = tuple[str, str, str]
"""File below native/src, text that occurs in it exactly once, and the text to put in its place."""


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
        ValueError: the text of a change is not there exactly once.
    """
    import pybind11

    texts = {path: path.read_text() for path in (ROOT / "native").rglob("*") if path.is_file()}
    for name, old, new in changes:
        path = ROOT / "native" / "src" / name
        if texts[path].count(old) != 1:
            raise ValueError(f"{name} has {texts[path].count(old)} times, not once: {old}")
        texts[path] = texts[path].replace(old, new)
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
