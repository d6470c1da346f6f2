# SPDX-License-Identifier: Apache-2.0
"""The ARM wheel on this machine, by QEMU: `make arm-test` (Debian or Ubuntu, as root, with qemu-user-static).

    python tests/stress/arm_core.py results/arm dist/cotton3dg-*_aarch64.whl

Unpacks Debian's Python for ARM and the ARM wheels of what the core needs into the folder, without installing anything
here. Images and gradients of the wheel's core must be within 1e-5 of those of this environment's core, and the tests of
the core that need no PyTorch must pass.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("python3.11", "libstdc++6", "libgomp1")
LIBRARIES = ("numpy", "scipy", "pytest", "packaging")
PLATFORMS = ("manylinux_2_28_aarch64", "manylinux_2_27_aarch64", "manylinux_2_17_aarch64", "manylinux2014_aarch64")
TESTS = ("test_matching.py", "test_rasterizer.py")
NOT_HERE = "environment_chooses or every_instruction_set"
"""Tests that start Python again, which QEMU does not, or that ask for another machine."""


def main() -> None:
    folder, wheel = Path(sys.argv[1]).resolve(), Path(sys.argv[2])
    system, site = folder / "system", folder / "site"
    if not site.is_dir():
        unpack_debian(folder, system)
        wheels = folder / "wheels"
        platforms = [word for name in PLATFORMS for word in ("--platform", name)]
        constraints = ["-c", str(ROOT / "constraints.txt")]
        download = [sys.executable, "-m", "pip", "download", "-q", "-d", wheels, "--only-binary", ":all:"]
        subprocess.run([*download, "--python-version", "3.11", *platforms, *constraints, *LIBRARIES], check=True)
        for file in wheels.glob("*.whl"):
            unzip(file, site)
    unzip(wheel, site)
    here = ROOT / "tests" / "native" / "other_builds.py"
    values = folder / "here.npz"
    subprocess.run([sys.executable, here, "write", values], check=True)
    arm = ["qemu-aarch64-static", "-L", system, "-E", f"PYTHONPATH={site}:{ROOT / 'tests'}"]
    arm += ["-E", "PYTHONDONTWRITEBYTECODE=1", system / "usr" / "bin" / "python3.11"]
    subprocess.run([*arm, here, "compare", values], check=True)
    tests = [ROOT / "tests" / "native" / name for name in TESTS]
    # Elsewhere than in the checkout, whose package has no core for ARM.
    command = [*arm, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", f"not ({NOT_HERE})", *tests]
    subprocess.run(command, check=True, cwd=folder)


def unpack_debian(folder: Path, system: Path) -> None:
    """Debian's ARM packages in a folder of their own, through an apt that knows of nothing installed."""
    for name in ("state/lists/partial", "cache/archives/partial", "system"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / "status").touch()
    settings = {
        "APT::Architecture": "arm64",
        "APT::Architectures": "arm64",
        "APT::Sandbox::User": "root",
        "Debug::NoLocking": "1",
        "Dir::State": folder / "state",
        "Dir::State::status": folder / "status",
        "Dir::Cache": folder / "cache",
    }
    apt = ["apt-get", "-q", "-y", *(word for key, value in settings.items() for word in ("-o", f"{key}={value}"))]
    subprocess.run([*apt, "update"], check=True)
    subprocess.run([*apt, "install", "--download-only", "--no-install-recommends", *PACKAGES], check=True)
    for file in (folder / "cache" / "archives").glob("*.deb"):
        subprocess.run(["dpkg-deb", "-x", file, system], check=True)


def unzip(wheel: Path, site: Path) -> None:
    subprocess.run([sys.executable, "-m", "zipfile", "-e", wheel, site], check=True)


if __name__ == "__main__":
    main()
