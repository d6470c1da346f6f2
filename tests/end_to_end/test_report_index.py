"""index.html of a batch."""

import numpy as np
from scenes.finished_scene import N_BOLLS
from scenes.report_page import Page, batch_row, batch_rows

from cotton3dg.report.advice import FLAGS
from cotton3dg.report.index import index_page, robust_z


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
    assert "8 of 9 plants done, 1 failed" in seen.text
    assert seen.text.index("Plants without a result") < seen.text.index(
        "Histogram" if "Histogram" in seen.text else "Traits"
    )
    links = [found["href"] for tag, found in seen.tags if tag == "a"]
    assert links == ["#plants", "sp%20ace/%23%25/report.html", "plant_017/report.html"]
    assert "height far above the others" in seen.text
    assert FLAGS["orbit_gap"].title in seen.text
    assert seen.count("img") == 1  # the one plant that has frames
    assert seen.count("img", src="x") == seen.count("b") == 0
    assert "default-src 'none'" in text
