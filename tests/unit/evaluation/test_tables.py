# SPDX-License-Identifier: Apache-2.0
"""Tables of many plants against figures that were computed by hand."""

import csv
import math

import numpy as np
import pytest

from cotton3dg.core.columns import Column
from cotton3dg.errors import BadInput, MissingInput
from cotton3dg.evaluation.tables import (
    evaluate_boll_tables,
    evaluate_tables,
    evaluation_text,
    is_boll_table,
    predict_left_out,
    score,
    write_evaluation,
)
from cotton3dg.io.images import read_image
from cotton3dg.io.scatter import plot_scatter
from cotton3dg.io.tables import csv_text


def test_scores_are_those_computed_by_hand():
    found = score("plant_height_cm", np.array([50.0, 80.0, 100.0]), np.array([52.0, 76.0, 103.0]))
    # Errors 2, -4, 3: squares 4 + 16 + 9 = 29; relative 4 %, 5 %, 3 %.
    assert found.n == 3
    assert found.rmse == pytest.approx(math.sqrt(29 / 3))
    assert found.mae == pytest.approx(3.0)
    assert found.mape_pct == pytest.approx(4.0)
    assert found.bias == pytest.approx(1 / 3)
    # Truth: mean 230/3, squared deviations 3800/3; measured: mean 77, sum of products 1270.
    assert found.r2 == pytest.approx(1270**2 / (3800 / 3 * 1302))
    assert found.r2_identity == pytest.approx(1 - 29 / (3800 / 3))


def test_what_is_not_defined_is_nan():
    one = score("boll_count", np.array([3.0]), np.array([4.0]))
    assert (one.rmse, one.bias) == (1.0, 1.0)
    assert math.isnan(one.r2)
    assert math.isnan(one.r2_identity)
    assert math.isnan(score("boll_count", np.array([0.0]), np.array([1.0])).mape_pct)
    assert math.isnan(score("boll_count", np.zeros(0), np.zeros(0)).rmse)
    assert math.isnan(score("boll_count", np.array([1.0, 2.0]), np.array([3.0, 3.0])).r2)


def test_each_plant_is_predicted_from_the_others():
    volumes, weights = np.array([1.0, 2.0, 3.0]), np.array([2.0, 4.0, 9.0])
    # Without the first: slope 5, 9 - 5*2 = -1; without the second: slope 3.5, 5.5; without the third: 2 v = 6.
    assert predict_left_out(volumes, weights) == pytest.approx([-1.0, 5.5, 6.0])
    assert np.isnan(predict_left_out(volumes[:2], weights[:2])).all()


@pytest.fixture
def tables(tmp_path):
    measured, truth = tmp_path / "batch.csv", tmp_path / "truth.csv"
    measured.write_text(
        "plant_id,boll_count,boll_volume_cm3,plant_height_cm,psnr_db,qc_flags\n"
        "a,10,100,50,30,\nb,12,200,,31,no_scale\nc,9,300,90,30,\nd,1,1,1,1,\nd,2,2,2,2,\ne,5,5,5,5,\n"
    )
    truth.write_text(
        "plant_id,boll_count,plant_height_cm,boll_weight_g,psnr_db,remark\n"
        "a,10,51,20,1,x\nb,10,70,40,1,y\nc,10,88,63,1,z\nd,4,4,4,4,\nf,7,7,7,7,\n"
    )
    return measured, truth


def test_plants_are_matched_and_the_rest_is_told(tables):
    found = evaluate_tables(*tables)
    assert [(item.trait, item.n) for item in found.scores] == [
        ("boll_count", 3), ("plant_height_cm", 2), ("boll_weight_g", 3),
    ]  # fmt: skip
    assert found.scores[0].mape_pct == pytest.approx(10.0)
    assert found.scores[1].mae == pytest.approx(1.5)
    assert (found.missing, found.extra, found.repeated) == (("f",), ("e",), ("d",))
    assert found.blank == {"plant_height_cm": ("b",)}
    # Left out in turn: 40 - 23 = 17 for 20, (20 + 63) / 2 = 41.5 for 40, 60 for 63.
    assert found.weight_error_pct == pytest.approx(100 * (3 / 20 + 1.5 / 40 + 3 / 63) / 3)
    text = evaluation_text(found)
    for words in ("truth only): f", "measured only): e", "twice in a table: d", "plant_height_cm is blank: b"):
        assert words in text


@pytest.mark.parametrize("name", ["-12", "=A1", "+3", "@home", "\tleft"])
def test_a_plant_whose_name_looks_like_a_formula_meets_its_truth(tmp_path, name):
    measured, truth = tmp_path / "batch.csv", tmp_path / "truth.csv"
    columns = (Column("plant_id", "", "a name"), Column("boll_count", "1", "bolls"))
    measured.write_text(csv_text(columns, [{"plant_id": name, "boll_count": 9}]), newline="")
    truth.write_text(f"plant_id,boll_count\n{name},10\n")
    assert evaluate_tables(measured, truth).scores[0].bias == -1.0


def test_the_scores_and_a_plot_for_each_trait_are_saved(tables, tmp_path):
    found = evaluate_tables(*tables)
    write_evaluation(tmp_path / "evaluation", found)
    with (tmp_path / "evaluation" / "evaluation.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["trait"] for row in rows] == [item.trait for item in found.scores]
    assert rows[0]["mape_pct"] == "10.00"
    for item in found.scores:
        assert read_image(tmp_path / "evaluation" / f"scatter_{item.trait}.png").shape == (720, 720, 3)


def test_points_on_the_line_lie_on_the_diagonal():
    true, measured = np.array([1.0, 5.0, 9.0]), np.array([1.0, 4.0, 9.0])
    figure = plot_scatter("x", true, measured, ["n = 3"])
    figure.draw_without_rendering()
    (axes,) = figure.axes
    (dots,), (diagonal, regression) = axes.collections, axes.lines
    np.testing.assert_array_equal(dots.get_offsets(), np.column_stack([true, measured]))
    np.testing.assert_array_equal(*diagonal.get_data())
    # By hand: slope 32 / 32, and 1/3 lower, for the middle point lies 1 below the line.
    x, y = regression.get_data()
    assert y - x == pytest.approx(np.full(2, -1 / 3))
    assert axes.get_xlim() == axes.get_ylim() == pytest.approx((0.6, 9.4))
    box = axes.get_window_extent()
    assert box.width == pytest.approx(box.height)


@pytest.mark.parametrize("value", [0.0, 5.0, -3.0])
def test_a_single_value_has_room_around_it(value):
    low, high = plot_scatter("x", np.array([value]), np.array([value]), []).axes[0].get_xlim()
    assert low < value < high


def test_tables_that_cannot_be_compared_are_refused(tables, tmp_path):
    measured, truth = tables
    with pytest.raises(MissingInput, match="other"):
        evaluate_tables(measured, tmp_path / "other.csv")
    other = tmp_path / "other.csv"
    other.write_text("plant,boll_count\na,1\n")
    with pytest.raises(BadInput, match="plant_id"):
        evaluate_tables(measured, other)
    other.write_text("plant_id,boll_count\nz,1\n")
    with pytest.raises(BadInput, match="no plant in common"):
        evaluate_tables(measured, other)
    other.write_text("plant_id,size\na,1\n")
    with pytest.raises(BadInput, match="no trait"):
        evaluate_tables(measured, other)
    assert truth.is_file()


MEASURED_BOLLS = """plant_id,boll_id,x_cm,y_cm,z_cm,volume_cm3,confidence
a,1,0.0,0.0,60.0,33.0,0.9
a,2,5.0,0.0,50.0,18.0,0.8
a,3,9.0,9.0,40.0,50.0,0.7
b,1,,,,22.0,0.9
c,1,0,0,30,10,0.5
"""


def boll_tables(tmp_path, truth):
    measured, true = tmp_path / "batch_bolls.csv", tmp_path / "true_bolls.csv"
    measured.write_text(MEASURED_BOLLS)
    true.write_text(truth)
    return measured, true


def test_bolls_are_matched_by_place_and_without_one_by_id(tmp_path):
    true = """plant_id,boll_id,x_cm,y_cm,z_cm,volume_cm3
a,top,0.5,0.0,60.0,30.0
a,left,5.0,0.5,50.0,20.0
a,lost,-9,0,20,40.0
b,1,0,0,44,20.0
d,1,0,0,44,20.0
"""
    measured, truth = boll_tables(tmp_path, true)
    assert is_boll_table(measured)
    found = evaluate_boll_tables(measured, truth)
    (volume,) = found.scores
    # Errors +3 of 30, -2 of 20, +2 of 20.
    assert (volume.trait, volume.n) == ("volume_cm3", 3)
    assert volume.mape_pct == pytest.approx(10.0)
    assert volume.bias == pytest.approx(1.0)
    assert volume.rmse == pytest.approx(math.sqrt(17 / 3))
    assert found.missing == ("a/lost",)
    assert found.extra == ("a/3",)


@pytest.mark.parametrize(
    ("truth", "says"),
    [
        ("plant_id,volume_cm3\na,1\n", "no column boll_id"),
        ("plant_id,boll_id,volume_cm3\na,1,2\na,1,3\n", "boll a/1 twice"),
        ("plant_id,boll_id,volume_cm3\nz,1,2\n", "no plant in common"),
        ("plant_id,boll_id,area\na,1,2\n", "no trait"),
    ],
)
def test_boll_tables_that_cannot_be_compared_are_refused(tmp_path, truth, says):
    measured, true = boll_tables(tmp_path, truth)
    with pytest.raises(BadInput, match=says):
        evaluate_boll_tables(measured, true)


def test_a_table_of_plants_is_none_of_bolls(tables):
    assert not is_boll_table(tables[0])
