# SPDX-License-Identifier: Apache-2.0
"""Gaussians in the PLY layout of the INRIA implementation, which SuperSplat and other viewers open.

Binary little-endian float32 properties in this order: x y z nx ny nz f_dc_0..2 f_rest_* opacity scale_0..2 rot_0..3.
`f_rest` is channel-major (all higher coefficients of red, then green, then blue), opacity is a logit, scales are
natural logarithms, rotations are wxyz. Other tools refuse extra columns, so none are written.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import SH_CONSTANT, Gaussians
from ..errors import BadInput

_HEADER_LIMIT: Final = 65536
_SCALARS: Final = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "<i2", "int16": "<i2", "ushort": "<u2",
    "uint16": "<u2", "int": "<i4", "int32": "<i4", "uint": "<u4", "uint32": "<u4", "float": "<f4", "float32": "<f4",
    "double": "<f8", "float64": "<f8",
}  # fmt: skip


def write_gaussians(path: Path, gaussians: Gaussians) -> None:
    """Write `gaussians` to `path`; the same Gaussians give the same bytes."""
    n, names = len(gaussians), _property_names(gaussians.sh.shape[1])
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {n}"]
    header += [f"property float {name}" for name in names] + ["end_header", ""]
    table = np.concatenate(
        [
            gaussians.means,
            np.zeros((n, 3), np.float32),
            gaussians.sh[:, 0],
            gaussians.sh[:, 1:].transpose(0, 2, 1).reshape(n, 3 * (gaussians.sh.shape[1] - 1)),
            gaussians.opacity_logits[:, None],
            gaussians.log_scales,
            gaussians.quats,
        ],
        axis=1,
    )
    with path.open("wb") as file:
        file.write("\n".join(header).encode("ascii"))
        file.write(table.astype("<f4", copy=False).tobytes())


def read_gaussians(path: Path, remedy: str = "make it again with `cotton3dg train`") -> Gaussians:
    """Read Gaussians from `path`. Columns may come in any order and extra scalar columns are ignored.

    Rows are never dropped, because per-Gaussian labels in other files refer to them by number: a file with a
    value that is not finite is refused as a whole.

    Args:
        remedy: what to do about a file that cannot be used.
    Raises:
        BadInput: not a binary PLY of Gaussians, shorter than its header says, or with non-finite values.
    """
    try:
        return _read_table(path)
    except _Unusable as error:
        raise BadInput(f"{path.name} {error}; {remedy}") from error


class _Unusable(ValueError):
    """What is wrong with a file."""


def _read_table(path: Path) -> Gaussians:
    size = path.stat().st_size
    with path.open("rb") as file:
        lines, start = _read_header(file.read(_HEADER_LIMIT))
        count, layout = _parse_layout(lines)
        # Compared as Python integers before anything is allocated, so that an absurd count costs nothing.
        if count * layout.itemsize > size - start:
            raise _Unusable(f"is shorter than the {count} Gaussians of its header")
        file.seek(start)
        table = np.frombuffer(file.read(count * layout.itemsize), layout)
    n_rest = sum(name.startswith("f_rest_") for name in layout.names or ())
    if n_rest not in (0, 9, 24, 45):
        raise _Unusable(f"has {n_rest} f_rest columns instead of 0, 9, 24 or 45")
    missing = set(_property_names(n_rest // 3 + 1)) - {"nx", "ny", "nz"} - set(layout.names or ())
    if missing:
        raise _Unusable(f"has no column {min(missing)}")

    def columns(prefix: str, n: int) -> NDArray[np.float32]:
        with np.errstate(over="ignore"):  # a float64 beyond float32 becomes infinite and is refused below
            return np.stack([table[f"{prefix}{i}"].astype(np.float32) for i in range(n)], axis=1)

    rest = columns("f_rest_", n_rest).reshape(count, 3, n_rest // 3) if n_rest else np.zeros((count, 3, 0), np.float32)
    gaussians = Gaussians(
        np.stack([table[axis].astype(np.float32) for axis in "xyz"], axis=1),
        columns("rot_", 4),
        columns("scale_", 3),
        table["opacity"].astype(np.float32),
        np.ascontiguousarray(np.concatenate([columns("f_dc_", 3)[:, None], rest.transpose(0, 2, 1)], axis=1)),
    )
    broken = ~gaussians.finite_rows
    if broken.any():
        raise _Unusable(f"has non-finite values in {broken.sum()} of {count} Gaussians")
    return gaussians


def recolour(gaussians: Gaussians, colours: NDArray[Any]) -> Gaussians:
    """The same Gaussians in the given colours, (N, 3) RGB in 0..1, which do not depend on the viewing direction."""
    sh = (np.asarray(colours, np.float32)[:, None] - np.float32(0.5)) / np.float32(SH_CONSTANT)
    return Gaussians(gaussians.means, gaussians.quats, gaussians.log_scales, gaussians.opacity_logits, sh)


def _property_names(n_coefficients: int) -> list[str]:
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{i}" for i in range(3 * (n_coefficients - 1))]
    return [*names, "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]


def _read_header(head: bytes) -> tuple[list[list[str]], int]:
    """Words of each header line, and where the header ends, bytes."""
    end = head.find(b"end_header")
    newline = head.find(b"\n", end)
    if not head.startswith(b"ply") or end < 0 or newline < 0:
        raise _Unusable("has no PLY header")
    try:
        lines = [line.split() for line in head[:end].decode("ascii").splitlines()]
    except UnicodeDecodeError as error:
        raise _Unusable("has no PLY header") from error
    return [words for words in lines if words and words[0] not in ("comment", "obj_info")], newline + 1


def _parse_layout(lines: list[list[str]]) -> tuple[int, np.dtype]:
    """Number of vertices and the layout of one, from the words of the header lines."""
    if [*lines, [], []][1][:2] != ["format", "binary_little_endian"]:
        raise _Unusable("is not a binary little-endian PLY")
    elements = [i for i, words in enumerate(lines) if words[0] == "element"]
    count = lines[elements[0]][2] if elements and len(lines[elements[0]]) == 3 else ""
    if not (count.isdecimal() and len(count) < 20) or lines[elements[0]][1] != "vertex":
        raise _Unusable("does not begin with its vertices")
    stop = elements[1] if len(elements) > 1 else len(lines)
    fields = []
    for words in lines[elements[0] + 1 : stop]:
        if len(words) != 3 or words[0] != "property" or words[1] not in _SCALARS:
            raise _Unusable(f"has a property that is not a number: {' '.join(words)[:60]}")
        fields.append((words[2], _SCALARS[words[1]]))
    if not fields or len({name for name, _ in fields}) < len(fields):
        raise _Unusable("has no columns or names one twice")
    return int(count), np.dtype(fields)
