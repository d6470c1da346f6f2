# SPDX-License-Identifier: Apache-2.0
"""Errors at the command line: one line, the right exit code, and a hint that helps; whatever path was named."""

import errno
import os
import re
from pathlib import Path

import pytest
from click.testing import Result
from scenes.tiny_plant import ROOT
from typer.testing import CliRunner

from cotton3dg.choices import read_toml
from cotton3dg.cli.app import app
from cotton3dg.cli.arguments import parse_overrides
from cotton3dg.errors import (
    EXIT_CODES,
    BadInput,
    BadUsage,
    CaptureFailed,
    EnvironmentUnusable,
    MissingInput,
    OutOfResources,
    as_capture_failure,
    unknown,
)
from cotton3dg.io.saving import explained
from cotton3dg.options import resolve
from cotton3dg.pipeline import selected, stage_options
from cotton3dg.workspace import Workspace

BELOW_PROC = Path("/proc/cotton3dg")
"""Nobody can make a folder there, root neither."""


def told(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(word) for word in arguments])


def assert_told(result: Result, code: int, words: str) -> None:
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code == code, result.output
    assert words in result.stderr.splitlines()[-1]


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "table.csv"
    path.write_text("plant_id,boll_count,boll_volume_cm3\na,9,300\nb,11,400\nc,4,100\n")
    return path


def test_what_was_typed_is_not_the_capture() -> None:
    assert {kind.exit_code for kind in (BadUsage, MissingInput, BadInput)} == {2}
    assert CaptureFailed.exit_code == 4
    with pytest.raises(CaptureFailed, match="cut off"), as_capture_failure():
        raise BadInput("a.jpg is cut off; copy it again")
    with pytest.raises(MissingInput), as_capture_failure():
        raise MissingInput("no video; copy it here")


def test_the_table_of_exit_codes_is_that_of_the_program() -> None:
    page = (ROOT / "docs" / "troubleshooting.md").read_text()
    assert dict(re.findall(r"^\| (\d+) \| ([^|]+) \|", page.replace("`", ""), re.M)) == {
        str(code): words.replace("`", "") for code, words in EXIT_CODES.items()
    }


def test_the_day_s_films_are_told_by_codes_of_films_only() -> None:
    """The loop in check.md writes down what is to be filmed again, and no misspelt name."""
    page = (ROOT / "docs" / "check.md").read_text()
    (codes,) = re.findall(r"case \$\? in ([\d|]+)\)", page)
    assert {int(code) for code in codes.split("|")} == {4, 9}


@pytest.mark.parametrize(
    ("code", "kind"),
    [
        (errno.ENOENT, BadInput),
        (errno.ENOTDIR, BadInput),
        (errno.EISDIR, BadInput),
        (errno.ENAMETOOLONG, BadInput),
        (errno.EACCES, EnvironmentUnusable),
        (errno.EROFS, EnvironmentUnusable),
        (errno.EIO, EnvironmentUnusable),
        (errno.ENOSPC, OutOfResources),
        (errno.EFBIG, OutOfResources),
    ],
)
def test_what_the_operating_system_says_of_a_path_names_it_and_a_remedy(code: int, kind: type) -> None:
    found = explained(OSError(code, os.strerror(code), "out/table.csv"), Path("plant"))
    assert type(found) is kind
    assert ("plant" if kind is OutOfResources else "out/table.csv") in str(found)
    assert "; " in str(found)


@pytest.mark.parametrize(
    "command",
    [
        ("demo", BELOW_PROC),
        ("simulate", BELOW_PROC),
        ("evaluate", "TABLE", "--truth", "TABLE", "--out", BELOW_PROC),
        ("evaluate", "TABLE", "--truth", "TABLE", "--out", "TABLE"),
        ("cards", "TABLE", BELOW_PROC / "cards.pdf"),
        ("cards", "TABLE", "TABLE/cards.pdf"),
        ("cards", "TABLE", "FOLDER.pdf"),
        ("markers", BELOW_PROC / "sheet.pdf"),
        ("masks-train", BELOW_PROC, "--scenes", "1", "--steps", "1"),
    ],
)
def test_a_path_that_cannot_be_written_is_one_line(table: Path, tmp_path: Path, command: tuple) -> None:
    (tmp_path / "FOLDER.pdf").mkdir()
    words = [str(word).replace("TABLE", str(table)).replace("FOLDER", str(tmp_path / "FOLDER")) for word in command]
    result = told(*words)
    assert isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code in (2, 3)
    assert "; " in result.stderr.splitlines()[-1]


def test_files_that_are_not_there_are_told_by_their_own_option(tmp_path: Path, table: Path) -> None:
    assert_told(told("doctor", tmp_path / "nosuch"), 2, "is not a folder; give the one where plants are to be run")
    assert_told(told("cards", table), 2, f"{table.name} is not .pdf; write cotton3dg cards {table.name} cards.pdf")
    trained = told("masks-train", tmp_path / "new", "--annotations", tmp_path / "nosuch")
    assert_told(trained, 2, "nosuch is not there; give a folder of masks or an annotation file")


def test_a_misspelt_word_is_answered_with_the_likely_one(tmp_path: Path) -> None:
    with pytest.raises(BadUsage, match=r"stage 'tran' is unknown; did you mean train\?"):
        parse_overrides(["tran.steps=100"])
    with pytest.raises(BadUsage, match=r"STAGE.OPTION=VALUE"):
        parse_overrides(["steps=100"])
    with pytest.raises(BadUsage, match=r"train\.stpes is unknown; did you mean steps\?"):
        resolve("train", asked={"stpes": "100"})
    with pytest.raises(BadUsage, match=r"'bols' is unknown; did you mean bolls\?"):
        resolve("masks", asked={"backend": "bols"})
    with pytest.raises(BadUsage, match=r"'drfat' is unknown; did you mean draft\?"):
        stage_options(None, "drfat")
    with pytest.raises(BadUsage, match=r"'sfn' is unknown; did you mean sfm\?"):
        selected("sfn")
    (tmp_path / "cotton3dg.toml").write_text("[segmnt]\n")
    with pytest.raises(BadUsage, match=r"\[segmnt\] is unknown; did you mean segment\?"):
        read_toml(tmp_path / "cotton3dg.toml")
    (tmp_path / "cotton3dg.toml").write_text("train = 3\n")
    with pytest.raises(BadUsage, match=r"train is not a table"):
        read_toml(tmp_path / "cotton3dg.toml")
    assert str(unknown("colour 'x'", "x", ("red", "blue"))) == "colour 'x' is unknown; use red, blue"


def test_who_holds_a_plant_is_named(tmp_path: Path) -> None:
    (tmp_path / "video.mp4").write_text("x")
    with Workspace(tmp_path).locked(), pytest.raises(EnvironmentUnusable) as refused, Workspace(tmp_path).locked():
        pass
    assert f"(process {os.getpid()} on " in str(refused.value)
    assert "--wait" in str(refused.value)
