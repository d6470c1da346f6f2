# SPDX-License-Identifier: Apache-2.0
"""Run the tests of all hard cases and print the table: number, case, promise, tests, pass or fail, seconds.

python tests/hard_cases/report.py               run (`make hard-cases`)
python tests/hard_cases/report.py --page FILE   write the page of docs/ instead, without running anything
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from registry import CASES, Case

ROOT = Path(__file__).parents[2]
SUBJECTS = {
    1: "Drawing and training",
    30: "Geometry and scale",
    36: "Structure from motion",
    39: "Videos, images and files",
    49: "Runs",
}
"""First case of a part of the page -> its heading."""


class Outcomes:
    """What pytest tells while it runs: seconds and outcome of every test function, and what the tests measured."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()
        self.outcomes: dict[str, set[str]] = {}
        self.worst: dict[str, float] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        test = report.nodeid.split("[")[0]
        self.seconds[test] += report.duration
        if report.when == "call" or report.outcome != "passed":
            self.outcomes.setdefault(test, set()).add(report.outcome)
        for name, value in report.user_properties if report.when == "call" else ():
            self.worst[name] = max(self.worst.get(name, 0.0), value)

    def verdict(self, case: Case) -> str:
        found = set().union(*(self.outcomes.get(test, {"missing"}) for test in case.tests))
        if found & {"failed", "missing"}:
            return "FAIL"
        return "pass" if "passed" in found else "skipped"


def print_table(outcomes: Outcomes) -> None:
    for case in CASES:
        seconds = sum(outcomes.seconds[test] for test in case.tests)
        print(f"{case.number:>3}  {outcomes.verdict(case):<7} {seconds:6.1f} s  {case.name}: {case.promise}")
        for test in case.tests:
            print(f"{'':23}{test}")
        if case.planned:
            print(f"{'':23}planned: {case.planned}")
    if outcomes.worst:
        print("\nmeasured, worst value (bound):")
    for name, value in sorted(outcomes.worst.items()):
        print(f"{value:12.3g}  {name}")


def page() -> str:
    """The registry as Markdown."""
    lines = [
        "# Hard cases",
        "",
        "Each row is an input or a state that has broken other splatting or measuring programs, what this program",
        "promises there, and the tests of the promise. `make hard-cases` runs them.",
    ]
    for case in CASES:
        if case.number in SUBJECTS:
            lines += ["", f"## {SUBJECTS[case.number]}", "", "| # | case | promise | tests |", "|---|---|---|---|"]
        tests = "<br>".join(f"[`{test.split('::')[1]}`](../{test.split('::')[0]})" for test in case.tests)
        planned = f"<br>*planned: {case.planned}*" if case.planned else ""
        lines.append(f"| {case.number} | {case.name} | {case.promise}{planned} | {tests} |")
    return "\n".join(lines) + "\n"


def run() -> int:
    tests = sorted({test for case in CASES for test in case.tests})
    outcomes: Any = Outcomes()
    status = pytest.main(["-q", "--no-header", f"--rootdir={ROOT}", *(str(ROOT / test) for test in tests)], [outcomes])
    print_table(outcomes)
    return int(status) or int(any(outcomes.verdict(case) == "FAIL" for case in CASES))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--page", type=Path, help="write this Markdown file")
    target = parser.parse_args().page
    if target:
        target.write_text(page(), encoding="utf-8")
    else:
        sys.exit(run())
