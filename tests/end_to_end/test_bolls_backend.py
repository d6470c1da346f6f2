# SPDX-License-Identifier: Apache-2.0
"""Masks by a network of bolls that calls lint what is bright, and its training by the command."""

import json

import numpy as np
import pytest
import torch
from scenes.bright_network import bright_network
from scenes.imagenet_weights import published_weights
from scenes.lint_scene import BOLLS, room_model
from scenes.lint_workspace import make_workspace

from cotton3dg.cluster import stage as cluster
from cotton3dg.commands.masks_train import train
from cotton3dg.errors import BadInput, BadUsage, MissingInput
from cotton3dg.io.images import read_ids, write_image
from cotton3dg.io.onnx import read_constants
from cotton3dg.io.ply import write_gaussians
from cotton3dg.io.yolo_labels import write_yolo_labels
from cotton3dg.masks import stage as masks
from cotton3dg.masks.bolls import BollNetwork
from cotton3dg.masks.weight_files import FILE, PACKAGE
from cotton3dg.options import MasksTrainOptions, resolve
from cotton3dg.segment import stage as segment


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    workspace, truths = make_workspace(tmp_path_factory.mktemp("plant"), BOLLS)
    (workspace.root / "bright.onnx").write_bytes(bright_network(diameter_px=16))
    return workspace, truths


def test_masks_of_the_network_need_no_model_and_become_bolls_with_one(plant):
    workspace, _ = plant
    options = resolve("masks", {"backend": "bolls", "weights": "bright.onnx", "views": 8})
    outcome = masks.run(workspace, options)
    assert outcome.summary["images"] == 8 and outcome.summary["masks"] > 0
    document = json.loads(workspace.masks_json.read_text())
    assert document["backend"] == "bolls" and list(document["weights_sha256"]) == ["bright.onnx"]
    assert document["maps"] and len(list(workspace.folder("masks").glob("*.npz"))) == 8
    with workspace.writing("train") as folder:
        write_gaussians(folder / workspace.gaussians_ply.name, room_model())
    assert segment.run(workspace, resolve("segment")).summary["lint_gaussians"] > 0
    found = cluster.run(workspace, resolve("cluster")).summary["bolls"]
    assert 0 < found < outcome.summary["masks"]
    drawn = {n for image in document["images"] for n in np.unique(read_ids(workspace.boll_ids_png(image["name"])))}
    assert drawn - {0} <= set(range(1, found + 1)), "a boll has the same number in all images"
    with pytest.raises(BadUsage, match="segment --method lift"):
        cluster.run(workspace, resolve("cluster", {"method": "dbscan"}))
    maps = list(workspace.folder("masks").glob("*.npz"))
    for path in maps:
        path.rename(path.with_suffix(".gone"))
    with pytest.raises(BadInput, match="other masks"):
        cluster.run(workspace, resolve("cluster"))
    for path in maps:
        path.with_suffix(".gone").rename(path)
    segment.run(workspace, resolve("segment", {"method": "lift"}))
    assert not workspace.lint_share_npz.exists() and workspace.selections_npz.exists()


def test_bad_weights_name_the_remedy(plant):
    workspace, _ = plant
    (workspace.root / "text.onnx").write_text("no network")
    with pytest.raises(BadInput, match="masks-train made, or none"):
        masks.run(workspace, resolve("masks", {"backend": "bolls", "weights": "text.onnx"}))
    with pytest.raises(MissingInput, match="masks-train made, or none"):
        masks.run(workspace, resolve("masks", {"backend": "bolls", "weights": "none.onnx"}))


def test_annotations_teach_a_network(tmp_path):
    """Annotated photos make a network, judged on a photo that it did not learn from."""
    rng = np.random.default_rng(0)
    drawn = tmp_path / "drawn"
    for number in range(5):
        image = rng.integers(30, 90, (96, 128, 3)).astype(np.uint8)
        ids = np.zeros((96, 128), np.uint16)
        for boll in range(1, 4):
            y, x = rng.integers(0, 70), 40 * boll - 30
            ids[y : y + 24, x : x + 24] = boll
        image[ids > 0] = 150
        (drawn / "labels").mkdir(parents=True, exist_ok=True)
        write_image(drawn / f"{number}.jpg", image)
        write_yolo_labels(drawn / "labels" / f"{number}.txt", ids)
    (drawn / "classes.txt").write_text("boll\n")
    (tmp_path / "bright.onnx").write_bytes(bright_network(diameter_px=16))
    options = MasksTrainOptions(annotations=str(drawn), weights=str(tmp_path / "bright.onnx"), steps=3, batch=2)
    weights = train(tmp_path / "model", options)
    assert weights == tmp_path / "model" / "bolls.onnx"
    document = json.loads((tmp_path / "model" / "training.json").read_text())
    assert document["finished"] and list(document["sha256"]) == ["bolls.onnx"]
    assert sorted(document["images"].values()) == ["judges", *4 * ["trains"]]
    assert document["accuracy"]["photos"]["images"] == 1
    BollNetwork(weights.read_bytes(), "bolls.onnx")


def test_training_asks_for_something_to_learn_from(tmp_path):
    with pytest.raises(BadUsage, match="--scenes"):
        train(tmp_path / "model", MasksTrainOptions())


@pytest.fixture
def few_scenes(monkeypatch):
    """Scenes that are quickly made."""
    from cotton3dg.simulate import plates

    monkeypatch.setattr("cotton3dg.commands.masks_train.PLATES_A_SCENE", 2)
    monkeypatch.setattr("cotton3dg.commands.masks_train.JUDGING_SCENES", 1)
    monkeypatch.setattr("cotton3dg.commands.masks_train.JUDGING_PICTURES", 2)
    monkeypatch.setattr(
        "cotton3dg.commands.masks_train.paint_backgrounds", lambda seed: np.full((2, 96, 96, 3), seed % 256, np.uint8)
    )
    monkeypatch.setattr(plates, "HEMISPHERE_RAYS", 4)


def test_simulated_scenes_teach_a_network_from_nothing(tmp_path, few_scenes):
    options = MasksTrainOptions(scenes=1, steps=2, batch=1, weights="none")
    weights = train(tmp_path / "model", options)
    accuracy = json.loads((tmp_path / "model" / "training.json").read_text())["accuracy"]
    assert accuracy["simulated"]["images"] == 2 and accuracy["photos"]["images"] == 0
    assert len(list((tmp_path / "model" / "scenes").glob("*/light.npy"))) == 2
    assert weights.stat().st_size < 10e6


def test_a_new_network_begins_with_weights_from_imagenet_or_says_how_to_get_them(tmp_path, few_scenes, monkeypatch):
    package = tmp_path / "site" / PACKAGE
    (package / FILE).parent.mkdir(parents=True)
    (package / "__init__.py").touch()
    torch.save(published_weights(), package / FILE)
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    options = MasksTrainOptions(scenes=1, steps=1, batch=1)
    constants = read_constants(train(tmp_path / "model", options).read_bytes(), "bolls.onnx")
    published = published_weights()
    scale = published["_bn0.weight"] / torch.sqrt(published["_bn0.running_var"] + 1e-3) / 128
    stem = (published["_conv_stem.weight"] * scale[:, None, None, None]).numpy()
    np.testing.assert_allclose(constants["stem.w"], stem, rtol=2e-3, atol=1e-6)
    monkeypatch.setattr("cotton3dg.masks.weight_files.PACKAGE", "no_such_package")
    with pytest.raises(BadUsage, match=r"cotton3dg\[training\].*--weights none"):
        train(tmp_path / "other", options)
    assert not (tmp_path / "other" / "scenes").exists(), "it says so before it renders anything"
