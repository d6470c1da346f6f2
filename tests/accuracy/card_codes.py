# SPDX-License-Identifier: Apache-2.0
"""How often a card's id is read in one photo, by the width of its code, and how often wrongly.

    python tests/accuracy/card_codes.py [--photos 1000] [--decoders zxing opencv aruco] [--seed 0]

For each width, photos of cards with ids of 4 to 24 characters, tilted by up to 65 degrees and turned at will, out of
focus, smeared, in uneven light, with noise; a third of them soiled or with a part of the code covered. The width is
that which the code would have seen from straight above: the tilt makes it smaller still.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from markdown_tables import markdown

sys.path.insert(0, str(Path(__file__).parents[1]))

from scenes.card_scene import card_photo, card_sheet

from cotton3dg.identity.codes import read_codes
from cotton3dg.identity.names import card_id

WIDTHS_PX = (20, 30, 40, 50, 60, 80, 100, 130, 160, 200)
PHOTOS_OF_A_CARD = 10
LETTERS = np.array(list("ABCDEFGHKLMNPRSTUVWXYZ0123456789-_./ äß"))


def opencv_with(detector: object) -> Callable[[np.ndarray], list[str]]:
    def read(grey: np.ndarray) -> list[str]:
        try:
            found, texts, _, _ = detector.detectAndDecodeMulti(grey)  # type: ignore[attr-defined]
        except (cv2.error, UnicodeDecodeError):
            return []
        return [text for text in texts if text] if found else []

    return read


DECODERS: dict[str, Callable[[], Callable[[np.ndarray], list[str]]]] = {
    "zxing": lambda: read_codes,
    "opencv": lambda: opencv_with(cv2.QRCodeDetector()),
    "aruco": lambda: opencv_with(cv2.QRCodeDetectorAruco()),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photos", type=int, default=1000, help="of each width")
    parser.add_argument("--decoders", nargs="+", choices=DECODERS, default=["zxing"])
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    readers = {name: DECODERS[name]() for name in arguments.decoders}
    rows = []
    for width in WIDTHS_PX:
        read = dict.fromkeys(readers, 0)
        spoilt = dict.fromkeys(readers, 0)
        wrong = dict.fromkeys(readers, 0)
        seconds = dict.fromkeys(readers, 0.0)
        for number in range(arguments.photos):
            rng = np.random.default_rng([arguments.seed, width, number])
            if number % PHOTOS_OF_A_CARD == 0:
                plant_id = "".join(rng.choice(LETTERS, rng.integers(4, 25))).strip() or "A"
                sheet = card_sheet(plant_id, 20)
            is_spoilt = number % 3 == 0
            photo = card_photo(
                sheet,
                width,
                tilt_deg=rng.uniform(0, 65),
                turn_deg=rng.uniform(0, 360),
                blur_px=rng.uniform(0, 1.2),
                motion_px=rng.uniform(0, 3),
                noise=rng.uniform(1, 8),
                light=(rng.uniform(0.2, 1.3), rng.uniform(0.2, 1.3)),
                dirt=rng.uniform(0, 0.06) if is_spoilt else 0.0,
                hidden=rng.uniform(0, 0.15) if is_spoilt and number % 2 else 0.0,
                seed=number,
            )
            for name, reader in readers.items():
                began = time.process_time()
                found = {card_id(text) for text in reader(photo)} - {None}
                seconds[name] += time.process_time() - began
                read[name] += plant_id in found and not is_spoilt
                spoilt[name] += plant_id in found and is_spoilt
                wrong[name] += bool(found - {plant_id})
        n_spoilt = (arguments.photos + 2) // 3
        row: dict[str, object] = {"code_px": width}
        for name in readers:
            row |= {
                f"{name}: clean read, %": round(100 * read[name] / (arguments.photos - n_spoilt), 1),
                f"{name}: soiled read, %": round(100 * spoilt[name] / n_spoilt, 1),
                f"{name}: wrong": wrong[name],
                f"{name}: ms": round(1000 * seconds[name] / arguments.photos, 1),
            }
        rows.append(row)
        print(row, flush=True)
    print(markdown(pd.DataFrame(rows)))


if __name__ == "__main__":
    main()
