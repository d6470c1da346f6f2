"""Options: precedence, conversion, bounds and TOML."""

from dataclasses import fields

import pytest

from cotton3dg.errors import BadUsage
from cotton3dg.options import PRESET_VALUES, STAGE_OPTIONS, TrainOptions, checked, help_text, read_toml, resolve


def test_later_layers_win():
    assert resolve("train", {"steps": 10, "seed": 3}, {"steps": 20}) == TrainOptions(steps=20, seed=3)


def test_strings_from_the_command_line_are_parsed():
    options = resolve("scale", {"table_length_cm": "90.5", "require_scale": "true"})
    assert options.table_length_cm == 90.5
    assert options.require_scale is True


@pytest.mark.parametrize(
    "stage, values, named",
    [
        ("train", {"stepz": 1}, "train.stepz"),
        ("train", {"steps": 0}, "train.steps"),
        ("train", {"steps": "many"}, "train.steps"),
        ("train", {"steps": 1.5}, "train.steps"),
        ("train", {"steps": True}, "train.steps"),
        ("train", {"dssim": float("nan")}, "train.dssim"),
        ("masks", {"backend": "magic"}, "masks.backend"),
        ("scale", {"require_scale": "perhaps"}, "scale.require_scale"),
    ],
)
def test_bad_values_are_refused_by_name(stage, values, named):
    with pytest.raises(BadUsage, match=named):
        resolve(stage, values)


@pytest.mark.parametrize("text", ["[train\n", "train = 3\n", "[trian]\nsteps = 3\n", "\xff"])
def test_bad_toml_is_refused(tmp_path, text):
    path = tmp_path / "cotton3dg.toml"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(BadUsage, match=r"cotton3dg\.toml"):
        read_toml(path)


def test_toml_is_read(tmp_path):
    path = tmp_path / "cotton3dg.toml"
    assert read_toml(path) == {}
    path.write_text("[scale]\ntable_length_cm = 100\n")
    assert resolve("scale", read_toml(path)["scale"]).table_length_cm == 100.0


def test_every_default_and_preset_keeps_its_own_rules():
    for stage, kind in STAGE_OPTIONS.items():
        checked(kind())
        for preset in PRESET_VALUES.values():
            resolve(stage, preset.get(stage, {}))
        assert all(help_text(item) for item in fields(kind))
