# SPDX-License-Identifier: Apache-2.0
"""Build the native core with sanitizers and run its tests under them (`make sanitize`).

    python tests/native/sanitize.py [address|thread] [tests ...]

Python and its other modules are not instrumented, so leaks are not looked for; libstdc++ is loaded first, so that the
sanitizers see exceptions.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from scratch_build import ROOT, build

SANITIZERS = {
    "address": (
        "-fsanitize=address,undefined -fno-sanitize-recover=all",
        ("libasan.so", "libubsan.so"),
        {"ASAN_OPTIONS": "detect_leaks=0:allocator_may_return_null=1", "UBSAN_OPTIONS": "print_stacktrace=1"},
    ),
    "thread": (
        "-fsanitize=thread",
        ("libtsan.so",),
        {"TSAN_OPTIONS": "exitcode=66:ignore_noninstrumented_modules=1"},
    ),
}
TESTS = (
    "tests/native",
    "tests/hard_cases/test_core_projection.py",
    "tests/hard_cases/test_core_blending.py",
    "tests/hard_cases/test_core_training.py",
    "tests/property/test_scenes.py",
    "tests/property/test_relations.py",
)


def library(name: str) -> str:
    found = subprocess.run(["g++", f"-print-file-name={name}"], check=True, capture_output=True, text=True).stdout
    return str(Path(found.strip()).resolve())


def run(name: str, tests: list[str]) -> int:
    flags, libraries, options = SANITIZERS[name]
    module = build(ROOT / "build" / f"sanitize-{name}", f"-O1 -g1 -fno-omit-frame-pointer {flags}", "baseline;avx2")
    preload = " ".join(library(each) for each in (*libraries, "libstdc++.so.6"))
    environment = os.environ | options | {"COTTON3DG_REPLACED": f"cotton3dg._native={module}"}
    # Without address randomisation: the shadow memory needs its place.
    command = ["setarch", "-R", "env", f"LD_PRELOAD={preload}", sys.executable, "-m", "pytest", "-q", "-s", *tests]
    return subprocess.run(command, check=False, cwd=ROOT, env=environment).returncode


if __name__ == "__main__":
    chosen = [argument for argument in sys.argv[1:] if argument in SANITIZERS]
    given = [argument for argument in sys.argv[1:] if argument not in SANITIZERS]
    codes = {name: run(name, given or list(TESTS)) for name in chosen or SANITIZERS}
    print("  ".join(f"{name}: {'clean' if code == 0 else f'failed ({code})'}" for name, code in codes.items()))
    sys.exit(any(codes.values()))
