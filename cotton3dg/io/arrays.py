# SPDX-License-Identifier: Apache-2.0
"""Arrays in .npy and uncompressed .npz files, without pickle and with sizes checked before anything is allocated."""

from __future__ import annotations

import io
import math
import tokenize
import zipfile
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from ..errors import BadInput

_DAMAGED: Final = (
    OSError, EOFError, ValueError, SyntaxError, TypeError, KeyError, RuntimeError, MemoryError, OverflowError,
    zipfile.BadZipFile, tokenize.TokenError,
)  # fmt: skip
"""The errors that zipfile and numpy raise if the bytes are not an archive of arrays."""


def read_array(path: Path) -> NDArray[Any]:
    """The array of a .npy file.

    Raises:
        BadInput: damaged, or an array of Python objects.
    """
    try:
        with path.open("rb") as file:
            return _read(file)
    except _DAMAGED as error:
        raise BadInput(f"{path.name} is damaged: {_explain(error)}; make it again") from error


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of an .npz as `numpy.savez` writes it, by name.

    Raises:
        BadInput: damaged, compressed (which could unpack to anything), or with an array of Python objects.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if any(member.compress_type != zipfile.ZIP_STORED for member in members):
                raise ValueError("it is compressed")
            if sum(member.file_size for member in members) > path.stat().st_size:
                raise ValueError("it claims more than it holds")
            return {member.filename.removesuffix(".npy"): _read(io.BytesIO(archive.read(member))) for member in members}
    except _DAMAGED as error:
        raise BadInput(f"{path.name} is damaged: {_explain(error)}; make it again") from error


def _read(file: IO[bytes]) -> NDArray[Any]:
    version = np.lib.format.read_magic(file)
    read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[version]
    shape, fortran_order, dtype = read_header(file)
    content = file.read()
    # Python integers, so that an absurd shape costs nothing.
    if dtype.hasobject or min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != len(content):
        raise ValueError("its size is not that of its arrays")
    return np.frombuffer(bytearray(content), dtype).reshape(shape, order="F" if fortran_order else "C")


def _explain(error: BaseException) -> str:
    return " ".join(str(error).split())[:80] or type(error).__name__
