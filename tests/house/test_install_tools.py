# SPDX-License-Identifier: Apache-2.0
"""What belongs to the installation: completion, manual page, checks of wheels, workflows."""

import os
import re
import shutil
import subprocess
import sys
import zipfile

import pytest
from scenes.doc_commands import COMMANDS
from scenes.tiny_plant import ROOT

from cotton3dg.errors import EXIT_CODES

sys.path.append(str(ROOT / "tools"))
import build_wheels
import man_page

HEAVY = ("numpy", "torch", "open3d", "pycolmap", "cv2", "pandas", "scipy")


COMPLETIONS = {
    "bash": {"_COTTON3DG_COMPLETE": "complete_bash", "COMP_WORDS": "cotton3dg doc", "COMP_CWORD": "1"},
    "zsh": {"_COTTON3DG_COMPLETE": "complete_zsh", "_TYPER_COMPLETE_ARGS": "cotton3dg doc"},
    "fish": {
        "_COTTON3DG_COMPLETE": "complete_fish",
        "_TYPER_COMPLETE_ARGS": "cotton3dg doc",
        "_TYPER_COMPLETE_FISH_ACTION": "get-args",
    },
}


@pytest.mark.parametrize("shell", COMPLETIONS)
def test_commands_are_completed_without_large_libraries(shell):
    script = (
        "import atexit, sys\n"
        f"atexit.register(lambda: print([m for m in {HEAVY} if m in sys.modules], file=sys.stderr))\n"
        "from cotton3dg.cli.app import app\napp(prog_name='cotton3dg')"
    )
    settings = {**os.environ, **COMPLETIONS[shell]}
    done = subprocess.run([sys.executable, "-c", script], env=settings, capture_output=True, text=True, check=False)
    assert "doctor" in done.stdout
    assert "batch" not in done.stdout
    assert done.stderr.strip().splitlines()[-1] == "[]"


def test_the_manual_page_has_every_command_and_exit_code():
    page = man_page.man_page()
    assert set(re.findall(r'^\.SS "(\S+)', page, re.M)) == {name.replace("-", "\\-") for name in COMMANDS}
    assert re.findall(r"^\.B (\d+)", page, re.M) == [str(code) for code in EXIT_CODES]
    if shutil.which("man"):
        done = subprocess.run(["man", "--warnings", "-l", "-"], input=page, capture_output=True, text=True, check=True)
        assert done.stderr == ""
        assert "cotton3dg run PLANT_DIR" in re.sub(r"\s+", " ", done.stdout)


@pytest.mark.parametrize("missing", ["", "masks/bolls.onnx", "_native.cpython-311.so"])
def test_a_wheel_without_what_the_program_reads_is_refused(tmp_path, monkeypatch, missing):
    monkeypatch.setattr(build_wheels, "run", lambda command: None)  # auditwheel
    wheel = tmp_path / "cotton3dg-1-cp311-cp311-manylinux_2_24_x86_64.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name in (*build_wheels.NEEDED, "_native.cpython-311.so"):
            if name != missing:
                archive.writestr(f"cotton3dg/{name}", "")
    if missing:
        with pytest.raises(SystemExit, match="lacks"):
            build_wheels.check(wheel)
    else:
        build_wheels.check(wheel)
        newer = wheel.rename(tmp_path / "cotton3dg-1-cp311-cp311-manylinux_2_36_x86_64.whl")
        with pytest.raises(SystemExit, match="newer system"):
            build_wheels.check(newer)


def test_all_that_a_wheel_needs_is_in_the_sources():
    assert all((ROOT / "cotton3dg" / name).is_file() for name in build_wheels.NEEDED)
    read = re.findall(r'"(\w+\.(?:html|css|js))"', (ROOT / "cotton3dg" / "report" / "page.py").read_text())
    assert read
    assert {f"report/templates/{name}" for name in read} <= {
        path.relative_to(ROOT / "cotton3dg").as_posix() for path in (ROOT / "cotton3dg" / "report").rglob("*")
    }


def test_workflows_call_what_the_makefile_has():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M))
    called = [
        name
        for file in (ROOT / ".github" / "workflows").glob("*.yml")
        for names in re.findall(r"- run: make ([\w -]+)|target: \[(.*)\]", file.read_text())
        for name in re.findall(r"[\w-]+", " ".join(names))
    ]
    assert len(called) > 3
    assert set(called) <= targets
