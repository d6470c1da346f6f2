# SPDX-License-Identifier: Apache-2.0
"""Evaluation against figures that were computed by hand."""

import json

import numpy as np
import pytest

from cotton3dg.errors import BadInput, MissingInput
from cotton3dg.evaluation.plant import compare_bolls, evaluate
from cotton3dg.workspace import Workspace

TRUE_CM = np.array([[10.0, 0, 30], [-5, 8, 40], [0, 0, 50], [3, -9, 20]])
TRUE_CM3 = np.array([20.0, 30, 40, 50])


@pytest.mark.parametrize("turn", [(1, 1, 1), (-1, -1, 1)])
def test_bolls_match_in_either_direction_of_x(turn):
    measured = (TRUE_CM[:3] + (0, 0, 1)) * turn
    found = compare_bolls(measured, 1.1 * TRUE_CM3[:3], TRUE_CM, TRUE_CM3)
    assert (found.n_matched, found.n_true, found.n_measured) == (3, 4, 3)
    assert found.median_distance_cm == pytest.approx(1.0)
    assert found.median_volume_error_pct == pytest.approx(10.0)
    assert found.volume_errors_pct == pytest.approx((10.0, 10.0, 10.0))
    assert found.recall == 0.75
    assert found.precision == 1.0


def test_a_mirrored_plant_does_not_match():
    assert compare_bolls(TRUE_CM * (1, -1, 1), TRUE_CM3, TRUE_CM, TRUE_CM3).n_matched < 4


def test_blank_centres_match_nothing():
    found = compare_bolls(np.full((2, 3), np.nan), np.full(2, np.nan), TRUE_CM, TRUE_CM3)
    assert found.n_matched == 0
    assert found.precision == 0.0
    assert np.isnan(found.median_volume_error_pct)


@pytest.fixture
def plant(tmp_path):
    workspace = Workspace(tmp_path)
    truth = {
        "boll_count": 4,
        "total_boll_convex_volume_cm3": 140.0,
        "plant_height_cm": 80.0,
        "canopy_size_cm": 40.0,
        "stem_base_xyz_m": [0.1, 0.0, 0.0],
        "bolls": [
            {"centre_xyz_m": list(centre / 100 + (0.1, 0, 0)), "convex_volume_cm3": volume}
            for centre, volume in zip(TRUE_CM, TRUE_CM3, strict=True)
        ],
    }
    workspace.truth_json.write_text(json.dumps(truth))
    workspace.traits_csv.parent.mkdir()
    workspace.traits_csv.write_text("boll_count,boll_volume_cm3,plant_height_cm,canopy_size_cm\n3,133,84,\n")
    rows = [f"{x},{y},{z},{volume}" for (x, y, z), volume in zip(TRUE_CM[1:], TRUE_CM3[1:], strict=True)]
    workspace.bolls_csv.write_text("\n".join(["x_cm,y_cm,z_cm,volume_cm3", *rows]) + "\n")
    return workspace


def test_a_plant_beside_its_truth(plant):
    errors, bolls = evaluate(plant, plant.truth_json)
    assert [item.error_pct for item in errors[:3]] == pytest.approx([-25.0, -5.0, 5.0])
    assert np.isnan(errors[3].error_pct)
    assert bolls.n_matched == 3
    assert bolls.median_distance_cm == pytest.approx(0.0, abs=1e-9)


def test_what_does_not_hang_on_the_plant_is_no_false_boll(plant):
    rows = plant.bolls_csv.read_text().splitlines()
    flagged = [f"{row},{flags}" for row, flags in zip(rows, ["qc_flags", "", "", "large"], strict=True)]
    plant.bolls_csv.write_text("\n".join([*flagged, "20,20,5,400,large;off_plant"]) + "\n")
    assert evaluate(plant, plant.truth_json)[1].n_measured == 3


def test_what_is_missing_is_named(plant):
    with pytest.raises(MissingInput, match="other"):
        evaluate(plant, plant.root / "other.json")
    plant.truth_json.write_text('{"bolls": []}')
    with pytest.raises(BadInput, match="plant_height_cm"):
        evaluate(plant, plant.truth_json)
    plant.truth_json.write_text("[1, 2")
    with pytest.raises(BadInput, match="damaged"):
        evaluate(plant, plant.truth_json)
