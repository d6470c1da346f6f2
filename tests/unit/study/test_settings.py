# SPDX-License-Identifier: Apache-2.0
"""Settings of a study: which there are, and what the footage does not allow."""

import pytest
from scenes.small_stages import filmed_plant

from cotton3dg.errors import BadUsage
from cotton3dg.stage import Footage
from cotton3dg.study.settings import settings_of, sweeps_of

VIDEO = Footage(120, 1280, 720)


@pytest.fixture
def plant(tmp_path):
    return filmed_plant(tmp_path)


def test_settings_name_what_the_footage_does_not_allow(plant):
    def obstacles(sweep, source=VIDEO):
        return {item.value: item.obstacle for item in settings_of(sweep, plant, "draft", {}, source) if item.obstacle}

    assert set(obstacles("images")) == {"150", "200", "250", "300"}
    assert obstacles("views") == {"72": "only 60 images are taken"}
    assert set(obstacles("resolution", Footage(120, 400, 300))) == {"960"}
    assert obstacles("style", Footage(80, 1280, 720, is_video=False)) == {"partial": "only a video can be cropped"}


def test_values_are_ordered_and_checked(plant):
    values = [item.value for item in settings_of("gaussians", plant, "draft", {}, VIDEO, ["90000", "500"])]
    assert values == ["500", "60000", "90000"]
    with pytest.raises(BadUsage, match="sh_degree"):
        settings_of("sh", plant, "draft", {}, VIDEO, ["7"])
    with pytest.raises(BadUsage, match="unknown"):
        sweeps_of(["colour"])
    assert list(sweeps_of(["all"]))[:4] == ["resolution", "steps", "schedule", "images"]


def test_presets_with_other_methods_are_tried_when_they_are_named(plant):
    usual = [item.value for item in settings_of("preset", plant, "draft", {}, VIDEO)]
    assert usual == ["draft", "standard", "paper"]
    named = settings_of("preset", plant, "standard", {}, VIDEO, ("paper1", "paper2"))
    assert [item.value for item in named] == ["paper1", "paper2", "standard"]
    assert named[1].options["segment"].method == "affinity" and named[1].options["cluster"].method == "dbscan"


def test_affinity_is_clustered_as_published_unless_another_way_is_asked_for(plant):
    pairs = {item.value: item.options["cluster"].method for item in settings_of("method", plant, "draft", {}, VIDEO)}
    assert pairs == {"lint": "votes", "lift": "votes", "probability": "votes", "affinity": "dbscan"}
    asked = settings_of("method", plant, "draft", {"cluster": {"method": "consensus"}}, VIDEO)
    assert {item.options["cluster"].method for item in asked} == {"consensus"}


def test_a_plant_filmed_close_by_takes_the_place_of_a_crop(plant):
    assert [item.value for item in settings_of("style", plant, "draft", {}, VIDEO)] == ["partial", "whole"]
    near, whole = settings_of("style", plant, "draft", {}, VIDEO, local=True)
    assert (near.value, near.partial, near.obstacle) == ("local", True, "") and whole.is_base


def test_large_images_are_trained_on_at_their_size_or_refused(plant):
    """A row of 3840 px of a 4K video takes frames of 3840 px; of a smaller video there is no such row."""
    (*_, row) = settings_of("resolution", plant, "draft", {}, Footage(120, 3840, 2160), ("3840",))
    assert (row.options["frames"].max_side, row.options["train"].max_side, row.obstacle) == (3840, 3840, "")
    (*_, row) = settings_of("resolution", plant, "draft", {}, Footage(120, 2560, 1440), ("3840",))
    assert row.obstacle == "the images have only 2560 px"
    (*_, row) = settings_of("resolution", plant, "draft", {}, Footage(120, 3840, 2160), ("1280",))
    assert row.options["frames"].max_side == 1920
