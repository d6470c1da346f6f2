# SPDX-License-Identifier: Apache-2.0
"""Options: precedence, conversion, bounds and TOML."""

import pytest

from cotton3dg.choices import read_toml
from cotton3dg.cli.arguments import parse_overrides
from cotton3dg.errors import BadUsage
from cotton3dg.option_rules import as_dict, checked, flags, places
from cotton3dg.options import (
    PRESET_VALUES,
    STAGE_OPTIONS,
    ProbabilityOptions,
    ScaleOptions,
    TrainOptions,
    resolve,
)
from cotton3dg.recorded_options import recorded


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
        checked(stage, kind())
        for preset in PRESET_VALUES.values():
            resolve(stage, preset.get(stage, {}))
        for name, (place, explained) in flags(kind).items():
            alike = [other for other in places(kind) if other.name == name]
            assert explained and {(other.kind, other.item.default) for other in alike} == {
                (place.kind, place.item.default)
            }


def test_the_name_alone_is_the_option_of_the_chosen_method():
    options = resolve("segment", {"method": "probability", "steps": 9, "seed": 3})
    assert options.probability == ProbabilityOptions(steps=9, seed=3)
    assert options.affinity.seed == 0
    assert resolve("segment", {"seed": 4}, asked={"method": "affinity"}).affinity.seed == 4
    every = resolve("scale", asked={"method": "all", "marker_cm": 8.0, "distance_cm": 9.0})
    assert (every.aruco.marker_cm, every.distance.distance_cm) == (8.0, 9.0)


def test_the_table_of_a_method_waits_until_it_is_chosen(tmp_path):
    path = tmp_path / "cotton3dg.toml"
    path.write_text(
        "[segment.probability]\nthreshold = 0.9\n[segment.affinity]\nviews = 6\n"
        '[masks]\nviews = 12\n[masks.grounded-sam]\nprompt = "boll"\n[masks.import]\nsource = "drawn"\n'
    )
    tables = read_toml(path)
    waiting = resolve("segment", tables["segment"])
    assert as_dict(waiting) == as_dict(resolve("segment"))
    chosen = resolve("segment", tables["segment"], asked={"method": "probability"})
    assert chosen.probability.threshold == 0.9 and "threshold" in as_dict(chosen) and "features" not in as_dict(chosen)
    assert resolve("masks", tables["masks"], {"backend": "grounded-sam"}).grounded_sam.prompt == "boll"
    imported = resolve("masks", tables["masks"], asked={"backend": "import"})
    assert imported.imported.source == "drawn" and imported.views == 12
    assert as_dict(imported) == {"backend": "import", "source": "drawn", "classes": ""}


def test_the_command_line_can_name_the_method_too():
    asked = parse_overrides(["segment.method=probability", "segment.probability.threshold=0.9"])["segment"]
    assert resolve("segment", {"threshold": 0.8}, asked=asked).probability.threshold == 0.9


@pytest.mark.parametrize(
    "stage, layer, asked, words",
    [
        (
            "segment",
            {},
            {"threshold": "0.9"},
            r"with method = lint; choose method = probability, leave it out",
        ),
        ("segment", {"threshold": 0.9}, {}, r"keep it below \[segment\.probability\] in cotton3dg\.toml"),
        ("segment", {"method": "affinity", "steps": 3}, {}, r"segment\.steps has no effect with method = affinity"),
        ("segment", {}, {"probability.threshold": "0.9"}, r"segment\.probability\.threshold has no effect"),
        ("segment", {"seed": 1}, {}, r"choose method = probability or affinity"),
        ("masks", {}, {"classes": "boll"}, r"choose backend = import or yolo"),
        ("masks", {}, {"confidence": "0.1"}, r"choose backend = yolo or sam or grounded-sam"),
        (
            "masks",
            {"backend": "import"},
            {"views": 4},
            r"masks\.views has no effect .* import; leave it out",
        ),
        ("scale", {}, {"distance_cm": 12.0}, r"choose method = distance or all"),
        ("scale", {"method": "none"}, {"table_width_cm": 50.0}, r"has no effect with method = none; leave it out"),
        ("cluster", {"eps": 0.5}, {}, r"choose method = dbscan"),
    ],
)
def test_what_has_no_effect_is_refused_with_the_remedy(stage, layer, asked, words):
    with pytest.raises(BadUsage, match=words) as raised:
        resolve(stage, layer, asked=asked)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    "table, named",
    [
        ({"probability": {"stepz": 1}}, r"segment\.probability\.stepz is unknown"),
        ({"probability": {"features": 1}}, r"segment\.probability\.features is unknown"),
        ({"probability": {"steps": 0}}, r"segment\.probability\.steps = 0 is too small"),
        ({"probability": {"steps": "many"}}, r"segment\.probability\.steps = 'many'"),
        ({"target": {}}, r"segment\.target = {} cannot be used; give a whole number"),
        ({"probability": 3}, r"segment\.probability is unknown"),
        ({"lift": {"steps": 3}}, r"segment\.lift is unknown"),
        ({"method": {"probability": 3}}, r"segment\.method = .* cannot be used; give text"),
    ],
)
def test_a_table_is_checked_whether_its_method_is_chosen_or_not(table, named):
    with pytest.raises(BadUsage, match=named):
        resolve("segment", table)


def test_a_record_of_all_methods_is_read():
    old = {"method": "table", "table_length_cm": 90.0, "marker_cm": 3.0, "dictionary": "4x4_50", "distance_cm": 7.0}
    assert recorded("scale", old) == ScaleOptions(table_length_cm=90.0)
    for stage, kind in STAGE_OPTIONS.items():
        for method in places(kind)[0].item.metadata["choices"] or (None,):
            options = resolve(stage, {places(kind)[0].name: method} if method else {})
            assert recorded(stage, as_dict(options)) == options


def test_the_papers_presets_are_what_is_published():
    first, second = PRESET_VALUES["paper1"], PRESET_VALUES["paper2"]
    segment = resolve("segment", first["segment"])
    assert (segment.method, segment.probability.steps, segment.probability.threshold) == ("probability", 7000, 0.75)
    assert segment.probability.spacing == 1
    assert list(first) == ["segment"]  # the model is what it was
    assert resolve("frames", second["frames"]).count == 100
    train = resolve("train", second["train"])
    assert (train.steps, train.start, train.max_side, train.dssim) == (30_000, "points", 960, 0.2)
    assert resolve("masks", second["masks"]).views == 4
    affinity = resolve("segment", second["segment"]).affinity
    assert (affinity.views, affinity.features, affinity.feature_steps) == (4, 32, 10_000)
    dbscan = resolve("cluster", second["cluster"]).dbscan
    assert dbscan.min_samples == 10
    assert resolve("scale", second["scale"]).method == "sections"


def test_a_table_counts_as_measured_when_both_sides_were_given():
    assert (ScaleOptions().table_cm, ScaleOptions().table_is_assumed) == ((120.0, 60.0), True)
    usual = resolve("scale", asked={"table_length_cm": "120", "table_width_cm": "60"})
    assert (usual.table_cm, usual.table_is_assumed) == ((120.0, 60.0), False)
    turned = resolve("scale", {"table_length_cm": 50, "table_width_cm": 100})
    assert (turned.table_cm, turned.table_is_assumed) == ((100.0, 50.0), False)
    usual_then = {"method": "table", "table_length_cm": 120.0, "table_width_cm": 60.0}
    assert recorded("scale", usual_then, 10).table_is_assumed  # it was the default
    assert not recorded("scale", usual_then, 11).table_is_assumed
    one = resolve("scale", {"table_length_cm": 100})
    assert (one.table_cm, one.table_is_assumed) == ((100.0, 60.0), True)
    with pytest.raises(BadUsage, match="at least 10"):
        resolve("scale", {"table_length_cm": 1.2})  # metres
