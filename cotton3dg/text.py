# SPDX-License-Identifier: Apache-2.0
"""Text files from users, as editors and spreadsheets of all countries save them."""

from __future__ import annotations

import codecs
import re
from pathlib import Path
from typing import Final

from .errors import BadInput, Cotton3dgError

MARKS: Final = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32-le",  # before UTF-16, because it begins with the mark of UTF-16
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}
"""Byte order marks; a mark names the encoding."""
LATIN_PAGES: Final = ("cp1252", "cp1250", "cp1254")
"""Windows code pages of Western and Central Europe, America and Turkey; a text is certain if all read the same."""
LATIN: Final = re.compile(r"[A-Za-z][äöü]?ß|[A-Za-z][à-öø-ÿ]|[À-ÖØ-Þà-öø-ÿ][a-z]|°|[\x00-\x7f]")
"""A letter with an accent stands alone beside plain ones; in Chinese, Korean, Greek or Cyrillic it does not."""


def read_text(path: Path, refusal: type[Cotton3dgError] = BadInput) -> str:
    """A text file with its lines ended by "\\n": UTF-8, or UTF-16 with its mark, or older Latin text that is certain.

    Raises:
        OSError: the file cannot be read.
        BadInput: it is in another encoding, or not text; `refusal` instead, if the caller gives one.
    """
    return decode_text(path.read_bytes(), path.name, refusal)


def decode_text(content: bytes, name: str, refusal: type[Cotton3dgError] = BadInput) -> str:
    """As `read_text`, but for the bytes of a file with that name."""
    mark = next((mark for mark in MARKS if content.startswith(mark)), b"")
    try:
        text = content[len(mark) :].decode(MARKS.get(mark, "utf-8"))
    except UnicodeDecodeError as error:
        found = None if mark else _latin(content)
        if found is None:
            line = content.count(b"\n", 0, error.start) + 1
            raise refusal(f"{name}, line {line}, is not in UTF-8; save the file as UTF-8 text") from error
        text = found
    if "\0" in text:
        raise refusal(f"{name} is not a text file, or in UTF-16 without its mark; save it as UTF-8 text")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _latin(content: bytes) -> str | None:
    """Text in an older encoding if there is no doubt about its letters, else None."""
    try:
        readings = {content.decode(page) for page in LATIN_PAGES}
    except UnicodeDecodeError:
        return None
    text = readings.pop()
    return text if not readings and not LATIN.sub("", text) else None
