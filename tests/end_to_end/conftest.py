# SPDX-License-Identifier: Apache-2.0
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

QUICK_FILES = (
    "test_frames.py",
    "test_corrections.py",
    "test_report_failures.py",
    "test_report_index.py",
    "test_report_page.py",
    "test_segment_cluster.py",
    "test_traits_stage.py",
    "test_view.py",
)
QUICK_TESTS = ("test_one_plant", "test_every_line_is_run_by_something", "test_each_has_a_test", "test_options_file")
"""Files and single tests here that `make test` has, too: one whole run, and what takes seconds."""


@pytest.hookimpl(tryfirst=True)  # before those that are not wanted are left out
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """All other tests of this folder are slow."""
    for item in items:
        here = item.path.parent == Path(__file__).parent
        if here and item.path.name not in QUICK_FILES and item.name not in QUICK_TESTS:
            item.add_marker(pytest.mark.slow)


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
