# SPDX-License-Identifier: Apache-2.0
"""What could do harm is permitted by the person at the keyboard, never by a file that came with a plant."""

import json

import pytest

from cotton3dg.choices import Asked, choose
from cotton3dg.errors import BadUsage
from cotton3dg.option_rules import as_dict
from cotton3dg.options import STAGE_OPTIONS, resolve
from cotton3dg.schemas.record import Choices, Record
from cotton3dg.staleness import changed_options
from cotton3dg.workspace import Workspace

TRUSTING = {"backend": "yolo", "yolo": {"weights": "best.pt", "trust_weights": True}}


@pytest.fixture
def plant(tmp_path):
    (tmp_path / "field" / "plant_1").mkdir(parents=True)
    return Workspace(tmp_path / "field" / "plant_1")


@pytest.mark.parametrize("table", ["[masks.yolo]", "[masks]\nbackend = 'yolo'"])
@pytest.mark.parametrize("above", [False, True])
def test_no_file_trusts_weights(plant, table, above):
    folder = plant.root.parent if above else plant.root
    (folder / "cotton3dg.toml").write_text(f"{table}\ntrust_weights = true\n")
    with pytest.raises(BadUsage, match="cannot stand in a file; give --trust-weights to `cotton3dg masks`"):
        choose(plant)


def test_no_kept_choice_trusts_weights(plant):
    kept = {"preset": "", "values": {"masks": TRUSTING, "train": {"steps": 400}}}
    plant.choices_json.parent.mkdir(parents=True, exist_ok=True)
    Choices(**kept).save(plant.choices_json)
    assert json.loads(plant.choices_json.read_text())["values"]["masks"]["yolo"]["trust_weights"]
    chosen = choose(plant).options
    assert not chosen["masks"].yolo.trust_weights
    assert chosen["train"].steps == 400


def test_a_person_trusts_weights_and_nothing_keeps_it(plant):
    chosen = choose(plant, Asked(values={"masks": TRUSTING}))
    assert chosen.options["masks"].yolo.trust_weights
    assert "trust_weights" not in as_dict(chosen.options["masks"])
    assert "trust_weights" not in json.dumps(chosen.to_keep(STAGE_OPTIONS).values)


def test_a_result_is_not_stale_for_want_of_trust():
    trusting = resolve("masks", TRUSTING)
    record = Record("masks", options=as_dict(trusting) | {"trust_weights": True})
    assert not changed_options(record, resolve("masks", {"backend": "yolo", "yolo": {"weights": "best.pt"}}))
