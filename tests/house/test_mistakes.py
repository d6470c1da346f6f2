# SPDX-License-Identifier: Apache-2.0
"""The rows of `make mistakes` are whole, and what looks at them sees what is wrong."""

import re
import subprocess

import pytest
from scenes.forty_mistakes import MISTAKES
from scenes.mistakes import Ended, Mistake, attempt, changed, faults, snapshot

TYPED = Mistake("a folder misspelt", "cotton3dg run plnat", r"plnat.*; look at its spelling")
RIGHT = b"frames: starts\nplnat: plnat does not exist; look at its spelling\n"


def test_each_row_is_whole():
    assert len({mistake.name for mistake in MISTAKES}) == len(MISTAKES) >= 40
    for mistake in MISTAKES:
        re.compile(mistake.says)
        assert mistake.exits and not {1, -9} & set(mistake.exits) - ({1} if "|" in mistake.command else set()), mistake
        # An error of the program's own says what to do; what works or is ended by the system has nothing to say.
        assert mistake.says or {0, 137} & set(mistake.exits), mistake
        for commands in (mistake.command, mistake.before, mistake.after, mistake.needs):
            subprocess.run(["bash", "-n", "-c", commands], check=True)


@pytest.mark.parametrize(
    ("ended", "fault"),
    [
        (Ended(2, b"", RIGHT), None),
        (Ended(4, b"", RIGHT), "exit code 4 instead of 2"),
        (Ended(2, b"", RIGHT, changed=("plant_1/run.log",)), "changed plant_1/run.log"),
        (Ended(2, RIGHT, b"plnat: cannot be used\n"), "does not say"),
        (Ended(2, b"", RIGHT + b"goodbye\n"), "does not say"),
        (Ended(2, b"", b"Traceback (most recent call last):\n  ...\n" + RIGHT), "Traceback"),
        (Ended(2, b"terminate called after throwing an instance of 'std::bad_alloc'\n", RIGHT), "terminate called"),
        (Ended(2, b"", b"[Errno 2] No such file or directory: 'plnat'\n" + RIGHT), "Errno"),
        (Ended(2, b"", b"Exception ignored in: <_io.TextIOWrapper name='<stdout>'>\n" + RIGHT), "Exception ignored"),
    ],
)
def test_the_checker_sees_what_is_wrong(ended, fault):
    found = faults(TYPED, ended)
    assert found == () if fault is None else any(fault in said for said in found), found


def test_a_frame_around_the_words_does_not_matter_and_the_words_do():
    framed = "╭─ Error ───╮\n│ plnat: not there; look at its spelling │\n╰───────────╯\n".encode()
    assert faults(TYPED, Ended(2, b"", framed)) == ()
    assert Ended(2, b"", framed).last_line == "plnat: not there; look at its spelling"
    assert Ended(2, b"", b"").last_line == ""


def test_every_change_of_a_folder_is_seen(tmp_path):
    (tmp_path / "plant").mkdir()
    for name in ("kept", "edited", "removed"):
        (tmp_path / "plant" / name).write_text(name)
    (tmp_path / "link").symlink_to("plant/kept")
    before = snapshot(tmp_path)
    assert snapshot(tmp_path) == before
    (tmp_path / "plant" / "edited").write_text("Edited")
    (tmp_path / "plant" / "removed").unlink()
    (tmp_path / "plant" / "new").mkdir()
    (tmp_path / "link").unlink()
    (tmp_path / "link").symlink_to("plant/edited")
    after = snapshot(tmp_path)
    assert changed(before, after, ()) == ("link", "plant/edited", "plant/new/", "plant/removed")
    assert changed(before, after, ("plant/*",)) == ("link",)


@pytest.fixture
def made(tmp_path):
    (tmp_path / "made").mkdir()
    (tmp_path / "made" / "table.csv").write_text("plant_id\n")
    return tmp_path / "made"


@pytest.mark.parametrize(
    ("mistake", "fault"),
    [
        (Mistake("in order", "echo 'no such plant; try another' >&2; exit 2", "try another"), None),
        (Mistake("harmful", "echo 'table: try another' >&2; rm table.csv; exit 2", "try another"), "changed table.csv"),
        (Mistake("allowed", "echo saved; rm table.csv", "saved", (0,), may_change=("*.csv",)), None),
        (Mistake("prepared", "echo saved; cat table.csv | grep p7", "p7", (0,), "echo p7 >> table.csv"), None),
        (Mistake("not to be prepared", "true", "", (0,), "cp nosuch here"), "could not be prepared"),
        (Mistake("no way on", "true", "", (0,), after="false"), "`false` ended with exit code 1"),
    ],
    ids=lambda value: value.name if isinstance(value, Mistake) else "",
)
def test_a_mistake_is_made_in_a_copy(made, mistake, fault):
    outcome = attempt(mistake, made, made.parent / "01")
    assert outcome.faults == () if fault is None else fault in outcome.faults[0], outcome
    assert (made.parent / "01").exists() == bool(fault)  # what is wrong can be looked at
    assert (made / "table.csv").read_text() == "plant_id\n"


def test_what_cannot_happen_here_is_skipped(made):
    outcome = attempt(Mistake("elsewhere", "exit 3", "", (0,), needs="false"), made, made.parent / "01")
    assert (outcome.ended, outcome.faults) == (None, ())
