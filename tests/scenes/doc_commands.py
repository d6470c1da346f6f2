# SPDX-License-Identifier: Apache-2.0
"""The commands in README, docs and examples, and what the command line makes of them."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import typer

from cotton3dg.cli.app import app
from cotton3dg.cli.arguments import parse_overrides
from cotton3dg.option_rules import flags, places
from cotton3dg.options import COMMAND_OPTIONS, PRESETS, STAGE_OPTIONS, resolve
from cotton3dg.pipeline import selected
from scenes.tiny_plant import ROOT

READMES = [ROOT / folder / "README.md" for folder in ("native", "tests")]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *READMES])
SCRIPTS = sorted((ROOT / "examples").glob("*.sh"))
GROUP: Any = typer.main.get_command(app)
COMMANDS: dict[str, Any] = GROUP.commands
KEYWORDS = {"if", "then", "else", "do", "while", "!"}
ENDS = {"|", "||", "&&", ";", "&", "(", ")", "{", "}"}


class Block(NamedTuple):
    """Lines that a reader would copy."""

    language: str
    lines: list[str]


def blocks(page: Path) -> list[Block]:
    """Fenced and indented code blocks of a page."""
    found: list[Block] = []
    fence, before = "", ""
    for line in page.read_text(encoding="utf-8").splitlines():
        mark = re.match(r"(```+)\s*(\w*)", line)
        if mark:
            fence = "" if fence else mark[1]
            if fence:
                found.append(Block(mark[2], []))
        elif fence:
            found[-1].lines.append(line)
        elif line.startswith("    "):
            if not before.startswith("    "):
                found.append(Block("", []))
            found[-1].lines.append(line.strip())
        before = line
    return found


def prose_code(page: Path) -> list[str]:
    """Code spans outside of blocks."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    return re.findall(r"`([^`\n]+)`", "\n".join(line for line in text.splitlines() if not line.startswith("    ")))


def commands(lines: list[str], programs: tuple[str, ...] = ("cotton3dg", "make")) -> Iterator[list[str]]:
    """Calls of `programs` in lines of shell, as words."""
    for line in re.sub(r"\\\n\s*", "", "\n".join(lines)).splitlines():
        if line.lstrip().startswith("#") or not re.search(rf"\b({'|'.join(programs)})\b", line):
            continue
        lexer = shlex.shlex(line, posix=True, punctuation_chars="|&;(){}")
        lexer.commenters = "#"
        lexer.wordchars += "$:,%=@+"
        words: list[str] = []
        for word in [*lexer, ";"]:
            if word not in ENDS:
                words.append(word)
                continue
            while words and (words[0] in KEYWORDS or "=" in words[0]):
                words.pop(0)
            if words and words[0] in programs:
                yield words
            words = []


def check(words: list[str], *, whole: bool = True) -> None:
    """Let the real command line parse `cotton3dg ...` without running it, and check the values of options.

    Args:
        whole: False where the text only mentions a command, perhaps without its arguments.
    Raises:
        Exception: of any kind, when it would be refused.
    """
    if not words[1:]:
        return
    if words[1].startswith("--"):  # the program's own, which act at once
        assert words[1] in option_names(), words
        return
    root = GROUP.make_context("cotton3dg", words[1:])
    with root:
        rest = [*root._protected_args, *root.args]
        if not rest:
            return
        name, command, arguments = GROUP.resolve_command(root, rest)
        try:
            given = command.make_context(name, list(arguments), parent=root).params
        except Exception as error:
            # By name, for typer has click as a module of its own or of others, depending on its version.
            if type(error).__name__ == "Exit" or (
                not whole and type(error).__name__ in ("MissingParameter", "BadOptionUsage")
            ):
                return
            raise
    if name in COMMAND_OPTIONS:
        names = flags(COMMAND_OPTIONS[name])
        resolve(name, asked={key: value for key, value in given.items() if key in names and value is not None})
    for stage, values in parse_overrides(given.get("set_")).items():
        resolve(stage, asked={key: value for key, value in values.items() if "$" not in value})
    assert (given.get("preset") or PRESETS[0]) in PRESETS
    if name == "run":
        selected(given["from_"], given["until"])


def option_names() -> set[str]:
    """Flags of all commands."""
    items = [item for command in (GROUP, *COMMANDS.values()) for item in command.params]
    return {flag for item in items for flag in (*item.opts, *item.secondary_opts)}


def stage_option_names() -> set[str]:
    """STAGE.OPTION of all stages."""
    return {
        f"{stage}.{name}"
        for stage, kind in STAGE_OPTIONS.items()
        for place in places(kind)
        for name in (place.name, place.path)
    }
