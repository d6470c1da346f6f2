# SPDX-License-Identifier: Apache-2.0
"""How the command line ends: by signals, with streams that are closed or full, and in a terminal of few letters."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from cotton3dg.errors import HUNG_UP, INTERRUPTED, TERMINATED, UNREAD, OutOfResources

PACKAGE = Path(__file__).parents[2] / "cotton3dg"
ORDERLY = "import os, signal, sys, time\nfrom cotton3dg.process import exit_cleanly\n"
WITHIN = ORDERLY + "with exit_cleanly():\n    "
FULL = Path("/dev/full")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="no /dev/full here")


def done(program: str, **streams: Any) -> subprocess.CompletedProcess[str]:
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | streams
    return subprocess.run([sys.executable, "-c", program], text=True, check=False, **pipes)


ENDED = (
    ORDERLY
    + """signal.signal({number}, signal.SIG_DFL)  # the tests themselves may run under nohup
with exit_cleanly():
    try:
        child = os.spawnlp(os.P_NOWAIT, 'sleep', 'sleep', '60')
        os.kill(os.getpid(), {number})
        time.sleep(60)
    finally:
        os.kill(os.getpid(), {number})  # while things are put in order
        os.kill(child, 9)
        print('in order')
"""
)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, TERMINATED), (signal.SIGHUP, HUNG_UP)])
def test_a_signal_ends_what_runs_in_order(number: signal.Signals, code: int) -> None:
    found = done(ENDED.format(number=int(number)))
    assert (found.returncode, found.stdout) == (code, "in order\n")
    assert found.stderr == f"ended by {number.name}; the same command continues\n"
    assert code == 128 + number


def test_nohup_is_obeyed() -> None:
    program = (
        ORDERLY + "signal.signal(1, signal.SIG_IGN)\nwith exit_cleanly():\n    os.kill(os.getpid(), 1)\n    print('on')"
    )
    found = done(program)
    assert (found.returncode, found.stdout) == (0, "on\n")


def test_a_library_for_cameras_does_not_take_sigterm() -> None:
    """Its log prints a stack of C++ and ends the process at once; the import may come from any thread."""
    program = WITHIN + (
        "import threading\n    from cotton3dg.core.libraries import import_pycolmap\n"
        "    thread = threading.Thread(target=import_pycolmap)\n    thread.start()\n    thread.join()\n"
        "    os.kill(os.getpid(), signal.SIGTERM)\n    time.sleep(60)"
    )
    found = done(program)
    assert (found.returncode, found.stderr.count("\n")) == (TERMINATED, 1), found.stderr


def test_nobody_imports_that_library_otherwise() -> None:
    direct = [
        path.name
        for path in PACKAGE.rglob("*.py")
        if re.search(r"^\s*(import|from) pycolmap", path.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert direct == ["libraries.py"]


@pytest.mark.parametrize("n_lines", [1, 20_000])
def test_a_reader_that_has_ended_ends_it_in_silence(n_lines: int) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as pipe:
        found = done(WITHIN + f"print('word\\n' * {n_lines})", stdout=pipe)
    assert (found.returncode, found.stderr) == (UNREAD, "")


@needs_full
@pytest.mark.parametrize("n_lines", [1, 20_000])
def test_a_full_disk_at_stdout_is_told_in_one_line(n_lines: int) -> None:
    with FULL.open("w") as full:
        found = done(WITHIN + f"print('word\\n' * {n_lines})", stdout=full)
    assert found.returncode == OutOfResources.exit_code
    assert re.fullmatch(r"the disk that holds standard output is full; .*\n", found.stderr)


@needs_full
def test_messages_that_cannot_be_written_end_nothing() -> None:
    program = WITHIN + "print('message', file=sys.stderr, flush=True)\n    print('result')"
    with FULL.open("w") as full:
        found = done(program, stderr=full)
    assert (found.returncode, found.stdout) == (0, "result\n")


def test_letters_that_a_terminal_does_not_have_are_spelled_out() -> None:
    program = WITHIN + "print('5 ± 1', 'Pfl\\udcfcnze')\n    print('5 ± 1', file=sys.stderr)"
    found = done(program, env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert (found.returncode, found.stdout, found.stderr) == (0, "5 \\xb1 1 Pfl\\udcfcnze\n", "5 \\xb1 1\n")
    found = done(program, env=os.environ | {"PYTHONIOENCODING": "utf-8"})
    assert (found.returncode, found.stdout) == (0, "5 ± 1 Pfl\\udcfcnze\n")


def test_a_home_that_cannot_be_written_needs_no_word(tmp_path: Path) -> None:
    environment = os.environ | {"HOME": "/proc/nowhere", "TMPDIR": str(tmp_path)}
    found = done(WITHIN + "import matplotlib.font_manager", env=environment)
    assert (found.returncode, found.stderr) == (0, "")


def test_a_stream_that_is_closed_is_none() -> None:
    program = WITHIN + "print('result')\n    sys.exit(8)"
    found = subprocess.run(["sh", "-c", f'"{sys.executable}" -c "$0" >&- 2>&-', program], check=False)
    assert found.returncode == 8


def test_the_command_line_is_orderly() -> None:
    program = "import sys\nfrom cotton3dg.cli.app import main\nsys.argv[1:] = ['--help']\nmain()"
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as pipe:
        found = done(program, stdout=pipe)
    assert (found.returncode, found.stderr) == (UNREAD, "")
    assert INTERRUPTED == 128 + signal.SIGINT
