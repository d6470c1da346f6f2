# SPDX-License-Identifier: Apache-2.0
"""A model trained elsewhere, end to end: our own, as each program would hand it over, gives the same traits."""

import shutil

import numpy as np
import pytest
from scenes.finished_scene import finished_workspace
from scenes.foreign_plys import ORDERS, in_nerfstudios_frame, write_as, write_transforms
from scipy.spatial.transform import Rotation

from cotton3dg.cluster import stage as cluster
from cotton3dg.io.ply import read_gaussians
from cotton3dg.io.tables import parse_number, read_rows
from cotton3dg.options import resolve
from cotton3dg.schemas.train import TrainMetrics
from cotton3dg.segment import stage as segment
from cotton3dg.train import stage as train
from cotton3dg.traits import stage as traits
from cotton3dg.workspace import Workspace

TRAITS = ("boll_count", "boll_volume_cm3", "plant_height_cm", "canopy_size_cm", "boll_volume_published_cm3")


@pytest.fixture(scope="module")
def plant(tmp_path_factory) -> Workspace:
    return finished_workspace(tmp_path_factory.mktemp("foreign") / "plant")


@pytest.fixture(scope="module")
def own_traits(plant) -> list[float]:
    """Of the model as our own training left it."""
    shutil.copy(plant.gaussians_ply, plant.root / "own.ply")
    run_with(plant, model="own.ply")
    assert read_gaussians(plant.gaussians_ply).sha256() == read_gaussians(plant.root / "own.ply").sha256()
    return measured(plant)


def measured(workspace: Workspace) -> list[float]:
    (row,) = read_rows(workspace.traits_csv)
    return [parse_number(row[trait]) for trait in TRAITS]


def run_with(workspace: Workspace, **options: object) -> tuple[str, ...]:
    outcome = train.run(workspace, resolve("train", {"exposure": "off", **options}))
    for stage in (segment, cluster, traits):
        stage.run(workspace, resolve(stage.STAGE.name))
    return outcome.flags


@pytest.mark.parametrize("tool", ORDERS)
def test_our_own_model_handed_over_by_each_program_has_the_same_traits(plant, own_traits, tool):
    model = read_gaussians(plant.root / "own.ply")
    path = plant.root / f"{tool}.ply"
    turn, shift, scale = Rotation.random(rng=7).as_matrix(), np.array([0.4, -1.0, 2.0]), 0.21
    options = {"model": path.name}
    if tool == "nerfstudio":
        write_as(tool, path, in_nerfstudios_frame(model, turn, shift, scale))
        write_transforms(plant.root / "dataparser_transforms.json", turn, shift, scale)
        options["transforms"] = "dataparser_transforms.json"
    else:
        write_as(tool, path, model)
    assert run_with(plant, **options) == ()
    assert measured(plant) == pytest.approx(own_traits, rel=1e-3)
    metrics = TrainMetrics.load(plant.metrics_json)
    assert metrics.steps == 0 and metrics.psnr_db > 35


def test_a_model_in_a_frame_of_its_own_is_doubted(plant, own_traits):
    model = read_gaussians(plant.root / "own.ply")
    write_as("nerfstudio", plant.root / "lost.ply", in_nerfstudios_frame(model, np.eye(3), np.array([3.0, 0, 0]), 0.2))
    outcome = train.run(plant, resolve("train", {"exposure": "off", "model": "lost.ply"}))
    assert "low_psnr" in outcome.flags
    assert any("--transforms" in warning for warning in outcome.warnings)
