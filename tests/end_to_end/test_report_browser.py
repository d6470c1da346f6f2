"""The pages in a real browser, by real input events."""

import shutil
import time

import numpy as np
import pytest
from scenes.chromium import Browser, executable
from scenes.report_page import HOSTILE, batch_row, batch_rows, fail, picture
from scenes.table_scene import BOLL_RADIUS_CM

from cotton3dg.commands.correct import Asked, correct
from cotton3dg.documents.bolls import read_bolls
from cotton3dg.documents.scale import read_scale
from cotton3dg.files.colmap import read_cameras
from cotton3dg.files.tables import read_rows
from cotton3dg.report.facts import read_facts
from cotton3dg.report.index import index_page
from cotton3dg.report.page import make_report
from cotton3dg.workspace import Workspace

pytestmark = pytest.mark.skipif(
    executable() is None, reason="no Chromium; apt-get install chromium, or name one in COTTON3DG_CHROMIUM"
)


def test_the_page_works_in_a_browser(reported, tmp_path):
    with Browser(tmp_path / "profile") as browser:
        browser.open(reported.report_html)
        browser.wait("document.getElementById('scene').dataset.drawn === 'yes'", 120)
        # The 3D view draws: the plant's and the bolls' colours are in it.
        drawn = picture(browser.screenshot("#scene"))
        assert len(np.unique(drawn.reshape(-1, 3) // 32, axis=0)) > 20

        # Pointing at a boll tells its volume, a click chooses its row and shows its cut-outs.
        x0, y0 = browser.middle("#scene")
        found = None
        for dy in range(-220, 221, 11):
            for dx in range(-170, 171, 11):
                browser.move(x0 + dx, y0 + dy)
                if browser.value("document.querySelector('tr.touched')?.dataset.boll"):
                    found = x0 + dx, y0 + dy
                    break
            if found:
                break
        assert found, "no boll answers the pointer"
        browser.wait("document.querySelector('#scene .hovertext')")
        boll = browser.value("document.querySelector('tr.touched').dataset.boll")
        told = browser.value("document.querySelector('#scene .hovertext').textContent")
        assert f"Boll {boll}" in told
        row = read_facts(reported).bolls[int(boll) - 1]
        assert f"{row['volume_cm3']} ± {row['volume_error_cm3']} cm³" in told
        browser.click(*found)
        browser.wait(f"document.querySelector('tr.chosen')?.dataset.boll === '{boll}'")
        assert browser.value("document.querySelectorAll('#chosen img').length") == 3
        assert f"Boll {boll}" in browser.value("document.getElementById('chosen').textContent")

        # The keyboard chooses another one.
        other = "1" if boll != "1" else "2"
        browser.value(f"document.querySelector('tr[data-boll=\"{other}\"] button').focus()")
        browser.key("Enter")
        assert browser.value("document.querySelector('tr.chosen').dataset.boll") == other
        assert browser.value("document.querySelectorAll('tr.chosen').length") == 1

        # The bolls' bodies give way to the lint, and the view turns.
        browser.click(*browser.middle("#bodies"))
        assert browser.value("document.getElementById('bodies').getAttribute('aria-pressed')") == "false"
        browser.click(*browser.middle("[data-eye=top]"))
        browser.wait("document.getElementById('scene')._fullLayout.scene._scene.getCamera().eye.z > 1.5")

        # A heading sorts, and again the other way round.
        order = "[...document.querySelectorAll('tr[data-boll]')].map(row => Number(row.cells[3].dataset.value))"
        heading = "table.sortable th:nth-child(4) button"
        browser.click(*browser.middle(heading))
        heights = browser.value(order)
        assert heights == sorted(heights)
        browser.click(*browser.middle(heading))
        assert browser.value(order) == heights[::-1]
        assert browser.value("document.querySelector('th:nth-child(4)').getAttribute('aria-sort')") == "descending"

        # The slider uncovers the render, by pointer and by keys.
        x, y = browser.middle(".compare")
        width = browser.value("document.querySelector('.compare').offsetWidth")
        browser.press(x, y)
        browser.move(x + 0.3 * width, y, pressed=True)
        browser.release(x + 0.3 * width, y)
        split = "parseFloat(document.querySelector('.compare').style.getPropertyValue('--split'))"
        assert browser.value(split) == pytest.approx(80, abs=6)
        before = browser.value(split)
        browser.key("ArrowLeft")
        assert browser.value(split) == before - 1

        # A picture opens large and closes again.
        browser.click(*browser.middle("button.zoom"))
        assert browser.value("document.getElementById('large').open")
        browser.click(*browser.middle("#large button"))
        assert not browser.value("document.getElementById('large').open")

        # Dark follows the system, also in 3D.
        browser.colours(dark=True)
        browser.wait("getComputedStyle(document.body).backgroundColor === 'rgb(20, 24, 27)'")
        assert picture(browser.screenshot("#scene"))[5, 5].max() < 80
        assert browser.complaints == []
        assert [url for url in browser.requests if not url.startswith(("data:", "blob:"))] == [
            reported.report_html.resolve().as_uri()
        ]


def test_small_screens_and_no_webgl(reported, tmp_path):
    folder = reported.root.parent
    (folder / "index.html").write_text(index_page("field", folder, batch_rows()), encoding="utf-8")
    with Browser(tmp_path / "profile", webgl=False) as browser:
        for page in (folder / "index.html", reported.report_html):
            for dark in (False, True):
                browser.open(page, 390, 800, dark=dark)
                assert browser.value("document.documentElement.scrollWidth") <= 390
        assert "WebGL" in browser.value("document.querySelector('.fallback').textContent")
        browser.click(*browser.middle("tr[data-boll='2'] button"))
        assert browser.value("document.querySelector('tr.chosen').dataset.boll") == "2"
        assert browser.complaints == []


LUMINANCE = """(colour => {
    const [r, g, b] = colour.match(/[\\d.]+/g).slice(0, 3).map(v => v / 255)
        .map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
})"""


def test_text_is_legible_in_light_and_dark(reported, tmp_path):
    """WCAG 2.1 asks for a contrast of 4.5."""
    with Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(reported.report_html)
        for dark in (False, True):
            browser.colours(dark=dark)
            for text, ground in (
                ("body", "body"),
                (".soft", ".card"),
                (".flags strong", ".alarm, section:not(.bare)"),
                ("th", ".long"),
            ):
                lights = [
                    browser.value(f"{LUMINANCE}(getComputedStyle(document.querySelector({element!r})).{name})")
                    for element, name in ((text, "color"), (ground, "backgroundColor"))
                ]
                assert (max(lights) + 0.05) / (min(lights) + 0.05) > 4.5, (dark, text)


def test_a_keyboard_is_enough(reported, tmp_path):
    focused = "document.activeElement"
    with Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(reported.report_html)
        browser.key("Tab")
        assert browser.value(f"{focused}.textContent") == "To the table of bolls"
        browser.key("Enter")
        assert browser.value("location.hash") == "#bolls"
        for _ in range(60):
            browser.key("Tab")
            where = browser.value(f"{focused}.closest('tr[data-boll=\"3\"]') && {focused}.tagName")
            if where == "BUTTON":
                browser.key("Enter")
                break
        assert browser.value("document.querySelector('tr.chosen').dataset.boll") == "3"
        browser.value("document.querySelector('button.zoom').focus()")
        browser.key("Enter")
        assert browser.value("document.getElementById('large').open")
        assert browser.value(f"{focused}.closest('dialog') !== null")
        browser.key("Escape")
        assert not browser.value("document.getElementById('large').open")
        assert browser.value(f"{focused}.className") == "zoom"
        assert browser.complaints == []


def test_paper_shows_what_the_screen_shows(reported, tmp_path):
    with Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(reported.report_html)
        browser.on_paper()
        shown = "(e => getComputedStyle(e).display !== 'none')(document.querySelector({!r}))"
        for element in (".cards", "tr[data-boll]", ".compare .over", ".flags", "#walk ~ .map svg"):
            assert browser.value(shown.format(element)), element
        for element in (".tools", ".compare input", ".skip"):
            assert not browser.value(shown.format(element)), element
        assert browser.value("getComputedStyle(document.querySelector('.compare .over')).clipPath") == "none"
        assert browser.value("document.querySelector('.scroll').scrollWidth") <= 1280
        browser.on_paper(on=False)
        pdf = browser.printed()
        assert pdf.startswith(b"%PDF")
        assert 2 <= pdf.count(b"/Type /Page\n") + pdf.count(b"/Type /Page ") + pdf.count(b"/Type /Page/") <= 8


def test_the_list_to_film_prints_alone(tmp_path):
    rows = [*batch_rows(), batch_row("dark", qc_flags="underexposed")]
    (tmp_path / "index.html").write_text(index_page("field", tmp_path, rows), encoding="utf-8")
    with Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(tmp_path / "index.html")
        browser.value("(window.print = () => { window.printed = (window.printed || 0) + 1; })")
        browser.click(*browser.middle("#print_list"))
        assert browser.value("window.printed") == 1
        browser.on_paper()
        shown = "[...document.querySelectorAll('main > section')].filter(e => e.offsetHeight).map(e => e.id)"
        assert browser.value(shown) == ["to_film"]
        assert browser.value("document.querySelector('h1').offsetHeight") > 0
        browser.on_paper(on=False)
        browser.value("window.dispatchEvent(new Event('afterprint'))")
        browser.on_paper()
        assert len(browser.value(shown)) > 2
        assert browser.complaints == []


def test_a_hostile_plant_does_nothing_in_a_browser(tmp_path):
    folder = tmp_path / "plants"
    folder.mkdir()
    workspace = Workspace(folder)
    fail(workspace, "frames", HOSTILE)
    make_report(workspace)
    (folder / "index.html").write_text(index_page(HOSTILE, folder, batch_rows()), encoding="utf-8")
    with Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(workspace.report_html)
        assert browser.value("document.title") == "plants – cotton3dg"
        assert browser.value("document.querySelector('.alarm strong').textContent") in HOSTILE
        browser.open(folder / "index.html")
        assert browser.value("document.title") == f"{HOSTILE} – cotton3dg"

        # The index: sort by height, choose traits, find a plant by its dot.
        order = "[...document.querySelectorAll('td[data-trait=plant_height_cm]')].map(cell => cell.dataset.value)"
        browser.click(*browser.middle("table.sortable th:nth-child(6) button"))
        heights = browser.value(order)
        assert heights[-1] == ""  # the failed plant has none
        assert [float(value) for value in heights[:-1]] == sorted(float(value) for value in heights[:-1])
        assert browser.value("document.querySelectorAll('#scatter circle').length") == 7
        browser.click(*browser.middle("#scatter circle.odd"))
        assert browser.value("document.querySelector('tr.chosen th').textContent") == "sp ace/#%"
        assert "160" in browser.value("document.getElementById('pointed').textContent")
        assert browser.complaints == []
        assert len([url for url in browser.requests if not url.startswith("data:")]) == 1


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
    return browser.value("[...document.querySelectorAll('#said li')].map(item => item.textContent)")


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


def test_a_wrong_merge_and_a_false_boll_are_mended_by_two_clicks_each(reported_copy, tmp_path):
    """Bolls 3 and 4 are one and boll 1 is none, by real clicks; what is saved replays to the same bytes twice."""
    (tmp_path / "downloads").mkdir()
    with Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(reported_copy.report_html)
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


ON_SCREEN = """(place => {{
    const scene = document.getElementById('scene')._fullLayout.scene._scene;
    const {{ model, view, projection }} = scene.glplot.cameraParams;
    const times = (m, v) => [0, 1, 2, 3].map(row => v.reduce((sum, x, k) => sum + m[row + 4 * k] * x, 0));
    const at = place.map((x, n) => x * scene.dataScale[n]);
    const [x, y, z, w] = times(projection, times(view, times(model, [...at, 1])));
    const box = document.querySelector('#scene .gl-container canvas, #scene canvas').getBoundingClientRect();
    return [box.x + (1 + x / w) / 2 * box.width, box.y + (1 - y / w) / 2 * box.height];
}})([{}, {}, {}])"""
"""Where a place of the 3D view is on the screen, by Plotly's own matrices."""


def test_a_length_is_measured_in_3d(reported_copy, tmp_path):
    """Between the topmost boll and another, which the side view shows apart."""
    rows = {row["boll_id"]: row for row in read_facts(reported_copy).bolls}
    places = [[float(rows[boll][f"{axis}_cm"]) for axis in "xyz"] for boll in ("1", "4")]
    with Browser(tmp_path / "profile") as browser:
        browser.open(reported_copy.report_html)
        browser.wait("document.getElementById('scene').dataset.drawn === 'yes'", 120)
        browser.click(*browser.middle("#ruler"))
        browser.middle("#scene")
        for boll, place in zip(("1", "4"), places, strict=True):
            x, y = browser.value(ON_SCREEN.format(*place))
            browser.move(x + 2, y + 2)
            browser.wait(f"document.querySelector('tr.touched')?.dataset.boll === '{boll}'")
            browser.click(x, y)
        (words,) = said(browser)
        told_cm, error_cm = (float(words.split()[n]) for n in (1, 3))
        assert told_cm == pytest.approx(np.linalg.norm(np.subtract(*places)), abs=2 * BOLL_RADIUS_CM)
        assert 0 < error_cm < 1
        assert told_cm == pytest.approx(
            float(browser.value("document.getElementById('measured').textContent").split()[0])
        )
        assert browser.complaints == []
