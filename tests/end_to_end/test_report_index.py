# SPDX-License-Identifier: Apache-2.0
"""index.html of a batch."""

import numpy as np
from scenes.finished_scene import N_BOLLS
from scenes.report_page import Page, batch_row, batch_rows

from cotton3dg.field.genotypes import Trial, compare_genotypes
from cotton3dg.report.advice import FLAGS
from cotton3dg.report.checklist import FILM_AGAIN, to_film
from cotton3dg.report.index import index_page, robust_z
from cotton3dg.schemas.check import RED, CheckInfo, Finding, film_of
from cotton3dg.schemas.record import Record
from cotton3dg.workspace import Workspace


def test_robust_z_finds_what_stands_out():
    scores = robust_z(np.array([1.0, 2, 3, 4, 5, 50, np.nan]))
    assert abs(scores[:5]).max() < 3.5 < scores[5]
    assert np.isnan(scores[6])
    assert np.isnan(robust_z(np.array([1.0, 2, 3, 100]))).all()
    assert np.isnan(robust_z(np.array([5.0, 5, 5, 5, 9]))).all()


def test_the_index_lists_failures_outliers_and_links(reported):
    folder = reported.root.parent
    (folder / "sp ace" / "#%").mkdir(parents=True, exist_ok=True)
    (folder / "sp ace" / "#%" / "report.html").touch()
    rows = [*batch_rows(), batch_row("plant_017", boll_count=N_BOLLS)]
    text = index_page("field", folder, rows)
    seen = Page(text)
    assert len(text) < 1e6
    assert "Red. 8 of 9 plants done, 1 of them yellow, 1 failed" in seen.text
    assert seen.text.index("Plants without a result") < seen.text.index(
        "Histogram" if "Histogram" in seen.text else "Traits"
    )
    links = [found["href"] for tag, found in seen.tags if tag == "a"]
    assert links[0] == "#plants"
    assert links[-2:] == ["sp%20ace/%23%25/report.html", "plant_017/report.html"]
    assert set(links[1:-2]) <= set(links[-2:])  # outliers, with their pictures
    assert "height far above the others" in seen.text
    assert FLAGS["orbit_gap"].title in seen.text
    assert f"plant_3 {FLAGS['orbit_gap'].title} a full turn that ends where it began" in seen.text
    assert seen.count("img") == 2  # the one plant that has frames, in the table and among the outliers
    assert seen.count("img", src="x") == seen.count("b") == 0
    assert "default-src 'none'" in text


def test_the_index_says_of_a_row_what_its_report_says(tmp_path):
    flagged = batch_row("a", boll_count=3, qc_flags="table_size_assumed")
    seen = Page(index_page("field", tmp_path, [batch_row("b", boll_count=3), flagged]))
    assert "Yellow. 2 of 2 plants done, 1 of them yellow" in seen.text
    assert seen.count("td", **{"class": "green"}) == seen.count("td", **{"class": "yellow"}) == 1
    assert seen.count("td", title="Look before you use it: table size assumed") == 1
    assert "Green. 1 of 1 plants done" in Page(index_page("field", tmp_path, [batch_row("b")])).text
    failed = batch_row("c", "failed", reason="dark; film again")
    assert "Red. 0 of 1 plants done, 1 failed" in Page(index_page("field", tmp_path, [failed])).text


def test_each_value_has_its_interval_and_a_mark(tmp_path):
    sure = {"boll_count_low": 2, "boll_count_high": 4, "plant_height_low_cm": 30, "plant_height_high_cm": 90}
    plain = batch_row("a", boll_count=3, plant_height_cm=60.0)
    seen = Page(index_page("field", tmp_path, [plain | sure]))
    assert "3 2 to 4" in seen.text
    assert "60.0 30.0 to 90.0" in seen.text
    assert seen.count("span", **{"class": "sure green"}) == seen.count("span", **{"class": "sure red"}) == 1
    assert not Page(index_page("field", tmp_path, [batch_row("a", "failed", reason="dark")])).count("span", role="img")


def test_genotypes_that_differ_by_rounding_alone_look_alike(tmp_path):
    """The axis is no shorter than what one plant is sure to; what differs by more fills it."""

    def widest(heights):
        rows = [batch_row(f"p{k}", plant_height_cm=height) | {"genotype": f"G{k % 2}"} for k, height in heights]
        trial = Trial(("genotype",), *compare_genotypes(rows, ("genotype",)))
        seen = Page(index_page("field", tmp_path, rows, trial))
        places = [float(found["cx"]) for tag, found in seen.tags if tag == "circle" and found.get("cy")]
        return max(places) - min(places)

    assert widest(enumerate([80.0, 80.004] * 3)) < 1
    assert widest(enumerate([80.0, 90.0] * 3)) > 150


def test_the_field_book_filters_lists_what_to_film_and_compares_genotypes(tmp_path):
    rows = [row | {"genotype": f"G{k % 3}", "block": str(k % 2), "plot": str(k)} for k, row in enumerate(batch_rows())]
    columns = ("genotype", "block", "plot")
    means, fits = compare_genotypes(rows, columns)
    unfilmed = {"late <1>": {"genotype": "G1", "block": "2", "plot": "77"}}
    seen = Page(index_page("field", tmp_path, rows, Trial(columns, means, fits, unfilmed)))
    assert seen.count("select", **{"data-filter": "0"}) == seen.count("select", **{"data-filter": "1"}) == 1
    assert seen.count("tr", **{"data-field0": "G1"}) == 3
    assert "late <1> block 2, plot 77 not filmed yet one slow full turn" in seen.text
    assert "Bolls : 3 genotypes, 7 plants; F" in seen.text


def test_the_list_to_film_has_failures_red_checks_and_flags(tmp_path):
    """With what to film; a check of another film, and failures that no film mends, are not on it."""
    film = Record("frames", inputs={"walk.mp4": "a" * 64})
    for name, now in (("red", film), ("filmed_again", Record("frames", inputs={"walk.mp4": "b" * 64}))):
        (tmp_path / name).mkdir()
        workspace = Workspace(tmp_path / name)
        workspace.write_record(now)
        with workspace.writing("check") as made:
            found = Finding(RED, "Plant", "the frame cuts it in 9 of 10 images", "step back")
            info = CheckInfo(RED, "", (found, Finding("green", "Light", "well lit")), {}, 1.0, film_of(film))
            info.save(made / "check.json")
    rows = [
        batch_row("red", boll_count=3),
        batch_row("filmed_again", boll_count=3),
        batch_row("dark", qc_flags="underexposed|orbit_gap|doubtful_bolls"),
        batch_row("lost", "failed", reason="12 of 100 frames registered; film one slow turn") | {"exit_code": 4},
        batch_row("no_memory", "failed", reason="out of memory; use a larger machine") | {"exit_code": 7},
    ]
    plants = [row | {"flags": [flag for flag in (row["qc_flags"] or "").split("|") if flag]} for row in rows]
    found = {item["plant"]: (item["why"], item["what"]) for item in to_film(tmp_path, plants, Trial())}
    assert found == {
        "red": (["the frame cuts it in 9 of 10 images"], ["step back"]),
        "dark": (
            [FLAGS["underexposed"].title, FLAGS["orbit_gap"].title],
            ["in more light", "a full turn that ends where it began"],
        ),
        "lost": (["12 of 100 frames registered"], ["film one slow turn"]),
    }
    assert FILM_AGAIN.keys() <= FLAGS.keys()
    seen = Page(index_page("field", tmp_path, rows))
    assert seen.text.index("To film") < seen.text.index("step back") < seen.text.index("Seconds")
