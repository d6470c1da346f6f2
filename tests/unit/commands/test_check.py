# SPDX-License-Identifier: Apache-2.0
"""Where `check` works: beside a finished plant, so that nothing of it changes; with small stages."""

import shutil

import pytest
from scenes.small_stages import copying_stage, filmed_plant, replace_stages

from cotton3dg import pipeline
from cotton3dg.choices import Asked, choose
from cotton3dg.commands.check import _where_to_work


@pytest.fixture
def plant(tmp_path, monkeypatch):
    replace_stages(monkeypatch, copying_stage)
    return filmed_plant(tmp_path)


def contents(plant):
    return {path: path.read_bytes() for path in sorted(plant.root.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("change", ["nothing", "an option", "the film", "cleaned"])
def test_a_check_of_what_is_finished_works_elsewhere(plant, change):
    pipeline.run(plant, pipeline.stage_options(plant, "draft"))
    asked = Asked(values={"frames": {"count": 30}} if change == "an option" else {})
    if change == "the film":
        (plant.root / "video.mp4").write_text("another")
    elif change == "cleaned":
        shutil.rmtree(plant.folder("frames"))
    before = contents(plant)
    with _where_to_work(plant, choose(plant, asked).options) as place:
        steps = pipeline.plan(place, choose(plant, asked).options, ("frames", "sfm"))
        assert all(step.reason for step in steps) == (change != "nothing")
        pipeline.run(place, choose(plant, asked).options, ("frames", "sfm"))
        assert place.root.parent == plant.root
    assert contents(plant) == before
    assert not place.root.exists()


def test_run_goes_on_from_a_check_where_there_is_no_result_yet(plant):
    options = pipeline.stage_options(plant)
    pipeline.run(plant, options, ("frames",))
    with _where_to_work(plant, options) as place:
        assert place is plant
