# SPDX-License-Identifier: Apache-2.0
"""PLY: exact layout, round trip, hostile files."""

from pathlib import Path

import numpy as np
import pytest

from cotton3dg.core.scene import Gaussians
from cotton3dg.errors import BadInput
from cotton3dg.io.ply import read_gaussians, recolour, write_gaussians

HEADER_DEGREE_0 = b"""ply
format binary_little_endian 1.0
element vertex 2
property float x
property float y
property float z
property float nx
property float ny
property float nz
property float f_dc_0
property float f_dc_1
property float f_dc_2
property float opacity
property float scale_0
property float scale_1
property float scale_2
property float rot_0
property float rot_1
property float rot_2
property float rot_3
end_header
"""


def some_gaussians(n: int, k: int, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)
    shapes = ((n, 3), (n, 4), (n, 3), (n,), (n, k, 3))
    return Gaussians(*(rng.normal(size=shape).astype(np.float32) for shape in shapes))


def test_header_is_the_one_other_tools_expect(tmp_path: Path) -> None:
    write_gaussians(tmp_path / "a.ply", some_gaussians(2, 1))
    written = (tmp_path / "a.ply").read_bytes()
    assert written.startswith(HEADER_DEGREE_0)
    assert len(written) == len(HEADER_DEGREE_0) + 2 * 17 * 4


def test_rest_coefficients_are_channel_major(tmp_path: Path) -> None:
    gaussians = some_gaussians(1, 4)
    write_gaussians(tmp_path / "a.ply", gaussians)
    row = np.frombuffer((tmp_path / "a.ply").read_bytes()[-26 * 4 :], "<f4")
    np.testing.assert_array_equal(row[9:12], gaussians.sh[0, 1:, 0])
    np.testing.assert_array_equal(row[15:18], gaussians.sh[0, 1:, 2])


@pytest.mark.parametrize("n", [0, 1, 50])
@pytest.mark.parametrize("k", [1, 4, 9, 16])
def test_round_trip_is_exact(tmp_path: Path, n: int, k: int) -> None:
    gaussians = some_gaussians(n, k)
    write_gaussians(tmp_path / "a.ply", gaussians)
    again = read_gaussians(tmp_path / "a.ply")
    assert again.sha256() == gaussians.sha256()
    write_gaussians(tmp_path / "b.ply", again)
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


def test_columns_in_another_order_and_without_normals_are_understood(tmp_path: Path) -> None:
    gaussians = some_gaussians(2, 1)
    write_gaussians(tmp_path / "a.ply", gaussians)
    body = np.frombuffer((tmp_path / "a.ply").read_bytes()[len(HEADER_DEGREE_0) :], "<f4").reshape(2, 17)
    names = [line.split()[-1] for line in HEADER_DEGREE_0.decode().splitlines() if line.startswith("property")]
    order = [i for i in reversed(range(17)) if names[i] not in ("nx", "ny", "nz")]
    header = ["ply", "format binary_little_endian 1.0", "comment made elsewhere", "element vertex 2"]
    header += [f"property double {names[i]}" for i in order] + ["end_header", ""]
    (tmp_path / "b.ply").write_bytes("\n".join(header).encode() + body[:, order].astype("<f8").tobytes())
    assert read_gaussians(tmp_path / "b.ply").sha256() == gaussians.sha256()


def replaced(old: bytes, new: bytes):
    return lambda whole: whole.replace(old, new, 1)


@pytest.mark.parametrize(
    "damage",
    [
        lambda whole: b"",
        lambda whole: b"ply\n",
        lambda whole: whole[:-1],
        lambda whole: whole[:200],
        lambda whole: b"\xff" * 1000,
        lambda whole: whole[:-4] + np.float32(np.nan).tobytes(),
        lambda whole: whole[:-4] + np.float32(-np.inf).tobytes(),
        replaced(b"vertex 2", b"vertex 99999999999999999999"),
        replaced(b"vertex 2", b"vertex -2"),
        replaced(b"vertex 2", b"vertex"),
        replaced(b"vertex 2", b"vertex 2 2"),
        replaced(b"element vertex", b"element face"),
        replaced(b"binary_little_endian", b"ascii"),
        replaced(b"format binary_little_endian 1.0\n", b""),
        replaced(b"property float rot_3", b"property float rot_2"),
        replaced(b"property float rot_3", b"property float rot_4"),
        replaced(b"property float nx", b"property float f_rest_0"),
        replaced(b"property float nx", b"property list uchar int nx"),
        replaced(b"property float nx", b"property float \xc3\xa9"),
    ],
)
def test_hostile_files_are_refused(tmp_path: Path, damage) -> None:
    write_gaussians(tmp_path / "a.ply", some_gaussians(2, 1))
    (tmp_path / "a.ply").write_bytes(damage((tmp_path / "a.ply").read_bytes()))
    with pytest.raises(BadInput, match=r"a\.ply"):
        read_gaussians(tmp_path / "a.ply")


def test_coloured_gaussians_have_the_colours() -> None:
    colours = np.random.default_rng(1).uniform(size=(5, 3))
    np.testing.assert_allclose(recolour(some_gaussians(5, 4), colours).colours, colours, atol=1e-6)
