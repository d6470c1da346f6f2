# SPDX-License-Identifier: Apache-2.0
"""Images on disk: what is written comes back, and what is not a whole image is refused."""

import struct
import zlib

import cv2
import numpy as np
import pytest

from cotton3dg.errors import BadInput, MissingInput
from cotton3dg.io import images


@pytest.fixture
def picture():
    """(48, 64, 3) smooth colours with a red top-left corner."""
    y, x = np.mgrid[:48, :64]
    rgb = np.stack([255 - 3 * x, 4 * y + 20, 2 * x + y], axis=2).astype(np.uint8)
    rgb[:8, :8] = (255, 0, 0)
    return rgb


def test_png_is_lossless(tmp_path, picture):
    images.write_image(tmp_path / "a.png", picture)
    np.testing.assert_array_equal(images.read_image(tmp_path / "a.png"), picture)


def test_jpeg_keeps_colours_without_chroma_subsampling(tmp_path, picture):
    striped = picture.copy()
    striped[20:, ::2], striped[20:, 1::2] = (200, 40, 40), (40, 40, 200)
    images.write_image(tmp_path / "a.jpg", striped)
    error = np.abs(images.read_image(tmp_path / "a.jpg").astype(int) - striped)
    assert error[22:, 2:-2].mean() < 4


@pytest.mark.parametrize("suffix", [".tif", ".jpg", ".png"])
def test_header_size_is_the_decoded_size(tmp_path, picture, suffix):
    path = tmp_path / f"a{suffix}"
    cv2.imwrite(str(path), picture[..., ::-1])
    assert images.image_size(path.read_bytes()) == (64, 48)
    assert images.read_image(path).shape == picture.shape


def test_ids_are_16_bit(tmp_path):
    ids = np.arange(70_000, dtype=np.uint32).reshape(7, 10_000) % 65_536
    images.write_ids(tmp_path / "m.png", ids.astype(np.uint16))
    back = images.read_ids(tmp_path / "m.png")
    assert back.dtype == np.uint16
    np.testing.assert_array_equal(back, ids)


def test_colour_image_is_no_mask(tmp_path, picture):
    images.write_image(tmp_path / "m.png", picture)
    with pytest.raises(BadInput, match="grey PNG"):
        images.read_ids(tmp_path / "m.png")


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
@pytest.mark.parametrize("progressive", [False, True])
def test_every_truncation_is_refused(tmp_path, picture, suffix, progressive):
    noisy = cv2.resize(picture, (320, 240)) ^ np.random.default_rng(0).integers(0, 64, (240, 320, 3), np.uint8)
    path = tmp_path / f"whole{suffix}"
    cv2.imwrite(str(path), noisy, [cv2.IMWRITE_JPEG_PROGRESSIVE, int(progressive)])
    content = path.read_bytes()
    assert images.read_image(path).shape == (240, 320, 3)
    cut = tmp_path / f"cut{suffix}"
    for length in [0, 1, 10, *range(500, len(content) - 1, 1000), len(content) - 2]:
        cut.write_bytes(content[:length])
        with pytest.raises(BadInput):
            images.read_image(cut)


def test_thumbnail_does_not_hide_a_truncation(tmp_path, picture):
    thumbnail = cv2.imencode(".jpg", picture)[1].tobytes()
    whole = cv2.imencode(".jpg", cv2.resize(picture, (320, 240)))[1].tobytes()
    segment = b"\xff\xe1" + struct.pack(">H", len(thumbnail) + 2) + thumbnail
    path = tmp_path / "a.jpg"
    path.write_bytes(whole[:2] + segment + whole[2:])
    assert images.read_image(path).shape == (240, 320, 3)
    path.write_bytes((whole[:2] + segment + whole[2:])[:-200])
    with pytest.raises(BadInput, match="cut off"):
        images.read_image(path)


def test_data_after_the_end_is_ignored(tmp_path, picture):
    path = tmp_path / "a.jpg"
    path.write_bytes(cv2.imencode(".jpg", picture)[1].tobytes() + b"MotionPhoto" * 100)
    assert images.read_image(path).shape == picture.shape


def _png(width, height, rows=b""):
    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


@pytest.mark.parametrize("size", [(100_000, 100_000), (2**31 - 1, 1), (0, 10)])
def test_image_bomb_is_refused_before_decoding(tmp_path, size, monkeypatch):
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    (tmp_path / "a.png").write_bytes(_png(*size))
    with pytest.raises(BadInput, match="claims"):
        images.read_image(tmp_path / "a.png")


@pytest.mark.parametrize("content", [b"", b"RIFF....WEBP", b"II*\0\xff\xff\xff\xff", b"\xff\xd8\xff\xd9", b"\x89PNG"])
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "a.jpg").write_bytes(content)
    with pytest.raises(BadInput):
        images.read_image(tmp_path / "a.jpg")


def test_missing_file_is_named(tmp_path):
    with pytest.raises(MissingInput, match=r"a\.png"):
        images.read_image(tmp_path / "a.png")


@pytest.mark.parametrize(("orientation", "corner"), [(1, (0, 0)), (3, (-1, -1)), (6, (0, -1)), (8, (-1, 0))])
def test_exif_orientation_is_applied(tmp_path, picture, orientation, corner):
    """The red corner of the stored picture goes where EXIF says."""
    content = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
    entry = struct.pack("<HHII", 0x0112, 3, 1, orientation)
    exif = b"Exif\0\0" + b"II*\0" + struct.pack("<IH", 8, 1) + entry + struct.pack("<I", 0)
    path = tmp_path / "a.jpg"
    path.write_bytes(content[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + content[2:])
    upright = images.read_image(path)
    assert upright.shape == ((48, 64, 3) if orientation in (1, 3) else (64, 48, 3))
    red, green, blue = upright[corner].astype(int)
    assert red > 200 and green < 60 and blue < 60


def test_natural_order(tmp_path):
    names = ["IMG_10.jpg", "IMG_2.JPG", "img_1.png", "b.txt", ".hidden.jpg", "2.tif"]
    for name in names:
        (tmp_path / name).touch()
    found = [path.name for path in images.list_images(tmp_path)]
    assert found == ["2.tif", "img_1.png", "IMG_2.JPG", "IMG_10.jpg"]


def test_scaling_only_shrinks(picture):
    assert images.scale_down(picture, 1000) is picture
    assert images.scale_down(picture, 32).shape == (24, 32, 3)
    assert images.fit_size(1281, 719, 640) == (640, 359)
    assert images.fit_size(10_000, 1, 100) == (100, 1)
