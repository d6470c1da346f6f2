# SPDX-License-Identifier: Apache-2.0
"""Constants of the package cannot be given a second value."""

import ast
import re

from scenes.tiny_plant import ROOT

CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]+")


def plain_constants(source: str) -> list[str]:
    """Names of the module's constants that are not `Final`, so that mypy lets them be assigned again."""
    found = []
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            found.append(node.targets[0].id)
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found += [] if "Final" in ast.unparse(node.annotation) else [node.target.id]
    return [name for name in found if CONSTANT.fullmatch(name)]


def test_what_counts_as_plain():
    assert plain_constants("A_B = 1\n_C_D: int = 2\nD: Final = 3\nE: Final[int] = 4\nlog = 5\nKind = 6") == [
        "A_B",
        "_C_D",
    ]


def test_constants_are_final():
    plain = {path: plain_constants(path.read_text(encoding="utf-8")) for path in (ROOT / "cotton3dg").rglob("*.py")}
    assert len(plain) > 300
    assert {path.name: names for path, names in plain.items() if names} == {}
