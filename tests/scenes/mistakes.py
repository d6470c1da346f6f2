# SPDX-License-Identifier: Apache-2.0
"""A mistake of a user or an accident of a machine: what it may end with, and what it must leave as it was."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from typing import Final

from cotton3dg.errors import DOUBTFUL, SOME_FAILED

LIMIT_S: Final = 600
"""No row trains for long; what takes longer hangs, or began anew what was done."""
WORKED: Final = (0, SOME_FAILED, DOUBTFUL)
TRACES: Final = re.compile(
    rb"Traceback \(most recent|terminate called|what\(\):|Segmentation fault|core dumped|Exception ignored|Aborted"
    rb"|stack trace|\[Errno |\w+(Error|Exception): |^\s+@ +0x",
    re.M,
)
"""What a program says that did not expect it."""
FRAME: Final = re.compile(r"[\s\u2500-\u257f+|]+")
"""What surrounds the words of a usage error."""


@dataclass(frozen=True)
class Mistake:
    """One row of the script. Its commands are bash's, in a folder with `plant_1`, `field`, `fresh` and `film.mp4`."""

    name: str
    command: str
    says: str
    """Regular expression: the remedy, in the last line of stderr; where the command did its work, in any line."""
    exits: tuple[int, ...] = (2,)
    before: str = ""
    """What has happened until then."""
    after: str = ""
    """What has to work then, as the remedy says."""
    may_change: tuple[str, ...] = ()
    """Patterns of what the command is there to write."""
    needs: str = ""
    """A command that fails where the accident cannot happen."""


@dataclass(frozen=True)
class Ended:
    """How the commands of a mistake ended."""

    exit_code: int
    stdout: bytes
    stderr: bytes
    changed: tuple[str, ...] = ()
    after: int = 0
    """Exit code of what has to work then."""

    @property
    def last_line(self) -> str:
        """The last line of stderr that has words, without a frame."""
        return next(iter(reversed(_lines(self.stderr))), "")


@dataclass(frozen=True)
class Outcome:
    """What became of a mistake."""

    mistake: Mistake
    ended: Ended | None = None
    """None where it was skipped."""
    faults: tuple[str, ...] = field(default=())


def faults(mistake: Mistake, ended: Ended) -> tuple[str, ...]:
    """What is not as it should be, each in a few words."""
    found = []
    if trace := TRACES.search(ended.stdout + b"\n" + ended.stderr):
        found.append(f"says {trace[0].decode(errors='replace').strip()!r}")
    if ended.exit_code not in mistake.exits:
        found.append(f"exit code {ended.exit_code} instead of {' or '.join(map(str, mistake.exits))}")
    said = _lines(ended.stdout + b"\n" + ended.stderr) if ended.exit_code in WORKED else [ended.last_line]
    if not any(re.search(mistake.says, line, re.I) for line in said):
        found.append(f"does not say {mistake.says!r}")
    if ended.changed:
        more = f" and {len(ended.changed) - 4} more" if len(ended.changed) > 4 else ""
        found.append(f"changed {', '.join(ended.changed[:4])}{more}")
    if ended.after:
        found.append(f"`{mistake.after}` ended with exit code {ended.after}")
    return tuple(found)


def _lines(said: bytes) -> list[str]:
    lines = [FRAME.sub(" ", line).strip() for line in said.decode(errors="replace").splitlines()]
    return [line for line in lines if re.search(r"\w", line)] or [""]


def snapshot(folder: Path) -> dict[str, str]:
    """What is below a folder, by path: the SHA-256 of each file, the target of each link, the folders.

    A lock's file names its last holder and is no result.
    """
    found = {}
    for above, folders, files in os.walk(os.fsencode(folder)):
        for name in folders + files:
            path = os.path.join(above, name)  # noqa: PTH118  names are bytes: some are not UTF-8
            key = os.path.relpath(path, os.fsencode(folder)).decode(errors="backslashreplace")
            if os.path.islink(path):  # noqa: PTH114
                found[key] = f"link to {os.fsdecode(os.readlink(path))!r}"  # noqa: PTH115
            elif name in folders:
                found[key + "/"] = "folder"
            else:
                found[key] = "lock" if name == b".lock" else _sha256(path)
    return found


def _sha256(path: bytes) -> str:
    with open(path, "rb") as file:  # noqa: PTH123
        return hashlib.file_digest(file, "sha256").hexdigest()


def changed(before: dict[str, str], after: dict[str, str], may_change: tuple[str, ...]) -> tuple[str, ...]:
    """Paths that are new, gone or different and should not be."""
    paths = (path for path in sorted(before.keys() | after.keys()) if before.get(path) != after.get(path))
    return tuple(path for path in paths if not any(fnmatch(path.rstrip("/"), pattern) for pattern in may_change))


def attempt(mistake: Mistake, made: Path, folder: Path) -> Outcome:
    """Make a mistake in a copy of what is finished; the copy stays where something is wrong."""
    _drop(folder)
    shutil.copytree(made, folder, symlinks=True)
    home = folder.with_name("home")
    home.mkdir(exist_ok=True)
    if _bash(mistake.needs, folder, home).returncode:
        _drop(folder)
        return Outcome(mistake)
    prepared = _bash(mistake.before, folder, home)
    if prepared.returncode:
        return Outcome(mistake, faults=(f"could not be prepared: {prepared.stderr.decode(errors='replace')}",))
    before = snapshot(folder)
    done = _bash(mistake.command, folder, home)
    after = _bash(mistake.after, folder, home).returncode
    differ = changed(before, snapshot(folder), mistake.may_change)
    ended = Ended(done.returncode, done.stdout, done.stderr, differ, after)
    found = faults(mistake, ended)
    if not found:
        _drop(folder)
    return Outcome(mistake, ended, found)


def _drop(folder: Path) -> None:
    if folder.exists():
        subprocess.run(["chmod", "-R", "u+rwX", folder], check=True)
        shutil.rmtree(folder)


def _bash(commands: str, folder: Path, home: Path) -> subprocess.CompletedProcess[bytes]:
    """Commands as an ordinary user types them: `cotton3dg` and `python` are this environment's."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {"PATH": path, "HOME": str(home), "LANG": "C.UTF-8", "COLUMNS": "160"}
    with subprocess.Popen(
        [*_as_a_user(), "bash", "-o", "pipefail", "-c", commands],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:
        try:
            said = process.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            stdout, stderr = process.communicate()
            said = stdout, stderr + f"\nstopped after {LIMIT_S} s".encode()
        return subprocess.CompletedProcess(commands, process.returncode, *said)


def _as_a_user() -> Iterator[str]:
    """Permissions bind root, too, once it has given up what is root's."""
    if os.geteuid() == 0 and shutil.which("setpriv"):
        yield from ("setpriv", "--bounding-set=-all", "--inh-caps=-all", "--")
