"""A sheet of paper as PDF or PNG that prints at its true size."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

CM_PER_POINT = 2.54 / 72


def write_sheet(path: Path, sheet: NDArray[np.uint8], dots_per_cm: int, *, pdf: bool = True) -> None:
    """Save a (H, W) grey picture, as PDF or as PNG."""
    path.write_bytes(pdf_of(sheet, dots_per_cm) if pdf else png_of(sheet, dots_per_cm))


def pdf_of(sheet: NDArray[np.uint8], dots_per_cm: int) -> bytes:
    """One page that is the picture (PDF 1.4)."""
    height, width = sheet.shape
    across, down = (side / dots_per_cm / CM_PER_POINT for side in (width, height))
    pixels = zlib.compress(np.ascontiguousarray(sheet).tobytes(), 9)
    drawing = f"q {across:.4f} 0 0 {down:.4f} 0 0 cm /Sheet Do Q".encode()
    image = f"<</Type/XObject/Subtype/Image/Width {width}/Height {height}/ColorSpace/DeviceGray/BitsPerComponent 8"
    page = f"<</Type/Page/Parent 2 0 R/MediaBox[0 0 {across:.4f} {down:.4f}]/Contents 5 0 R"
    objects = [
        # A viewer that offers to fit the page would spoil its size.
        b"<</Type/Catalog/Pages 2 0 R/ViewerPreferences<</PrintScaling/None>>>>",
        b"<</Type/Pages/Kids[3 0 R]/Count 1>>",
        f"{page}/Resources<</XObject<</Sheet 4 0 R>>>>>>".encode(),
        f"{image}/Filter/FlateDecode/Length {len(pixels)}>>stream\n".encode() + pixels + b"\nendstream",
        f"<</Length {len(drawing)}>>stream\n".encode() + drawing + b"\nendstream",
    ]
    content, starts = b"%PDF-1.4\n", []
    for number, body in enumerate(objects, 1):
        starts.append(len(content))
        content += f"{number} 0 obj".encode() + body + b"\nendobj\n"
    table = "".join(f"{start:010d} 00000 n \n" for start in starts)
    trailer = f"trailer<</Size {len(objects) + 1}/Root 1 0 R>>\nstartxref\n{len(content)}\n%%EOF\n"
    return content + f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}{trailer}".encode()


def png_of(sheet: NDArray[np.uint8], dots_per_cm: int) -> bytes:
    """PNG that says how large its pixels are."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    height, width = sheet.shape
    lines = np.concatenate([np.zeros((height, 1), np.uint8), sheet], axis=1)
    return b"".join(
        [
            b"\x89PNG\r\n\x1a\n",
            chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)),
            chunk(b"pHYs", struct.pack(">IIB", 100 * dots_per_cm, 100 * dots_per_cm, 1)),
            chunk(b"IDAT", zlib.compress(lines.tobytes(), 9)),
            chunk(b"IEND", b""),
        ]
    )
