# SPDX-License-Identifier: Apache-2.0
"""The manual page, from the help: `python tools/man_page.py cotton3dg.1`. make wheel puts it into the wheels."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import typer

from cotton3dg import __version__
from cotton3dg.cli.app import app
from cotton3dg.errors import EXIT_CODES


def man_page() -> str:
    """roff of all commands with their options, and of the exit codes."""
    group: Any = typer.main.get_command(app)
    lines = [f'.TH COTTON3DG 1 "" "cotton3dg {__version__}" "User Commands"', ".SH NAME"]
    lines += [f"cotton3dg \\- {_roff(group.help)}", ".SH SYNOPSIS", ".B cotton3dg", ".I COMMAND", "[options]"]
    lines += [".SH DESCRIPTION", "The usual call is", '.BR "cotton3dg run PLANT_DIR" ,']
    lines += [
        "with a folder that holds one plant's video. The same command continues after any interruption.",
        ".SH COMMANDS",
    ]
    for name, command in group.commands.items():
        wanted = [item for item in command.params if item.param_type_name == "argument"]
        words = " ".join(item.metavar or item.name.upper() for item in wanted)
        lines += [f'.SS "{_roff(name)} {_roff(words)}"', _roff(command.help or "")]
        for option in command.params:
            if option.param_type_name == "option" and not option.hidden:
                names = ", ".join([*option.opts, *option.secondary_opts])
                lines += [".TP", f".B {_roff(names)}", _roff(option.help or "")]
    lines += [".SH EXIT STATUS"]
    for code, meaning in EXIT_CODES.items():
        lines += [".TP", f".B {code}", _roff(meaning)]
    lines += [".SH SEE ALSO", "Each command's", ".B \\-\\-help", "groups its options and gives units and defaults.", ""]
    return "\n".join(lines)


def _roff(text: str) -> str:
    """One line of text, nothing of which roff takes for a request."""
    line = " ".join(text.split()).replace("\\", "\\e").replace("-", "\\-").replace("'", "\\(aq")
    return f"\\&{line}" if line.startswith(".") else line


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(man_page(), encoding="utf-8")
