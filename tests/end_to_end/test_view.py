# SPDX-License-Identifier: Apache-2.0
"""The pages of a plant and of a field as a browser gets them: the same bytes as by the commands, and nothing else."""

import io
import json
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from http import HTTPStatus
from pathlib import Path
from urllib.parse import quote

import pandas as pd
import pytest
from scenes.local_client import serving
from scenes.viewed import viewed
from typer.testing import CliRunner

from cotton3dg.batch import save_tables
from cotton3dg.choices import choose
from cotton3dg.cli.app import app
from cotton3dg.commands import view as module
from cotton3dg.commands.correct import Asked, correct
from cotton3dg.commands.view import view
from cotton3dg.errors import BadUsage, MissingInput
from cotton3dg.io.local_server import BYTES, LocalServer
from cotton3dg.io.tables import read_rows
from cotton3dg.schemas.record import Choices
from cotton3dg.workspace import Workspace

MERGE = {"corrections": [{"kind": "merge", "bolls": [{"boll_id": 3}, {"boll_id": 4}]}]}
DELETE = {"corrections": [{"kind": "delete", "bolls": [{"boll_id": 1}]}]}


@pytest.fixture
def page_of():
    """Opens a folder as `view` does; all is closed at the end."""
    with ExitStack() as opened:
        yield lambda folder: opened.enter_context(viewed(folder))


@pytest.fixture
def field(reported, tmp_path) -> Path:
    """A finished plant, one without a film, and one whose folder lies elsewhere."""
    shutil.copytree(reported.root, tmp_path / "field" / "row 1" / "plant_017")
    (tmp_path / "field" / "plant_018").mkdir()
    shutil.copytree(reported.root, tmp_path / "elsewhere")
    (tmp_path / "field" / "linked").symlink_to(tmp_path / "elsewhere")
    return tmp_path / "field"


def bytes_of(workspace):
    kept = (workspace.traits_csv, workspace.bolls_csv, workspace.corrections_json, workspace.corrected_bolls_json)
    return [path.read_bytes() if path.exists() else b"" for path in kept]


def test_corrections_leave_the_bytes_that_correct_leaves_and_undo_takes_them_back(reported_copy, tmp_path, page_of):
    by_command = Workspace(shutil.copytree(reported_copy.root, tmp_path / "again" / "plant_017"))
    before = bytes_of(reported_copy)
    page = page_of(reported_copy.root)
    assert page.json("plant_017/corrections") == {"kept": [], "message": ""}
    status, answer = page.posts("plant_017/corrections", MERGE)
    assert status == HTTPStatus.OK
    assert re.fullmatch(r"Bolls: 4 → 3, volume: \d+ → \d+ cm³ \(a merged .*\)", answer["message"])
    saved = tmp_path / "corrections.json"
    saved.write_text(json.dumps(MERGE))
    correct(by_command, Asked(file=saved))
    assert bytes_of(reported_copy) == bytes_of(by_command) != before
    assert page.json("plant_017/corrections") == {"kept": ["merge 3 + 4"]} | answer
    assert page.json("plant_017/corrections")["message"] == "", "it is shown once"
    (plant,) = page.json("state")["plants"]
    assert plant["traits"]["boll_count"] == read_rows(reported_copy.traits_csv)[0]["boll_count"] == "3"
    content = page.gets("plant_017/report.html")[2]
    assert b'data-boll="3"' in content and b'data-boll="4"' not in content
    status, answer = page.posts("plant_017/undo")
    assert status == HTTPStatus.OK and answer["message"].startswith("Bolls: 3 → 4, ")
    assert bytes_of(reported_copy) == before
    status, answer = page.posts("plant_017/undo")
    assert (status, answer["message"]) == (HTTPStatus.CONFLICT, "there is no correction to take back")
    assert "no correction to take back" in page.json("plant_017/corrections")["message"]


def test_while_a_run_holds_the_plant_a_correction_is_refused_and_nothing_changes(reported_copy, page_of):
    page = page_of(reported_copy.root)
    before = bytes_of(reported_copy)
    with reported_copy.locked():
        status, answer = page.posts("plant_017/corrections", DELETE)
        assert status == HTTPStatus.CONFLICT and "another cotton3dg (process" in answer["message"]
        assert bytes_of(reported_copy) == before
        # The page is there all the same, and says that somebody works.
        assert page.gets("plant_017/report.html")[0] == HTTPStatus.OK
        assert page.json("state")["plants"][0]["state"] == "working"
    assert page.json("state")["plants"][0]["state"] == "done"


@pytest.mark.parametrize("content", [b"", b"[]", b'{"corrections": 3}', b"\xff", b'{"corrections": [{"kind": "eat"}]}'])
def test_what_is_no_correction_is_refused(reported_copy, page_of, content):
    page = page_of(reported_copy.root)
    assert page.posts("plant_017/corrections", content)[0] == HTTPStatus.CONFLICT
    assert not reported_copy.corrections_json.exists()


def test_a_report_of_another_version_is_made_anew_and_one_of_somebody_else_may_ask_nothing(reported_copy, page_of):
    page = page_of(reported_copy.root)
    status, headers, content = page.gets("plant_017/report.html")
    assert status == HTTPStatus.OK and b'<html lang="en" data-view>' in content
    assert "connect-src 'self'" in headers["Content-Security-Policy"]
    assert b"data-view>" not in reported_copy.report_html.read_bytes()
    reported_copy.report_html.write_text("<title>a page – cotton3dg</title><script>fetch('undo')</script>")
    assert b'data-boll="1"' in page.gets("plant_017/report.html")[2]
    reported_copy.report_html.write_text("<title>mine</title><script>fetch('undo')</script>")
    _, headers, content = page.gets("plant_017/report.html")
    assert headers["Content-Security-Policy"].startswith("sandbox allow-scripts") and b"mine" in content
    shutil.rmtree(reported_copy.root / "records")
    (reported_copy.root / "traits" / "traits.csv").unlink()
    assert b"mine" in page.gets("plant_017/report.html")[2]


def test_nothing_but_the_pages_and_tables_of_the_folder_is_shown(field, page_of):
    page = page_of(field)
    assert [plant["plant"] for plant in page.json("state")["plants"]] == ["plant_018", "row 1/plant_017"]
    assert [plant["shown"] for plant in page.json("state")["plants"]] == ["plant_018", "row 1/plant_017"]
    at = quote("row 1/plant_017")
    assert page.gets(f"{at}/report.html")[0] == HTTPStatus.OK
    status, headers, content = page.gets(f"{at}/traits/bolls.csv")
    assert content == (field / "row 1/plant_017/traits/bolls.csv").read_bytes()
    assert headers["Content-Disposition"].endswith("plant_017_bolls.csv")
    for path in (
        f"{at}/run.log", f"{at}/records/traits.json", f"{at}/frames/000000.jpg", f"{at}/traits", at, "batch.csv",
        "linked/report.html", "elsewhere/report.html", "row%201/report.html", f"{at}/traits/../run.log", "x.toml",
    ):  # fmt: skip
        assert page.gets(path)[0] == HTTPStatus.NOT_FOUND, path
    (field / "row 1/plant_017/report.html").unlink()
    (field / "secret").write_text("secret – cotton3dg</title>")
    (field.parent / "secret").write_text("secret")
    outside = field / "row 1/plant_017/traits/traits.csv"
    outside.unlink()
    outside.symlink_to(field.parent / "secret")
    (field / "batch.csv").symlink_to("/etc/passwd")
    for path in (f"{at}/traits/traits.csv", "batch.csv"):
        status, _, content = page.gets(path)
        assert status == HTTPStatus.FORBIDDEN and b"leads out of the folder" in content
    for path in (f"{at}/eat", "tables/x", "linked/undo", "linked/run"):
        assert page.posts(path)[0] == HTTPStatus.NOT_FOUND, path
    too_large = {"Content-Length": str(module.MOST_BYTES + 1)}
    assert page.posts(f"{at}/undo", b"", **too_large)[0] == HTTPStatus.REQUEST_ENTITY_TOO_LARGE


@pytest.mark.slow
def test_the_tables_of_a_field_hold_what_was_corrected(field, page_of):
    page = page_of(field)
    assert page.posts(f"{quote('row 1/plant_017')}/corrections", DELETE)[0] == HTTPStatus.OK
    assert page.posts("tables") == (HTTPStatus.OK, {})
    status, headers, content = page.gets("batch.csv")
    assert status == HTTPStatus.OK and headers["Content-Disposition"].endswith("''batch.csv")
    rows = {row["folder"]: row for row in read_rows(field / "batch.csv")}
    assert content == (field / "batch.csv").read_bytes()
    assert rows["row 1/plant_017"]["boll_count"] == "3" and rows["plant_018"]["state"] == "waiting"
    assert page.json("state")["pages"] == ["index.html", "batch.csv", "batch_bolls.csv"]
    assert page.gets("index.html")[1]["Content-Security-Policy"].startswith("sandbox")
    status, headers, content = page.gets("workbook.xlsx")
    assert status == HTTPStatus.OK and headers["Content-Disposition"].endswith("field.xlsx")
    assert pd.read_excel(io.BytesIO(content), sheet_name=0).shape[0] == len(rows)
    bolls = pd.read_excel(io.BytesIO(content), sheet_name="bolls")
    assert len(bolls) and bolls["boll_id"].dtype == int
    made = {plant["plant"]: plant.get("made_with", "") for plant in page.json("state")["plants"]}
    assert made["row 1/plant_017"].endswith("; 1 correction by hand") and "by hand" not in made["plant_018"]
    assert not (field / "export").exists()
    # What is corrected later is in the tables that are shown and exported.
    assert page.posts(f"{quote('row 1/plant_017')}/undo")[0] == HTTPStatus.OK
    assert b",4," in page.gets("batch.csv")[2]
    assert page.posts(f"{quote('row 1/plant_017')}/corrections", DELETE)[0] == HTTPStatus.OK
    done = CliRunner().invoke(app, ["export", str(field), "--out", str(field.parent / "exported")])
    assert done.exit_code == 0 and "2 plants saved" in done.output
    assert {row["folder"]: row["boll_count"] for row in read_rows(field / "batch.csv")}["row 1/plant_017"] == "3"
    # What a batch said of a failure stays.
    text = (
        (field / "batch.csv").read_text(encoding="utf-8").replace("waiting", "failed").replace("frames: ", "broken: ")
    )
    (field / "batch.csv").write_text(text, encoding="utf-8")
    page.posts("tables")
    (row,) = [row for row in read_rows(field / "batch.csv") if row["folder"] == "plant_018"]
    assert row["state"] == "failed" and row["reason"].startswith("broken: ")


def test_a_dropped_film_is_a_new_plant(field, page_of, monkeypatch):
    page = page_of(field)
    film = b"film" * 1000
    sent = {"Content-Type": BYTES}
    assert page.posts("plant_019/My%20walk.MOV", film, **sent) == (HTTPStatus.OK, {"plant": "plant_019"})
    (saved,) = (field / "plant_019").iterdir()
    assert saved.read_bytes() == film and saved.suffix == ".MOV" and Workspace(field / "plant_019").capture() == saved
    assert page.posts("plant_018/walk.mp4", film, **sent)[0] == HTTPStatus.OK
    status, answer = page.posts("plant_019/walk.mp4", film, **sent)
    assert status == HTTPStatus.CONFLICT and "has a film already" in answer["message"]
    (field / "file").touch()
    for plant, words in (("linked", "not a folder of"), ("file", "not a folder of"), ("%20", "blank")):
        status, answer = page.posts(f"{plant}/walk.mp4", film, **sent)
        assert status == HTTPStatus.CONFLICT and words in answer["message"], answer
    status, answer = page.posts("..%00/walk.mp4", film, **sent)
    assert status == HTTPStatus.NOT_FOUND
    assert page.posts("plant_020/walk.html", film, **sent)[0] == HTTPStatus.NOT_FOUND
    monkeypatch.setattr(module.shutil, "disk_usage", lambda folder: shutil._ntuple_diskusage(10, 10, 10))
    status, answer = page.posts("plant_021/walk.mp4", film, **sent)
    assert status == HTTPStatus.CONFLICT and "is full" in answer["message"] and not (field / "plant_021").exists()


def test_a_film_is_not_added_to_a_plant(reported_copy, page_of):
    status, answer = page_of(reported_copy.root).posts("other/walk.mp4", b"film", **{"Content-Type": BYTES})
    assert status == HTTPStatus.CONFLICT and "one plant" in answer["message"]


def until(page, plant, found):
    """The plant's state once it is `found`."""
    for _ in range(600):
        (state,) = [state for state in page.json("state")["plants"] if state["plant"] == plant]
        if found(state):
            return state
        time.sleep(0.1)
    raise AssertionError(state)


def test_plants_are_checked_and_measured_one_at_a_time_and_told_why_not(field, page_of, monkeypatch):
    """By the real commands on a film that is none: check finds it red, run fails, and the page says why."""
    page = page_of(field)
    assert page.posts("plant_018/walk.mp4", b"no film", **{"Content-Type": BYTES})[0] == HTTPStatus.OK
    assert page.posts("plant_018/check")[0] == HTTPStatus.OK
    status, answer = page.posts("plant_018/run")
    assert status == HTTPStatus.CONFLICT and "waits already" in answer["message"]
    state = until(page, "plant_018", lambda state: not state["busy"])
    assert state["check"]["verdict"] == "red" and "check/check.html" in state["pages"]
    assert page.gets("plant_018/check/check.html")[0] == HTTPStatus.OK
    assert page.posts("plant_018/run")[0] == HTTPStatus.OK
    state = until(page, "plant_018", lambda state: not state["busy"])
    assert (state["state"], state["verdict"]) == ("failed", "red") and state["text"] in state["job"]


def test_a_new_plant_is_measured_as_the_last_one(field, page_of, monkeypatch):
    """The page says so, and a plant that was measured keeps what it has."""
    page, given = page_of(field), []
    monkeypatch.setattr(module.CommandQueue, "add", lambda self, plant, words: given.append(words[2:]))
    measured = Workspace(field / "row 1/plant_017")
    Choices("draft", {"scale": {"table_length_cm": 90.0}}).save(measured.choices_json)
    assert b"a new plant: draft" in page.gets("")[2] and b'placeholder="90"' in page.gets("")[2]
    for plant, said in (
        ("plant_018", {}), (quote("row 1/plant_017"), {}), ("plant_018", {"preset": "paper", "table_width_cm": "40"}),
    ):  # fmt: skip
        assert page.posts(f"{plant}/run", said)[0] == HTTPStatus.OK
    length, width = "scale.table_length_cm=90", "scale.table_width_cm=40"
    assert given == [
        ["--preset", "draft", "--set", length], [], ["--preset", "paper", "--set", length, "--set", width]
    ]  # fmt: skip


def test_a_measurement_has_the_preset_and_the_table_of_the_form(field, page_of, monkeypatch):
    page, given = page_of(field), []
    monkeypatch.setattr(module.CommandQueue, "add", lambda self, plant, words: given.append(words[2:]))
    form = {"preset": "draft", "table_length_cm": "100,5", "table_width_cm": "50"}
    words = ["--preset", "draft", "--set", "scale.table_length_cm=100.5", "--set", "scale.table_width_cm=50"]
    for said in ({}, {"preset": "", "table_length_cm": ""}, form):
        assert page.posts("plant_018/run", said)[0] == HTTPStatus.OK
    assert given == [[], [], words]
    for wrong, reason in (
        ({"preset": "daft"}, "draft"), ({"table_width_cm": "wide"}, "centimetres"),
        ({"table_length_cm": "-3"}, "number"),
        ({"preset": ["draft"]}, "preset"), (b"[]", "load the page again"), (b"x", "load the page again"),
    ):  # fmt: skip
        status, answer = page.posts("plant_018/run", wrong)
        assert status == HTTPStatus.CONFLICT and reason in answer["message"], answer
    assert not page.json("state")["plants"][0]["busy"]


def test_the_page_shows_each_trait_with_its_interval_and_how_sure_it_is(reported_copy, page_of):
    page = page_of(reported_copy.root)
    (plant,) = page.json("state")["plants"]
    (row,) = read_rows(reported_copy.traits_csv)
    assert plant["intervals"]["boll_count"] == f"{row['boll_count_low']} to {row['boll_count_high']}"
    assert set(plant["sure"].values()) <= {"green", "yellow", "red", ""} and plant["sure"]["boll_count"]
    shutil.rmtree(reported_copy.root / "records")
    reported_copy.traits_csv.unlink()
    (plant,) = page.json("state")["plants"]
    assert (plant["state"], plant["text"], plant["intervals"]["boll_count"]) == ("waiting", "not measured yet", "")


def test_the_log_of_a_run_tells_how_far_it_is(reported_copy, page_of):
    page = page_of(reported_copy.root)
    reported_copy.log_file.write_text(
        "2026-01-01 10:00:00,000 INFO sfm done in 3.0 s: {}\n2026-01-01 10:00:03,000 INFO train starts: forced\n"
    )
    with reported_copy.locked():
        state = page.json("state")["plants"][0]
    assert state["text"].startswith("train, stage 3 of 8, for ")


def test_a_film_in_an_empty_folder_begins_a_field(tmp_path, page_of):
    page = page_of(tmp_path)
    assert page.json("state") == {"plants": [], "pages": []} and b'id="film"' in page.gets("")[2]
    assert page.posts("plant_1/walk.mp4", b"film", **{"Content-Type": BYTES})[0] == HTTPStatus.OK
    assert [plant["plant"] for plant in page.json("state")["plants"]] == ["plant_1"]


def test_a_name_that_no_folder_can_have_stays_the_plants_id(tmp_path, page_of):
    page = page_of(tmp_path)
    status, answer = page.posts("plot%2012%3F/walk.mp4", b"film", **{"Content-Type": BYTES})
    assert status == HTTPStatus.OK and answer["plant"].startswith("plot_12_")
    (state,) = page.json("state")["plants"]
    assert (state["plant"], state["shown"]) == (answer["plant"], "plot 12?")
    assert choose(Workspace(tmp_path / answer["plant"])).options["traits"].plant_id == "plot 12?"
    # Options that are there already stay as they are.
    (tmp_path / "plot_13").mkdir()
    (tmp_path / "plot_13" / "cotton3dg.toml").write_text('preset = "draft"\n')
    assert page.posts("plot_13/walk.mp4", b"film", **{"Content-Type": BYTES})[0] == HTTPStatus.OK
    assert (tmp_path / "plot_13" / "cotton3dg.toml").read_text() == 'preset = "draft"\n'


def test_the_command_serves_until_it_is_interrupted(reported_copy):
    command = [sys.executable, "-m", "cotton3dg.cli", "view", str(reported_copy.root), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        address = process.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:") and address.endswith("/")
        from urllib.request import urlopen

        assert b"plant_017" in urlopen(address, timeout=60).read()
        process.send_signal(signal.SIGINT)
        said, errors = process.communicate(timeout=120)
    assert process.returncode == 0 and "ended" in said and "Traceback" not in errors


def test_mistakes_are_told(tmp_path, monkeypatch):
    done = CliRunner().invoke(app, ["view", str(tmp_path / "nowhere"), "--no-browser"])
    assert done.exit_code == MissingInput.exit_code and "does not exist" in done.output
    with serving(LocalServer(0, lambda request: None, lambda parts: 0)) as taken:
        done = CliRunner().invoke(app, ["view", str(tmp_path), "--no-browser", "--port", str(taken.server_port)])
    assert done.exit_code == BadUsage.exit_code and "cannot be had" in done.output


@pytest.mark.parametrize("screen", [True, False])
def test_the_browser_opens_where_there_is_a_screen(tmp_path, monkeypatch, screen):
    opened, told = [], []
    monkeypatch.setattr(module.webbrowser, "open", lambda address: opened.append(address) or True)
    monkeypatch.setattr(module.sys, "platform", "linux")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", ":0") if screen else monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(LocalServer, "serve_forever", interrupt)
    view(tmp_path, save_tables, told.append)
    assert opened == ([told[0].splitlines()[0]] if screen else [])
    assert ("open the address" in told[1]) != screen and "ended" in told[-1]


def interrupt(server):
    assert threading.active_count() > 1
    raise KeyboardInterrupt
