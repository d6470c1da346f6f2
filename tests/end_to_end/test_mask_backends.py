# SPDX-License-Identifier: Apache-2.0
"""The stage masks with networks, and the commands that export masks and train on them."""

import json
from pathlib import Path

import numpy as np
import pytest
from scenes import torchvision_stand_in
from scenes.lint_scene import BOLLS
from scenes.lint_workspace import make_workspace
from scenes.onnx_scene import SIDE, write_bright_cells

from cotton3dg.commands.masks_export import export
from cotton3dg.commands.masks_train import train
from cotton3dg.errors import BadInput, BadUsage, MissingInput
from cotton3dg.io.annotations import read_masks
from cotton3dg.io.images import read_ids, write_ids
from cotton3dg.io.saving import file_sha256
from cotton3dg.masks import stage as masks
from cotton3dg.options import MasksOptions, MasksTrainOptions, resolve
from cotton3dg.workspace import Workspace


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    return make_workspace(tmp_path_factory.mktemp("plant"), BOLLS)


def written(workspace: Workspace) -> dict:
    document = json.loads(workspace.masks_json.read_text())
    for image in document["images"]:
        ids = read_ids(workspace.mask_png(image["name"]))
        assert image["instances"] == len(np.unique(ids[ids > 0])) == len(image["scores"])
    return document


def test_an_onnx_network_needs_no_extra(plant, tmp_path: Path) -> None:
    workspace, _ = plant
    weights = write_bright_cells(tmp_path / "cells.onnx")
    options = resolve(
        "masks",
        {"backend": "yolo", "weights": str(weights), "image_size": SIDE, "tile": 96, "confidence": 0.3, "views": 4},
    )
    outcome = masks.run(workspace, options)
    document = written(workspace)
    assert outcome.summary["images"] == 4 and outcome.summary["masks"] > 0
    assert document["backend"] == "yolo" and document["seconds_per_image"] > 0
    assert document["weights_sha256"] == {"cells.onnx": file_sha256(weights)}
    assert outcome.warnings == () and outcome.flags == ()


def test_weights_beside_the_plant_are_found_by_their_name(plant) -> None:
    workspace, _ = plant
    write_bright_cells(workspace.root / "cells.onnx")
    options = resolve(
        "masks", {"backend": "yolo", "weights": "cells.onnx", "image_size": SIDE, "confidence": 1.0, "views": 2}
    )
    outcome = masks.run(workspace, options)
    assert outcome.flags == ("no_masks",) and "--confidence" in outcome.warnings[0]


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"backend": "yolo"}, BadUsage, "--weights"),
        ({"backend": "sam"}, BadUsage, "--weights"),
        ({"backend": "grounded-sam"}, BadUsage, "--detector"),
        ({"backend": "grounded-sam", "prompt": " "}, BadUsage, "--prompt is empty"),
        ({"backend": "yolo", "weights": "absent.onnx"}, MissingInput, "absent.onnx"),
        ({"backend": "yolo", "weights": "cells.onnx", "classes": "boll"}, BadUsage, "no class 'boll'"),
        ({"backend": "yolo", "weights": "cells.onnx", "classes": "7"}, BadInput, "no class 7"),
    ],
)
def test_what_cannot_work_is_told_in_one_line(plant, options: dict, error: type, words: str) -> None:
    workspace, _ = plant
    write_bright_cells(workspace.root / "cells.onnx")
    with pytest.raises(error, match=words) as raised:
        masks.run(workspace, resolve("masks", {"yolo": {"image_size": SIDE}} | options))
    assert "\n" not in str(raised.value)


def test_exported_masks_come_back_by_import(plant, tmp_path: Path) -> None:
    workspace, truths = plant
    before = {name: truths[name] for name in list(truths)[::6]}
    for name, ids in before.items():
        write_ids(tmp_path / f"{Path(name).stem}.png", ids)
    masks.run(workspace, resolve("masks", {"backend": "import", "source": str(tmp_path)}))
    coco = export(workspace)
    assert len(list((coco.parent / "images").glob("*.jpg"))) == 4
    outcome = masks.run(workspace, resolve("masks", {"backend": "import", "source": "annotations"}))
    assert outcome.summary["images"] == 4
    for name, ids in before.items():
        found = read_ids(workspace.mask_png(name)) > 0
        assert (found & (ids > 0)).sum() / (found | (ids > 0)).sum() > 0.9
    assert read_masks(coco).ids.keys() == {Path(name).stem for name in before}


def test_imported_images_without_masks_are_told(plant) -> None:
    workspace, _ = plant
    masks.run(workspace, MasksOptions(views=4))
    document = json.loads(export(workspace).read_text())
    first = document["images"][0]
    document["annotations"] = [item for item in document["annotations"] if item["image_id"] != first["id"]]
    (workspace.root / "edited.json").write_text(json.dumps(document))
    outcome = masks.run(workspace, resolve("masks", {"backend": "import", "source": "edited.json"}))
    assert (
        outcome.warnings[0].startswith("1 of 4 imported images have no mask")
        and first["file_name"] in outcome.warnings[0]
    )


def test_training_says_what_it_lacks(tmp_path: Path) -> None:
    for options, words in (
        ({}, "--annotations"),
        ({"annotations": str(tmp_path / "absent")}, "absent"),
    ):
        with pytest.raises((BadUsage, MissingInput), match=words):
            train(tmp_path / "model", MasksTrainOptions(**options))
    (tmp_path / "thesis.txt").write_text("x")
    with pytest.raises(BadUsage, match="not empty"):
        train(tmp_path, MasksTrainOptions(annotations="x"))


@pytest.mark.parametrize("kind", ["sam", "sam2"])
def test_sam_with_prompts_of_bolls_and_of_a_table(plant, tmp_path: Path, kind: str) -> None:
    pytest.importorskip("transformers")
    from scenes.transformer_scene import save

    workspace, _ = plant
    save(tmp_path / kind, kind)
    options = {"backend": "sam", "weights": str(tmp_path / kind), "confidence": 0.0}
    assert masks.run(workspace, resolve("masks", {"views": 4, **options})).summary["images"] == 4
    assert written(workspace)["weights_sha256"].keys() == {f"{kind}/model.safetensors"}
    table = tmp_path / "clicks.csv"
    table.write_text("image,x,y\n000004,200,120\n000004,300,130\n000009,220,100\n")
    assert masks.run(workspace, resolve("masks", {"prompts": str(table), **options})).summary["images"] == 2
    table.write_text("image,x,y\n000004,900,120\n")
    with pytest.raises(BadInput, match="outside of its 480 x 270"):
        masks.run(workspace, resolve("masks", {"prompts": str(table), **options}))
    table.write_text("image,x,y\nIMG_7,9,1\n")
    with pytest.raises(BadInput, match="IMG_7"):
        masks.run(workspace, resolve("masks", {"prompts": str(table), **options}))


def test_a_text_finds_boxes_that_prompt_sam(plant, tmp_path: Path) -> None:
    pytest.importorskip("transformers")
    from scenes.transformer_scene import save

    workspace, _ = plant
    options = resolve(
        "masks",
        {
            "backend": "grounded-sam",
            "weights": str(save(tmp_path / "sam", "sam")),
            "detector": str(save(tmp_path / "dino", "grounding-dino")),
            "text_confidence": 0.0,
            "confidence": 0.0,
            "views": 2,
        },
    )
    assert masks.run(workspace, options).summary["images"] == 2
    assert len(written(workspace)["weights_sha256"]) == 2


@pytest.mark.slow
def test_yolo_is_trained_exported_and_used_with_and_without_ultralytics(plant, tmp_path: Path) -> None:
    pytest.importorskip("ultralytics")
    torchvision_stand_in.provide()
    workspace, _ = plant
    masks.run(workspace, MasksOptions(views=6))
    export(workspace)
    model = tmp_path / "model"
    options = MasksTrainOptions(
        network="yolo",
        annotations=str(workspace.root / "annotations"),
        weights="yolo11n-seg.yaml",
        image_size=160,
        epochs=1,
        batch=4,
    )
    best = train(model, options)
    document = json.loads((model / "training.json").read_text())
    assert document["finished"] and sorted(document["images"].values()).count("judges") == 1
    answers = {}
    for name in ("best.pt", "best.onnx"):
        given = resolve(
            "masks",
            {
                "backend": "yolo",
                "weights": str(best.with_name(name)),
                "trust_weights": name.endswith(".pt"),
                "image_size": 160,
                "confidence": 0.0,
                "nms_iou": 0.2,
                "views": 2,
            },
        )
        outcome = masks.run(workspace, given)
        answers[name] = {
            image["name"]: read_ids(workspace.mask_png(image["name"])) for image in written(workspace)["images"]
        }
        assert any("AGPL-3.0" in warning for warning in outcome.warnings) == name.endswith(".pt")
    for name, ids in answers["best.pt"].items():
        other = answers["best.onnx"][name]
        assert ((ids > 0) & (other > 0)).sum() >= 0.9 * ((ids > 0) | (other > 0)).sum()
