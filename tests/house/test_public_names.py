# SPDX-License-Identifier: Apache-2.0
"""The Python API: what `import cotton3dg` offers, what it costs, and that stub and documentation say the same."""

import ast
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest

import cotton3dg

ROOT = Path(__file__).parents[2]
PUBLIC = {name: module for module, names in cotton3dg._HOMES.items() for name in names}


def test_the_stub_names_the_same():
    stub = ast.parse(Path(cotton3dg.__file__).with_suffix(".pyi").read_text())
    found = {
        alias.asname: node.module for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert found == PUBLIC
    assert (ROOT / "cotton3dg" / "py.typed").exists()


def test_each_is_there_and_explained():
    for name in PUBLIC:
        assert getattr(cotton3dg, name).__doc__, name
    assert set(PUBLIC) <= set(dir(cotton3dg))
    with pytest.raises(AttributeError, match="no attribute 'harvest'"):
        _ = cotton3dg.harvest


def test_none_hides_a_module():
    assert not set(PUBLIC) & {module.name for module in pkgutil.iter_modules(cotton3dg.__path__)}


def test_the_documentation_lists_each():
    text = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    table = "\n".join(line for line in text.splitlines() if line.startswith("| "))
    listed = set(re.findall(r"`(\w+)`", table))
    assert listed == set(PUBLIC)
    assert set(re.findall(r"c3d\.(\w+)", text)) <= listed


def test_importing_loads_nothing_large():
    script = "import sys, cotton3dg; print([m for m in ('numpy', 'typer', 'torch', 'cv2') if m in sys.modules])"
    assert subprocess.check_output([sys.executable, "-c", script], text=True).strip() == "[]"
