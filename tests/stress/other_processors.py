# SPDX-License-Identifier: Apache-2.0
"""The quick tests as on processors of other kinds: `make test-processors`.

    python tests/stress/other_processors.py FOLDER [--only NAME ...] [--jobs 2] [--list] [--pytest ARGUMENTS ...]

Libraries choose their instructions when they are loaded and can be made to do without the newer ones; so a processor is
a set of environment variables. The tests run on four machines: this one as it is, and three of other years, in which
several things differ at once. What fails on one of these runs again with one change at a time, so that the table names
the change. It ends with 1 if anything failed, and says what this machine cannot try. What pytest said of each is in
FOLDER. NAMES are of machines or of single changes. ARGUMENTS for pytest take the place of "-m 'not slow'": a few files
are enough while something is mended.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

from cotton3dg.core.machine import usable_cores

sys.path.append(str(Path(__file__).parents[1] / "accuracy"))

from processors import LIBRARIES

ROOT = Path(__file__).parents[2]
OLD = {key: value for variables in LIBRARIES.values() for key, value in variables.items()}
CHOOSERS = frozenset(OLD)
"""Variables that choose instructions: whoever starts this may have set some."""
QUICK = ("-m", "not slow")
TINY_PLANT = ("tests/end_to_end/test_examples.py::test_one_plant",)


@dataclass(frozen=True)
class Variant:
    """A processor that the tests see."""

    name: str
    environment: dict[str, str] = field(default_factory=dict)
    needs: frozenset[str] = frozenset()
    """Flags in /proc/cpuinfo."""
    tests: tuple[str, ...] = ()
    """What is tested, in place of all quick tests."""
    cores: int = 0
    """0 = all there are."""


AVX2, AVX512 = frozenset({"avx2", "fma"}), frozenset({"avx512f", "avx512dq", "avx512bw", "avx512vl"})
PLAIN_OPENCV = {"PYTHONPATH": str(Path(__file__).with_name("plain_opencv"))}
WHOLE = (
    Variant("base"),
    Variant("of-2008", OLD | {"OMP_NUM_THREADS": "4"}),
    Variant("of-2013", {"COTTON3DG_ISA": "avx2", "OPENBLAS_CORETYPE": "Haswell"} | PLAIN_OPENCV, AVX2),
    Variant("of-2017", {"COTTON3DG_ISA": "avx512", "OPENBLAS_CORETYPE": "SkylakeX"}, AVX2 | AVX512),
    Variant("seed-6", {"COTTON3DG_TINY_SEED": "6"}, tests=TINY_PLANT),
    Variant("seed-7", {"COTTON3DG_TINY_SEED": "7"}, tests=TINY_PLANT),
)
"""Machines. Each instruction set of the core, kernel of OpenBLAS and number of threads is in one of them."""
SINGLE = (
    *(Variant(f"{name.lower()}-of-2008", variables) for name, variables in LIBRARIES.items()),
    Variant("core-avx2", {"COTTON3DG_ISA": "avx2"}, AVX2),
    Variant("core-avx512", {"COTTON3DG_ISA": "avx512"}, AVX2 | AVX512),
    Variant("openblas-haswell", {"OPENBLAS_CORETYPE": "Haswell"}, AVX2),
    Variant("openblas-skylakex", {"OPENBLAS_CORETYPE": "SkylakeX"}, AVX2 | AVX512),
    Variant("opencv-plain", PLAIN_OPENCV),
    Variant("four-threads", {"OMP_NUM_THREADS": "4"}),
    Variant("one-core", cores=1),
)
"""One change at a time: which of them makes a test fail that failed on a machine."""


def flags_of(cpuinfo: str) -> set[str]:
    """What the processor can, by /proc/cpuinfo; nothing known elsewhere than on x86-64 Linux."""
    found = re.search(r"^flags\s*:\s*(.*)$", cpuinfo, re.MULTILINE)
    return set(found[1].split()) if found else set()


def environment_of(variant: Variant, surroundings: dict[str, str]) -> dict[str, str]:
    """Variables of the tests' process."""
    plain = {key: value for key, value in surroundings.items() if key not in CHOOSERS}
    path = {key: os.pathsep.join([value, plain[key]]) for key, value in variant.environment.items() if plain.get(key)}
    own = variant.environment | {key: path[key] for key in path if key == "PYTHONPATH"}
    return plain | {"OMP_NUM_THREADS": "1"} | own


def failures(said: str) -> list[str]:
    """Names of the tests that pytest says failed."""
    return re.findall(r"^(?:FAILED|ERROR) (\S+)", said, re.MULTILINE)


def tested(variant: Variant, folder: Path, jobs: int, wanted: tuple[str, ...]) -> tuple[str, list[str]]:
    """Run the tests in a process that sees another processor: how pytest summed up, and what failed."""
    command = [sys.executable, "-m", "pytest", "-vv", "-rfE", "-p", "no:cacheprovider", *(variant.tests or wanted)]
    command += ["-n", str(1 if variant.tests or variant.cores else jobs), "--dist", "loadfile"]
    command += ["--no-loadscope-reorder"]
    cores = sorted(usable_cores())[: variant.cores or None]
    log = folder / f"{variant.name}.log"
    with log.open("w", encoding="utf-8") as file:
        done = subprocess.run(
            command,
            check=False,
            cwd=ROOT,
            stdout=file,
            stderr=subprocess.STDOUT,
            env=environment_of(variant, dict(os.environ)),
            preexec_fn=lambda: os.sched_setaffinity(0, cores),
        )
    said = log.read_text(encoding="utf-8")
    failed = failures(said) or ([f"pytest ended with {done.returncode}"] if done.returncode else [])
    return (said.strip().splitlines() or ["nothing"])[-1].strip("= "), failed


def causes(failed: list[str], machine: Variant, folder: Path, jobs: int) -> list[str]:
    """The single changes of a machine with which some of its failed tests fail, too."""
    tests = tuple(name for name in failed if "::" in name)
    changes = [
        single for single in SINGLE if single.environment and single.environment.items() <= machine.environment.items()
    ]
    return [single.name for single in changes if tests and tested(single, folder, jobs, tests)[1]]


def main() -> None:
    every = (*WHOLE, *SINGLE)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="+", choices=[variant.name for variant in every], metavar="NAME")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--list", action="store_true", help="say what would be tried")
    parser.add_argument("--pytest", nargs=argparse.REMAINDER, default=QUICK, help="comes last")
    wanted = parser.parse_args()
    info = Path("/proc/cpuinfo")
    flags = flags_of(info.read_text(encoding="utf-8")) if info.is_file() else set()
    wanted.folder.mkdir(parents=True, exist_ok=True)
    print(f"{platform.machine()}, {len(usable_cores())} cores\n\n| processor | tests | failed |")
    print("|---|---|---|")
    bad = 0
    for variant in [one for one in every if one.name in wanted.only] if wanted.only else WHOLE:
        failed: list[str] = []
        if lacking := sorted(variant.needs - flags):
            said = f"cannot be tried here: this processor has no {', '.join(lacking)}"
        elif wanted.list:
            changes = [f"{key}={value}" for key, value in variant.environment.items()]
            said = " ".join(changes + ["1 core"] * variant.cores) or "this machine as it is"
        else:
            said, failed = tested(variant, wanted.folder, wanted.jobs, tuple(wanted.pytest))
            if failed and variant in WHOLE and variant.environment:
                alone = causes(failed, variant, wanted.folder, wanted.jobs)
                said += f"; with one change alone: {', '.join(alone) or 'none fails'}"
        bad += bool(failed)
        print(f"| {variant.name} | {said} | {'<br>'.join(failed)} |", flush=True)
    sys.exit(bad > 0)


if __name__ == "__main__":
    main()
