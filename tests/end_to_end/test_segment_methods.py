# SPDX-License-Identifier: Apache-2.0
"""The seed papers' methods of the stage segment on a workspace made here, on to the bolls."""

import json
from pathlib import Path

import numpy as np
import pytest
from scenes.boll_scene import CENTRES, N_VIEWS, RADIUS, cameras, made_workspace, masks_of, model, write_masks

from cotton3dg.cluster import stage as cluster
from cotton3dg.errors import BadInput
from cotton3dg.evaluation.match import match_bolls
from cotton3dg.io.images import read_image
from cotton3dg.io.ply import read_gaussians
from cotton3dg.options import ClusterOptions, resolve
from cotton3dg.schemas.bolls import read_bolls
from cotton3dg.segment import stage as segment
from cotton3dg.workspace import Workspace

QUICK = {
    "probability": resolve("segment", {"method": "probability", "steps": 1500, "spacing": 2}),
    "affinity": resolve("segment", {"method": "affinity", "feature_steps": 150}),
}


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    return made_workspace(tmp_path)


def found(workspace: Workspace) -> set[int]:
    """The true bolls that were found."""
    bolls, _ = read_bolls(workspace.bolls_json, workspace.labels_npy)
    return set(match_bolls(np.array([boll.centre for boll in bolls]), CENTRES, 0.25 * RADIUS)[:, 1])


def test_probabilities_become_bolls(workspace):
    outcome = segment.run(workspace, QUICK["probability"])
    assert outcome.flags == ()
    probabilities, truth = np.load(workspace.probabilities_npy), model()[1]
    assert probabilities.shape == truth.shape and probabilities.dtype == np.float32
    assert np.median(probabilities[truth > 0]) > 0.8 and np.median(probabilities[truth == 0]) < 0.5
    report = json.loads(workspace.segment_json.read_text())
    (row,) = report["by_steps"]
    assert row["steps"] == 1500 and row["seconds"] > 0
    assert row["mbiou"]["0.7"] > 0.65 and list(row["mbiou"]) == ["0.7", "0.75", "0.8", "0.9"]
    assert report["vote"]["mbiou"]["0.7"] > 0.5 and row["mbiou_held_out"]["0.7"] > 0.6
    maps = sorted(workspace.folder("segment").glob("probability_*.png"))
    assert len(maps) == 4 and read_image(maps[0]).shape == (200, 240, 3)
    assert read_image(maps[0]).max() > 200
    assert len(read_gaussians(workspace.lint_ply)) == (probabilities > 0.75).sum()
    for kind in ("training", "lint"):
        assert len(list(workspace.folder("segment").glob(f"{kind}_*.jpg"))) == 4
    for method in ("consensus", "dbscan"):
        cluster.run(workspace, ClusterOptions(method=method))
        assert {0, 1, 4} <= found(workspace)


def test_features_become_bolls(workspace):
    outcome = segment.run(workspace, QUICK["affinity"])
    assert outcome.flags == () and outcome.summary["views"] == 4
    report = json.loads(workspace.segment_json.read_text())
    # One of the four views may be that without masks.
    assert report["sets"] == outcome.summary["masks"] >= 13
    assert report["loss"][-1] < 0.8 * report["loss"][0]
    features, truth = np.load(workspace.features_npy), model()[1]
    assert features.shape == (len(truth), 16) and features.dtype == np.float32 and np.isfinite(features).all()
    # Alike within a boll and unlike between bolls, as far as so few steps go.
    means = np.stack([features[truth == boll].mean(axis=0) for boll in (1, 2, 5)])
    means /= np.linalg.norm(means, axis=1, keepdims=True)
    within = np.mean([(features[truth == boll] @ means[k]).mean() for k, boll in enumerate((1, 2, 5))])
    between = np.mean([(features[truth == boll] @ means[k - 1]).mean() for k, boll in enumerate((1, 2, 5))])
    assert within > between + 0.2
    cluster.run(workspace, ClusterOptions(method="dbscan"))
    assert {0, 1, 4} <= found(workspace)
    six = segment.run(workspace, resolve("segment", {"method": "affinity", "feature_steps": 2, "views": 6}))
    assert six.summary["views"] == 6


@pytest.mark.parametrize("method", QUICK)
def test_flipped_labels_in_some_views_do_no_harm(workspace, method):
    """Two of twelve views say boll where there is none and none where there is one."""
    gaussians, bolls = model()
    masks = masks_of(gaussians, bolls, cameras())
    for k in (2, 7):
        masks[k] = (masks[k] == 0).astype(np.uint16)
    write_masks(workspace, masks)
    segment.run(workspace, QUICK[method])
    cluster.run(workspace, ClusterOptions(method="dbscan"))
    assert {0, 1, 4} <= found(workspace)


def test_a_single_target(workspace):
    gaussians, bolls = model()
    write_masks(workspace, masks_of(gaussians, bolls, cameras()))
    segment.run(workspace, resolve("segment", {"method": "probability", "steps": 1500, "spacing": 2, "target": 2}))
    assert json.loads(workspace.segment_json.read_text())["by_steps"][0]["mbiou"]["0.7"] > 0.7
    assert cluster.run(workspace, ClusterOptions()).summary["bolls"] == 1
    assert found(workspace) == {1}


@pytest.mark.parametrize("method", QUICK)
def test_the_same_masks_give_the_same_selections(workspace, method):
    digests = []
    for _ in range(2):
        segment.run(workspace, QUICK[method])
        digests.append(workspace.hashes(workspace.selections_npz))
    assert digests[0] == digests[1]


@pytest.mark.parametrize("method", QUICK)
@pytest.mark.parametrize("value", [0, 1])
def test_empty_and_full_masks(workspace, method, value):
    """Nothing is an answer, and masks that are all boll make no boll of the rest."""
    write_masks(workspace, [np.full((200, 240), value, np.uint16)] * N_VIEWS)
    outcome = segment.run(workspace, QUICK[method])
    bolls = cluster.run(workspace, ClusterOptions()).summary["bolls"]
    assert bolls <= 1
    if not value:
        assert outcome.flags == ("no_bolls",) and bolls == 0
    assert "NaN" not in workspace.segment_json.read_text()


@pytest.mark.parametrize("method", QUICK)
def test_no_masks_and_wrong_masks(workspace, method):
    write_masks(workspace, [np.zeros((100, 240), np.uint16)] * N_VIEWS)
    with pytest.raises(BadInput, match="240x100"):
        segment.run(workspace, QUICK[method])
    for png in workspace.folder("masks").glob("*.png"):
        png.unlink()
    assert segment.run(workspace, QUICK[method]).flags == ("no_bolls",)
