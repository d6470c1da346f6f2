# SPDX-License-Identifier: Apache-2.0
"""Small changes of sources, found by the function that they are in and by their code, however it is laid out.

Code is given as in the source; spaces and line breaks do not matter, and `@name` stands for any one name or number, the
same one wherever it occurs again. So a change still fits after a formatter or a renamed variable.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]


class Change(NamedTuple):
    """Other code in one place of one function."""

    file: str
    """Below native/src, or below the root where it is a .py."""
    function: str
    """In whose body the code occurs exactly once."""
    code: str
    instead: str
    """What is put in its place; @names are those that were found."""

    @property
    def path(self) -> Path:
        return ROOT / self.file if self.file.endswith(".py") else ROOT / "native" / "src" / self.file


def apply_change(source: str, change: Change) -> str:
    """The source with the change made.

    Raises:
        ValueError: the function, or its code, is not there exactly once.
    """
    spans = python_spans if change.file.endswith(".py") else cpp_spans
    bodies = spans(source, change.function)
    found = [match for begin, end in bodies for match in pattern_of(change.code).finditer(source, begin, end)]
    if len(bodies) != 1 or len(found) != 1:
        where = f"{change.file} has {len(bodies)} functions {change.function}"
        raise ValueError(f"{where}, and in them {len(found)} times, not once: {change.code}")
    instead = re.sub(r"@(\w+)", lambda hole: found[0][hole[1]], change.instead)
    return source[: found[0].start()] + instead + source[found[0].end() :]


def pattern_of(code: str) -> re.Pattern[str]:
    """What matches the code in any layout."""
    pattern, seen, before = "", set(), ""
    for token in re.findall(r"@?\w+|[^\w\s]", code):
        is_word = token[-1].isalnum() or token[-1] == "_"
        if before:
            pattern += r"\s+" if is_word and before == "word" else r"\s*"
        before = "word" if is_word else "sign"
        name = token[1:]
        if not token.startswith("@"):
            pattern += rf"\b{token}\b" if is_word else re.escape(token)
        else:
            pattern += rf"\b(?P={name})\b" if name in seen else rf"\b(?P<{name}>\w+)\b"
            seen.add(name)
    return re.compile(pattern)


def python_spans(source: str, function: str) -> list[tuple[int, int]]:
    """Where functions of this name begin and end."""
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    return [
        (starts[node.lineno - 1], starts[node.end_lineno or node.lineno])
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FunctionDef) and node.name == function
    ]


def cpp_spans(source: str, function: str) -> list[tuple[int, int]]:
    """Where functions of this name that have a body begin and end; strings and comments must hold brackets in pairs."""
    spans = []
    for match in re.finditer(rf"\b{function}\s*\(", source):
        signature = closing(source, match.end() - 1)
        body = re.compile(r"\s*(?:const|noexcept)?\s*\{").match(source, signature)
        if body:
            spans.append((match.start(), closing(source, body.end() - 1)))
    return spans


def closing(source: str, at: int) -> int:
    """Index behind the bracket that closes the one at `at`."""
    depth = 0
    for index in range(at, len(source)):
        depth += (source[index] in "({[") - (source[index] in ")}]")
        if depth == 0:
            return index + 1
    raise ValueError(f"nothing closes the bracket at {at}")
