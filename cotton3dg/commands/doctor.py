"""What this machine offers and lacks: each finding with the command that mends it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from .. import __version__
from ..core.machine import usable_cores
from ..errors import Cotton3dgError
from ..files.video import ffmpeg_binary

MODULE_OF = {
    "ffmpeg-python": "ffmpeg",
    "imageio-ffmpeg": "imageio_ffmpeg",
    "opencv-contrib-python-headless": "cv2",
    "pillow": "PIL",
    "zxing-cpp": "zxingcpp",
}
"""Distribution -> module, where the names differ."""

DEBIAN_PACKAGE_OF = {
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libX11.so.6": "libx11-6",
    "libgomp.so.1": "libgomp1",
    "libusb-1.0.so.0": "libusb-1.0-0",
}
"""System libraries that the wheels leave to the machine."""

PHONE_CODECS = ("h264", "hevc")
"""What smartphones film with."""

LEAST_MEMORY_GIB, LEAST_DISK_GIB = 4.0, 2.0
"""A plant of 100 images takes 1 to 2 GiB of memory; its folder some 0.3 GiB and as much again while it is made."""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    name: str
    found: str
    remedy: str = ""
    """What to do about it; empty when all is well."""
    fatal: bool = False
    """Nothing works without it."""


def examine(folder: Path) -> list[Finding]:
    """Everything that matters for running plants in `folder`. Takes seconds: the large libraries are imported."""
    libraries = _list_libraries()
    with ThreadPoolExecutor(len(usable_cores())) as pool:
        imported = list(pool.map(_examine_library, libraries))
    return [
        Finding("cotton3dg", f"{__version__}, Python {sys.version.split()[0]}"),
        *imported,
        _examine_core(),
        *_examine_ffmpeg(),
        *_examine_machine(folder),
    ]


def _list_libraries() -> list[str]:
    """Names of the distributions that the package needs."""
    needed = metadata.requires("cotton3dg") or []
    return [re.split(r"[^\w.-]", line, maxsplit=1)[0] for line in needed if "extra ==" not in line]


def _examine_library(name: str) -> Finding:
    """Imported in a process of its own: a library built for another processor ends the one that imports it."""
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        return Finding(name, "missing", f"pip install {name}", fatal=True)
    module = MODULE_OF.get(name, name)
    done = subprocess.run(
        [sys.executable, "-c", f"import {module}"], check=False, capture_output=True, text=True, errors="replace"
    )
    return _import_finding(name, version, done.returncode, done.stderr)


def _import_finding(name: str, version: str, code: int, said: str) -> Finding:
    """What the end of `import` means."""
    if code == 0:
        return Finding(name, version)
    missing = re.search(r"(lib[\w.+-]+\.so[.\d]*): cannot open", said)
    if missing:
        library = missing.group(1)
        package = DEBIAN_PACKAGE_OF.get(library)
        remedy = f"sudo apt-get install {package}" if package else f"install the system package that has {library}"
        return Finding(name, f"{version}, but {library} is missing", remedy, fatal=True)
    if code < 0:
        remedy = f"install a build of {name} for this processor"
        return Finding(name, f"{version} ends with signal {-code}", remedy, fatal=True)
    reason = next((line for line in reversed(said.strip().splitlines()) if line.strip()), "no reason was given")
    return Finding(name, f"{version} cannot be imported: {reason}", f"pip install --force-reinstall {name}", fatal=True)


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
        version = _said_by(binary, "-version").splitlines()[0]
        decoders = _said_by(binary, "-hide_banner", "-decoders")
    except (Cotton3dgError, OSError, IndexError) as error:
        return [Finding("ffmpeg", f"missing: {error}", "sudo apt-get install ffmpeg", fatal=True)]
    lacking = [codec for codec in PHONE_CODECS if not re.search(rf"^ V\S* {codec}\b", decoders, re.MULTILINE)]
    codecs = Finding(
        "video codecs",
        f"no {', '.join(lacking)}" if lacking else ", ".join(PHONE_CODECS),
        "install an ffmpeg with them: sudo apt-get install ffmpeg" if lacking else "",
    )
    return [Finding("ffmpeg", f"{version.split(' Copyright')[0]} ({binary})"), codecs]


def _said_by(*command: str) -> str:
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
