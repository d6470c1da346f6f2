# SPDX-License-Identifier: Apache-2.0
"""Libraries that a default run does not need. They are imported where they are used, with a remedy if that fails."""

from __future__ import annotations

import ctypes
import re
import signal
from types import ModuleType
from typing import Any, Final

from ..errors import EnvironmentUnusable

DEBIAN_PACKAGE_OF: Final = {
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libX11.so.6": "libx11-6",
    "libusb-1.0.so.0": "libusb-1.0-0",
}
"""System libraries that the wheel of Open3D leaves to the machine."""


def import_open3d() -> ModuleType:
    """Open3D, whose wheel needs libraries of a desktop.

    Raises:
        EnvironmentUnusable: names what is missing.
    """
    try:
        import open3d
    except (ImportError, OSError) as error:
        library = missing_library(str(error))
        remedy = remedy_of(library) if library else "pip install --force-reinstall open3d"
        raise EnvironmentUnusable(f"Open3D cannot be used: {error}; {remedy}") from error
    return open3d


def import_pycolmap() -> Any:
    """pycolmap, without its answer to SIGTERM.

    At import its log installs handlers for the signals of a crash, and for SIGTERM, too: they print a C++ stack, and
    the process ends in the middle of saving. Python's own function for this works in the main thread only.
    """
    restore = ctypes.pythonapi.PyOS_setsig
    read = ctypes.pythonapi.PyOS_getsig
    read.restype = restore.restype = ctypes.c_void_p
    restore.argtypes = (ctypes.c_int, ctypes.c_void_p)
    before = read(signal.SIGTERM)
    import pycolmap

    restore(signal.SIGTERM, before)
    return pycolmap


def missing_library(output: str) -> str:
    """The shared library that a failed import names; empty when it names none."""
    found = re.search(r"(lib[\w.+-]+\.so[.\d]*): cannot open", output)
    return found.group(1) if found else ""


def remedy_of(library: str) -> str:
    """How to install a shared library; for one of Open3D's, all of these, because the loader names one at a time."""
    if library in DEBIAN_PACKAGE_OF:
        return f"sudo apt-get install {' '.join(DEBIAN_PACKAGE_OF.values())}"
    return f"install the system package that has {library}"
