# SPDX-License-Identifier: Apache-2.0
"""CSV as a spreadsheet and a parser read it."""

import csv
import io
import math

import pytest

from cotton3dg.core.columns import Column
from cotton3dg.errors import BadInput
from cotton3dg.io.tables import (
    BOLLS,
    BRANCHES,
    TRAITS,
    columns_text,
    csv_text,
    flags_of,
    frame_of,
    parse_number,
    read_rows,
    value_of,
)

CONTRACT = {
    "traits.csv": "plant_id, boll_count, boll_count_low, boll_count_high, boll_volume_cm3, boll_volume_low_cm3, "
    "boll_volume_high_cm3, plant_height_cm, plant_height_low_cm, plant_height_high_cm, "
    "canopy_size_cm, canopy_size_low_cm, canopy_size_high_cm, qc_flags, boll_count_error, "
    "boll_volume_error_cm3, plant_height_error_cm, canopy_size_error_cm, boll_volume_mean_cm3, "
    "lint_area_cm2, boll_count_odd, boll_count_even, boll_height_mean_cm, boll_height_sd_cm, "
    "boll_height_min_cm, boll_height_max_cm, bolls_lower, bolls_middle, bolls_upper, "
    "canopy_length_cm, canopy_width_cm, plant_height_obb_cm, plant_hull_volume_cm3, seed_cotton_g, "
    "seed_cotton_low_g, seed_cotton_high_g, lint_g, boll_volume_published_cm3, "
    "plant_height_published_cm, canopy_size_published_cm, corrections, original_boll_count, "
    "original_boll_volume_cm3, original_plant_height_cm, original_canopy_size_cm, stem_length_cm, "
    "stem_length_error_cm, stem_diameter_mm, stem_diameter_error_mm, stem_lean_deg, branch_count, "
    "branch_count_error, fruiting_branch_count, bearing_branch_count, "
    "first_fruiting_branch_height_cm, first_fruiting_branch_height_error_cm, internode_mean_cm, "
    "internode_mean_error_cm, branch_angle_mean_deg, branch_angle_mean_error_deg, "
    "branch_length_mean_cm, branch_length_mean_error_cm, branch_density_lower, branch_density_middle, "
    "branch_density_upper, bolls_by_branch, bolls_position_1, bolls_position_2, bolls_position_3, "
    "first_position_share_pct, lint_cie_l, lint_cie_a, lint_cie_b, lint_rd_pct, lint_plus_b, "
    "scale_source, scale_error_pct, n_frames, registered_pct, psnr_db, seconds, version",
    "bolls.csv": "plant_id, boll_id, x_cm, y_cm, z_cm, volume_cm3, alpha_volume_cm3, diameter_cm, n_gaussians, "
    "n_views, confidence, qc_flags, volume_error_cm3, projected_area_cm2, volume_published_cm3, "
    "corrected, original_bolls, original_volume_cm3, branch, branch_confidence, rank_on_branch, "
    "path_from_stem_cm, fruiting_position, fruiting_position_confidence, lint_cie_l, lint_cie_a, "
    "lint_cie_b, lint_rd_pct, lint_plus_b, lint_colour_views",
    "branches.csv": "plant_id, branch, kind, parent, height_cm, azimuth_deg, angle_deg, length_cm, reach_cm, "
    "diameter_mm, n_bolls, boll_ids, confidence",
}
COLUMNS = (Column("name", "", "a name"), Column("size", "cm", "a size", 2), Column("flags", "", "some flags"))


def read(text):
    return list(csv.DictReader(io.StringIO(text, newline="")))


@pytest.mark.parametrize(
    ("file", "columns"), [("traits.csv", TRAITS), ("bolls.csv", BOLLS), ("branches.csv", BRANCHES)]
)
def test_columns_are_those_of_the_contract(file, columns):
    names = [column.name for column in columns]
    assert names == CONTRACT[file].split(", "), f"a new column of {file} belongs into CONTRACT, too; none ever goes"
    assert all(name.isascii() for name in names)


def test_quotes_commas_and_newlines_survive():
    name = 'row 3, "left"\nplot 7'
    text = csv_text(COLUMNS, [{"name": name, "size": 1.0, "flags": ()}])
    assert read(text) == [{"name": name, "size": "1.00", "flags": ""}]
    assert text.startswith("name,size,flags\r\n")
    assert text.endswith("\r\n")


def test_numbers_have_a_dot_and_blanks_where_there_is_none():
    sizes = [1234.5678, -0.001, float("nan"), float("inf"), None, 0.0]
    cells = [row["size"] for row in read(csv_text(COLUMNS, [{"name": "a", "size": s, "flags": ()} for s in sizes]))]
    assert cells == ["1234.57", "0.00", "", "", "", "0.00"]


def test_flags_are_joined():
    assert read(csv_text(COLUMNS, [{"name": "a", "size": None, "flags": ("few", "dark")}]))[0]["flags"] == "few|dark"


def test_flags_are_read_from_tables_of_this_version_and_of_earlier_ones():
    assert [flags_of({"qc_flags": cell}) for cell in ("few|dark", "few;dark", "few", "", None)] == [
        ["few", "dark"], ["few", "dark"], ["few"], [], [],
    ]  # fmt: skip


def test_byte_order_mark_only_for_excel():
    assert csv_text(COLUMNS, []).encode() == b"name,size,flags\r\n"
    assert csv_text(COLUMNS, [], excel=True).encode() == b"\xef\xbb\xbfname,size,flags\r\n"


def test_every_column_is_described():
    rows = read(columns_text({"traits.csv": TRAITS, "bolls.csv": BOLLS}))
    assert [row["column"] for row in rows] == [c.name for c in TRAITS + BOLLS]
    assert all(row["description"] for row in rows)
    terms = {row["column"]: row["crop_ontology"] for row in rows if row["crop_ontology"]}
    assert terms == {"boll_count": "CO_358:0001327", "plant_height_cm": "CO_358:0001138"}
    for row in rows:
        if row["column"].endswith("_cm3"):
            assert row["unit"] == "cm3"
        elif row["column"].endswith("_cm"):
            assert row["unit"] == "cm"


@pytest.mark.parametrize("excel", [False, True])
def test_what_was_written_is_read_again(tmp_path, excel):
    path = tmp_path / "table.csv"
    names = ["plain", "-12", "=A1", " +3", "\tleft", "it's", "'quoted'", 'two "lines"\nand, a comma', "NA", "", "å"]
    rows = [{"name": name, "size": 1.5, "flags": ("few", "dark")} for name in names]
    path.write_bytes(csv_text(COLUMNS, rows, excel=excel).encode())
    found = read_rows(path)
    assert [row["name"] for row in found] == names
    assert {(row["size"], row["flags"]) for row in found} == {("1.50", "few|dark")}
    values = [{column.name: value_of(row[column.name], column) for column in COLUMNS} for row in found]
    assert csv_text(COLUMNS, values, excel=excel).encode() == path.read_bytes()


def test_tables_that_others_made_are_read_or_refused(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("a,b\n1\n\n2,3\n")
    assert read_rows(path) == [{"a": "1", "b": ""}, {"a": "2", "b": "3"}]
    path.write_text("")
    assert read_rows(path) == []
    for damage, words in (
        (b"a\xff\xfe", "table.csv, line 1, is not in UTF-8; save the file as UTF-8"),
        (b'a\n"never closed', r"cannot be read .*; save it as CSV"),
        (b"a,b\n1,2,5\n", "row 2: more cells than columns; put"),
        (b"a,b\n1,2\n1,2,5\n", "row 3: more cells than columns; put"),
    ):
        path.write_bytes(damage)
        with pytest.raises(BadInput, match=words):
            read_rows(path)
    with pytest.raises(BadInput):
        read_rows(tmp_path / "none.csv")
    assert parse_number("1.5") == 1.5
    assert all(math.isnan(parse_number(cell)) for cell in ("", None, "high"))


def test_a_table_that_a_spreadsheet_saved_again_is_read(tmp_path):
    """Opened and saved in German: all measurements were NaN, or a column was missing."""
    path = tmp_path / "traits.csv"
    for encoding in ("cp1252", "utf-8-sig", "utf-16"):
        text = "plant_id;boll_count;plant_height_cm;qc_flags\r\nGröße 1;12;73,80;few;\r\n".replace("few;", '"few;dark"')
        path.write_bytes(text.encode(encoding))
        assert read_rows(path) == [
            {"plant_id": "Größe 1", "boll_count": "12", "plant_height_cm": "73.80", "qc_flags": "few;dark"}
        ]


def test_a_cell_that_somebody_changed_is_named():
    with pytest.raises(BadInput, match="column size: 'large' is not a number"):
        value_of("large", COLUMNS[1])


def test_frames_keep_text_and_have_nan_for_blank_numbers():
    rows = [
        {"name": "007", "size": "1.5", "flags": "", "block": "3"},
        {"name": "", "size": "", "flags": "few", "block": ""},
    ]
    frame = frame_of(rows, COLUMNS)
    assert list(frame.columns) == ["name", "size", "flags", "block"]
    assert list(frame.name) == ["007", ""]
    assert list(frame["flags"]) == ["", "few"]
    assert frame["size"][0] == 1.5
    assert math.isnan(frame["size"][1])
    assert frame.block[0] == 3  # of a field book: a number if all are
    assert list(frame_of([row | {"block": "3b"} for row in rows], COLUMNS).block) == ["3b", "3b"]
    blank = frame_of([], BOLLS)
    assert list(blank.columns) == [column.name for column in BOLLS]
    assert len(blank) == 0
    assert frame_of([{"plant_id": "1", "boll_id": "2"}], BOLLS).to_dict("records") == [{"plant_id": "1", "boll_id": 2}]
