# SPDX-License-Identifier: Apache-2.0
"""Hard case 49: runs that die, at every write boundary and at random; and a run that has no network."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from killed_runs import assert_whole, kill_at_random, run_command

from cotton3dg import pipeline
from cotton3dg.commands.clean import clean
from cotton3dg.workspace import Workspace

pytestmark = pytest.mark.slow

SCRIPT = Path(__file__).with_name("killed_runs.py")
N_KILLS = 5


def without_network() -> list[str]:
    """What to put in front of a command so that it runs in a network namespace without interfaces; [] if forbidden."""
    for prefix in (["unshare", "-n"], ["unshare", "-rn"]):
        if (
            shutil.which("unshare")
            and subprocess.run([*prefix, "true"], check=False, capture_output=True).returncode == 0
        ):
            return prefix
    return []


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """A plant run through all stages, looked at on the way; without a network where that can be arranged."""
    plant = tmp_path_factory.mktemp("undisturbed") / "plant"
    command = [*without_network(), sys.executable, str(SCRIPT), "look", str(plant)]
    return plant, subprocess.run(command, capture_output=True, text=True, check=False)


def test_case_49_killed_at_any_write_boundary_of_any_stage_a_result_is_whole(
    undisturbed: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    """Each stage twice: where there is nothing yet, and over an old result."""
    done = undisturbed[1]
    assert done.returncode == 0, done.stderr[-3000:]
    assert int(done.stdout.split()[0]) > 200, done.stdout


def test_the_whole_run_needs_no_network(undisturbed: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    if not without_network():
        pytest.skip("this user may not make a network namespace (unshare -n)")
    here = "import socket; print(*[name for _, name in socket.if_nameindex()])"
    seen = subprocess.run([*without_network(), sys.executable, "-c", here], capture_output=True, text=True, check=True)
    assert set(seen.stdout.split()) <= {"lo"}
    plant, done = undisturbed
    assert done.returncode == 0, done.stderr
    assert assert_whole(Workspace(plant))["traits"].keys() >= {"traits/traits.csv"}


def test_case_49_killed_at_random_the_results_are_those_of_an_undisturbed_run(
    undisturbed: tuple[Path, subprocess.CompletedProcess[str]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Some kills here; `python tests/hard_cases/killed_runs.py kill` does a hundred."""
    kill_at_random(tmp_path / "plant", N_KILLS, 0, undisturbed[0])
    assert capsys.readouterr().out.startswith(f"{N_KILLS} kills: ")


def test_what_clean_dropped_is_made_again_with_the_same_bits(
    undisturbed: tuple[Path, subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    workspace = Workspace(shutil.copytree(undisturbed[0], tmp_path / "plant"))
    before = assert_whole(workspace)
    assert clean(workspace).n_files == len(workspace.dropped()) > 40
    assert assert_whole(workspace) == before
    again = subprocess.run(
        run_command(workspace.root, "--until", "sfm", "-v"), capture_output=True, text=True, check=True
    ).stderr.splitlines()
    assert [line for line in again if "starts" in line] == [
        "frames: starts (clean dropped its files)",
        "sfm: starts (clean dropped its files)",
    ]
    assert not workspace.dropped()
    assert assert_whole(workspace) == before
    standard = pipeline.stage_options(workspace, "standard")
    reasons = [step.reason for step in pipeline.plan(workspace, standard, ("frames",))]
    assert reasons == ["option count 28 -> 100"]
