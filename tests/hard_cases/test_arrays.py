# SPDX-License-Identifier: Apache-2.0
"""Hard case 46: .npy and .npz files that are not what they seem."""

from __future__ import annotations

import io
import re
import struct
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from cotton3dg.errors import BadInput
from cotton3dg.io.arrays import read_array, read_arrays

PACKAGE = Path(__file__).parents[2] / "cotton3dg"


def npy(array: np.ndarray, **options) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, **options)
    return buffer.getvalue()


def absurd(shape: str, kind: str = "<f8") -> bytes:
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode() + bytes(80)


def archive(path: Path, content: bytes, compression: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(path, "w", compression) as members:
        members.writestr("a.npy", content)
    return path


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("array", [np.zeros((0, 3)), np.arange(24.0).reshape(2, 3, 4), np.array("text"), np.float32(1)])
def test_case_46_what_was_saved_comes_back(tmp_path: Path, array: np.ndarray, order: str) -> None:
    array = np.asarray(array, order=order)
    np.save(tmp_path / "a.npy", array)
    with (tmp_path / "b.npz").open("wb") as file:
        np.savez(file, a=array, b=np.arange(3))
    for found in (read_array(tmp_path / "a.npy"), read_arrays(tmp_path / "b.npz")["a"]):
        assert found.dtype == array.dtype
        assert found.flags.writeable
        np.testing.assert_array_equal(found, array)


@pytest.mark.parametrize(
    "content",
    [
        npy(np.array([{"an": "object"}]), allow_pickle=True),
        absurd("(1099511627776,)"),
        absurd("(9223372036854775807, 9223372036854775807)"),
        absurd("(-1,)"),
        absurd("(9, 9, -9)"),
        absurd("(10,)", "|O"),
        absurd("(" + "1," * 40 + ")"),
        absurd("[" * 60),
        absurd("(10,)")[:40],
        b"",
    ],
)
def test_case_46_objects_bombs_and_absurd_sizes_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.npy").write_bytes(content)
    tracemalloc.start()
    try:
        with pytest.raises(BadInput, match=r"a\.npy is damaged"):
            read_array(tmp_path / "a.npy")
        with pytest.raises(BadInput, match=r"b\.npz is damaged"):
            read_arrays(archive(tmp_path / "b.npz", content))
        assert tracemalloc.get_traced_memory()[1] < 2**20
    finally:
        tracemalloc.stop()


def test_case_46_a_compressed_archive_is_never_unpacked(tmp_path: Path) -> None:
    """A thousandfold bomb."""
    path = archive(tmp_path / "b.npz", npy(np.zeros(2**22)), zipfile.ZIP_DEFLATED)
    assert path.stat().st_size < 2**16
    with pytest.raises(BadInput, match="compressed"):
        read_arrays(path)


def test_case_46_nothing_is_ever_unpickled() -> None:
    """No module imports pickle or reads through it; torch reads published weights as tensors and nothing else."""
    forbidden = re.compile(
        r"import pickle|pickle\.load|torch\.load\((?!.*weights_only=True)|allow_pickle=True|joblib"
        r"|np\.load\((?!.*allow_pickle=False)"
    )
    found = [path.name for path in PACKAGE.rglob("*.py") if forbidden.search(path.read_text(encoding="utf-8"))]
    assert found == []
