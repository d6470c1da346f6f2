# SPDX-License-Identifier: Apache-2.0
"""Wheels for any Linux since 2019 (glibc 2.28), and the sdist: `make wheel`.

    python tools/build_wheels.py dist [x86_64 aarch64]

The core is compiled by zig's clang, which knows the symbols of every glibc and carries its own C++ library, so that the
wheel asks for no newer system than manylinux_2_28 and no libstdc++; the same compiler builds for ARM. auditwheel checks
what the result needs and names it. The wheel is of the Python that runs this; other versions and systems are left to
cibuildwheel (.github/workflows/wheels.yml).
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
GLIBC = "2.28"
MACHINES = ("x86_64", "aarch64")
NEEDED = (
    "masks/bolls.onnx",
    "masks/bolls.onnx.sha256",
    "report/templates/report.html",
    "report/templates/style.css",
)
"""Files without which the program would not run, though it could be imported."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("machines", nargs="*", default=[platform.machine()], choices=MACHINES)
    wanted = parser.parse_args()
    folder = wanted.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    commit = run(["git", "-C", ROOT, "rev-parse", "--short", "HEAD"], capture_output=True).stdout.strip()
    run([sys.executable, "-m", "build", "--sdist", "--no-isolation", "--outdir", folder, ROOT])
    for machine in wanted.machines:
        with tempfile.TemporaryDirectory() as scratch:
            built = build(machine, Path(scratch), commit)
            # It names the oldest glibc that will do; that of another machine's wheel cannot be asked for.
            done = run([sys.executable, "-m", "auditwheel", "repair", "-w", folder, built], capture_output=True)
            print(done.stdout + done.stderr, end="")
    for wheel in sorted(folder.glob("*.whl")):
        check(wheel)


def build(machine: str, scratch: Path, commit: str) -> Path:
    """A wheel for `machine` in `scratch`, named after this machine's glibc as yet."""
    target = f"{machine}-linux-gnu.{GLIBC}"
    tools = {name: script(scratch / name, name) for name in ("ar", "ranlib")}
    page = scratch / "cotton3dg.1"
    run([sys.executable, ROOT / "tools" / "man_page.py", page])
    defines = {f"CMAKE_{name.upper()}": str(path) for name, path in tools.items()}
    defines |= {"COTTON_COMMIT": commit, "COTTON_MAN_PAGE": str(page)}
    # zig builds its C++ library anew for each way of optimising, so all that CMake tries out is optimised alike, and
    # nothing is linked but the core.
    flags = ("-target", target, "-O3")
    environment = {
        **os.environ,
        "CC": str(script(scratch / "cc", "cc", *flags)),
        "CXX": str(script(scratch / "c++", "c++", *flags)),
    }
    defines |= {"CMAKE_TRY_COMPILE_TARGET_TYPE": "STATIC_LIBRARY", "CMAKE_MODULE_LINKER_FLAGS": "-s"}
    if machine != platform.machine():
        suffix = sysconfig.get_config_var("EXT_SUFFIX").replace(platform.machine(), machine)
        defines |= {"CMAKE_SYSTEM_NAME": "Linux", "CMAKE_SYSTEM_PROCESSOR": machine, "PYTHON_MODULE_EXTENSION": suffix}
        environment |= {"_PYTHON_HOST_PLATFORM": f"linux-{machine}", "SETUPTOOLS_EXT_SUFFIX": suffix}
    settings = [f"-Ccmake.define.{name}={value}" for name, value in defines.items()]
    run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", scratch, ROOT]
        + [f"-Cbuild-dir={scratch / 'build'}", *settings],
        env=environment,
    )
    (wheel,) = scratch.glob("*.whl")
    return wheel


def script(path: Path, *words: str) -> Path:
    """A command that CMake can call by one name."""
    path.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ziglang {" ".join(words)} "$@"\n')
    path.chmod(0o755)
    return path


def check(wheel: Path) -> None:
    """End with an error where a wheel lacks a file that the program reads."""
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    missing = [name for name in NEEDED if f"cotton3dg/{name}" not in names]
    if missing or not any(name.startswith("cotton3dg/_native.") and name.endswith(".so") for name in names):
        sys.exit(f"{wheel.name} lacks {', '.join(missing) or 'the core'}")
    tags = [tuple(map(int, tag)) for tag in re.findall(r"manylinux_(\d+)_(\d+)_", wheel.name)]
    if not tags or min(tags) > tuple(map(int, GLIBC.split("."))):
        sys.exit(f"{wheel.name} asks for a newer system than glibc {GLIBC}")
    print(f"{wheel.name}: {wheel.stat().st_size / 2**20:.1f} MiB")
    run([sys.executable, "-m", "auditwheel", "show", wheel])


def run(command: list[str | Path], **settings) -> subprocess.CompletedProcess[str]:  # type: ignore[no-untyped-def]
    """Run a command; a failed one ends this program with what it said."""
    done = subprocess.run([str(word) for word in command], text=True, check=False, **settings)
    if done.returncode:
        sys.exit(f"{command[2] if len(command) > 2 else command[0]} failed\n{done.stdout or ''}{done.stderr or ''}")
    return done


if __name__ == "__main__":
    main()
