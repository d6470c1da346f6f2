# SPDX-License-Identifier: Apache-2.0
"""The plant's Gaussians for the page: which ones, and what is left of them in few bytes."""

import base64
import gzip

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cotton3dg.core.scene import Camera, Gaussians, rotations
from cotton3dg.report import splats
from cotton3dg.report.frame import Frame


def cloud(n: int = 500, seed: int = 0) -> Gaussians:
    random = np.random.default_rng(seed)
    draw = (random.normal(size=(n, width)).astype(np.float32) for width in (3, 4, 3))
    means, quats, log_scales = draw
    sh = random.uniform(-1.5, 1.5, (n, 1, 3)).astype(np.float32)
    return Gaussians(means, quats, log_scales - 4, random.normal(size=n).astype(np.float32), sh)


def page() -> Frame:
    """Turned, 20 cm to a scene unit, with an origin elsewhere."""
    return Frame(20 * Rotation.from_euler("xyz", [0.3, -1.1, 2.0]).as_matrix(), np.array([1.0, 2.0, 3.0]), "cm")


def planes(packed) -> np.ndarray:
    return np.frombuffer(gzip.decompress(base64.b64decode(packed["gzip"])), np.uint8).reshape(19, packed["n"]).T


def covariances(turns: np.ndarray, scales: np.ndarray) -> np.ndarray:
    return turns @ (scales[:, :, None] ** 2 * np.swapaxes(turns, 1, 2))


def test_places_shapes_colours_and_owners_survive_packing() -> None:
    shown, frame = cloud(), page()
    owners = np.arange(500) * 3
    packed = splats.pack_splats(shown, owners, frame)
    bytes_ = planes(packed).astype(int)
    found = bytes_[:, 17] + 256 * bytes_[:, 18]
    assert sorted(found) == sorted(owners)
    rows = found // 3
    steps = bytes_[:, 0:3] + 256 * bytes_[:, 3:6]
    places = packed["low"] + steps / 65535 * np.array(packed["widths"])
    assert places == pytest.approx(frame.places(shown.means)[rows], abs=2e-3)
    least, most = packed["log_scales"]
    scales = np.exp(least + bytes_[:, 6:9] / 255 * (most - least))
    there = covariances(rotations(bytes_[:, 9:13] - 127), scales)
    turn = frame.page_from_scene
    true = turn @ covariances(rotations(shown.quats), shown.scales)[rows] @ turn.T
    sizes = np.trace(true, axis1=1, axis2=2)[:, None, None]
    assert np.abs((there - true) / sizes).max() < 0.06
    wanted = np.column_stack([shown.colours, shown.opacities])[rows]
    assert bytes_[:, 13:17] / 255 == pytest.approx(wanted, abs=0.003)


def test_neighbours_in_space_are_neighbours_in_the_file() -> None:
    packed = splats.pack_splats(cloud(3000), np.zeros(3000, int), page())
    bytes_ = planes(packed).astype(int)
    steps = bytes_[:, 0:3] + 256 * bytes_[:, 3:6]
    along, apart = (np.linalg.norm(np.diff(way, axis=0), axis=1).mean() for way in (steps, steps[::-7]))
    assert along < 0.7 * apart


def camera() -> Camera:
    return Camera("a.jpg", 200, 160, 100.0, 100.0, 100.0, 80.0, np.column_stack([np.eye(3), [0, 0, 5.0]]))


def test_what_no_camera_sees_is_left_out_and_the_most_seen_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    near = cloud(40)
    means = near.means * np.float32(0.3)
    means[:10, 2] = -50  # behind the camera
    size = np.full((40, 3), -3.0, np.float32)
    size[10:15] = -1.0
    shown = Gaussians(means, near.quats, size, np.full(40, 2, np.float32), near.sh)
    wanted = np.ones(40, bool)
    wanted[39] = False
    rows = splats.choose_splats(shown, wanted, [camera()])
    assert rows.min() >= 10 and 39 not in rows and len(rows) > 15
    monkeypatch.setattr(splats, "MOST_SPLATS", 5)
    few = splats.choose_splats(shown, wanted, [camera()])
    assert len(few) == 5 and len(set(few) & set(range(10, 15))) >= 3
    assert len(splats.choose_splats(shown, wanted, [])) == 5
