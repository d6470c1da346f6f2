# SPDX-License-Identifier: Apache-2.0
"""The pages of `cotton3dg view` in a real browser, by real input events."""

import shutil

import pytest
from scenes.chromium import Browser, executable
from scenes.tiny_plant import OPTIONS
from scenes.viewed import viewed

from cotton3dg.io.tables import read_rows
from cotton3dg.schemas.corrections import Corrections

pytestmark = pytest.mark.skipif(
    executable() is None, reason="no Chromium; apt-get install chromium, or name one in COTTON3DG_CHROMIUM"
)
ANSWER_S = 600
"""A busy machine must not fail what works."""
BOLLS = "[...document.querySelectorAll('tr[data-boll]')].map(row => row.dataset.boll).join(' ')"
NOTE = "document.querySelector('#mending p').textContent"
AXES = "document.getElementById('scene').view().axes.flat().join(' ')"


def measured(browser, bolls, note):
    """Until the page has been read anew with these bolls."""
    browser.wait(
        f"document.readyState === 'complete' && {BOLLS} === '{bolls}' && {NOTE}.startsWith('{note},')", ANSWER_S
    )


def test_two_clicks_mend_a_boll_and_two_take_it_back(reported_copy, tmp_path):
    """Nothing is downloaded or typed; the 3D view draws under the policy of the server."""
    with viewed(reported_copy.root) as page, Browser(tmp_path / "profile") as browser:
        browser.open(page.server.address)
        browser.wait("document.querySelector('#plants a') !== null", ANSWER_S)
        assert "done" in browser.value("document.querySelector('#plants td').textContent")
        browser.click(*browser.middle("#plants a"))
        browser.wait(f"document.readyState === 'complete' && {BOLLS} === '1 2 3 4'", ANSWER_S)
        browser.wait("document.getElementById('scene').dataset.drawn === 'yes'", ANSWER_S)
        assert browser.value("document.getElementById('mending').hidden")
        browser.click(*browser.middle("[data-eye=front]"))
        turned = browser.value(AXES)
        browser.value("addEventListener('pagehide', () => { sessionStorage.inert = document.body.inert; })")
        browser.click(*browser.middle("tr[data-boll='3'] th button"))
        browser.click(*browser.middle("tr[data-boll='4'] [data-mend=merge]"))
        measured(browser, "1 2 3", "Bolls: 4 → 3")
        # A click on the page that goes would be lost. The one that comes shows the plant as it was turned.
        assert browser.value("sessionStorage.inert") == "true" and not browser.value("document.body.inert")
        browser.wait("document.getElementById('scene').dataset.drawn === 'yes'", ANSWER_S)
        assert browser.value(AXES) == turned
        assert browser.value("document.querySelector('.cards b').textContent.trim()") == "3"
        assert browser.value("document.getElementById('save').hidden")
        browser.click(*browser.middle("tr[data-boll='1'] [data-mend=delete]"))
        measured(browser, "2 3", "Bolls: 3 → 2")
        said = "[...document.querySelectorAll('#correction_list li')].map(item => item.textContent).join()"
        assert browser.value(said) == "merge 3 + 4,delete 1"
        kept = Corrections.load(reported_copy.corrections_json)
        assert [correction.summary for correction in kept.corrections] == ["merge 3 + 4", "delete 1"]
        assert read_rows(reported_copy.traits_csv)[0]["boll_count"] == "2"
        browser.click(*browser.middle("#undo"))
        measured(browser, "1 2 3", "Bolls: 2 → 3")
        browser.click(*browser.middle("#undo"))
        measured(browser, "1 2 3 4", "Bolls: 3 → 4")
        assert browser.value("document.getElementById('undo').disabled")
        assert not reported_copy.corrections_json.exists()
        assert browser.complaints == []
        own = page.server.address.removesuffix("/")
        assert {request for request in browser.requests if not request.startswith((own, "data:", "blob:"))} == set()


def test_while_a_run_goes_on_the_page_says_so_and_keeps_nothing(reported_copy, tmp_path):
    with viewed(reported_copy.root) as page, Browser(tmp_path / "profile", webgl=False) as browser:
        with reported_copy.locked():
            browser.open(f"{page.server.address}plant_017/report.html")
            browser.click(*browser.middle("tr[data-boll='1'] [data-mend=delete]"))
            browser.wait(
                f"document.readyState === 'complete' && {NOTE}.startsWith('Not done: another cotton3dg')", ANSWER_S
            )
        assert browser.value(BOLLS) == "1 2 3 4" and not reported_copy.corrections_json.exists()


def test_a_film_is_added_and_checked_without_a_shell(reported, tmp_path):
    shutil.copytree(reported.root, tmp_path / "field" / "plant_017")
    (tmp_path / "downloads").mkdir()
    with viewed(tmp_path / "field") as page, Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(page.server.address)
        browser.downloads_to(tmp_path / "downloads")
        browser.wait("document.querySelectorAll('#plants tr').length === 1", ANSWER_S)
        (tmp_path / "My walk.mp4").write_text("film")
        browser.drop(tmp_path / "My walk.mp4", *browser.middle("#plants"))
        browser.write("plant_018")
        browser.click(*browser.middle("#add button"))
        browser.wait("document.querySelectorAll('#plants tr').length === 2", ANSWER_S)
        assert "plant_018 is there" in browser.value("document.getElementById('message').textContent")
        assert [film.read_text() for film in (tmp_path / "field" / "plant_018").iterdir()] == ["film"]
        browser.click(*browser.middle("#plants tr:nth-child(2) button"))
        browser.wait("document.querySelector('#plants tr:nth-child(2) span.red a')?.textContent === 'red'", ANSWER_S)
        browser.click(*browser.middle('[data-saves="batch.csv"]'))
        browser.wait("!document.getElementById('overview').hidden", ANSWER_S)
        # On a phone's width only the table scrolls.
        browser.open(page.server.address, 390, 800)
        browser.wait("document.querySelectorAll('#plants tr').length === 2", ANSWER_S)
        assert browser.value("document.documentElement.scrollWidth") == 390
        assert browser.complaints == []
        for plant in ("plant_017", "plant_018"):
            assert plant in (tmp_path / "field" / "batch.csv").read_text()


@pytest.mark.slow
def test_a_dropped_film_ends_as_a_row(filmed, tmp_path):
    """Dropped, named, measured and corrected, all by hand: the rows are those of the files."""
    field, shown = tmp_path / "field", "[...document.querySelectorAll('#plants tr')].map(row => row.innerText).join()"
    field.mkdir()
    (field / "cotton3dg.toml").write_text(OPTIONS)
    with viewed(field) as page, Browser(tmp_path / "profile") as browser:
        browser.open(page.server.address)
        browser.wait("!document.getElementById('none').hidden", ANSWER_S)
        browser.drop(filmed / "video.mp4", *browser.middle("#plants"))
        browser.write("plant_031")
        browser.click(*browser.middle("#add button"))
        browser.wait("document.querySelectorAll('#plants tr').length === 1", ANSWER_S)
        browser.click(*browser.middle("#plants [data-job=run]"))
        browser.wait("!document.querySelector('[data-job=stop]').hidden", ANSWER_S)
        browser.click(*browser.middle("#plants [data-job=stop]"))
        browser.wait("document.querySelector('[data-job=stop]').hidden", ANSWER_S)
        browser.click(*browser.middle("#plants [data-job=run]"))
        browser.wait("document.querySelector('#plants td').textContent.includes('done')", ANSWER_S)
        (row,) = read_rows(field / "plant_031" / "traits" / "traits.csv")
        assert int(row["boll_count"]) > 1 and row["plant_id"] == "plant_031"
        assert row["boll_count"] in browser.value(shown)
        browser.click(*browser.middle("#plants a"))
        browser.wait("document.readyState === 'complete' && document.getElementById('mending')?.hidden", ANSWER_S)
        browser.click(*browser.middle("tr[data-boll='1'] [data-mend=delete]"))
        fewer = str(int(row["boll_count"]) - 1)
        browser.wait(f"document.readyState === 'complete' && {NOTE}.includes(' → {fewer},')", ANSWER_S)
        (corrected,) = read_rows(field / "plant_031" / "traits" / "traits.csv")
        assert corrected["boll_count"] == fewer
        assert browser.complaints == []


def test_neither_another_site_nor_a_hostile_report_can_act(reported_copy, tmp_path):
    """A page from disk that knows the whole address, and a report of somebody else with a script of its own."""
    acts = "fetch('{}plant_017/undo', {{ method: 'POST', headers: {{ 'Content-Type': '{}' }}, body: '{{}}'{} }})"
    outcome = ".then(answer => 'answer ' + answer.status).catch(() => 'refused')"
    Corrections().save(reported_copy.corrections_json)
    kept = reported_copy.corrections_json.read_bytes()
    with viewed(reported_copy.root) as page, Browser(tmp_path / "profile", webgl=False) as browser:
        (tmp_path / "other.html").write_text("<title>another site</title>")
        browser.open(tmp_path / "other.html")
        address = page.server.address
        assert browser.value(acts.format(address, "application/json", "") + outcome) == "refused"
        assert browser.value(acts.format(address, "text/plain", ", mode: 'no-cors'") + outcome) == "refused"
        framed = f"document.body.append(Object.assign(document.createElement('iframe'), {{ src: '{address}' }}))"
        browser.value(framed)
        hostile = "<html lang=\"en\"><script>document.title = 'ran';</script>"
        reported_copy.report_html.write_text(hostile)
        browser.open(f"{address}plant_017/report.html")
        assert browser.value("document.title") == "ran" and browser.value("window.origin") == "null"
        assert browser.value(acts.format(address, "application/json", "") + outcome) == "refused"
        assert page.json("plant_017/corrections") == {"kept": [], "message": ""}
        assert reported_copy.corrections_json.read_bytes() == kept
