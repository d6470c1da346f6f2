# SPDX-License-Identifier: Apache-2.0
"""Ids of plants: the text of their printed codes, and the names of their folders."""

from __future__ import annotations

import base64
import hashlib
import re
import unicodedata
import zlib
from typing import Final

PREFIX: Final = "c3d:"
"""The start of the text of a card's code, so that no other code in the picture is taken for one."""
CHECK_CHARACTERS: Final = 4
MOST_CHARACTERS: Final = 64
"""Longest id. A longer one needs a code that is too fine for a video."""
DEVICES: Final = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
"""Names that Windows takes for a device in any folder."""


def id_problem(plant_id: str) -> str:
    """Why a text cannot be an id, in a few words; empty when it can."""
    if not plant_id.strip():
        return "the id is blank"
    if len(plant_id) > MOST_CHARACTERS:
        return f"the id has {len(plant_id)} characters, {MOST_CHARACTERS} at most"
    if any(unicodedata.category(character)[0] == "C" for character in plant_id):
        return "the id has characters that cannot be printed"
    if plant_id != plant_id.strip():
        return "the id begins or ends with a space"
    return ""


def card_text(plant_id: str) -> str:
    """The text of the code on a plant's card: `c3d:ID:CHECK`.

    The check is a part of a CRC-32. It reveals a code that is misread in spite of its own error correction.
    """
    return f"{PREFIX}{plant_id}:{_check(plant_id)}"


def card_id(text: str) -> str | None:
    """The id that the text of a card's code names; None for any other text, also for a misread one."""
    plant_id, colon, check = text.removeprefix(PREFIX).rpartition(":")
    right = text.startswith(PREFIX) and colon and check == _check(plant_id) and not id_problem(plant_id)
    return plant_id if right else None


def folder_name(plant_id: str) -> str:
    """A name for the plant's folder that every file system accepts: the id itself if it is one.

    Any other id becomes its harmless characters and a part of its SHA-256, so that two ids never share a name.
    """
    name = re.sub(r"[^\w.+-]+", "_", unicodedata.normalize("NFC", plant_id))
    name = name.strip("._").lstrip("-._") or "plant"
    if name == plant_id and not DEVICES.fullmatch(name):
        return name
    return f"{name}_{hashlib.sha256(plant_id.encode()).hexdigest()[:6]}"


def _check(plant_id: str) -> str:
    crc = zlib.crc32(plant_id.encode("utf-8", "surrogatepass"))
    return base64.b32encode(crc.to_bytes(4, "big"))[:CHECK_CHARACTERS].decode()
