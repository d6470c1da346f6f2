"""The tests are ordered as the package is, and tests/README.md tells the order."""

import re
from pathlib import Path

from scenes.tiny_plant import ROOT

TESTS = ROOT / "tests"


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


def test_the_readme_tells_each_folder():
    told = re.findall(r"^\| `(\w+)/` \|", (TESTS / "README.md").read_text(encoding="utf-8"), re.M)
    assert sorted(told) == sorted(
        folder.name for folder in TESTS.iterdir() if folder.is_dir() and folder.name != "__pycache__"
    )
