# SPDX-License-Identifier: Apache-2.0
"""The pages in a real browser, by real input events."""

import numpy as np
import pytest
from scenes.chromium import Browser, executable
from scenes.report_page import HOSTILE, batch_row, batch_rows, fail, picture

from cotton3dg.report.facts import read_facts
from cotton3dg.report.index import index_page
from cotton3dg.report.page import make_report
from cotton3dg.workspace import Workspace

pytestmark = pytest.mark.skipif(
    executable() is None, reason="no Chromium; apt-get install chromium, or name one in COTTON3DG_CHROMIUM"
)

VIEW = "document.getElementById('scene').view()"


def on_screen(browser, place):
    """Where the 3D view shows a place of the page's frame, px; its middle must be on the screen."""
    browser.wait("document.getElementById('scene').dataset.drawn === 'yes'", 120)
    x, y, _ = browser.value(f"document.getElementById('scene').where({list(place)})")
    left, top = browser.value("(b => [b.x, b.y])(document.getElementById('scene').getBoundingClientRect())")
    return left + x, top + y


def saturated(drawn):
    """Number of pixels of strong colour."""
    return int((np.ptp(drawn.astype(int), axis=2) > 100).sum())


def test_the_page_works_in_a_browser(reported, tmp_path):
    with Browser(tmp_path / "profile") as browser:
        browser.open(reported.report_html)
        browser.wait("document.getElementById('scene').dataset.drawn === 'yes'", 120)
        # The 3D view draws: the plant's and the bolls' colours are in it.
        drawn = picture(browser.screenshot("#scene"))
        assert len(np.unique(drawn.reshape(-1, 3) // 32, axis=0)) > 20

        # Pointing at a boll tells its volume, a click chooses its row and shows its cut-outs.
        browser.middle("#scene")
        row = read_facts(reported).bolls[1]
        found = on_screen(browser, [float(row[f"{axis}_cm"]) for axis in "xyz"])
        browser.move(*found)
        browser.wait("document.querySelector('tr.touched')?.dataset.boll === '2'")
        told = browser.value("document.querySelector('#scene .tip').textContent")
        assert told.startswith("Boll 2: ")
        assert f"{row['volume_cm3']} ± {row['volume_error_cm3']} cm³" in told
        browser.click(*found)
        browser.wait("document.querySelector('tr.chosen')?.dataset.boll === '2'")
        assert browser.value("document.querySelectorAll('#chosen img').length") == 3
        assert "Boll 2" in browser.value("document.getElementById('chosen').textContent")
        assert browser.value("document.querySelector('#scene .boll.chosen').dataset.boll") == "2"

        # The keyboard chooses another one.
        browser.value("document.querySelector('tr[data-boll=\"1\"] button').focus()")
        browser.key("Enter")
        assert browser.value("document.querySelector('tr.chosen').dataset.boll") == "1"
        assert browser.value("document.querySelectorAll('tr.chosen').length") == 1

        # Bolls take the colours of their rows, outlines go, and the view turns.
        filmed = picture(browser.screenshot("#scene"))
        browser.click(*browser.middle("#outlines"))
        browser.click(*browser.middle("#bodies"))
        assert browser.value("document.getElementById('bodies').getAttribute('aria-pressed')") == "true"
        coloured = picture(browser.screenshot("#scene"))
        assert saturated(coloured) > saturated(filmed) + 100
        browser.click(*browser.middle("[data-eye=top]"))
        assert browser.value(f"{VIEW}.pitch") > 1.4

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


def test_the_view_never_keeps_the_wheel(reported, tmp_path):
    """Before a click the page scrolls; after it the view comes closer, within limits, and then the page scrolls on."""
    with Browser(tmp_path / "profile") as browser:
        browser.open(reported.report_html)
        x, y = on_screen(browser, [0, 0, 0])
        x, y = browser.middle("#scene")
        far, top = browser.value(f"{VIEW}.far"), browser.value("scrollY")
        browser.wheel(x, y, 120)
        browser.wait(f"scrollY > {top} + 50")
        assert browser.value(f"{VIEW}.far") == far

        x, y = browser.middle("#scene")
        top = browser.value("scrollY")
        browser.click(x - 250, y - 200)
        browser.wheel(x, y, -120)
        browser.wait(f"{VIEW}.far < {far} * 0.9")
        assert browser.value("scrollY") == top
        for _ in range(30):
            browser.wheel(x, y, 120)
        browser.wait(f"scrollY > {top} + 50")
        assert browser.value(f"{VIEW}.far") < 2 * far

        # Once the pointer has left, the wheel is the page's again.
        x, y = browser.middle("#scene")
        browser.click(x - 250, y - 200)
        browser.move(*browser.middle("h1"))
        x, y = browser.middle("#scene")
        browser.move(x, y)
        far, top = browser.value(f"{VIEW}.far"), browser.value("scrollY")
        browser.wheel(x, y, 120)
        browser.wait(f"scrollY > {top} + 50")
        assert browser.value(f"{VIEW}.far") == far


def test_two_fingers_turn_and_one_scrolls(reported, tmp_path):
    with Browser(tmp_path / "profile") as browser:
        browser.open(reported.report_html, 390, 800)
        browser.wait("document.getElementById('scene').dataset.drawn === 'yes'", 120)
        x, y = browser.middle("#scene")
        before, top = browser.value(VIEW), browser.value("scrollY")
        browser.touches("touchStart", (x - 40, y), (x + 40, y))
        for step in range(1, 6):
            browser.touches("touchMove", (x - 40 - 8 * step, y + 4 * step), (x + 40 + 16 * step, y + 4 * step))
        browser.touches("touchEnd")
        after = browser.value(VIEW)
        assert after["far"] < 0.8 * before["far"] and after["pitch"] > before["pitch"] + 0.05
        assert browser.value("[scrollY, visualViewport.scale]") == [top, 1]

        browser.swipe(x, y, -150)
        browser.wait(f"scrollY > {top} + 80")
        assert browser.value(VIEW) == after
        assert browser.complaints == []


def test_keys_turn_the_view_within_limits(reported, tmp_path):
    with Browser(tmp_path / "profile") as browser:
        browser.open(reported.report_html)
        browser.wait("document.getElementById('scene').dataset.drawn === 'yes'", 120)
        browser.middle("#scene")
        browser.value("document.getElementById('scene').focus({ preventScroll: true })")
        before, top = browser.value(VIEW), browser.value("scrollY")
        browser.key("ArrowLeft")
        assert np.linalg.norm(np.subtract(browser.value(VIEW)["eye"], before["eye"])) > 0.05 * before["far"]
        for _ in range(30):
            browser.key("ArrowUp")
        assert 1.3 < browser.value(VIEW)["pitch"] < np.pi / 2
        for _ in range(30):
            browser.key("ArrowDown")
        assert -0.3 < browser.value(VIEW)["pitch"] < 0
        assert browser.value("scrollY") == top


def test_numbers_of_bolls_in_the_view_stand_apart(reported, tmp_path):
    boxes = (
        "[...document.querySelectorAll('#scene text:not([hidden])')].map(text => text.getBoundingClientRect())"
        ".map(box => [box.left, box.top, box.right, box.bottom])"
    )
    with Browser(tmp_path / "profile") as browser:
        for width in (1280, 390):
            browser.open(reported.report_html, width, 800)
            browser.wait("document.getElementById('scene').dataset.drawn === 'yes'", 120)
            for face in ("side", "front", "top"):
                browser.click(*browser.middle(f"[data-eye={face}]"))
                browser.value("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
                shown = browser.value(boxes)
                assert len(shown) == 4
                for n, a in enumerate(shown):
                    for b in shown[n + 1 :]:
                        assert a[2] <= b[0] + 3 or b[2] <= a[0] + 3 or a[3] <= b[1] + 3 or b[3] <= a[1] + 3, (a, b)


def test_small_screens_and_no_webgl(reported, tmp_path):
    folder = reported.root.parent
    (folder / "index.html").write_text(index_page("field", folder, batch_rows()), encoding="utf-8")
    with Browser(tmp_path / "profile", webgl=False) as browser:
        for page in (folder / "index.html", reported.report_html):
            for dark in (False, True):
                browser.open(page, 390, 800, dark=dark)
                assert browser.value("document.documentElement.scrollWidth") <= 390
        assert "WebGL" in browser.value("document.querySelector('.fallback').textContent")
        assert browser.value("document.querySelector('#scene img').naturalWidth") > 400
        assert not browser.value("document.querySelector('#ruler').checkVisibility()")
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
