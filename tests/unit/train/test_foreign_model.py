# SPDX-License-Identifier: Apache-2.0
"""Models that other programs trained: their columns, their frame, and what is said of files that are none."""

import json

import numpy as np
import pytest
import torch
from scenes.documents import train_metrics
from scenes.foreign_plys import ORDERS, in_nerfstudios_frame, write_as, write_transforms
from scipy.spatial.transform import Rotation
from splatting import sh_basis

from cotton3dg.core.runs import StageOutcome
from cotton3dg.core.scene import Gaussians, rotations
from cotton3dg.errors import BadInput, MissingInput
from cotton3dg.gaussians.harmonics import basis, rotate_harmonics
from cotton3dg.train.foreign_model import explained, read_dataparser_transforms, read_foreign

QUARTER = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
"""Turns x into y."""


def some_gaussians(n=50, k=16, seed=0):
    rng = np.random.default_rng(seed)
    shapes = ((n, 3), (n, 4), (n, 3), (n,), (n, k, 3))
    return Gaussians(*(rng.normal(size=shape).astype(np.float32) for shape in shapes))


def assert_alike(found, expected):
    assert found.means == pytest.approx(expected.means, abs=1e-5)
    assert found.log_scales == pytest.approx(expected.log_scales, abs=1e-5)
    assert found.opacity_logits == pytest.approx(expected.opacity_logits)
    assert found.sh == pytest.approx(expected.sh, abs=1e-5)
    assert rotations(found.quats) == pytest.approx(rotations(expected.quats), abs=1e-5)


def test_the_basis_is_that_of_the_core():
    directions = np.random.default_rng(1).normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    assert basis(directions, 16) == pytest.approx(sh_basis(torch.from_numpy(directions), 3).numpy(), abs=1e-12)


def test_a_quarter_turn_of_the_first_degree():
    """By hand: what grows with -x in the turned frame grows with +y here, for (R d)_x = -d_y."""
    sh = np.zeros((1, 4, 3), np.float32)
    sh[0, 3] = 1.0
    expected = np.zeros((1, 4, 3))
    expected[0, 1] = -1.0
    assert rotate_harmonics(sh, QUARTER) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("k", [1, 4, 9, 16])
def test_turned_colours_look_the_same(k):
    rng = np.random.default_rng(2)
    sh, turn = rng.normal(size=(5, k, 3)).astype(np.float32), Rotation.random(rng=3).as_matrix()
    directions = rng.normal(size=(30, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    here = np.einsum("dk,nkc->ndc", basis(directions, k), rotate_harmonics(sh, turn))
    there = np.einsum("dk,nkc->ndc", basis(directions @ turn.T, k), sh)
    assert here == pytest.approx(there, abs=1e-5)


def test_nerfstudios_frame_is_undone(tmp_path):
    """By hand: (4, 5, 6) turns to (-5, 4, 6), moves to (-4, 6, 9) and shrinks to (-2, 3, 4.5); sizes halve."""
    there = Gaussians(
        np.array([[-2, 3, 4.5]], np.float32),
        np.array([[1, 0, 0, 0]], np.float32),
        np.log(np.full((1, 3), 0.1, np.float32)),
        np.zeros(1, np.float32),
        np.zeros((1, 1, 3), np.float32),
    )
    write_as("nerfstudio", tmp_path / "splat.ply", there)
    write_transforms(tmp_path / "dataparser_transforms.json", QUARTER, np.array([1, 2, 3.0]), 0.5)
    found = read_foreign(tmp_path / "splat.ply", tmp_path / "dataparser_transforms.json")
    assert found.means == pytest.approx(np.array([[4, 5, 6]]), abs=1e-5)
    assert found.scales == pytest.approx(np.full((1, 3), 0.2), rel=1e-5)
    # Along its own x it lay along x' there, which is -y here.
    assert rotations(found.quats)[0] == pytest.approx(QUARTER.T, abs=1e-6)


@pytest.mark.parametrize("tool", ORDERS)
@pytest.mark.parametrize("k", [1, 16])
def test_every_programs_columns_are_read(tmp_path, tool, k):
    expected = some_gaussians(k=k)
    write_as(tool, tmp_path / "model.ply", expected)
    assert_alike(read_foreign(tmp_path / "model.ply"), expected)


def test_any_frame_comes_back(tmp_path):
    expected, turn = some_gaussians(), Rotation.random(rng=5).as_matrix()
    write_as("nerfstudio", tmp_path / "a.ply", in_nerfstudios_frame(expected, turn, np.array([0.3, -2, 1]), 0.37))
    write_transforms(tmp_path / "t.json", turn, np.array([0.3, -2, 1]), 0.37)
    assert_alike(read_foreign(tmp_path / "a.ply", tmp_path / "t.json"), expected)


def test_files_that_are_none_say_what_to_do(tmp_path):
    with pytest.raises(MissingInput, match=r"splat\.ply is not there"):
        read_foreign(tmp_path / "splat.ply")
    (tmp_path / "splat.ply").write_bytes(b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n")
    with pytest.raises(BadInput, match="export it again"):
        read_foreign(tmp_path / "splat.ply")
    path = tmp_path / "dataparser_transforms.json"
    for text in (
        "{",
        "{}",
        json.dumps({"transform": np.eye(4).tolist(), "scale": 1.0}),
        json.dumps({"transform": np.eye(4)[:3].tolist(), "scale": 0.0}),
        json.dumps({"transform": (2 * np.eye(4)[:3]).tolist(), "scale": 1.0}),
        json.dumps({"transform": (np.diag([1, 1, -1.0, 1])[:3]).tolist(), "scale": 1.0}),
        json.dumps({"transform": [[1, 0, 0, 0], [0, 1, 0], [0, 0, 1, 0]], "scale": 1.0}),
    ):
        path.write_text(text)
        with pytest.raises(BadInput, match=r"config\.yml"):
            read_dataparser_transforms(path)


def test_a_model_unlike_the_photos_is_doubted_with_its_own_remedy():
    told = StageOutcome({}, ("low_psnr",), ("renders differ from the photos (PSNR 9.0 dB); try --preset paper",))
    (warning,) = explained(told, train_metrics(psnr_db=9.0)).warnings
    assert "--transforms" in warning and "--preset" not in warning
    assert explained(told, train_metrics(psnr_db=30.0)) == told
