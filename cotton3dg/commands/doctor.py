# SPDX-License-Identifier: Apache-2.0
"""What this machine offers and lacks: each finding comes with the command that fixes it."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Final

from packaging.requirements import Requirement

from ..core.libraries import missing_library, remedy_of
from ..core.machine import usable_cores
from ..core.version import version_text
from ..errors import Cotton3dgError, MissingInput
from ..io.video import ffmpeg_binary

MODULE_OF: Final = {
    "ffmpeg-python": "ffmpeg",
    "imageio-ffmpeg": "imageio_ffmpeg",
    "open3d-cpu": "open3d",
    "opencv-contrib-python-headless": "cv2",
    "pillow": "PIL",
    "zxing-cpp": "zxingcpp",
}
"""Distribution -> module, if the names differ."""

ONLY_FOR: Final = {
    "open3d": "clusters by DBSCAN, point clouds of scanners",
    "open3d-cpu": "clusters by DBSCAN, point clouds of scanners",
    "openpyxl": "Excel files",
    "torch": "segmentation by affinity, training of networks",
    "zxing-cpp": "cards that name plants",
}
"""Distribution -> what needs it; a default run needs all others."""

PHONE_CODECS: Final = ("h264", "hevc")
"""The codecs of smartphones."""

LEAST_MEMORY_GIB: Final = 4.0
LEAST_DISK_GIB: Final = 2.0
"""A plant of 100 images takes 1 to 2 GiB of memory; its folder some 0.3 GiB and as much again while it is made."""


@dataclass(frozen=True)
class Finding:
    """One thing that the command examines."""

    name: str
    found: str
    remedy: str = ""
    """The remedy; empty if all is well."""
    fatal: bool = False
    """Nothing works without it."""


def examine(folder: Path) -> list[Finding]:
    """Examine everything that matters for runs in `folder`. It takes seconds, because it imports the large libraries.

    Raises:
        MissingInput: the folder does not exist.
    """
    if not folder.is_dir():
        raise MissingInput(f"{folder} is not a folder; give the one where plants are to be run")
    libraries = _list_libraries()
    with ThreadPoolExecutor(len(usable_cores())) as pool:
        imported = list(pool.map(_examine_library, libraries))
    return [
        Finding("cotton3dg", f"{version_text()}, Python {sys.version.split()[0]}"),
        *imported,
        _examine_core(),
        *_examine_ffmpeg(),
        *_examine_machine(folder),
    ]


def is_ready(findings: list[Finding]) -> bool:
    """Whether the machine can run plants."""
    return not any(finding.fatal and finding.remedy for finding in findings)


def conclude(findings: list[Finding]) -> str:
    """The verdict in one line."""
    lacking = [finding.name for finding in findings if finding.remedy and finding.fatal]
    if lacking:
        return f"not ready: {', '.join(lacking)} must be mended first; the lines marked with ! say how"
    doubtful = [finding.name for finding in findings if finding.remedy]
    return "ready" + (f", but look at {', '.join(doubtful)}" if doubtful else "")


def mend(findings: list[Finding], tell: Callable[[str], None]) -> None:
    """Run the remedies that this user may run: pip always, apt-get as root or if sudo needs no password."""
    for remedy in dict.fromkeys(finding.remedy for finding in findings if finding.remedy):
        commands = _commands_of(remedy)
        if not commands:
            tell(f"left to you: {remedy}")
        for command in commands:
            tell(f"$ {shlex.join(command)}")
            if subprocess.run(command, check=False).returncode:
                tell(f"failed: {remedy}")
                break


def _commands_of(remedy: str) -> list[list[str]]:
    """The commands of a remedy for this user; empty if it is not a command, or this user may not run it."""
    words = shlex.split(remedy)
    if words[:2] == ["pip", "install"]:
        # Do not look for its module: for pip, setuptools' finder then brings back the old distutils.
        if any(metadata.distributions(name="pip")):
            return [[sys.executable, "-m", *words]]
        return [["uv", "pip", "install", "--python", sys.executable, *words[2:]]] if shutil.which("uv") else []
    by_apt = words[:3] == ["sudo", "apt-get", "install"] and shutil.which("apt-get")
    if by_apt and (first := _as_root()) is not None:
        return [[*first, "apt-get", "update", "-q"], [*first, "apt-get", "install", "-y", "-q", *words[3:]]]
    return []


def _as_root() -> list[str] | None:
    """The words in front of a command that needs root; None if this user may not run it."""
    if os.geteuid() == 0:
        return []
    sudo = ["sudo", "-n"]
    allowed = shutil.which("sudo") and subprocess.run([*sudo, "true"], check=False, capture_output=True).returncode == 0
    return sudo if allowed else None


def _list_libraries() -> list[str]:
    """Names of the distributions that the package needs."""
    needed = map(Requirement, metadata.requires("cotton3dg") or [])
    return [item.name for item in needed if item.marker is None or item.marker.evaluate({"extra": ""})]


def _examine_library(name: str) -> Finding:
    """Import it in a separate process: a library built for another processor ends the process that imports it."""
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        return _library_finding(name, "missing", f"pip install {name}")
    module = MODULE_OF.get(name, name)
    done = subprocess.run(
        [sys.executable, "-c", f"import {module}"], check=False, capture_output=True, text=True, errors="replace"
    )
    return _import_finding(name, version, done.returncode, done.stderr)


def _import_finding(name: str, version: str, code: int, output: str) -> Finding:
    """The finding for an `import` that has ended."""
    if code == 0:
        return Finding(name, version)
    if library := missing_library(output):
        return _library_finding(name, f"{version}, but {library} is missing", remedy_of(library))
    if code < 0:
        remedy = f"install a build of {name} for this processor"
        return _library_finding(name, f"{version} ends with signal {-code}", remedy)
    reason = next((line for line in reversed(output.strip().splitlines()) if line.strip()), "no reason was given")
    remedy = f"pip install --force-reinstall {name}"
    return _library_finding(name, f"{version} cannot be imported: {reason}", remedy)


def _library_finding(name: str, found: str, remedy: str) -> Finding:
    purpose = ONLY_FOR.get(name)
    return Finding(name, f"{found} (only for {purpose})" if purpose else found, remedy, fatal=purpose is None)


def _examine_core() -> Finding:
    try:
        from .. import _native
    except ImportError as error:
        return Finding("C++ core", f"cannot be imported: {error}", "make setup, or pip install again", fatal=True)
    levels = ", ".join(_native.instruction_sets())
    return Finding("C++ core", f"instruction set {_native.instruction_set()} (this processor has {levels})")


def _examine_ffmpeg() -> list[Finding]:
    try:
        binary = ffmpeg_binary()
        version = _output_of(binary, "-version").splitlines()[0]
        decoders = _output_of(binary, "-hide_banner", "-decoders")
    except (Cotton3dgError, OSError, IndexError) as error:
        return [Finding("ffmpeg", f"missing: {error}", "sudo apt-get install ffmpeg", fatal=True)]
    lacking = [codec for codec in PHONE_CODECS if not re.search(rf"^ V\S* {codec}\b", decoders, re.MULTILINE)]
    codecs = Finding(
        "video codecs",
        f"no {', '.join(lacking)}" if lacking else ", ".join(PHONE_CODECS),
        "install an ffmpeg with them: sudo apt-get install ffmpeg" if lacking else "",
    )
    return [Finding("ffmpeg", f"{version.split(' Copyright')[0]} ({binary})"), codecs]


def _output_of(*command: str) -> str:
    return subprocess.run(command, check=False, capture_output=True, text=True, errors="replace").stdout


def _examine_machine(folder: Path) -> list[Finding]:
    page, pages = os.sysconf("SC_PAGE_SIZE"), os.sysconf("SC_PHYS_PAGES")
    memory_gib = page * pages / 2**30
    free_gib = shutil.disk_usage(folder).free / 2**30
    return [
        Finding("processor", f"{len(usable_cores())} cores for this process"),
        Finding(
            "memory",
            f"{memory_gib:.1f} GiB",
            "" if memory_gib >= LEAST_MEMORY_GIB else "use --preset draft, or a machine with more memory",
        ),
        Finding(
            "disk",
            f"{free_gib:.1f} GiB free in {folder}",
            "" if free_gib >= LEAST_DISK_GIB else "free some space: a plant takes about 0.5 GiB",
        ),
        Finding(
            "writing",
            "allowed" if os.access(folder, os.W_OK) else f"not allowed in {folder}",
            "" if os.access(folder, os.W_OK) else "change the folder's permissions or copy the plants elsewhere",
            fatal=not os.access(folder, os.W_OK),
        ),
        Finding("GPU", "not needed and not used, but by the yolo, sam and grounded-sam masks"),
    ]
