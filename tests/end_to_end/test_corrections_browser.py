# SPDX-License-Identifier: Apache-2.0
"""Corrections made in the report's page in a real browser, by real input events, and replayed."""

import json
import shutil
import time

import numpy as np
import pytest
from scenes.chromium import Browser, executable
from scenes.table_scene import BOLL_RADIUS_CM

from cotton3dg.commands.correct import Asked, correct
from cotton3dg.io.colmap import read_cameras
from cotton3dg.io.tables import read_rows
from cotton3dg.report.facts import read_facts
from cotton3dg.schemas.bolls import read_bolls
from cotton3dg.schemas.scale import read_scale
from cotton3dg.workspace import Workspace

pytestmark = pytest.mark.skipif(
    executable() is None, reason="no Chromium; apt-get install chromium, or name one in COTTON3DG_CHROMIUM"
)


def saved_by_clicks(browser, folder):
    """What the page saves as a download."""
    browser.click(*browser.middle("#save"))
    saved = folder / "corrections.json"
    for _ in range(100):
        if saved.is_file() and saved.stat().st_size:
            return saved
        time.sleep(0.1)
    raise AssertionError("nothing was saved")


def replayed_twice(workspace, saved, tmp_path):
    """A plant after the saved corrections, which must give the same bytes on two copies."""
    results = []
    for name in ("first", "second"):
        copy = Workspace(shutil.copytree(workspace.root, tmp_path / name / "plant_017"))
        outcome = correct(copy, Asked(file=saved))
        results.append([path.read_bytes() for path in (copy.traits_csv, copy.bolls_csv, copy.scale_json)])
    assert results[0] == results[1]
    return copy, outcome


def said(browser):
    return browser.value("[...document.querySelectorAll('#correction_list li')].map(item => item.textContent)")


def click_in_photo(browser, pane, camera, point, off_px=0.0):
    """Show a camera's photo in a pane and click where it sees a scene point."""
    names = "JSON.parse(document.getElementById('photos_data').textContent).photos.map(photo => photo.name)"
    wanted = browser.value(names).index(camera.name)
    figure = f".two > .pane:nth-child({pane})"
    for _ in range(12):
        if browser.value(f"document.querySelector('{figure} .named').textContent").startswith(f"{wanted + 1} of "):
            break
        browser.click(*browser.middle(f"{figure} [data-act=next]"))
    ((x, y),), _ = camera.project(point[None])
    browser.middle(f"{figure} svg")
    left, top, width, height = browser.value(
        f"(b => [b.x, b.y, b.width, b.height])(document.querySelector('{figure} svg').getBoundingClientRect())"
    )
    browser.click(left + x / camera.width * width, top + (y + off_px) / camera.height * height)


OVERLAPS = """
[...document.querySelectorAll('.pane')].map(pane => {
  const boxes = [...pane.querySelectorAll('text.known')].map(text => text.getBoundingClientRect());
  const apart = (a, b) => a.right <= b.left || b.right <= a.left || a.bottom <= b.top + 3 || b.bottom <= a.top + 3;
  const overlaps = boxes.filter((a, n) => boxes.some((b, m) => m > n && !apart(a, b)));
  return [pane.querySelectorAll('circle').length, boxes.length, overlaps.length];
})"""
"""Of each photo: dots, numbers, and numbers that lie on another."""


def test_numbers_in_photos_do_not_lie_on_each_other(reported_copy, tmp_path):
    """Three bolls that a photo shows near each other: a dot for each, and all numbers once the photo is enlarged."""
    page = reported_copy.report_html.read_text(encoding="utf-8")
    begin = page.index('id="photos_data"')
    begin, end = page.index(">", begin) + 1, page.index("</script>", begin)
    data = json.loads(page[begin:end])
    _, x, y, z = data["bolls"][0]
    data["bolls"] += [[98, x, y, z + 0.9], [99, x, y, z + 1.8]]
    reported_copy.report_html.write_text(page[:begin] + json.dumps(data) + page[end:], encoding="utf-8")
    with Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(reported_copy.report_html, 400, 800)
        for dots, numbers, overlaps in browser.value(OVERLAPS):
            assert dots == len(data["bolls"]) and overlaps == 0 and numbers < dots
        for _ in range(5):
            browser.click(*browser.middle(".pane [data-act=closer]"))
        dots, numbers, overlaps = browser.value(OVERLAPS)[0]
        assert numbers == dots == len(data["bolls"]) and overlaps == 0
        assert browser.complaints == []


@pytest.mark.parametrize("width", [1280, 400])
def test_a_wrong_merge_and_a_false_boll_are_mended_by_two_clicks_each(reported_copy, tmp_path, width):
    """Bolls 3 and 4 are one and boll 1 is none, by real clicks; what is saved replays to the same bytes twice."""
    (tmp_path / "downloads").mkdir()
    with Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(reported_copy.report_html, width, 800)
        browser.downloads_to(tmp_path / "downloads")
        browser.click(*browser.middle("tr[data-boll='3'] th button"))
        browser.click(*browser.middle("tr[data-boll='4'] [data-mend=merge]"))
        browser.click(*browser.middle("tr[data-boll='2'] [data-mend=split]"))
        assert said(browser) == ["merge 3 + 4", "split 2"]
        browser.click(*browser.middle("#undo"))
        browser.click(*browser.middle("tr[data-boll='1'] [data-mend=branch]"))
        assert said(browser) == ["merge 3 + 4", "branch 1"]
        assert browser.value("[...document.querySelectorAll('tr.mended')].map(row => row.dataset.boll)") == [
            "1",
            "3",
            "4",
        ]
        saved = saved_by_clicks(browser, tmp_path / "downloads")
        assert browser.complaints == []
    copy, outcome = replayed_twice(reported_copy, saved, tmp_path)
    assert (outcome.before, outcome.after, outcome.refused) == (4, 2, ())
    assert b"merged,3+4" in copy.bolls_csv.read_bytes()


def test_a_wrongly_merged_boll_is_parted_by_one_click(reported_copy, tmp_path):
    (tmp_path / "downloads").mkdir()
    correct(reported_copy, Asked(merge=["3,4"]))
    with Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(reported_copy.report_html)
        browser.downloads_to(tmp_path / "downloads")
        browser.click(*browser.middle("tr[data-boll='3'] [data-mend=split]"))
        saved = saved_by_clicks(browser, tmp_path / "downloads")
    _, outcome = replayed_twice(reported_copy, saved, tmp_path)
    assert (outcome.before, outcome.after, outcome.refused) == (3, 4, ())


def test_a_boll_is_added_by_clicks_in_two_photos(reported_copy, tmp_path):
    """A boll that was lost is clicked in two photos; rays that do not meet are refused."""
    (tmp_path / "downloads").mkdir()
    bolls = {boll.boll_id: boll for boll in read_bolls(*reported_copy.final_bolls())[0]}
    cameras = read_cameras(reported_copy.undistorted / "sparse")
    correct(reported_copy, Asked(delete=[2]))
    lost = bolls[2].centre
    with Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(reported_copy.report_html)
        browser.downloads_to(tmp_path / "downloads")
        shown = browser.value("JSON.parse(document.getElementById('photos_data').textContent).photos.map(p => p.name)")
        seen = [camera for camera in cameras if camera.name in shown]
        hint = "document.getElementById('hint').textContent"
        click_in_photo(browser, 1, seen[0], lost)
        assert browser.value(hint) == "Choose what to do."
        browser.click(*browser.middle("[data-point=add]"))
        click_in_photo(browser, 1, seen[0], lost)
        assert "it lies on the line" in browser.value(hint)
        # The line goes through where the other photo shows it.
        for pane, camera in ((1, seen[0]), (2, seen[4])):
            click_in_photo(browser, pane, camera, lost, off_px=60.0 if pane == 2 else 0.0)
        assert "do not meet in space" in browser.value(hint)
        assert browser.value("document.querySelectorAll('.pane .epipolar').length") == 1
        away = browser.value(EPIPOLAR_AWAY.format(*seen[4].project(lost[None])[0][0]))
        assert away < 1.0
        click_in_photo(browser, 2, seen[4], lost)
        assert said(browser) == ["add a boll at height 50.0 cm"]
        saved = saved_by_clicks(browser, tmp_path / "downloads")
        assert browser.complaints == []
    copy, outcome = replayed_twice(reported_copy, saved, tmp_path)
    assert (outcome.before, outcome.after, outcome.refused) == (3, 4, ())
    (added,) = [row for row in read_rows(copy.bolls_csv) if row["corrected"] == "added"]
    assert float(added["volume_cm3"]) == pytest.approx(4 / 3 * np.pi * BOLL_RADIUS_CM**3, rel=0.25)


EPIPOLAR_AWAY = """(() => {{
    const line = document.querySelector('.pane .epipolar');
    const far = Array.from({{ length: 20001 }}, (_, n) => line.getPointAtLength(line.getTotalLength() * n / 20000));
    return Math.min(...far.map(at => Math.hypot(at.x - {}, at.y - {})));
}})()"""


def test_a_corner_is_moved_and_a_length_measured_in_photos(reported_copy, tmp_path):
    (tmp_path / "downloads").mkdir()
    bolls = {boll.boll_id: boll for boll in read_bolls(*reported_copy.final_bolls())[0]}
    cameras = read_cameras(reported_copy.undistorted / "sparse")
    scale = read_scale(reported_copy.scale_json)
    there = scale.corners[2] + 4 * (scale.table_frame[0] + scale.table_frame[1]) / scale.cm_per_su
    with Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(reported_copy.report_html)
        browser.downloads_to(tmp_path / "downloads")
        shown = browser.value("JSON.parse(document.getElementById('photos_data').textContent).photos.map(p => p.name)")
        seen = [camera for camera in cameras if camera.name in shown]
        browser.click(*browser.middle("[data-point=ruler]"))
        for boll, views in ((1, (0, 3)), (4, (5, 2))):
            for pane, view in enumerate(views, 1):
                click_in_photo(browser, pane, seen[view], bolls[boll].centre)
        browser.click(*browser.middle("[data-point=corner]"))
        for pane, view in ((1, 1), (2, 4)):
            click_in_photo(browser, pane, seen[view], bolls[3].centre)
        assert "above the table top" in browser.value("document.getElementById('hint').textContent")
        inside = [camera for camera in seen if (np.abs(camera.project(there[None])[0][0] / [160, 120] - 1) < 0.9).all()]
        for pane, camera in ((1, inside[0]), (2, inside[2])):
            click_in_photo(browser, pane, camera, there)
        words = said(browser)
        assert words[0].startswith("ruler ") and words[1] == "corner 3 of the table moved by 5.7 cm"
        saved = saved_by_clicks(browser, tmp_path / "downloads")
        browser.click(*browser.middle("#undo"))
        browser.click(*browser.middle("#undo"))
        assert browser.value("document.getElementById('mending').hidden")
        assert browser.complaints == []
    told_cm, error_cm = (float(words[0].split()[n]) for n in (1, 3))
    true_cm = float(np.linalg.norm(bolls[1].centre - bolls[4].centre) * scale.cm_per_su)
    assert told_cm == pytest.approx(true_cm, abs=0.1) and 0 < error_cm < 1
    copy, outcome = replayed_twice(reported_copy, saved, tmp_path)
    assert outcome.refused == () and read_scale(copy.scale_json).source == "corners"
    factor = read_scale(copy.scale_json).cm_per_su / scale.cm_per_su
    assert factor < 0.97
    assert outcome.lengths[0].length_cm == pytest.approx(told_cm * factor, abs=0.02)
    # What the page tells of the error is what the command line tells, but for that of the scale.
    assert outcome.lengths[0].error_cm == pytest.approx(error_cm, rel=0.5)


def click_in_view(browser, place):
    """Click where the 3D view shows a place of the page's frame, cm."""
    browser.middle("#scene")
    x, y, _ = browser.value(f"document.getElementById('scene').where({list(place)})")
    left, top = browser.value("(b => [b.x, b.y])(document.getElementById('scene').getBoundingClientRect())")
    browser.click(left + x, top + y)


def places_of(workspace, *bolls):
    rows = {row["boll_id"]: row for row in read_facts(workspace).bolls}
    return [[float(rows[boll][f"{axis}_cm"]) for axis in "xyz"] for boll in bolls]


def test_a_length_is_measured_in_3d(reported_copy, tmp_path):
    """Between the topmost boll and another, which the side view shows apart."""
    places = places_of(reported_copy, "1", "4")
    with Browser(tmp_path / "profile") as browser:
        browser.open(reported_copy.report_html)
        browser.wait("document.getElementById('scene').dataset.drawn === 'yes'", 120)
        browser.click(*browser.middle("#ruler"))
        for place in places:
            click_in_view(browser, place)
        (words,) = said(browser)
        told_cm, error_cm = (float(words.split()[n]) for n in (1, 3))
        assert told_cm == pytest.approx(np.linalg.norm(np.subtract(*places)), abs=2 * BOLL_RADIUS_CM)
        assert 0 < error_cm < 1
        assert told_cm == pytest.approx(
            float(browser.value("document.getElementById('measured').textContent").split()[0])
        )
        assert browser.complaints == []


def test_bolls_are_mended_where_the_3d_view_shows_them(reported_copy, tmp_path):
    """A boll is picked in the view; its panel has the buttons of its row, and merge takes the next boll."""
    (tmp_path / "downloads").mkdir()
    first, third, fourth = places_of(reported_copy, "1", "3", "4")
    with Browser(tmp_path / "profile") as browser:
        browser.open(reported_copy.report_html)
        browser.downloads_to(tmp_path / "downloads")
        browser.wait("document.getElementById('scene').dataset.drawn === 'yes'", 120)
        click_in_view(browser, third)
        browser.click(*browser.middle("#chosen [data-mend=merge]"))
        assert "one with boll 3" in browser.value("document.getElementById('chosen').textContent")
        click_in_view(browser, fourth)
        click_in_view(browser, first)
        browser.click(*browser.middle("#chosen [data-mend=delete]"))
        assert said(browser) == ["merge 3 + 4", "delete 1"]
        saved = saved_by_clicks(browser, tmp_path / "downloads")
        assert browser.complaints == []
    _, outcome = replayed_twice(reported_copy, saved, tmp_path)
    assert (outcome.before, outcome.after, outcome.refused) == (4, 2, ())
