# SPDX-License-Identifier: Apache-2.0
"""`run --repeat`: other frames, another seed, and what the runs say of each other."""

import json

from scenes.tiny_plant import in_shell

from cotton3dg.io.tables import read_rows
from cotton3dg.schemas.frames import FramesInfo


def test_other_runs_of_a_film_are_laid_beside_it(tiny_plant, tmp_path):
    row = tiny_plant.traits_csv.read_bytes()
    done = in_shell("cotton3dg", "run", tiny_plant.root, "--repeat", "1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert tiny_plant.traits_csv.read_bytes() == row
    again = tiny_plant.repeat_run(1)
    taken, others = (FramesInfo.load(run.frames_json).images for run in (tiny_plant, again))
    assert len(others) == len(taken) - 1
    assert {image.source_index for image in others} != {image.source_index for image in taken}
    seeds = [json.loads(run.record_file("train").read_text())["options"]["seed"] for run in (tiny_plant, again)]
    assert seeds[1] == seeds[0] + 1
    by_trait = {row["trait"]: row for row in read_rows(tiny_plant.repeats / "repeat_traits.csv")}
    heights = [float(read_rows(run.traits_csv)[0]["plant_height_cm"]) for run in (tiny_plant, again)]
    assert abs(float(by_trait["plant_height_cm"]["mean"]) - sum(heights) / 2) < 0.01
    assert "saved in" in done.stdout

    done = in_shell("cotton3dg", "run", tiny_plant.root, "--repeat", "1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "starts" not in done.stderr


def test_repeat_is_for_whole_runs(tiny_plant, tmp_path):
    done = in_shell("cotton3dg", "run", tiny_plant.root, "--repeat", "1", "--until", "sfm", cwd=tmp_path)
    assert done.returncode == 2
    assert "--repeat is for whole runs" in done.stderr
