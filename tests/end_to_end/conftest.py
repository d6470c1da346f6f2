"""One tiny simulated plant for all tests that only need some finished plant, run by the first example."""

import shutil
from pathlib import Path

import pytest
from scenes.finished_scene import finished_workspace
from scenes.tiny_plant import FILM, OPTIONS, ROOT, in_shell

from cotton3dg.commands.simulate import simulate
from cotton3dg.options import resolve
from cotton3dg.report.page import make_report
from cotton3dg.workspace import Workspace


@pytest.fixture(scope="session")
def filmed(tmp_path_factory) -> Path:
    """Folder of a simulated plant with its truth."""
    folder = tmp_path_factory.mktemp("filmed") / "plant_017"
    simulate(folder, resolve("simulate", FILM))
    return folder


@pytest.fixture(scope="session")
def first_run(filmed, tmp_path_factory) -> tuple[Workspace, str]:
    """A plant finished by examples/one_plant.sh, and what that said; tests must not change it."""
    folder = tmp_path_factory.mktemp("finished") / "plant_017"
    folder.mkdir()
    (folder / "cotton3dg.toml").write_text(OPTIONS)
    shutil.copyfile(filmed / "truth.json", folder / "truth.json")
    done = in_shell(ROOT / "examples" / "one_plant.sh", filmed / "video.mp4", folder, cwd=folder.parent)
    assert done.returncode == 0, done.stderr
    return Workspace(folder), done.stdout


@pytest.fixture
def tiny_plant(first_run, tmp_path) -> Workspace:
    """A copy of the finished plant that may be changed."""
    shutil.copytree(first_run[0].root, tmp_path / "plant_017")
    return Workspace(tmp_path / "plant_017")


@pytest.fixture(scope="session")
def reported(tmp_path_factory) -> Workspace:
    """A plant made by code, with its page; tests must not change it."""
    workspace = finished_workspace(tmp_path_factory.mktemp("batch") / "plant_017")
    make_report(workspace)
    return workspace


@pytest.fixture
def reported_copy(reported, tmp_path) -> Workspace:
    """A copy that may be changed."""
    shutil.copytree(reported.root, tmp_path / "plant_017")
    return Workspace(tmp_path / "plant_017")
