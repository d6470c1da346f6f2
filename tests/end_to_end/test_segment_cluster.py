# SPDX-License-Identifier: Apache-2.0
"""The stages segment and cluster on a workspace made here: five bolls on a stem, rendered to exact masks."""

import json
from pathlib import Path

import numpy as np
import pytest
from scenes.boll_scene import CENTRES, N_VIEWS, RADIUS, made_workspace, model, write_masks

from cotton3dg.cluster import stage as cluster
from cotton3dg.errors import BadInput, MissingInput
from cotton3dg.evaluation.match import match_bolls
from cotton3dg.io.images import read_ids
from cotton3dg.io.ply import read_gaussians, write_gaussians
from cotton3dg.options import ClusterOptions, SegmentOptions
from cotton3dg.schemas.bolls import read_bolls, read_lifted
from cotton3dg.segment import stage as segment
from cotton3dg.workspace import Workspace


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    return made_workspace(tmp_path)


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


def test_objects_join_by_dbscan_too(workspace):
    segment.run(workspace, SegmentOptions())
    summary = cluster.run(workspace, ClusterOptions(method="dbscan")).summary
    bolls, _ = read_bolls(workspace.bolls_json, workspace.labels_npy)
    pairs = match_bolls(np.array([boll.centre for boll in bolls]), CENTRES, 0.25 * RADIUS)
    # Distance alone does not tell touching bolls apart for certain, but the three others it must.
    assert {0, 1, 4} <= set(pairs[:, 1])
    assert 4 <= summary["bolls"] <= 6


def test_each_boll_gets_a_ply_on_request(workspace):
    segment.run(workspace, SegmentOptions())
    cluster.run(workspace, ClusterOptions(boll_plys=True))
    labels, gaussians = np.load(workspace.labels_npy), model()[0]
    for k in range(1, 6):
        assert np.array_equal(read_gaussians(workspace.boll_ply(k)).means, gaussians.means[labels == k])
    cluster.run(workspace, ClusterOptions())
    assert not workspace.boll_ply(1).exists()


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


def test_masks_of_other_images_are_noticed(workspace):
    """Names match, contents do not: as masks of another plant."""
    drawn = [read_ids(workspace.mask_png(f"{i:06d}.jpg")) for i in range(N_VIEWS)]
    rng = np.random.default_rng(0)
    write_masks(workspace, [np.roll(ids, rng.integers(0, 200, 2), (0, 1)) for ids in drawn])
    outcome = segment.run(workspace, SegmentOptions())
    assert outcome.flags == ("masks_misfit",)
    assert "named like its images" in outcome.warnings[0]


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
