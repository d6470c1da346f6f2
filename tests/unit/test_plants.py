# SPDX-License-Identifier: Apache-2.0
"""What a command takes for a plant, and what it says where there is none; nothing is written before."""

from pathlib import Path

import pytest

from cotton3dg.commands.import_ import Import, import_videos
from cotton3dg.commands.render import render
from cotton3dg.errors import BadInput, BadUsage, MissingInput
from cotton3dg.options import RenderOptions
from cotton3dg.plants import plant_at
from cotton3dg.workspace import OWN_FOLDERS, Workspace


def below(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


def test_the_folders_of_a_plant_have_names_of_their_own():
    assert {"frames", "records", "render", "check", "images", "repeats", "study"} <= OWN_FOLDERS
    assert not any("." in name for name in OWN_FOLDERS)


@pytest.mark.parametrize("rows", ["", "row 1/"])
def test_whoever_is_too_high_is_told_which_command_is_meant(tmp_path, rows):
    for name in ("a", "b"):
        (tmp_path / rows / name).mkdir(parents=True)
        (tmp_path / rows / name / "walk.mp4").touch()
    (tmp_path / "records").mkdir()  # what an earlier version left there
    before = below(tmp_path)
    with pytest.raises(BadUsage, match=rf"holds 2 plants and .* `cotton3dg batch {tmp_path}`.*e\.g\. .*{rows}a"):
        plant_at(tmp_path, make=True)
    assert below(tmp_path) == before


def test_an_empty_folder_is_told_what_is_missing(tmp_path):
    (tmp_path / "plant").mkdir()
    for folder in (tmp_path, tmp_path / "plant"):
        with pytest.raises(MissingInput, match="no video"):
            plant_at(folder, make=True)
    assert below(tmp_path) == ["plant"]


def test_commands_leave_no_lock_where_there_is_nothing_for_them(tmp_path):
    (tmp_path / "walk.mp4").touch()
    with pytest.raises(MissingInput, match="cotton3dg train"):
        render(Workspace(tmp_path), RenderOptions())
    assert below(tmp_path) == ["walk.mp4"]


def test_an_import_into_a_plant_is_refused(tmp_path):
    with Workspace(tmp_path).writing("frames"):
        pass
    before = below(tmp_path)
    with pytest.raises(BadUsage, match="is a plant; give the folder of its field"):
        import_videos([tmp_path / "a.mp4"], Import(tmp_path))
    assert below(tmp_path) == before


def test_results_make_a_plant_whose_film_is_gone(tmp_path):
    workspace = Workspace(tmp_path)
    with workspace.writing("frames"):
        pass
    assert plant_at(tmp_path).root == tmp_path


def test_a_film_gets_a_folder_of_its_name_and_a_plants_film_is_the_plant(tmp_path):
    film = tmp_path / "a.mp4"
    film.write_bytes(b"film")
    with pytest.raises(MissingInput, match="begin with `cotton3dg run"):
        plant_at(film)
    assert below(tmp_path) == ["a.mp4"]
    plant = plant_at(film, make=True)
    assert plant.root == tmp_path / "a"
    assert plant.capture().read_bytes() == b"film"
    assert plant_at(film).root == plant.root
    with plant.writing("frames"):
        pass
    assert plant_at(plant.root / "a.mp4").root == plant.root
    assert plant_at(plant.root).root == plant.root


def test_what_is_no_video_is_told(tmp_path):
    (tmp_path / "notes.txt").write_text("x")
    with pytest.raises(BadInput, match=r"notes.txt is not a video"):
        plant_at(tmp_path / "notes.txt", make=True)
    with pytest.raises(MissingInput):
        plant_at(tmp_path / "nothing.mp4", make=True)
    assert below(tmp_path) == ["notes.txt"]


@pytest.mark.parametrize("name", ["a.mp4", "b.mp4"])
def test_the_folder_of_another_film_is_left_alone(tmp_path, name):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / name).write_bytes(b"kiln")
    (tmp_path / "a.mp4").write_bytes(b"film")
    with pytest.raises(BadInput, match="another video"):
        plant_at(tmp_path / "a.mp4", make=True)
    assert below(tmp_path / "a") == [name]
    (tmp_path / "c").touch()
    (tmp_path / "c.mp4").write_bytes(b"film")
    with pytest.raises(BadInput, match="c is a file"):
        plant_at(tmp_path / "c.mp4", make=True)
