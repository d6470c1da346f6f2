# SPDX-License-Identifier: Apache-2.0
"""What `cotton3dg view` shows: its own page, how plants do at this moment, and reports that may ask the server.

Everything is read from the files of a run or a batch, which know nothing of the page.
"""

from __future__ import annotations

import base64
import hashlib
import math
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from datetime import datetime
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Final

from .. import __version__
from ..core.runs import State
from ..errors import BadInput
from ..io.command_queue import BUTTONS
from ..io.tables import parse_number
from ..options import PRESETS, USUAL_TABLE_CM
from ..schemas.check import RED, YELLOW, CheckInfo
from ..stage import STAGES
from ..workspace import VIDEO_SUFFIXES, Workspace
from .facts import read_facts
from .index import SHOWN, interval_text
from .page import MARKED_BYTES, TEMPLATES, fill_template, give_verdict
from .verdicts import SURENESS, rounded, sureness_of

CLOSED: Final = b"default-src 'none';"
OPENED: Final = CLOSED + b" connect-src 'self';"
"""The policy that a page brings with it, as it is and as it may ask the server that it came from."""
PAGE: Final = b'<html lang="en">'
MARKED: Final = b'<html lang="en" data-view>'
"""A page that knows that `view` shows it."""
BEGIN: Final = re.compile(rb'<body>\s*(?:<a class="skip"[^>]*>[^<]*</a>)?')
"""Where a page's content begins; a link that skips it stays the first."""
BACK: Final = b'<nav class="back" aria-label="Back"><a href="%b">Back to the table</a></nav>'
SANDBOX: Final = "sandbox allow-scripts allow-downloads allow-modals; frame-ancestors 'none'"
"""Policy for any other page: its scripts run as if it had come from elsewhere, and the server refuses what they ask."""
WORKING: Final = "working"
PRESET_WORDS: Final = {
    "draft": ": quickest",
    "paper": ": finest, slowest",
    "paper1": ": as Cotton3DGaussians",
    "paper2": ": as the second paper",
}
LOG_BYTES: Final = 2**16
"""The end of run.log that is read; the last begin of a stage stands there."""
TURNS: Final = re.compile(r"^(\S+ \S+),\d+ \w+ (\w+) (starts:|begins$|done in|failed:)", re.MULTILINE)
BEGINS: Final = ("starts:", "begins")


def view_page(name: str, *, is_field: bool, usual: Mapping[str, str] | None = None) -> bytes:
    """The page with all plants, which fills itself by asking for their states.

    Args:
        usual: what the form means for a new plant where it is blank.
    """
    content = {
        "name": name,
        "is_field": is_field,
        "usual": usual or {},
        "buttons": BUTTONS,
        "usual_table": [f"{side:g}" if is_field else "as before" for side in USUAL_TABLE_CM],
        "shown": SHOWN,
        "presets": {preset: f"{preset}{PRESET_WORDS.get(preset, '')}" for preset in PRESETS},
        "sureness": SURENESS,
        "suffixes": ",".join(VIDEO_SUFFIXES),
        "version": __version__,
    }
    scripts = [(TEMPLATES / "view.js").read_text("utf-8")]
    return fill_template("view.html", scripts, content).encode()


def opened(page: bytes, depth: int) -> tuple[bytes, str]:
    """A page as the browser gets it, with a link to the first page, and the policy that the browser holds it to.

    A page with a script of this version may ask the server, and no script but those of this version runs in it: the
    folder may come from somebody else. Any other page is shown apart from the server.

    Args:
        depth: number of names in the page's address; 0 = the first page itself, which gets no link.
    """
    head = page[:MARKED_BYTES]
    if depth:
        back = BACK % (b"../" * (depth - 1) or b"./")
        page = BEGIN.sub(lambda begin: begin[0] + back, page, count=1)
    if not any(script.encode() in head for script in _asking()):
        return page, SANDBOX
    policy = f"script-src {' '.join(_own_scripts())}; connect-src 'self'; base-uri 'none'; frame-ancestors 'none'"
    return page.replace(PAGE, MARKED, 1).replace(CLOSED, OPENED, 1), policy


@cache
def _asking() -> tuple[str, ...]:
    """The scripts that ask the server, as a policy names them."""
    return tuple(_hash((TEMPLATES / name).read_text("utf-8")) for name in ("mend.js", "view.js"))


@cache
def _own_scripts() -> tuple[str, ...]:
    """All scripts of this version, as a policy names them."""
    return tuple(f"'{_hash(path.read_text('utf-8'))}'" for path in sorted(TEMPLATES.glob("*.js")))


def _hash(script: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


def describe(workspace: Workspace) -> dict[str, Any]:
    """How a plant does: state, verdict and why, its traits as the page shows them, the verdict of the last check."""
    seen = (workspace.root, workspace.record_file("").parent, workspace.check_html.parent, workspace.traits_csv.parent)
    found = _describe(workspace.root, tuple(_changed_ns(path) for path in seen))
    if not workspace.is_locked:
        return found
    return found | {"state": WORKING, "verdict": YELLOW, "text": working_text(workspace, datetime.now())}


@lru_cache(maxsize=4096)
def _describe(root: Path, _changed: tuple[int, ...]) -> dict[str, Any]:
    """Cached, as the page asks every few seconds; whoever changes a plant changes one of its folders."""
    workspace = Workspace(root)
    facts = read_facts(workspace)
    found: dict[str, Any] = {
        "traits": {name: _shown(facts.traits, name) for name in SHOWN},
        "intervals": {name: interval_text(facts.traits, name) for name in SHOWN},
        "sure": {name: sureness_of(facts.traits, name) or "" for name in SHOWN},
    }
    if check := _last_check(workspace):
        found["check"] = {"verdict": check.verdict, "text": check.line}
    if facts.traits:
        table = facts.scale.table_words if facts.scale else ""
        corrections = int(facts.traits.get("corrections") or 0)
        by_hand = f"{corrections} correction{'s' * (corrections > 1)} by hand" if corrections else ""
        found["made_with"] = "; ".join(filter(None, (facts.preset, table, by_hand)))
        return found | {"state": State.DONE} | give_verdict(facts, "")
    if any(item.state == State.FAILED for item in facts.stages):
        return found | {"state": State.FAILED, "verdict": RED, "text": facts.failure}
    return found | {"state": State.WAITING, "verdict": YELLOW, "text": "not measured yet"}


def _shown(row: dict[str, str], trait: str) -> str:
    value = parse_number(row.get(trait))
    return "" if math.isnan(value) else rounded(value, SHOWN[trait][2])


def _last_check(workspace: Workspace) -> CheckInfo | None:
    with suppress(BadInput):
        return CheckInfo.load_if_there(workspace.check_json)
    return None


def _changed_ns(path: Path) -> int:
    with suppress(OSError):
        return path.stat().st_mtime_ns
    return 0


def working_text(workspace: Workspace, now: datetime) -> str:
    """What a run that is going on does, by the end of its log: `train, stage 3 of 8, for 4 min`."""
    turns = TURNS.findall(_log_end(workspace.log_file))
    if not turns or turns[-1][2] not in BEGINS or turns[-1][1] not in STAGES:
        return "at work"
    since, stage, _ = turns[-1]
    minutes = max(0, int((now - datetime.fromisoformat(since)).total_seconds() // 60))
    long = f", for {minutes} min" if minutes else ""
    return f"{stage}, stage {STAGES.index(stage) + 1} of {len(STAGES)}{long}"


def _log_end(file: Path) -> str:
    try:
        with file.open("rb") as log:
            log.seek(max(0, log.seek(0, os.SEEK_END) - LOG_BYTES))
            return log.read().decode("utf-8", "replace")
    except OSError:
        return ""
