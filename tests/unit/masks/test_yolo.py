# SPDX-License-Identifier: Apache-2.0
"""YOLO segmentation around a network that can be worked out by hand, run by OpenCV; files that are no network."""

import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from scenes.onnx_scene import CELL, SIDE, write_bright_cells

from cotton3dg.errors import BadInput, BadUsage, EnvironmentUnusable, MissingInput
from cotton3dg.masks.sam import open_sam
from cotton3dg.masks.yolo import decode, detect_yolo, fit_image, suppress
from cotton3dg.masks.yolo_networks import Network, open_network

DEFAULTS = {"image_size": SIDE, "confidence": 0.3, "nms_iou": 0.7}


@pytest.fixture(scope="module")
def network(tmp_path_factory) -> Network:
    return open_network(write_bright_cells(tmp_path_factory.mktemp("onnx") / "cells.onnx"), trusted=False)


def bright(height: int, width: int, *rectangles: tuple[int, int, int, int]) -> np.ndarray:
    image = np.zeros((height, width, 3), np.uint8)
    for top, left, bottom, right in rectangles:
        image[top:bottom, left:right] = 255
    return image


def iou(one: np.ndarray, other: np.ndarray) -> float:
    return (one & other).sum() / (one | other).sum()


def test_bright_cells_become_masks_of_their_bright_pixels(network: Network) -> None:
    image = bright(SIDE, SIDE, (16, 32, 28, 48), (48, 0, 64, 16))
    ids, scores = detect_yolo(image, network, **DEFAULTS)
    assert scores == {1: 1.0, 2: 0.75}
    assert iou(ids == 1, image[..., 0].astype(bool) & (np.arange(SIDE) < 16)) > 0.99
    assert iou(ids == 2, image[..., 0].astype(bool) & (np.arange(SIDE) >= 32)) > 0.9
    assert not (ids > 0)[:16].any() and not (ids > 0)[:, 48:].any()  # nothing outside of the boxes


@pytest.mark.parametrize(("height", "width"), [(128, 128), (96, 128), (128, 72), (32, 32)])
def test_masks_come_back_at_the_size_and_place_of_the_image(network: Network, height: int, width: int) -> None:
    scale = SIDE / max(height, width)
    left = ((SIDE - round(width * scale)) // 2) / scale
    top = ((SIDE - round(height * scale)) // 2) / scale
    y, x, side = round(2 * CELL / scale - top), round(CELL / scale - left), round(CELL / scale)
    image = bright(height, width, (y, x, y + side, x + side))
    ids, scores = detect_yolo(image, network, **(DEFAULTS | {"confidence": 0.8}))
    assert ids.shape == (height, width) and len(scores) == 1
    assert iou(ids > 0, image[..., 0] > 0) > 0.9


def test_tiles_find_what_is_too_small_for_the_whole_image(network: Network) -> None:
    image = bright(256, 320, (66, 146, 76, 158), (160, 144, 176, 160))  # amid the tiles from 48, 128 and 144, 128 on
    whole, _ = detect_yolo(image, network, **(DEFAULTS | {"confidence": 0.5}))
    assert not whole.any()
    ids, scores = detect_yolo(image, network, tile_px=64, **(DEFAULTS | {"confidence": 0.2}))
    assert len(scores) == 2 and ids[70, 150] != ids[170, 150]
    assert iou(ids > 0, image[..., 0] > 0) > 0.8


def test_confidence_decides_what_counts(network: Network) -> None:
    image = bright(SIDE, SIDE, (16, 32, 28, 48), (48, 0, 64, 16))
    assert len(detect_yolo(image, network, **(DEFAULTS | {"confidence": 0.9}))[1]) == 1
    assert not detect_yolo(bright(SIDE, SIDE), network, **DEFAULTS)[0].any()


def test_a_box_that_overlaps_a_surer_one_is_suppressed() -> None:
    boxes = np.array([[0, 0, 10, 10], [1, 0, 11, 10], [0, 20, 10, 30], [0, 0, 10, 4]], float)
    scores = np.array([0.5, 0.9, 0.7, 0.8])
    assert suppress(boxes, scores, 0.5) == [1, 3, 2]
    assert suppress(boxes, scores, 0.9) == [1, 3, 2, 0]
    assert suppress(np.zeros((0, 4)), np.zeros(0), 0.5) == []


def test_only_chosen_classes_count() -> None:
    predictions = np.array([[8, 8, 8], [8, 24, 40], [4, 4, 4], [6, 6, 6], [0.9, 0.1, 0.2], [0.1, 0.8, 0.3], [1, 2, 3]])
    boxes, scores, coefficients = decode(predictions.astype(np.float32), 1, 0.25, [])
    np.testing.assert_allclose(scores, [0.9, 0.8, 0.3])
    np.testing.assert_allclose(boxes[0], [6, 5, 10, 11])
    _, scores, coefficients = decode(predictions.astype(np.float32), 1, 0.25, [1])
    np.testing.assert_allclose(scores, [0.8, 0.3])
    np.testing.assert_allclose(coefficients, [[2], [3]])
    with pytest.raises(BadInput, match="no class 2"):
        decode(predictions.astype(np.float32), 1, 0.25, [2])


def test_an_image_is_fitted_without_distortion() -> None:
    image = bright(50, 100, (0, 0, 50, 100))
    pixels, fit = fit_image(image, 64)
    assert pixels.shape == (1, 3, 64, 64) and (fit.scale, fit.left, fit.top) == (0.64, 0, 16)
    assert (pixels[0, :, 16:48] == 1).all() and np.allclose(pixels[0, :, :16], 114 / 255)
    assert fit_image(image, 60)[0].shape == (1, 3, 64, 64)


def test_files_that_are_no_segmentation_network(tmp_path: Path) -> None:
    with pytest.raises(MissingInput, match="--weights"):
        open_network(tmp_path / "absent.onnx", trusted=False)
    for name, content, error, words in (
        ("empty.onnx", b"", BadInput, "empty"),
        ("torn.onnx", b"\x08\x08:\xff", BadInput, r"torn\.onnx.*export"),
        ("model.h5", b"x", BadUsage, "neither .pt nor .onnx"),
        ("best.pt", b"x", BadUsage, "--trust-weights"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(error, match=words):
            open_network(tmp_path / name, trusted=False)
    with pytest.raises(BadInput, match="damaged or no checkpoint"):
        open_network(tmp_path / "best.pt", trusted=True)
    with pytest.raises(BadInput, match="1 outputs"):
        open_network(write_bright_cells(tmp_path / "boxes.onnx", ("predictions",)), trusted=False)


def test_a_network_that_answers_nonsense_is_told(network: Network, tmp_path: Path) -> None:
    image = bright(SIDE, SIDE, (16, 32, 28, 48))
    with pytest.raises(BadInput, match="--image-size"):
        detect_yolo(image, network, **(DEFAULTS | {"image_size": 128}))
    broken = open_network(write_bright_cells(tmp_path / "nan.onnx", gain=float("nan")), trusted=False)
    with pytest.raises(BadInput, match="not finite"):
        detect_yolo(image, broken, **DEFAULTS)
    swapped = Network(lambda pixels: network.forward(pixels)[::-1])
    with pytest.raises(BadInput, match="YOLO segmentation"):
        detect_yolo(image, swapped, **DEFAULTS)


def test_a_missing_extra_is_named_with_its_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with zipfile.ZipFile(tmp_path / "best.pt", "w") as archive:
        archive.writestr("data.pkl", b"")
    (tmp_path / "config.json").write_text('{"model_type": "sam"}')
    (tmp_path / "model.safetensors").write_bytes(b"x")
    for name in ("ultralytics", "transformers"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(EnvironmentUnusable, match=r"pip install 'cotton3dg\[yolo\]'"):
        open_network(tmp_path / "best.pt", trusted=True)
    with pytest.raises(EnvironmentUnusable, match=r"pip install 'cotton3dg\[sam\]'"):
        open_sam(tmp_path, trusted=False)
