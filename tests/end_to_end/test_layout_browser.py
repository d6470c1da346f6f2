# SPDX-License-Identifier: Apache-2.0
"""How the pages lie on a phone and on paper, in a real browser."""

import re

import numpy as np
import pytest
from scenes.branch_scene import mapped
from scenes.chromium import Browser, executable
from scenes.filmed_scene import filmed_again, grown, leaning, save_film

from cotton3dg.evaluation.change_detection import compare
from cotton3dg.evaluation.change_detection_page import write_comparisons
from cotton3dg.evaluation.repeatability import repeat
from cotton3dg.evaluation.repeatability_page import write_repeats
from cotton3dg.io.skeleton import draw_map

pytestmark = pytest.mark.skipif(
    executable() is None, reason="no Chromium; apt-get install chromium, or name one in COTTON3DG_CHROMIUM"
)

BEYOND = """[...document.querySelectorAll('header *, main *, footer *')].filter(element => {
    const box = element.getBoundingClientRect();
    const scrolled = element.parentElement.closest('.scroll, .menu, svg');
    return element.checkVisibility() && !scrolled && box.width && (box.right > innerWidth + 1 || box.left < -1);
}).map(element => element.outerHTML.slice(0, 90))"""
"""Visible elements that leave the screen; what lies in a region that scrolls by itself is told apart."""
SMALL = """[...document.querySelectorAll('main button, .menu a')].filter(element => {
    const box = element.getBoundingClientRect();
    return element.checkVisibility() && box.width && (box.height < 44 || box.width < 44);
}).map(element => element.outerHTML.slice(0, 90))"""


@pytest.mark.parametrize("width", [360, 400])
def test_a_report_fits_a_phone_and_a_thumb(reported, tmp_path, width):
    with Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(reported.report_html, width, 800)
        browser.value("document.getElementById('fold').open = true")
        browser.click(*browser.middle("tr[data-boll='2'] th button"))
        assert browser.value("document.documentElement.scrollWidth") <= width
        assert browser.value(BEYOND) == []
        assert browser.value(SMALL) == []
        for region in (".scroll[aria-label='Table of bolls']", ".scroll[aria-label='Table of stages']"):
            wide, shown = browser.value(f'(e => [e.scrollWidth, e.clientWidth])(document.querySelector("{region}"))')
            assert wide <= shown, region
        # A card says what its figures are.
        label = "getComputedStyle(document.querySelector('tr[data-boll] td'), '::before').content"
        assert browser.value(label) == '"Volume cm³"'


def test_the_menu_stays_and_leads_to_all_parts(reported, tmp_path):
    with Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(reported.report_html, 400, 800)
        links = browser.value("[...document.querySelectorAll('.menu a')].map(a => a.getAttribute('href'))")
        assert {"#threed", "#boll_table", "#fold"} <= set(links)
        assert all(browser.value(f"document.querySelector('{link}') !== null") for link in links)
        browser.click(*browser.middle(".menu a[href='#boll_table']"))
        browser.wait("location.hash === '#boll_table'")
        menu = browser.value("document.querySelector('.menu').getBoundingClientRect().bottom")
        heading = browser.value("document.querySelector('#boll_table').getBoundingClientRect().top")
        assert 40 < menu <= heading < 400


def test_where_an_interval_stands_its_level_does(reported, tmp_path):
    ranges = re.findall(r'<span class="range">(.*?)</span>\s*([^<]*)', reported.report_html.read_text("utf-8"))
    assert len(ranges) >= 3
    assert all("95 %" in level for level, _ in ranges)


def test_folds_open_and_colours_stay_on_paper(reported, tmp_path):
    with Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(reported.report_html)
        assert not browser.value("document.getElementById('masks').checkVisibility()")
        assert browser.printed().startswith(b"%PDF")
        assert browser.value("document.getElementById('fold').open")
        browser.on_paper()
        for element in (".legend i", "tr[data-boll] .swatch", ".sure"):
            assert browser.value(f"getComputedStyle(document.querySelector('{element}')).printColorAdjust") == "exact"
        for element, shown in (("#scene img", True), (".menu", False), ("summary", False), ("#chosen", False)):
            assert browser.value(f"document.querySelector('{element}').checkVisibility()") == shown, element


def test_comparison_and_repeat_stay_within_the_screen(tmp_path):
    films = [tmp_path / ("a_long_name_of_a_folder_" * 3 + name) / "p1" for name in ("may", "june")]
    plant = grown(8, seed=4)
    for film, found in zip(films, (plant, filmed_again(plant, leaning(40))), strict=True):
        save_film(film, found, np.linspace(40, 75, 8), traits={"plant_height_cm": 70.0, "plant_height_error_cm": 0.5})
    write_comparisons(tmp_path / "comparison", compare(films))
    write_repeats(tmp_path / "repeat", repeat(films))
    with Browser(tmp_path / "profile", webgl=False) as browser:
        for page in ("comparison", "repeat"):
            browser.open(tmp_path / page / f"{page}.html", 400, 800)
            assert browser.value("document.querySelectorAll('.scroll table').length") >= 2
            assert browser.value(BEYOND) == [], page
            assert browser.value("document.documentElement.scrollWidth") <= 400


def test_a_plant_map_has_no_blank_bands_and_is_legible_on_a_phone(reported, tmp_path):
    page = tmp_path / "map.html"
    style = re.search(r"<style>(.*?)</style>", reported.report_html.read_text("utf-8"), re.S)[1]
    drawings = (("wide_map", draw_map(mapped())), ("narrow_map", draw_map(mapped(), most_px=360)))
    parts = "".join(f'<div class="{kind}">{drawn}</div>' for kind, drawn in drawings)
    page.write_text(
        f'<!DOCTYPE html><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<style>{style}</style>"
        f'<main><section class="plantmap">{parts}</section></main>',
        encoding="utf-8",
    )
    shape = """[...document.querySelectorAll('.plantmap svg')].filter(svg => svg.checkVisibility()).map(svg => {
        const [box, view] = [svg.getBoundingClientRect(), svg.viewBox.baseVal];
        const letters = Math.min(...[...svg.querySelectorAll('text')].map(text => parseFloat(text.style.fontSize)));
        return [box.width / box.height, view.width / view.height, letters * box.width / view.width];
    })"""
    with Browser(tmp_path / "profile", webgl=False) as browser:
        for width in (400, 1280):
            browser.open(page, width, 800)
            ((drawn, wanted, letters_px),) = browser.value(shape)
            assert drawn == pytest.approx(wanted, rel=0.02)
            assert letters_px >= 9.5
