"""One tiny simulated plant for all tests that only need some finished plant, run by the first example."""

import shutil
from pathlib import Path

import pytest
from scenes.finished_scene import finished_workspace
from scenes.made_once import made_once
from scenes.tiny_plant import FILM, OPTIONS, ROOT, in_shell

from cotton3dg.commands.simulate import simulate
from cotton3dg.options import resolve
from cotton3dg.report.page import make_report
from cotton3dg.workspace import Workspace


@pytest.fixture(scope="session")
def filmed(tmp_path_factory) -> Path:
    """Folder of a simulated plant with its truth."""
    return made_once(tmp_path_factory, "filmed", lambda folder: simulate(folder, resolve("simulate", FILM)))


@pytest.fixture(scope="session")
def first_run(filmed, tmp_path_factory) -> tuple[Workspace, str]:
    """A plant finished by examples/one_plant.sh, and what that said; tests must not change it."""

    def make(folder: Path) -> None:
        plant = folder / "plant_017"
        plant.mkdir()
        (plant / "cotton3dg.toml").write_text(OPTIONS)
        shutil.copyfile(filmed / "truth.json", plant / "truth.json")
        done = in_shell(ROOT / "examples" / "one_plant.sh", filmed / "video.mp4", plant, cwd=folder)
        assert done.returncode == 0, done.stderr
        (folder / "said.txt").write_text(done.stdout)

    folder = made_once(tmp_path_factory, "finished", make)
    return Workspace(folder / "plant_017"), (folder / "said.txt").read_text()


@pytest.fixture
def tiny_plant(first_run, tmp_path) -> Workspace:
    """A copy of the finished plant that may be changed."""
    shutil.copytree(first_run[0].root, tmp_path / "plant_017")
    return Workspace(tmp_path / "plant_017")


@pytest.fixture(scope="session")
def reported(tmp_path_factory) -> Workspace:
    """A plant made by code, with its page; tests must not change it."""
    batch = made_once(tmp_path_factory, "batch", lambda folder: make_report(finished_workspace(folder / "plant_017")))
    return Workspace(batch / "plant_017")


@pytest.fixture
def reported_copy(reported, tmp_path) -> Workspace:
    """A copy that may be changed."""
    shutil.copytree(reported.root, tmp_path / "plant_017")
    return Workspace(tmp_path / "plant_017")
