"""The pages of a plant and of a batch: what they say, what they must never do, and what they do in a browser."""

import base64
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest
from chromium import Browser, executable
from finished_scene import N_BOLLS, UNPLACED, finished_workspace, record

from cotton3dg import pipeline
from cotton3dg.errors import BadInput, CaptureFailed
from cotton3dg.files.tables import TRAITS
from cotton3dg.options import STAGE_OPTIONS
from cotton3dg.report import page as report_page
from cotton3dg.report.advice import FLAGS, capture_advice, meaning
from cotton3dg.report.facts import read_facts
from cotton3dg.report.index import index_page, robust_z
from cotton3dg.report.page import make_report, plant_page, stale
from cotton3dg.workspace import Workspace

HOSTILE = "<img src=x onerror=document.title='owned'>\"'&{{7*7}}</script><script>document.title='owned'</script>"

needs_browser = pytest.mark.skipif(
    executable() is None, reason="no Chromium; apt-get install chromium, or name one in COTTON3DG_CHROMIUM"
)


class Page(HTMLParser):
    """Tags, their attributes and the text outside of scripts and styles."""

    def __init__(self, text: str):
        super().__init__(convert_charrefs=True)
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._silent = 0
        self.feed(text)
        self.text = " ".join(self.text.split())

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._silent += tag in ("script", "style")

    def handle_endtag(self, tag):
        self._silent -= tag in ("script", "style")

    def handle_data(self, data):
        self.text += "" if self._silent else data + " "

    def count(self, tag, **wanted):
        return sum(name == tag and all(found.get(k) == v for k, v in wanted.items()) for name, found in self.tags)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A finished plant with its page; tests must not change it."""
    workspace = finished_workspace(tmp_path_factory.mktemp("batch") / "plant_017")
    make_report(workspace)
    return workspace


@pytest.fixture
def workspace(made, tmp_path):
    """A copy that may be changed."""
    shutil.copytree(made.root, tmp_path / "plant_017")
    return Workspace(tmp_path / "plant_017")


def fail(workspace, stage, error):
    workspace.write_record(stage, {"stage": stage, "status": "failed", "error": error, "exit_code": 4, "seconds": 3.0})


def test_the_page_tells_traits_flags_bolls_walk_and_stages(made):
    text = made.report_html.read_text(encoding="utf-8")
    seen = Page(text)
    traits = read_facts(made).traits
    assert "plant_017" in seen.text
    assert f"{float(traits['plant_height_cm']):.1f} cm" in seen.text
    assert "±" in seen.text
    for flag in ("few_frames_registered", "orbit_gap"):
        assert FLAGS[flag].title in seen.text
        assert FLAGS[flag].action in seen.text
    assert [found["data-boll"] for name, found in seen.tags if "data-boll" in found] == ["1", "2", "3", "4"]
    assert seen.count("input", type="range") == 3
    assert "16 of 17 frames could be placed" in seen.text
    assert "330° around the plant" in seen.text
    assert f"{UNPLACED} at 8.0 s" in text
    for stage in STAGE_OPTIONS:
        assert stage in seen.text
    assert seen.text.count("321") == len(STAGE_OPTIONS)
    scene = json.loads(re.search(r'id="scene_data">(.*?)</script>', text, re.S)[1])
    assert [boll["id"] for boll in scene["bolls"]] == [1, 2, 3, 4]
    centres = {row["boll_id"]: [float(row[f"{axis}_cm"]) for axis in "xyz"] for row in read_facts(made).bolls}
    for boll in scene["bolls"]:
        assert boll["centre"] == pytest.approx(centres[str(boll["id"])], abs=0.3)


def test_bodies_in_3d_have_the_measured_volumes(made):
    from scipy.spatial import ConvexHull

    text = made.report_html.read_text(encoding="utf-8")
    scene = json.loads(re.search(r'id="scene_data">(.*?)</script>', text, re.S)[1])
    volumes = {row["boll_id"]: float(row["volume_cm3"]) for row in read_facts(made).bolls}
    for boll in scene["bolls"]:
        axes = [np.frombuffer(base64.b64decode(axis), np.float32) for axis in boll["corners"]]
        assert ConvexHull(np.stack(axes, 1)).volume == pytest.approx(volumes[str(boll["id"])], rel=1e-3)


def test_the_page_is_small_closed_and_accessible(made):
    assert made.report_html.stat().st_size < 15e6
    text = made.report_html.read_text(encoding="utf-8")
    seen = Page(text)
    (policy,) = [found["content"] for name, found in seen.tags if "http-equiv" in found]
    assert policy.startswith("default-src 'none'; img-src data: blob:;")
    assert "unsafe" not in policy.partition("script-src")[2]
    for tag, found in seen.tags:
        for key in ("src", "href"):
            assert (found.get(key) or "data:").startswith(("data:", "#")), (tag, found)
        assert not [key for key in found if key.startswith("on")]
    assert all("alt" in found for tag, found in seen.tags if tag == "img")
    assert seen.count("html", lang="en") == seen.count("h1") == seen.count("main") == 1
    assert all("aria-label" in found for tag, found in seen.tags if tag in ("input", "svg"))


def test_a_hostile_name_and_hostile_metadata_are_only_text(made, tmp_path):
    name = HOSTILE.replace("/", "∕")
    shutil.copytree(made.root, tmp_path / name)
    workspace = Workspace(tmp_path / name)
    facts = json.loads(workspace.frames_json.read_text())
    facts["file"] = facts["video"]["width"] = facts["images"][0]["timestamp_s"] = HOSTILE
    facts["images"][1]["name"] = "../../" + HOSTILE
    workspace.frames_json.write_text(json.dumps(facts))
    harmless = workspace.traits_csv.read_text().replace("orbit_gap", "<b>flag</b>")
    workspace.traits_csv.write_text(harmless)
    entry = workspace.read_record("scale")
    workspace.write_record("scale", entry | {"flags": [HOSTILE], "warnings": [HOSTILE], "summary": {HOSTILE: HOSTILE}})
    text = plant_page(workspace, failure=HOSTILE)
    seen = Page(text)
    assert HOSTILE in seen.text
    assert seen.count("img", src="x") == 0
    assert seen.count("b") == 4  # the cards' figures
    assert "49" not in re.findall(r"\{\{.*?\}\}|>49<", text)
    assert seen.count("script") == 4  # plotly, the page's two, the data


def test_failures_are_explained_with_what_there_is(workspace):
    fail(workspace, "sfm", "7 of 17 frames registered (40 % needed); film one slow full turn")
    seen = Page(plant_page(workspace))
    assert "No result" in seen.text
    assert "7 of 17 frames registered (40 % needed)" in seen.text
    assert "What to do: film one slow full turn" in seen.text
    assert "Every boll that was counted" not in seen.text  # bolls of an earlier video
    assert seen.count("img") == 11  # the strip of frames, and the empty one that enlarges
    assert "out of date" in seen.text


def test_results_of_other_inputs_are_not_shown(workspace):
    entry = workspace.read_record("train")
    workspace.write_record("train", entry | {"outputs": entry["outputs"] | {"train/gaussians.ply": "another"}})
    facts = read_facts(workspace)
    assert [item.state for item in facts.stages] == ["done"] * 4 + ["outdated"] * 4
    assert not facts.traits
    assert "segment" in facts.failure


def test_without_scale_and_without_bolls_the_page_says_so(workspace):
    from cotton3dg.options import resolve
    from cotton3dg.stages import cluster, segment, traits

    with workspace.writing("scale") as made:
        (made / "scale.json").write_text(json.dumps({"source": "none", "reason": "no table"}))
    record(workspace, "scale", ("no_scale",))
    traits.run(workspace, resolve("traits"))
    record(workspace, "traits")
    seen = Page(plant_page(workspace))
    assert "Counted only" in seen.text
    assert "No scale: no table" in seen.text
    assert '"unit": "scene units"' in plant_page(workspace)
    for path in workspace.folder("masks").glob("*.png"):
        cv2.imwrite(str(path), np.zeros((240, 320), np.uint16))
    record(workspace, "masks", ("no_masks",))
    for module in (segment, cluster, traits):
        stage = module.__name__.rpartition(".")[2]
        outcome = module.run(workspace, resolve(stage))
        record(workspace, stage, outcome.flags)
        if stage == "cluster":
            record(workspace, "scale", ("no_scale",))
    seen = Page(plant_page(workspace))
    assert "No bolls were found" in seen.text
    assert "What to do: Look at the photos" in seen.text
    assert seen.count("table") == 1  # no table of bolls


def test_a_folder_without_anything_has_a_page(tmp_path):
    seen = Page(plant_page(Workspace(tmp_path)))
    assert "no video" in seen.text
    assert "What to do: copy the plant's video here" in seen.text


@pytest.mark.parametrize(
    "file",
    [
        "train/gaussians.ply",
        "cluster/bolls.json",
        "segment/selections.npz",
        "masks/000003.png",
        "traits/bolls.csv",
        "sfm/sfm.json",
    ],
)
def test_a_damaged_file_costs_its_parts_only(workspace, file):
    (workspace.root / file).write_bytes(b"damaged")
    seen = Page(plant_page(workspace))
    assert "Plant height" in seen.text
    assert "Every boll that was counted" in seen.text
    assert "The walk around the plant" in seen.text


def test_every_flag_of_the_stages_has_words():
    from pathlib import Path

    source = "".join(path.read_text() for path in Path(pipeline.__file__).parent.glob("stages/*.py"))
    source += "".join(path.read_text() for path in Path(pipeline.__file__).parent.glob("plant/*.py"))
    appended = set(re.findall(r'(?<!doubts )flags(?:\.append\(| \+= \()"([a-z_]+)"', source))
    assert len(appended) > 10
    assert appended <= FLAGS.keys(), appended - FLAGS.keys()
    assert meaning("new_flag").title == "new flag"


@pytest.mark.parametrize(
    ("found", "good", "text"),
    [
        ({"on": False, "spread_pct": 0.22, "error_pct": 0.15, "visible_from_pct": 1.0}, True, "steady: 0.2 % (± 0.1"),
        ({"on": True, "spread_pct": 7.8, "error_pct": 0.2, "visible_from_pct": 1.0}, False, "drifted by 7.8 % (± 0.2"),
        ({"on": False, "spread_pct": 0.0, "error_pct": None, "visible_from_pct": 1.0}, True, "steady"),
    ],
)
def test_the_evidence_for_effects_is_shown(made, found, good, text):
    facts = replace(read_facts(made), effects={"exposure": found})
    (item,) = [item for item in capture_advice(facts) if item.topic == "Exposure"]
    assert item.good is good
    assert text in item.text


def test_a_forced_effect_needs_no_evidence(made):
    facts = replace(read_facts(made), effects={"exposure": {"option": "off", "on": False}})
    assert "Exposure" not in {item.topic for item in capture_advice(facts)}


def test_advice_names_what_this_video_lacks(made):
    facts = read_facts(made)
    advice = {item.topic: item for item in capture_advice(facts, [8.0, 9.0, 40.0])}
    assert not advice["Walk"].good
    assert "widest gap is 45°" in advice["Walk"].text
    assert not advice["Placed frames"].good
    assert not advice["Distance"].good
    assert not advice["Sharpness"].good
    assert "from 7.0 to 8.0 s" in advice["Sharpness"].text
    assert advice["Light"].good
    assert advice["Table"].good
    states = [item.good for item in capture_advice(facts)]
    assert states == sorted(states)


def test_run_makes_the_page_once_and_never_fails_by_it(workspace, monkeypatch):
    class Ears(pipeline.Watcher):
        def __init__(self):
            self.heard = []

        def reported(self, remark):
            self.heard.append(remark)

    def run(**keywords):
        ears = Ears()
        pipeline.run(workspace, pipeline.stage_options(workspace), ("cluster",), watcher=ears, **keywords)
        return ears.heard

    assert stale(workspace) is False
    assert run() == run(report=True) == []
    with workspace.report_html.open("a") as file:
        file.write("changed by hand")
    (remark,) = run(report=True)
    assert remark == f"see {workspace.report_html}"
    assert run(report=True) == []
    workspace.report_html.unlink()
    monkeypatch.setattr(report_page, "plant_page", lambda *_: 1 / 0)
    (remark,) = run(report=True)
    assert "warning: could not be made (division by zero)" in remark


def test_a_page_of_somebody_else_is_never_replaced(workspace):
    workspace.report_html.write_text("mine")
    with pytest.raises(BadInput, match="was not made by it"):
        make_report(workspace)
    assert workspace.report_html.read_text() == "mine"


def test_a_failed_run_leaves_a_page_that_says_why(tmp_path):
    folder = tmp_path / "plant_018"
    folder.mkdir()
    workspace = Workspace(folder)
    with pytest.raises(CaptureFailed):
        pipeline.run(workspace, pipeline.stage_options(workspace), report=True)
    assert "copy the plant&#39;s video here" in workspace.report_html.read_text()
    assert stale(workspace, "no video")


def batch_row(folder, state="done", **cells):
    blank = {column.name: None for column in TRAITS}
    return {"folder": folder, "state": state, "exit_code": 0, "reason": "", **blank, **cells}


def batch_rows():
    rows = [
        batch_row("bad", "failed", reason=f"no {HOSTILE}; film it"),
        batch_row("sp ace/#%", boll_count=12, boll_volume_cm3=500.0, plant_height_cm=160.0, canopy_size_cm=30.0),
    ]
    for k in range(6):
        cells = {"boll_count": 10 + k, "boll_volume_cm3": 400.0 + 10 * k, "plant_height_cm": 70.0 + k}
        rows.append(
            batch_row(f"plant_{k}", canopy_size_cm=35.0 + k / 2, qc_flags="orbit_gap" if k == 3 else "", **cells)
        )
    return rows


def test_robust_z_finds_what_stands_out():
    scores = robust_z(np.array([1.0, 2, 3, 4, 5, 50, np.nan]))
    assert abs(scores[:5]).max() < 3.5 < scores[5]
    assert np.isnan(scores[6])
    assert np.isnan(robust_z(np.array([1.0, 2, 3, 100]))).all()
    assert np.isnan(robust_z(np.array([5.0, 5, 5, 5, 9]))).all()


def test_the_index_lists_failures_outliers_and_links(made):
    folder = made.root.parent
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


def picture(png):
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)


@needs_browser
def test_the_page_works_in_a_browser(made, tmp_path):
    with Browser(tmp_path / "profile") as browser:
        browser.open(made.report_html)
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
        row = read_facts(made).bolls[int(boll) - 1]
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
            made.report_html.resolve().as_uri()
        ]


@needs_browser
def test_small_screens_print_and_no_webgl(made, tmp_path):
    with Browser(tmp_path / "profile", webgl=False) as browser:
        browser.open(made.report_html, 390, 800)
        assert browser.value("document.documentElement.scrollWidth") <= 390
        assert "WebGL" in browser.value("document.querySelector('.fallback').textContent")
        browser.click(*browser.middle("tr[data-boll='2'] button"))
        assert browser.value("document.querySelector('tr.chosen').dataset.boll") == "2"
        assert browser.printed().startswith(b"%PDF")
        assert browser.complaints == []


@needs_browser
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
