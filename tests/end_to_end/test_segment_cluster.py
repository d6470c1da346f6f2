"""The stages segment and cluster on a workspace made here: five bolls on a stem, rendered to exact masks."""

import json
from pathlib import Path

import numpy as np
import pytest

from cotton3dg.core.scene import Camera, Gaussians
from cotton3dg.errors import BadInput, MissingInput
from cotton3dg.files.bolls import read_bolls, read_lifted
from cotton3dg.files.images import write_ids
from cotton3dg.files.ply import read_gaussians, write_gaussians
from cotton3dg.options import ClusterOptions, SegmentOptions
from cotton3dg.plant.match import match_bolls
from cotton3dg.splat.ops import render_values
from cotton3dg.stages import cluster, segment
from cotton3dg.workspace import Workspace

CENTRES = np.array([[0, 0, 3.0], [0.5, 0, 2.0], [-0.35, 0.35, 1.5], [0.05, 0.55, 1.45], [0, -0.6, 1.0]])
"""The third and fourth touch."""
RADIUS = 0.22
N_VIEWS = 12


def model() -> tuple[Gaussians, np.ndarray]:
    """Gaussians and the boll of each, 0 = stem."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(5, 160, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    stem = np.column_stack([rng.normal(0, 0.02, (300, 2)), rng.uniform(0, 2.7, 300)])
    means = np.concatenate([(CENTRES[:, None] + RADIUS * directions).reshape(-1, 3), stem]).astype(np.float32)
    n = len(means)
    gaussians = Gaussians(
        means,
        np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        np.full((n, 3), np.log(0.035), np.float32),
        np.full(n, 3.0, np.float32),
        np.zeros((n, 1, 3), np.float32),
    )
    return gaussians, np.concatenate([np.repeat(np.arange(1, 6), 160), np.zeros(300, int)])


def cameras() -> list[Camera]:
    views = []
    for i in range(N_VIEWS):
        angle = 2 * np.pi * i / N_VIEWS
        centre = np.array([6 * np.cos(angle), 6 * np.sin(angle), 2.5])
        forward = np.array([0, 0, 1.7]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0]) / np.linalg.norm(np.cross(forward, [0, 0, 1.0]))
        rotation = np.stack([right, np.cross(forward, right), forward])
        pose = np.column_stack([rotation, -rotation @ centre])
        views.append(Camera(f"{i:06d}.jpg", 240, 200, 260.0, 260.0, 120.0, 100.0, pose))
    return views


def write_model(folder: Path, views: list[Camera]) -> None:
    import pycolmap

    model = pycolmap.Reconstruction()
    first = views[0]
    intrinsics = [first.fx, first.fy, first.cx, first.cy]
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(model="PINHOLE", width=first.width, height=first.height, params=intrinsics, camera_id=1)
    )
    for i, view in enumerate(views, 1):
        image = pycolmap.Image(name=view.name, camera_id=1, image_id=i)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(view.cam_from_scene))
    folder.mkdir(parents=True)
    model.write_binary(str(folder))


def write_masks(workspace: Workspace, ids: list[np.ndarray]) -> None:
    with workspace.writing("masks") as folder:
        for view, image in zip(cameras(), ids, strict=True):
            write_ids(folder / workspace.mask_png(view.name).name, image)


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    workspace = Workspace(tmp_path)
    gaussians, bolls = model()
    write_model(workspace.undistorted / "sparse", cameras())
    with workspace.writing("train") as folder:
        write_gaussians(folder / workspace.gaussians_ply.name, gaussians)
    shares = np.eye(6, dtype=np.float32)[bolls]
    ids = []
    for i, view in enumerate(cameras()):
        rendered = render_values(gaussians, view, shares).image
        name = np.where(rendered.sum(axis=2) > 0.5, rendered.argmax(axis=2), 0)
        # Other numbers in every view: nothing may rest on them.
        ids.append(np.where(name > 0, (name * 7 + i) % 5 + 1 + i, 0).astype(np.uint16))
    ids[4] = np.zeros_like(ids[4])
    write_masks(workspace, ids)
    return workspace


@pytest.mark.parametrize("n_masks", [12, 4])
def test_masks_become_bolls(workspace, n_masks):
    for i in set(range(N_VIEWS)) - set(range(0, N_VIEWS, N_VIEWS // n_masks)):
        workspace.mask_png(f"{i:06d}.jpg").unlink()
    lifted = segment.run(workspace, SegmentOptions())
    outcome = cluster.run(workspace, ClusterOptions())
    assert lifted.summary["views"] == n_masks and lifted.flags == ()
    assert outcome.summary["bolls"] == 5 and outcome.flags == ()
    bolls, sha256 = read_bolls(workspace.bolls_json, workspace.labels_npy)
    gaussians, truth = model()
    assert sha256 == gaussians.sha256()
    pairs = match_bolls(np.array([boll.centre for boll in bolls]), CENTRES, 0.25 * RADIUS)
    # From the top downwards, as the truth is listed.
    assert pairs.tolist() == [[k, k] for k in range(5)]
    labels = np.load(workspace.labels_npy)
    assert labels.dtype == np.int32
    for k in range(1, 6):
        both = ((labels == k) & (truth == k)).sum()
        assert both / ((labels == k) | (truth == k)).sum() > 0.8
    assert [boll.diameter_su for boll in bolls] == pytest.approx([2 * RADIUS] * 5, rel=0.15)
    shown = read_gaussians(workspace.bolls_ply)
    assert np.array_equal(shown.means, gaussians.means)
    assert len(np.unique(shown.colours.round(3), axis=0)) == 6


def test_objects_join_by_distance_too(workspace):
    segment.run(workspace, SegmentOptions())
    summary = cluster.run(workspace, ClusterOptions(method="dbscan")).summary
    bolls, _ = read_bolls(workspace.bolls_json, workspace.labels_npy)
    pairs = match_bolls(np.array([boll.centre for boll in bolls]), CENTRES, 0.25 * RADIUS)
    # Distance alone does not tell touching bolls apart for certain, but the three others it must.
    assert {0, 1, 4} <= set(pairs[:, 1])
    assert 4 <= summary["bolls"] <= 6


def test_the_same_masks_give_the_same_files(workspace):
    digests = []
    for _ in range(2):
        segment.run(workspace, SegmentOptions())
        cluster.run(workspace, ClusterOptions())
        digests.append(workspace.hashes(workspace.selections_npz, workspace.folder("cluster")))
    assert digests[0] == digests[1]


def test_smaller_renders_find_the_same_bolls(workspace):
    segment.run(workspace, SegmentOptions(max_side=120))
    assert cluster.run(workspace, ClusterOptions()).summary["bolls"] == 5


@pytest.mark.parametrize("method", ["consensus", "dbscan"])
def test_no_bolls_is_an_answer(workspace, method):
    write_masks(workspace, [np.zeros((200, 240), np.uint16)] * N_VIEWS)
    assert segment.run(workspace, SegmentOptions()).flags == ("no_bolls",)
    outcome = cluster.run(workspace, ClusterOptions(method=method))
    assert outcome.flags == ("no_bolls",) and outcome.warnings
    assert json.loads(workspace.bolls_json.read_text())["bolls"] == []
    assert not np.load(workspace.labels_npy).any()


def test_selections_of_another_model_are_refused(workspace):
    segment.run(workspace, SegmentOptions())
    gaussians, _ = model()
    with workspace.writing("train") as folder:
        write_gaussians(folder / workspace.gaussians_ply.name, gaussians[np.arange(len(gaussians))[::-1]])
    with pytest.raises(BadInput, match="another model"):
        cluster.run(workspace, ClusterOptions())


def test_wrong_masks_and_missing_inputs_are_named(workspace, tmp_path):
    write_masks(workspace, [np.zeros((100, 240), np.uint16)] * N_VIEWS)
    with pytest.raises(BadInput, match="240x100"):
        segment.run(workspace, SegmentOptions())
    with pytest.raises(MissingInput, match="cotton3dg segment"):
        cluster.run(workspace, ClusterOptions())
    empty = tmp_path / "other"
    empty.mkdir()
    with pytest.raises(MissingInput, match="cotton3dg train"):
        segment.run(Workspace(empty), SegmentOptions())


def test_a_damaged_file_is_refused(workspace):
    segment.run(workspace, SegmentOptions())
    whole = workspace.selections_npz.read_bytes()
    assert read_lifted(workspace.selections_npz).views
    for length in (0, 100, len(whole) // 2, len(whole) - 40):
        workspace.selections_npz.write_bytes(whole[:length])
        with pytest.raises(BadInput, match="cotton3dg segment"):
            cluster.run(workspace, ClusterOptions())
