# SPDX-License-Identifier: Apache-2.0
"""Codes in pictures, and the vote of the codes in many frames of a video."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..core.card import CODE_CM, MARKER_DICTIONARY, MARKERS_CM, marker_corner_cm
from ..geometry.printed_markers import find_squares
from .draw_card import Picture
from .names import PREFIX, card_id, id_problem

MODULE_PX: Final = 8
"""Side of a module in a code that is rectified by its markers."""
CODE_MODULES: Final = (25, 29, 21, 33, 37)
"""Modules along a side of the codes for ids of 1 to 64 letters, the usual ones first."""
LEAST_FRAMES: Final = 2
"""Frames that must read the same id."""


@dataclass(frozen=True)
class Identity:
    """The plant of a video."""

    plant_id: str
    """Empty when it is not known for certain."""
    doubt: str
    """Why it is not certain, in a few words; empty when it is."""
    votes: dict[str, int]
    """Id -> frames that read it."""


def code_picture(text: str) -> Picture:
    """(N, N) QR code of a text, one pixel per module, 0 = dark, without a margin, with error correction M (15 %)."""
    import zxingcpp

    code = zxingcpp.create_barcode(text, zxingcpp.BarcodeFormat.QRCode, ec_level="M")
    return np.array(code.to_image(scale=1, add_quiet_zones=False), np.uint8)


def read_codes(grey: Picture) -> list[str]:
    """Texts of the QR codes and DataMatrix codes in a (H, W) picture.

    The decoder is zxing-cpp, which reads about twice as many small codes as OpenCV's two decoders, in a fifth of their
    time (docs/notes/libraries.md). If it reads none but the picture shows the markers of a card, the function looks
    for the code at the place that the markers give.
    """
    return _texts(grey) or _read_by_markers(grey)


def _texts(grey: Picture) -> list[str]:
    import zxingcpp

    kinds: Any = [zxingcpp.BarcodeFormat.QRCode, zxingcpp.BarcodeFormat.DataMatrix]
    found = zxingcpp.read_barcodes(np.ascontiguousarray(grey), formats=kinds)
    return sorted({code.text for code in found if code.valid})


def _read_by_markers(grey: Picture) -> list[str]:
    """The code of a card that lies at an angle, lies far away, or has dirt on the corners of its code.

    Two markers or more give the homography that shows the code from straight above. The patterns by which a reader
    finds a code are the same in all codes of a size, so the function draws them over the picture.
    """
    import cv2

    squares = find_squares(grey, MARKER_DICTIONARY)
    own = [number for number in squares if number in MARKERS_CM]
    if len(own) < 2:
        return []
    # OpenCV counts from the centre of the first pixel.
    seen = np.concatenate([squares[number] for number in own]) - 0.5
    left, top, side = CODE_CM
    flat = np.array([marker_corner_cm(number, corner) for number in own for corner in range(4)])
    flat = (flat - (left, top)) / side
    for modules in CODE_MODULES:
        # A margin of four modules; pixel (0, 0) of a picture is the middle of its first one.
        target = (flat * modules + 4) * MODULE_PX - 0.5
        homography, _ = cv2.findHomography(target, seen)
        if homography is None:
            continue
        whole = (modules + 8) * MODULE_PX
        upright = cv2.warpPerspective(grey, homography, (whole, whole), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
        if texts := _texts(_with_patterns(upright, modules)):
            return texts
    return []


def _with_patterns(upright: Picture, modules: int) -> Picture:
    """A code seen from above with the three corner patterns and the margin drawn again."""
    inside = upright[4 * MODULE_PX : -4 * MODULE_PX, 4 * MODULE_PX : -4 * MODULE_PX]
    dark, bright = (int(np.percentile(inside, share)) for share in (5, 95))
    pattern = np.full((8, 8), bright, np.uint8)
    pattern[:7, :7] = dark
    pattern[1:6, 1:6] = bright
    pattern[2:5, 2:5] = dark
    large = np.kron(pattern, np.ones((MODULE_PX, MODULE_PX), np.uint8))
    drawn = np.full_like(upright, bright)
    code = inside.copy()
    size = 8 * MODULE_PX
    code[:size, :size], code[:size, -size:], code[-size:, :size] = large, large[:, ::-1], large[::-1]
    drawn[4 * MODULE_PX : -4 * MODULE_PX, 4 * MODULE_PX : -4 * MODULE_PX] = code
    return drawn


def identify_plant(frames: Mapping[str, int], known: Collection[str] = ()) -> Identity:
    """The plant that the codes of a video name.

    A card's code names its id. Another code, such as the label of a plot, counts only if a field book has its text.
    The function never guesses: two ids in one video, an id that the field book does not have, or an id from a single
    frame give a doubt.

    Args:
        frames: text of a code -> frames that read it. known: ids of the field book; empty without one.
    """
    votes: dict[str, int] = {}
    for text, n in frames.items():
        if plant_id := _named(text, known):
            votes[plant_id] = max(n, votes.get(plant_id, 0))
    votes = dict(sorted(votes.items(), key=lambda item: (-item[1], item[0])))
    if not votes:
        return Identity("", "no card was read", {})
    if len(votes) > 1:
        listed = ", ".join(f"{plant_id} in {n} frames" for plant_id, n in list(votes.items())[:3])
        return Identity("", f"several cards were read: {listed}", votes)
    ((plant_id, n),) = votes.items()
    if known and plant_id not in known:
        return Identity("", f"the card says {plant_id}, which is not in the field book", votes)
    if n < LEAST_FRAMES:
        return Identity("", f"one frame only read {plant_id}", votes)
    return Identity(plant_id, "", votes)


def _named(text: str, known: Collection[str]) -> str:
    """The id that a code names; empty if it names none."""
    if text.startswith(PREFIX):
        return card_id(text) or ""
    return text if text in known and not id_problem(text) else ""
