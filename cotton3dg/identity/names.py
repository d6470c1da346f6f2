"""Ids of plants: what a printed code says of one, and the name of the folder that it gets."""

from __future__ import annotations

import base64
import hashlib
import re
import unicodedata
import zlib
from typing import Final

PREFIX: Final = "c3d:"
"""How the text of a card's code begins, so that no other code in the picture is taken for one."""
CHECK_CHARACTERS: Final = 4
MOST_CHARACTERS: Final = 64
"""Of an id. Longer ones need codes too fine for a video."""
DEVICES: Final = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
"""What Windows takes for a device, whatever folder it is in."""


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
    """What the code on a plant's card says: `c3d:ID:CHECK`.

    The check is a part of a CRC-32, so that a code misread in spite of its own error correction is noticed.
    """
    return f"{PREFIX}{plant_id}:{_check(plant_id)}"


def card_id(text: str) -> str | None:
    """The id that the text of a card's code names; None of any other text, also of one misread."""
    plant_id, colon, check = text.removeprefix(PREFIX).rpartition(":")
    right = text.startswith(PREFIX) and colon and check == _check(plant_id) and not id_problem(plant_id)
    return plant_id if right else None


def folder_name(plant_id: str) -> str:
    """A name for the plant's folder that every file system takes: the id itself where it is one.

    Another id becomes what is harmless of it and a part of its SHA-256, so that two ids never share a name.
    """
    name = re.sub(r"[^\w.+-]+", "_", unicodedata.normalize("NFC", plant_id))
    name = name.strip("._").lstrip("-._") or "plant"
    if name == plant_id and not DEVICES.fullmatch(name):
        return name
    return f"{name}_{hashlib.sha256(plant_id.encode()).hexdigest()[:6]}"


def _check(plant_id: str) -> str:
    crc = zlib.crc32(plant_id.encode("utf-8", "surrogatepass"))
    return base64.b32encode(crc.to_bytes(4, "big"))[:CHECK_CHARACTERS].decode()
