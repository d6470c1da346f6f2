# SPDX-License-Identifier: Apache-2.0
"""The stage masks on a workspace made here: white balls in a room with a white wall and posters."""

import json
from pathlib import Path

import numpy as np
import pytest
from scenes.lint_scene import BOLLS
from scenes.lint_workspace import make_workspace
from scenes.onnx_scene import SIDE, write_bright_cells

from cotton3dg.errors import BadInput, MissingInput
from cotton3dg.io.images import read_ids, write_ids
from cotton3dg.masks import stage as masks
from cotton3dg.masks.bolls import SHIPPED_FILE
from cotton3dg.options import MasksOptions, resolve
from cotton3dg.workspace import Workspace


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    return make_workspace(tmp_path_factory.mktemp("plant"), BOLLS)


def test_masks_of_evenly_spaced_views(plant) -> None:
    workspace, truths = plant
    weights = write_bright_cells(workspace.root / "cells.onnx")
    options = {"backend": "yolo", "weights": str(weights), "image_size": SIDE, "confidence": 0.3, "views": 16}
    outcome = masks.run(workspace, resolve("masks", options))
    document = json.loads(workspace.masks_json.read_text())
    names = [image["name"] for image in document["images"]]
    assert len(names) == 16 == outcome.summary["images"]
    assert len(list(workspace.folder("masks").glob("*.png"))) == 16
    assert document["backend"] == "yolo" and document["options"]["views"] == 16
    assert not outcome.flags
    for image in document["images"]:
        ids = read_ids(workspace.mask_png(image["name"]))
        assert ids.shape == truths[image["name"]].shape
        assert image["instances"] == len(np.unique(ids[ids > 0])) == len(image["scores"])
    assert outcome.summary["masks"] == sum(image["instances"] for image in document["images"]) > 0


@pytest.mark.parametrize(
    ("options", "shipped"),
    [
        ({}, True),
        ({"weights": "own.onnx"}, False),
        ({"backend": "sam", "weights": "."}, True),
        ({"backend": "sam", "weights": ".", "prompts": "."}, False),
        ({"backend": "import"}, False),
    ],
)
def test_masks_depend_on_the_network_that_finds_bolls_and_not_on_the_model(plant, options: dict, shipped: bool) -> None:
    workspace, _ = plant
    read = masks.STAGE.reads(workspace, resolve("masks", options))
    assert (SHIPPED_FILE in read) == shipped
    assert workspace.gaussians_ply not in read


def test_a_plant_without_open_bolls_is_told_not_failed(tmp_path: Path) -> None:
    workspace, _ = make_workspace(tmp_path, np.zeros((0, 3)))
    outcome = masks.run(workspace, MasksOptions(views=6))
    assert outcome.flags == ("no_masks",)
    assert outcome.summary["masks"] == 0 and outcome.summary["images"] == 6
    assert "--backend import" in outcome.warnings[0]
    assert not any(read_ids(path).any() for path in workspace.folder("masks").glob("*.png"))


def test_imported_masks_are_kept_as_they_are(plant, tmp_path: Path) -> None:
    workspace, truths = plant
    for name in list(truths)[:3]:
        write_ids(tmp_path / f"{Path(name).stem}.png", truths[name])
    outcome = masks.run(workspace, resolve("masks", {"backend": "import", "source": str(tmp_path)}))
    assert outcome.summary["images"] == 3
    assert len(list(workspace.folder("masks").glob("*.png"))) == 3
    for name in list(truths)[:3]:
        np.testing.assert_array_equal(read_ids(workspace.mask_png(name)), truths[name])


def test_white_masks_are_said_and_names_of_exports_are_understood(plant, tmp_path: Path) -> None:
    """One boll, 1 (1 to 1), and no flag, was the answer to white masks."""
    workspace, truths = plant
    for name in list(truths)[:2]:
        white = np.where(truths[name] > 0, np.uint16(255), np.uint16(0))
        write_ids(tmp_path / f"{Path(name).stem}_jpg.rf.0c2d9a.png", white)
    outcome = masks.run(workspace, resolve("masks", {"backend": "import", "source": str(tmp_path)}))
    assert outcome.summary["images"] == 2
    assert outcome.summary["masks"] > 2
    assert "each connected piece counts as a boll" in outcome.warnings[0]
    write_ids(tmp_path / f"{Path(name).stem}_jpg.rf.ffff.png", white)
    with pytest.raises(BadInput, match="several versions of an image"):
        masks.run(workspace, resolve("masks", {"backend": "import", "source": str(tmp_path)}))


def test_own_masks_in_the_plant_folder_need_no_option_and_count_as_input(plant) -> None:
    workspace, truths = plant
    workspace.masks_input.mkdir()
    name = next(iter(truths))
    write_ids(workspace.masks_input / f"{Path(name).stem}.png", truths[name])
    outcome = masks.run(workspace, MasksOptions(backend="import"))
    assert outcome.summary["images"] == 1
    assert "only one image has masks" in outcome.warnings[0]
    assert any("own_masks" in path for path in workspace.hashes(*masks.inputs(workspace)))


def test_masks_of_unknown_images_are_refused_and_the_old_result_stays(plant, tmp_path: Path) -> None:
    workspace, truths = plant
    name, ids = next(iter(truths.items()))
    write_ids(tmp_path / f"{Path(name).stem}.png", ids)
    options = resolve("masks", {"backend": "import", "source": str(tmp_path)})
    masks.run(workspace, options)
    before = workspace.masks_json.read_bytes()
    write_ids(tmp_path / "IMG_77.png", ids)
    with pytest.raises(BadInput, match="IMG_77"):
        masks.run(workspace, options)
    assert workspace.masks_json.read_bytes() == before


def test_without_sfm_the_user_is_told_to_run_it(tmp_path: Path) -> None:
    with pytest.raises(MissingInput, match="cotton3dg sfm"):
        masks.run(Workspace(tmp_path), MasksOptions())
