# SPDX-License-Identifier: Apache-2.0
"""The same small plant filmed twice, the second time turned, on another walk and with two bolls picked."""

import shutil

import pytest
from scenes.made_once import made_once
from scenes.tiny_plant import FILM, OPTIONS, in_shell

from cotton3dg.commands.simulate import simulate
from cotton3dg.io.tables import read_rows
from cotton3dg.options import resolve

TURNED_DEG, PICKED = 70.0, 2


@pytest.fixture(scope="module")
def films(tmp_path_factory):
    """Folders of both films, finished."""

    def make(folder):
        for name, how in (("first", {}), ("later", {"walk": 1, "turned_deg": TURNED_DEG, "picked": PICKED})):
            simulate(folder / "filmed" / name, resolve("simulate", FILM | how))
            plant = folder / name / "plant_017"
            plant.mkdir(parents=True)
            (plant / "cotton3dg.toml").write_text(OPTIONS)
            shutil.copyfile(folder / "filmed" / name / "video.mp4", plant / "video.mp4")
            done = in_shell("cotton3dg", "run", plant, "--no-report", cwd=folder)
            assert done.returncode == 0, done.stderr

    folder = made_once(tmp_path_factory, "two_films", make)
    return [folder / name / "plant_017" for name in ("first", "later")]


def test_compare_finds_the_turn_and_the_picked_bolls(films, tmp_path):
    done = in_shell("cotton3dg", "compare", *films, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = read_rows(tmp_path / "comparison" / "boll_changes.csv")
    states = [row["state"] for row in rows]
    left = FILM["bolls"] - PICKED
    assert abs(states.count("same") - left) <= 1
    assert abs(states.count("gone") - PICKED) <= 1
    assert states.count("new") <= 1
    assert all(float(row["moved_cm"]) < 1.5 for row in rows if row["state"] == "same")
    turn = float(done.stdout.split("turned by ")[1].split()[0])
    # The ends of a table look alike.
    assert min(abs((turn - TURNED_DEG + half + 180) % 360 - 180) for half in (0, 180)) < 4
    count = next(
        row for row in read_rows(tmp_path / "comparison" / "trait_changes.csv") if row["trait"] == "boll_count"
    )
    assert float(count["change"]) == states.count("new") - states.count("gone")
    assert (tmp_path / "comparison" / "comparison.html").is_file()


def test_repeat_finds_the_same_bolls(films, tmp_path):
    done = in_shell("cotton3dg", "repeat", *films, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    both = [row for row in read_rows(tmp_path / "repeat" / "repeat_bolls.csv") if row["n_films"] == "2"]
    assert len(both) >= FILM["bolls"] - PICKED - 1
    assert all(float(row["place_sd_cm"]) < 1.5 for row in both)
    (volume,) = (row for row in read_rows(tmp_path / "repeat" / "repeat_traits.csv") if row["trait"] == "boll volume")
    assert float(volume["cv_pct"]) < 20
    # Both films show the bolls that both have.
    page = (tmp_path / "repeat" / "repeat.html").read_text("utf-8")
    assert page.count('alt="Boll') >= 2 * len(both)
