# SPDX-License-Identifier: Apache-2.0
"""A font for a text in any script: DejaVu Sans from matplotlib, or a font of the machine that has the letters."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any, Final

PLACEHOLDERS: Final = ("lastresort", "adobeblank", "notdef")
"""Parts of the names of fonts that show a placeholder for every character and have no letters."""
JOINED_SCRIPTS: Final = range(0x0590, 0x1900)
"""Characters whose letters change with their neighbours, from Hebrew to Mongolian; Hangul's parts lie there, too."""


def font(text: str, size: int) -> Any:
    """Pillow's font of `size` px for a text; DejaVu Sans, which shows boxes, if no font has all of its letters."""
    return _opened(_font_file(frozenset(text)) or _dejavu(), size)


def unprintable(texts: Iterable[str]) -> list[str]:
    """The texts that no font of this machine can write, in their order."""
    return [text for text in texts if _font_file(frozenset(text)) is None or not _can_join(text)]


@cache
def _opened(path: Path, size: int) -> Any:
    from PIL import ImageFont

    return ImageFont.truetype(str(path), size)


@cache
def _font_file(letters: frozenset[str]) -> Path | None:
    """The first font that has all of these letters."""
    wanted = {ord(letter) for letter in letters if not letter.isspace()}
    return next((path for path in _fonts() if wanted <= _letters(path)), None)


@cache
def _fonts() -> list[Path]:
    from matplotlib import font_manager

    found = sorted(map(Path, font_manager.findSystemFonts()), key=lambda path: path.name)
    return [_dejavu(), *(path for path in found if not any(part in path.name.lower() for part in PLACEHOLDERS))]


def _dejavu() -> Path:
    import matplotlib

    return Path(matplotlib.get_data_path()) / "fonts/ttf/DejaVuSans.ttf"


@cache
def _letters(path: Path) -> frozenset[int]:
    """The letters of a font; none if the font cannot be opened."""
    from matplotlib.ft2font import FT2Font

    try:
        return frozenset(FT2Font(str(path)).get_charmap())
    except (OSError, RuntimeError):
        return frozenset()


def _can_join(text: str) -> bool:
    """Whether letters that change with their neighbours are drawn correctly."""
    from PIL import features

    return features.check("raqm") or not any(ord(letter) in JOINED_SCRIPTS for letter in text)
