"""Text that a spreadsheet would compute (CWE-1236): an apostrophe in front of it keeps it text."""

from __future__ import annotations


def defuse(text: str) -> str:
    """`text` in a form that a spreadsheet shows instead of computing it."""
    text = text.replace("\0", "")
    return "'" + text if _is_computed(text) else text


def restore(cell: str) -> str:
    """The text from which `defuse` made a cell."""
    return cell[1:] if cell[:1] == "'" and _is_computed(cell[1:]) else cell


def _is_computed(text: str) -> bool:
    """Whether a spreadsheet takes a text for a formula."""
    return text.lstrip().startswith(("=", "+", "-", "@")) or text[:1] in ("\t", "\r")
