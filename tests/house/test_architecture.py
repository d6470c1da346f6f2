# SPDX-License-Identifier: Apache-2.0
"""Modules have a readable size. The tests are ordered as the package is, and tests/README.md tells the order."""

import re
from pathlib import Path

from scenes.tiny_plant import ROOT

TESTS = ROOT / "tests"
MOST_LINES, LEAST_LINES = 400, 30
SHORT = {
    "cli/__main__.py": "`python -m cotton3dg.cli` needs a file of this name",
    "core/srgb.py": "rooms of all layers use the curve, and no module of core is about colour",
    "train/random_streams.py": "three modules of train use it, and none of them is about random numbers",
}
"""Modules with fewer lines, and why they are modules of their own."""


def strays(unit: Path, package: Path) -> list[str]:
    """Files of unit tests that carry the name of no module of their room; a conftest may stand anywhere."""
    found = []
    for file in sorted(unit.rglob("*.py")):
        name = file.relative_to(unit)
        module = package / name.with_name(name.name.removeprefix("test_"))
        if name.name != "conftest.py" and not (name.name.startswith("test_") and module.is_file()):
            found.append(name.as_posix())
    return found


def test_each_file_of_unit_tests_carries_the_name_of_a_module_of_its_room():
    assert len(list((TESTS / "unit").rglob("test_*.py"))) > 100
    assert strays(TESTS / "unit", ROOT / "cotton3dg") == [], "what tests the whole goes to tests/house"


def test_a_stray_is_noticed(tmp_path):
    for name in ("package/text.py", "package/io/text.py", "package/io/ply.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    right = ("test_text.py", "io/test_text.py", "io/conftest.py")
    wrong = ("io/ply.py", "io/test_text_files.py", "scale/test_text.py", "test_ply.py")
    for name in (*right, *wrong):
        (tmp_path / "unit" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "unit" / name).touch()
    assert strays(tmp_path / "unit", tmp_path / "package") == list(wrong)


def test_modules_are_neither_long_nor_slivers():
    package = ROOT / "cotton3dg"
    modules = [path for path in package.rglob("*.py") if path.name != "__init__.py"]
    lines = {str(path.relative_to(package).as_posix()): len(path.read_text("utf-8").splitlines()) for path in modules}
    assert len(lines) > 250
    assert [name for name, n in lines.items() if n > MOST_LINES] == [], "split off one thought"
    short = {name for name, n in lines.items() if n < LEAST_LINES}
    assert short == set(SHORT), "does it belong to a neighbour, or is its reason to be told here?"


def test_no_file_of_tests_or_of_the_core_is_long():
    files = [path for pattern in ("tests/**/*.py", "native/**/*.[ch]pp") for path in ROOT.glob(pattern)]
    assert len(files) > 300
    assert [path.name for path in files if len(path.read_text("utf-8").splitlines()) > MOST_LINES] == []


def test_the_readme_tells_each_folder():
    told = re.findall(r"^\| `(\w+)/` \|", (TESTS / "README.md").read_text(encoding="utf-8"), re.M)
    assert sorted(told) == sorted(
        folder.name for folder in TESTS.iterdir() if folder.is_dir() and folder.name != "__pycache__"
    )
