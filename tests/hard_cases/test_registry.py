# SPDX-License-Identifier: Apache-2.0
"""Every hard case has its tests, and the page that shows them is up to date."""

from __future__ import annotations

import ast

import pytest
from bench_guards import GUARDS
from mutations import MUTATIONS
from registry import CASES, CORE, GEOMETRY
from report import page
from source_changes import ROOT, Change, apply_change


def test_numbers_are_complete_and_never_reused() -> None:
    numbers = [case.number for case in CASES]
    assert numbers == list(range(1, len(numbers) + 1))
    assert len(numbers) >= 54


def test_every_case_has_a_promise_and_a_test() -> None:
    for case in CASES:
        assert case.name, case.number
        assert case.promise, case.number
        assert case.tests or case.planned, case.number


def test_no_case_of_the_core_or_of_geometry_is_only_planned() -> None:
    open_cases = [case.number for case in CASES if case.planned]
    print("planned:", *(f"{case.number} {case.name}: {case.planned}" for case in CASES if case.planned), sep="\n  ")
    assert not set(open_cases) & {*CORE, *GEOMETRY, 53, 54}
    assert all(CASES[number - 1].tests for number in (*CORE, *GEOMETRY, 53, 54))


def test_every_named_test_exists() -> None:
    functions: dict[str, set[str]] = {}
    for case in CASES:
        for test in case.tests:
            path, name = test.split("::")
            if path not in functions:
                body = ast.parse((ROOT / path).read_text(encoding="utf-8")).body
                functions[path] = {node.name for node in body if isinstance(node, ast.FunctionDef)}
            assert name in functions[path], f"case {case.number}: {test}"


def test_the_page_is_up_to_date() -> None:
    written = (ROOT / "docs" / "hard_cases.md").read_text(encoding="utf-8")
    assert written == page(), "write it again: python tests/hard_cases/report.py --page docs/hard_cases.md"


CHANGES = [change for mutation in MUTATIONS for change in mutation.changes]
CHANGES += [change for changes in GUARDS.values() for change in changes]


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: f"{change.file}:{change.function}")
def test_the_bugs_to_bring_back_still_fit_the_sources(change: Change) -> None:
    """So that mutations.py and bench_guards.py keep working; whoever rewrites the code that they name changes them."""
    before = change.path.read_text(encoding="utf-8")
    after = apply_change(before, change)
    assert after != before
    assert after.count("@") == before.count("@")  # nothing is left open
    if change.file.endswith(".py"):
        ast.parse(after)


def test_a_change_fits_after_a_formatter_and_a_renamed_variable_but_in_no_other_function() -> None:
    change = Change("a.cpp", "work", "if (!(@flags[@lane] == 0))", "if (@lane < 0)")
    other = "void other() {\n    if (!(bad[i] == 0)) {}\n}\n"
    source = other + "bool work(int n) {\n    for (;;) {\n        if (!(bad[i]\n              == 0)) {}\n    }\n}\n"
    assert apply_change(source, change) == source[: len(other)] + source[len(other) :].replace(
        "if (!(bad[i]\n              == 0))", "if (i < 0)"
    )
    python = "def other(x):\n    return clip(x, 0)\n\ndef work(y):\n    return clip(\n        y, 0\n    )\n"
    changed = apply_change(python, Change("a.py", "work", "clip(@p, 0)", "@p"))
    assert changed == "def other(x):\n    return clip(x, 0)\n\ndef work(y):\n    return y\n"
    for wrong in (other, source + source, source.replace("bad[i]\n", "bad[i + 1]\n")):
        with pytest.raises(ValueError, match="not once"):
            apply_change(wrong, change)
