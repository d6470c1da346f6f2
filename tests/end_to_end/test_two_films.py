"""The same tiny plant filmed twice, the second time turned, on another walk and with two bolls picked."""

import shutil

import pytest
from scenes.made_once import made_once
from scenes.tiny_plant import FILM, OPTIONS, in_shell

from cotton3dg.commands.simulate import simulate
from cotton3dg.files.tables import read_rows
from cotton3dg.options import resolve
from cotton3dg.workspace import Workspace

TURNED_DEG, PICKED = 70.0, 2


@pytest.fixture(scope="module")
def again(tmp_path_factory) -> Workspace:
    """The second film, finished."""

    def make(folder):
        filmed, plant = folder / "filmed", folder / "plant_017"
        later = {"walk": 1, "turned_deg": TURNED_DEG, "picked": PICKED}
        simulate(filmed, resolve("simulate", FILM | later))
        plant.mkdir()
        (plant / "cotton3dg.toml").write_text(OPTIONS)
        shutil.copyfile(filmed / "video.mp4", plant / "video.mp4")
        done = in_shell("cotton3dg", "run", "plant_017", "--no-report", cwd=folder)
        assert done.returncode == 0, done.stderr

    return Workspace(made_once(tmp_path_factory, "again", make) / "plant_017")


def test_compare_finds_the_turn_and_the_picked_bolls(first_run, again, tmp_path):
    done = in_shell("cotton3dg", "compare", first_run[0].root, again.root, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    states = [row["state"] for row in read_rows(tmp_path / "comparison" / "boll_changes.csv")]
    n_first, n_again = (len(read_rows(plant.bolls_csv)) for plant in (first_run[0], again))
    assert states.count("same") >= FILM["bolls"] - PICKED - 1
    assert states.count("same") + states.count("gone") == n_first
    assert states.count("same") + states.count("new") == n_again
    assert states.count("gone") >= 1
    turn = float(done.stdout.split("turned by ")[1].split()[0])
    # The ends of a table look alike.
    assert min(abs((turn - TURNED_DEG + half + 180) % 360 - 180) for half in (0, 180)) < 8
    count = next(
        row for row in read_rows(tmp_path / "comparison" / "trait_changes.csv") if row["trait"] == "boll_count"
    )
    assert float(count["change"]) == n_again - n_first
    assert (tmp_path / "comparison" / "comparison.html").is_file()


def test_repeat_on_two_films(first_run, again, tmp_path):
    done = in_shell("cotton3dg", "repeat", first_run[0].root, again.root, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    bolls = read_rows(tmp_path / "repeat" / "repeat_bolls.csv")
    both = [row for row in bolls if row["n_films"] == "2"]
    assert len(both) >= FILM["bolls"] - PICKED - 1
    assert all(float(row["place_sd_cm"]) < 3 for row in both)
