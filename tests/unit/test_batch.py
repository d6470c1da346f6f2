# SPDX-License-Identifier: Apache-2.0
"""Batches whose plants are run by a stand-in that does what the plant's `behaviour` file says."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from scenes.stand_in_runs import STAND_IN, make_plant, stand_in_command, table, until

from cotton3dg.batch import (
    BOLL_TABLE,
    FITS_TABLE,
    MEANS_TABLE,
    SAME_FILM,
    TABLE,
    Batch,
    default_jobs,
    find_plants,
    require_named,
    result_of,
    saved_results,
)
from cotton3dg.errors import BadInput, BadUsage, MissingInput
from cotton3dg.io.tables import BOLLS, TRAITS, csv_text, is_number
from cotton3dg.pipeline import stage_options


@pytest.fixture
def stand_in(tmp_path):
    return stand_in_command(tmp_path)


@pytest.fixture(autouse=True)
def interruptible():
    """A process that a shell started in the background, as continuous integration may, ignores Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_plants_share_cores_and_memory_among_themselves_and_not_with_jobs_that_do_not_exist(tmp_path, stand_in):
    field = tmp_path / "field"
    make_plant(field, "a")
    limit = (
        "import resource; print(resource.getrlimit(resource.RLIMIT_DATA)[0], file=open(sys.argv[1] + '/limit', 'w'))"
    )
    Path(stand_in[1]).write_text(f"{STAND_IN}{limit}\n")
    (result,) = Batch(field, jobs=10**6, tell=lambda line: None, command=stand_in).run(find_plants(field))
    assert result.state == "done"
    assert int((field / "a" / "limit").read_text()) in (-1, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))


def test_what_a_run_left_in_a_plant_without_video_is_no_plant(tmp_path):
    plant = tmp_path / "field" / "forgotten"
    (plant / "records").mkdir(parents=True)
    assert find_plants(tmp_path / "field") == [plant]
    (plant / "run.log").touch()
    assert find_plants(tmp_path / "field") == [plant]


def test_what_an_earlier_run_left_in_a_field_is_no_plant(tmp_path):
    make_plant(tmp_path, "field/a")
    make_plant(tmp_path, "field/check")  # a plot of the check variety
    for name in ("records", "render", "frames"):
        (tmp_path / "field" / name).mkdir()
    (tmp_path / "field" / "render" / "turntable.png").touch()
    (tmp_path / "field" / "run.log").touch()
    field = tmp_path / "field"
    assert find_plants(field) == [field / "a", field / "check"]
    assert find_plants(tmp_path) == [field / "a", field / "check"]  # the log makes the field no plant


def test_a_batch_of_one_plant_is_refused(tmp_path):
    plant = make_plant(tmp_path, "a")
    for name in ("records", "render/turntable", "notes"):
        (plant / name).mkdir(parents=True)
    with pytest.raises(BadUsage, match=rf"one plant and no field; use `cotton3dg run {plant}`"):
        find_plants(plant)
    (plant / "walk.mp4").unlink()
    (plant / "records" / "frames.json").write_text("{}")  # its film was moved to an archive
    with pytest.raises(BadUsage, match="one plant and no field"):
        find_plants(plant)


def test_folders_that_wait_for_no_film_are_no_field(tmp_path):
    (tmp_path / "documents").mkdir()
    (tmp_path / "documents" / "letter.txt").touch()
    (tmp_path / "empty").mkdir()
    with pytest.raises(MissingInput, match=r"no folder below .* has a video or images"):
        find_plants(tmp_path)


@pytest.mark.parametrize("name", [TABLE, MEANS_TABLE, FITS_TABLE, "index.html"])
def test_a_table_of_the_users_is_not_replaced(tmp_path, stand_in, name):
    field = tmp_path / "field"
    make_plant(field, "a")
    (field / name).write_text("genotype,seeds\nLN-1,20\n")
    batch = Batch(field, tell=lambda line: None, command=stand_in)
    if name.endswith(".csv"):
        with pytest.raises(BadInput, match=f"{name} stands where cotton3dg writes its table"):
            batch.run(find_plants(field))
        assert sorted(path.name for path in field.iterdir()) == sorted(["a", name])
    else:
        batch.run(find_plants(field))
    assert (field / name).read_text().startswith("genotype,seeds")


def test_a_file_that_is_beside_no_plant_is_refused_before_the_tables_are_touched(tmp_path):
    plants = [make_plant(tmp_path, name) for name in ("a", "b")]
    options = stage_options(None, overrides={"masks": {"bolls.weights": "own.onnx"}})
    with pytest.raises(MissingInput, match=r"masks\.bolls\.weights = 'own\.onnx' is not there"):
        require_named(plants, options)
    (plants[1] / "own.onnx").touch()
    require_named(plants, options)


def test_failures_come_first_with_their_reasons_and_cost_no_other_plant(tmp_path, stand_in):
    field = tmp_path / "field"
    make_plant(field, "a")
    make_plant(field, "b", "fail no video; film it")
    make_plant(field, "c", "die")
    make_plant(field, "d")
    said = []
    results = Batch(field, ["--preset", "draft"], 2, tell=said.append, command=stand_in).run(find_plants(field))
    assert [(r.folder, r.state, r.exit_code) for r in results] == [
        ("b", "failed", 4), ("c", "failed", -9), ("a", "done", 0), ("d", "done", 0)
    ]  # fmt: skip
    rows = table(field)
    assert [row["folder"] for row in rows] == ["b", "c", "a", "d"]
    assert rows[0]["reason"] == "no video; film it"
    assert "signal 9" in rows[1]["reason"]
    assert rows[0]["boll_count"] == ""
    assert len(said) == 4
    assert any("b: failed: no video; film it" in line for line in said)
    assert (field / "a" / "arguments").read_text() == "--wait --preset draft"


def test_a_film_in_two_folders_is_noticed(tmp_path, stand_in):
    field = tmp_path / "field"
    for name, film in (("a", b"film"), ("b", b"kiln"), ("c", b"film"), ("d", b"")):
        (make_plant(field, name) / "walk.mp4").write_bytes(film)
    said = []
    Batch(field, jobs=1, tell=said.append, command=stand_in).run(find_plants(field))
    assert said[0] == "c has the same film as a; put each plant's own film into its folder"
    assert [row["folder"] for row in table(field) if SAME_FILM in row["qc_flags"].split("|")] == ["a", "c"]
    # Those that failed alone are tried again; the others are known from the table.
    again = Batch(field, jobs=1, tell=said.append, command=stand_in, results=saved_results(field))
    again.run([field / "c"])
    assert [row["folder"] for row in table(field) if row["qc_flags"]] == ["a", "c"]


def test_cells_of_the_plants_tables_arrive_unchanged(tmp_path, stand_in):
    field = tmp_path / "field"
    plant = make_plant(field, "a")
    Batch(field, jobs=1, tell=lambda line: None, command=stand_in).run([plant])
    own = table(plant / "traits", "bolls.csv")
    assert table(field, BOLL_TABLE) == own
    assert own[0]["plant_id"] == "007"
    assert own[0]["x_cm"] == "-2.50"
    row = table(field)[0]
    assert row["plant_id"] == "'=a"
    assert {name: row[name] for name in ("boll_count", "seconds", "psnr_db")} == {
        "boll_count": "7", "seconds": "90.0", "psnr_db": "1.50"
    }  # fmt: skip


def test_only_faults_of_the_machine_are_tried_again(tmp_path, stand_in):
    field = tmp_path / "field"
    make_plant(field, "bad", "fail no video; film it")
    make_plant(field, "flaky", "flaky")
    make_plant(field, "dead", "die")
    results = Batch(field, jobs=1, retries=1, tell=lambda line: None, command=stand_in).run(find_plants(field))
    assert {r.folder: r.state for r in results} == {"bad": "failed", "dead": "failed", "flaky": "done"}
    assert {name: (field / name / "tries").read_text() for name in ("bad", "flaky", "dead")} == {
        "bad": "1", "flaky": "2", "dead": "2"
    }  # fmt: skip


def test_plants_are_found_at_any_depth_and_forgotten_videos_are_not_left_out(tmp_path):
    make_plant(tmp_path, "east/plant_2")
    make_plant(tmp_path, "east/plant_10")
    (tmp_path / "east" / "plant_2" / "sfm" / "images").mkdir(parents=True)  # a plant's own folders are no plants
    (tmp_path / "west" / "empty").mkdir(parents=True)
    (tmp_path / "photos" / "images").mkdir(parents=True)
    (tmp_path / ".hidden").mkdir()
    found = [plant.relative_to(tmp_path).as_posix() for plant in find_plants(tmp_path)]
    assert found == ["east/plant_10", "east/plant_2", "photos", "west/empty"]


def test_folders_without_plants_are_told(tmp_path):
    with pytest.raises(MissingInput, match="holds no folders"):
        find_plants(tmp_path)
    with pytest.raises(MissingInput, match="is not a folder"):
        find_plants(tmp_path / "nowhere")
    with pytest.raises(MissingInput, match="run the whole batch first"):
        saved_results(tmp_path)
    with pytest.raises(BadUsage, match="--jobs 0"):
        Batch(tmp_path, jobs=0).run([])
    assert default_jobs() >= 1


def test_the_saved_table_tells_what_failed(tmp_path, stand_in):
    field = tmp_path / "field"
    make_plant(field, "=odd name", "fail no video; film it")
    make_plant(field, "good")
    results = Batch(field, tell=lambda line: None, command=stand_in).run(find_plants(field))
    assert saved_results(field) == {result.folder: result for result in results}


def test_a_killed_batch_has_saved_what_was_done_and_the_next_goes_on(tmp_path, stand_in):
    field = tmp_path / "field"
    make_plant(field, "a")
    make_plant(field, "b", "sleep 60")
    code = (
        "import sys; from pathlib import Path; from cotton3dg.batch import Batch, find_plants;"
        f"f = Path({str(field)!r}); Batch(f, jobs=1, command={stand_in!r}).run(find_plants(f))"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL)
    until((field / "b" / "awake").exists)
    process.kill()
    process.wait()
    assert {row["folder"]: row["state"] for row in table(field)} == {"a": "done", "b": "waiting"}
    (field / "b" / "behaviour").write_text("ok")
    results = Batch(field, tell=lambda line: None, command=stand_in).run(find_plants(field))
    assert [result.state for result in results] == ["done", "done"]


def test_the_first_ctrl_c_drains(tmp_path, stand_in):
    field = tmp_path / "field"
    make_plant(field, "a", "sleep 1.5")
    make_plant(field, "b")
    said = []
    pressed = threading.Thread(target=lambda: (until((field / "a" / "awake").exists), press()))
    pressed.start()
    results = Batch(field, jobs=1, tell=said.append, command=stand_in).run(find_plants(field))
    pressed.join()
    assert [(result.folder, result.state) for result in results] == [("b", "waiting"), ("a", "done")]
    assert "no further plant is started" in said[0]


def test_the_second_ctrl_c_interrupts(tmp_path, stand_in):
    field = tmp_path / "field"
    make_plant(field, "a", "sleep 60")

    def twice() -> None:
        until((field / "a" / "awake").exists)
        press()
        time.sleep(0.5)
        press()

    pressed = threading.Thread(target=twice)
    pressed.start()
    began = time.monotonic()
    (result,) = Batch(field, jobs=1, tell=lambda line: None, command=stand_in).run(find_plants(field))
    pressed.join()
    assert (result.state, result.reason) == ("waiting", "interrupted")
    assert time.monotonic() - began < 40


def test_a_signal_that_ends_the_batch_ends_its_runs(tmp_path, stand_in):
    field = tmp_path / "field"
    make_plant(field, "a", "sleep 60")
    make_plant(field, "b")
    work = Batch(field, jobs=1, tell=lambda line: None, command=stand_in)

    def end(number, frame):
        raise SystemExit(143)

    def terminate() -> None:
        until((field / "a" / "awake").exists)
        os.kill(os.getpid(), signal.SIGTERM)

    before = signal.signal(signal.SIGTERM, end)
    sender = threading.Thread(target=terminate)
    sender.start()
    try:
        with pytest.raises(SystemExit):
            work.run(find_plants(field))
    finally:
        sender.join()
        signal.signal(signal.SIGTERM, before)
    assert {name: (result.state, result.reason) for name, result in work.results.items()} == {
        "a": ("waiting", "interrupted"),
        "b": ("waiting", ""),
    }
    assert not (field / "b" / "tries").exists()


@pytest.mark.parametrize("code", [129, 130, 143, -1, -2, -15])
def test_a_run_that_was_ended_from_outside_waits(code):
    assert (result_of("a", code, "").state, result_of("a", code, "").reason) == ("waiting", "interrupted")


def press() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def test_the_field_book_stands_behind_the_columns(tmp_path, stand_in):
    field = tmp_path / "field"
    for number in range(6):
        make_plant(field, f"p{number}")
        row = {column.name: 1.5 if column.digits is not None else 7 if column.unit else "" for column in TRAITS}
        row |= {"plant_id": f"p{number}", "seconds": 1.0, "boll_count": 10 + number % 3 + 5 * (number > 2)}
        (field / f"p{number}" / "traits.template").write_text(csv_text(TRAITS, [row]), newline="")
        bolls = [{column.name: 1 if is_number(column) else f"p{number}" for column in BOLLS}]
        (field / f"p{number}" / "bolls.template").write_text(csv_text(BOLLS, bolls), newline="")
    make_plant(field, "p6", "fail no plant; film it")
    lines = [f"p{n};{'ab'[n > 2]};{n % 3};-2.5;=1+1" for n in range(7)] + ["p7;b;1;;"]
    (field / "fieldbook.csv").write_text("\n".join(["plant_id;genotype;block;x;version", *lines]))
    Batch(field, jobs=2, command=stand_in, tell=lambda text: None).run(find_plants(field))
    rows = {row["folder"]: row for row in table(field)}
    assert list(rows["p0"])[-4:] == ["genotype", "block", "x", "fieldbook_version"]
    assert [rows[f"p{n}"]["genotype"] for n in range(7)] == list("aaabbbb")  # the failed one is known by its folder
    assert rows["p0"]["x"] == "-2.5" and rows["p0"]["fieldbook_version"] == "'=1+1"
    assert {row["plant_id"]: row["block"] for row in table(field, BOLL_TABLE)}["p5"] == "2"
    means = {(row["trait"], row["genotype"]): row for row in table(field, MEANS_TABLE)}
    assert float(means["boll_count", "b"]["adjusted_mean"]) - float(means["boll_count", "a"]["adjusted_mean"]) == 5
    fit = {row["trait"]: row for row in table(field, FITS_TABLE)}["boll_count"]
    assert fit["model"] == "genotype + block" and fit["plants"] == "6"
    page = (field / "index.html").read_text()
    assert "p7" in page and "not filmed yet" in page and 'data-filter="0"' in page
    (field / "fieldbook.csv").write_text("plant_id,x\np0,1\np0,2\n")
    with pytest.raises(BadInput, match="rows 2 and 3"):
        Batch(field, command=stand_in, tell=lambda text: None).run(find_plants(field))
