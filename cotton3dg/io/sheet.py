# SPDX-License-Identifier: Apache-2.0
"""Sheets of paper as PDF or PNG that print at their true size."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

CM_PER_POINT: Final = 2.54 / 72


def write_sheet(path: Path, sheet: NDArray[np.uint8], dots_per_cm: int, *, pdf: bool = True) -> None:
    """Save a (H, W) grey picture, as PDF or as PNG."""
    from PIL import Image

    if pdf:
        path.write_bytes(pdf_of([sheet], dots_per_cm))
    else:
        Image.fromarray(sheet).save(path, "PNG", dpi=(2.54 * dots_per_cm,) * 2)


def pdf_of(sheets: Iterable[NDArray[np.uint8]], dots_per_cm: int) -> bytes:
    """A page for each (H, W) grey picture (PDF 1.4).

    Pillow's PDF writer blurs edges, because it compresses grey pictures as JPEG, and cannot forbid viewers to scale
    the page.
    """
    bodies: list[bytes] = []
    pages = []
    for sheet in sheets:
        height, width = sheet.shape
        across, down = (side / dots_per_cm / CM_PER_POINT for side in (width, height))
        pixels = zlib.compress(np.ascontiguousarray(sheet).tobytes(), 9)
        drawing = f"q {across:.4f} 0 0 {down:.4f} 0 0 cm /Sheet Do Q".encode()
        number = 3 + len(bodies)
        pages.append(f"{number} 0 R")
        page = f"<</Type/Page/Parent 2 0 R/MediaBox[0 0 {across:.4f} {down:.4f}]/Contents {number + 2} 0 R"
        image = f"<</Type/XObject/Subtype/Image/Width {width}/Height {height}/ColorSpace/DeviceGray/BitsPerComponent 8"
        bodies += [
            f"{page}/Resources<</XObject<</Sheet {number + 1} 0 R>>>>>>".encode(),
            f"{image}/Filter/FlateDecode/Length {len(pixels)}>>stream\n".encode() + pixels + b"\nendstream",
            f"<</Length {len(drawing)}>>stream\n".encode() + drawing + b"\nendstream",
        ]
    objects = [
        # A viewer that offers to fit the page would spoil its size.
        b"<</Type/Catalog/Pages 2 0 R/ViewerPreferences<</PrintScaling/None>>>>",
        f"<</Type/Pages/Kids[{' '.join(pages)}]/Count {len(pages)}>>".encode(),
        *bodies,
    ]
    content, starts = bytearray(b"%PDF-1.4\n"), []
    for number, body in enumerate(objects, 1):
        starts.append(len(content))
        content += f"{number} 0 obj".encode() + body + b"\nendobj\n"
    table = "".join(f"{start:010d} 00000 n \n" for start in starts)
    trailer = f"trailer<</Size {len(objects) + 1}/Root 1 0 R>>\nstartxref\n{len(content)}\n%%EOF\n"
    return bytes(content) + f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}{trailer}".encode()
