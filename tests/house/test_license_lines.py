# SPDX-License-Identifier: Apache-2.0
"""Each source begins with a line that names its license."""

from pathlib import Path

import pytest
from scenes.tiny_plant import ROOT

LICENSE_LINE = "SPDX-License-Identifier: Apache-2.0"
FOLDERS = (".ci", "cotton3dg", "examples", "native", "tests", "tools")
COMMENTS = {".py": "#", ".pyi": "#", ".sh": "#", ".cpp": "//", ".h": "//", ".hpp": "//", ".js": "//", ".css": "/*"}
"""Ending of a source -> what begins a comment in it."""
NAMED = {"CMakeLists.txt": "#", "run": "#"}
"""Sources whose ending says nothing."""
SENT = ROOT / "cotton3dg" / "report" / "templates"
"""Its files (.html, .js, .css) are copied into each report, so they carry no line of their own."""


def sources() -> list[Path]:
    files = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*")) if path.is_file()]
    return [path for path in files if comment_of(path) and not path.is_relative_to(SENT)]


def comment_of(path: Path) -> str:
    return NAMED.get(path.name, "") or COMMENTS.get(path.suffix, "")


def names_the_license(text: str, comment: str) -> bool:
    lines = text.splitlines()
    first = lines[1:2] if text.startswith("#!") else lines[:1]
    return bool(first) and first[0].removesuffix("*/").strip() == f"{comment} {LICENSE_LINE}"


def test_each_source_names_its_license_first():
    found = sources()
    assert {path.suffix for path in found} >= {".py", ".pyi", ".sh", ".cpp", ".h"}
    missing = [path for path in found if not names_the_license(path.read_text("utf-8"), comment_of(path))]
    assert [path.relative_to(ROOT).as_posix() for path in missing] == [], f"the first line is: {LICENSE_LINE}"


def test_reports_carry_no_license_line():
    assert [path.name for path in SENT.iterdir() if LICENSE_LINE in path.read_text("utf-8")] == []


@pytest.mark.parametrize(
    ("text", "comment", "named"),
    [
        (f"# {LICENSE_LINE}\n", "#", True),
        (f"#!/bin/sh\n# {LICENSE_LINE}\n", "#", True),
        (f"/* {LICENSE_LINE} */\n", "/*", True),
        (f"// {LICENSE_LINE}\n", "#", False),
        (f'"""A module."""\n# {LICENSE_LINE}\n', "#", False),
        ("", "#", False),
    ],
)
def test_a_source_without_it_is_noticed(text, comment, named):
    assert names_the_license(text, comment) == named
