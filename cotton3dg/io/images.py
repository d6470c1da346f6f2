# SPDX-License-Identifier: Apache-2.0
"""Images and instance-id images on disk, with limits that are checked before a pixel is decoded."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.libraries import import_pycolmap
from ..errors import BadInput, MissingInput, OutOfResources
from .listing import files_in

MAX_PIXELS: Final = 2**27
"""134 Mpx: more than any phone saves, and 400 MB once decoded."""
MAX_FILE_BYTES: Final = 2**29
IMAGE_SUFFIXES: Final = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
UNREAD_SUFFIXES: Final = (
    ".heic", ".heif", ".hif", ".avif", ".webp", ".jxl", ".jp2", ".bmp", ".gif",
    ".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw",
)  # fmt: skip
"""Formats of photos from phones, browsers and cameras that have to be converted first."""
JPEG_QUALITY: Final = 97

# A marker inside entropy-coded data: 0xff followed by anything but a stuffed zero, a restart marker or fill.
_JPEG_MARKER: Final = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")


def list_images(folder: Path) -> list[Path]:
    """Image files of a folder in natural order (2 before 10)."""
    return sorted(files_in(folder, IMAGE_SUFFIXES), key=lambda path: natural_key(path.name))


def unread_photos(folder: Path) -> list[Path]:
    """Photos of a folder in a format that is not read, unless a converted copy is beside them."""
    read = {path.stem.lower() for path in list_images(folder)}
    return [path for path in files_in(folder, UNREAD_SUFFIXES) if path.stem.lower() not in read]


def how_to_convert(photo: Path) -> str:
    """The remedy for photos in another format; the message in front of it names `photo`."""
    return f"convert them to JPEG, e.g. with ImageMagick: magick mogrify -format jpg '*{photo.suffix}'"


def has_transparency(path: Path) -> bool:
    """Whether parts of an image are transparent, so that viewers do not show the colours that it has there."""
    from PIL import Image

    with Image.open(path) as image:
        if "A" not in image.getbands() and "transparency" not in image.info:
            return False
        least: int = image.convert("RGBA").getextrema()[3][0]
        return least < 255


def natural_key(name: str) -> list[tuple[bool, int, str]]:
    """Sort key in which runs of digits compare as numbers; case only breaks ties."""
    parts = re.split(r"([0-9]+)", name.lower())
    return [(part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in [*parts, name]]


def read_image(path: Path) -> NDArray[np.uint8]:
    """Decode a JPEG, PNG or TIFF image.

    An EXIF orientation is applied to the pixels, so that the image is as the photographer saw it.

    Returns:
        (H, W, 3) RGB.
    Raises:
        BadInput: not a whole image of one of these kinds, or larger than `MAX_PIXELS`.
        MissingInput: no such file.
    """
    import cv2

    content = read_checked(path)
    pixels = decode(path, content, cv2.IMREAD_COLOR)
    rgb: NDArray[np.uint8] = cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB)
    return rgb


def exif_focal_length_px(path: Path) -> float | None:
    """Focal length of a photo from its EXIF data, in pixels of the photo; None if the data do not give it."""
    pycolmap = import_pycolmap()

    if path.suffix.lower() not in (".jpg", ".jpeg"):
        return None
    camera = pycolmap.infer_camera_from_image(path)
    return float(camera.mean_focal_length()) if camera.has_prior_focal_length else None


def write_image(path: Path, rgb: NDArray[np.uint8]) -> None:
    """Save (H, W, 3) RGB; `.jpg` at quality 97 without chroma subsampling, `.png` without loss."""
    import cv2

    settings = {
        ".jpg": [
            cv2.IMWRITE_JPEG_QUALITY,
            JPEG_QUALITY,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
        ],
        ".png": [cv2.IMWRITE_PNG_COMPRESSION, 3],
    }[path.suffix]
    _write(path, cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), settings)


def read_ids(path: Path) -> NDArray[np.uint16]:
    """Read instance ids from a 16-bit (or 8-bit) grey PNG.

    Returns:
        (H, W), 0 = background.
    Raises:
        BadInput: not a whole grey PNG.
        MissingInput: no such file.
    """
    import cv2

    ids = decode(path, read_checked(path), cv2.IMREAD_UNCHANGED)
    if ids.ndim != 2 or ids.dtype not in (np.uint8, np.uint16):
        raise BadInput(f"{path.name} is not a mask; masks are grey PNG files of 8 or 16 bits, one value an object")
    return ids.astype(np.uint16)


def write_ids(path: Path, ids: NDArray[np.uint16]) -> None:
    """Save (H, W) instance ids as a 16-bit grey PNG."""
    import cv2

    if ids.ndim != 2 or ids.dtype != np.uint16:
        raise ValueError(f"ids must be uint16 (H, W), got {ids.dtype} {ids.shape}")
    _write(path, ids, [cv2.IMWRITE_PNG_COMPRESSION, 6])


def scale_down(rgb: NDArray[np.uint8], max_side: int) -> NDArray[np.uint8]:
    """(H, W, 3) with its longer side at most `max_side` px, by area averaging; smaller images stay as they are."""
    import cv2

    height, width = rgb.shape[:2]
    size = fit_size(width, height, max_side)
    return rgb if size == (width, height) else cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)


def fit_size(width: int, height: int, max_side: int) -> tuple[int, int]:
    """Width and height scaled down, never up, so that the longer is at most `max_side`."""
    factor = min(1.0, max_side / max(width, height))
    return max(1, round(width * factor)), max(1, round(height * factor))


def read_checked(path: Path) -> bytes:
    """All bytes of an image file that is whole and not too large.

    Raises:
        BadInput: the file is not whole or is too large. MissingInput: it does not exist.
    """
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise BadInput(f"{path.name} is larger than {MAX_FILE_BYTES >> 20} MiB; save it smaller")
        content = path.read_bytes()
    except (FileNotFoundError, IsADirectoryError) as error:
        raise MissingInput(f"{path.name} is not there; put it back or run the stage that makes it") from error
    size = image_size(content)
    if size is None:
        raise BadInput(f"{path.name} is not a JPEG, PNG or TIFF image; convert or remove it")
    if not 0 < size[0] * size[1] <= MAX_PIXELS:
        raise BadInput(f"{path.name} claims {size[0]} x {size[1]} px, over {MAX_PIXELS} in all; save it smaller")
    if not is_whole(content):
        raise BadInput(f"{path.name} is cut off; copy it again from the camera or remove it")
    return content


def decode(path: Path, content: bytes, flags: int) -> NDArray[Any]:
    """An image as OpenCV decodes it with `flags`.

    Raises:
        BadInput: OpenCV cannot decode it.
    """
    import cv2

    try:
        pixels: NDArray[Any] | None = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except cv2.error as error:
        raise BadInput(f"{path.name} cannot be decoded; copy it again or remove it") from error
    if pixels is None:
        raise BadInput(f"{path.name} cannot be decoded; copy it again or remove it")
    return pixels


def image_size(content: bytes) -> tuple[int, int] | None:
    """Stored width and height from the header of a JPEG, PNG or TIFF file, None if they cannot be found."""
    if content.startswith(b"\x89PNG\r\n\x1a\n") and content[12:16] == b"IHDR" and len(content) >= 24:
        return struct.unpack(">II", content[16:24])
    if content.startswith(b"\xff\xd8"):
        return _jpeg_size(content)
    if content[:4] in (b"II*\0", b"MM\0*"):
        return _tiff_size(content)
    return None


def is_whole(content: bytes) -> bool:
    """Whether a file reaches its format's end mark; decoders silently fill in missing data."""
    if content.startswith(b"\x89PNG"):
        return b"IEND\xaeB`\x82" in content[-4096:]
    if content.startswith(b"\xff\xd8"):
        return _jpeg_is_whole(content)
    return True


def _write(path: Path, pixels: NDArray[Any], settings: list[int]) -> None:
    import cv2

    done, content = cv2.imencode(path.suffix, pixels, settings)
    if not done:
        raise OutOfResources(f"{path.name} could not be encoded; free some memory")
    path.write_bytes(content.tobytes())


def _jpeg_size(content: bytes) -> tuple[int, int] | None:
    for marker, at in _jpeg_segments(content):
        # Start of frame: C0 to CF without C4 (tables), C8 (reserved) and CC (arithmetic coding).
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC) and at + 7 <= len(content):
            height, width = struct.unpack(">HH", content[at + 3 : at + 7])
            return width, height
    return None


def _jpeg_segments(content: bytes) -> list[tuple[int, int]]:
    """Markers before the first scan, each with the offset of its length field."""
    segments, at = [], 2
    while at + 4 <= len(content) and content[at] == 0xFF:
        marker = content[at + 1]
        if marker == 0xFF:
            at += 1
            continue
        segments.append((marker, at + 2))
        if marker == 0xDA:
            break
        at += 2 + max(2, int.from_bytes(content[at + 2 : at + 4], "big"))
    return segments


def _jpeg_is_whole(content: bytes) -> bool:
    """Walk all scans to the end-of-image marker; one inside an EXIF thumbnail does not count."""
    segments = _jpeg_segments(content)
    if not segments or segments[-1][0] != 0xDA:
        return False
    at = segments[-1][1]
    while (found := _JPEG_MARKER.search(content, at)) is not None:
        if content[found.start() + 1] == 0xD9:
            return True
        at = found.end() + int.from_bytes(content[found.end() : found.end() + 2], "big")
    return False


def _tiff_size(content: bytes) -> tuple[int, int] | None:
    order = "<" if content[:2] == b"II" else ">"
    try:
        (at,) = struct.unpack_from(f"{order}I", content, 4)
        (count,) = struct.unpack_from(f"{order}H", content, at)
        sides = {}
        for entry in range(at + 2, at + 2 + 12 * count, 12):
            tag, kind = struct.unpack_from(f"{order}HH", content, entry)
            if tag in (256, 257):
                (sides[tag],) = struct.unpack_from(f"{order}{'H' if kind == 3 else 'I'}", content, entry + 8)
        return sides[256], sides[257]
    except (struct.error, KeyError):
        return None
