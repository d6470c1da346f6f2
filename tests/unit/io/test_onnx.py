# SPDX-License-Identifier: Apache-2.0
"""Networks written to ONNX files, and read back."""

import cv2
import numpy as np
import pytest

from cotton3dg.errors import BadInput
from cotton3dg.io import onnx

CONSTANTS = {
    "w": np.arange(18, dtype=np.float32).reshape(2, 1, 3, 3) / 9,
    "b": np.array([1, -2], np.float16),
    "line": np.array([1, -1], np.int64),
}


def small_model() -> bytes:
    nodes = [onnx.node("Conv", ["x", "w", "b"], "y", kernel_shape=[3, 3], strides=[1, 1], pads=[1, 1, 1, 1])]
    shapes = {"x": (1, 1, "height", "width")}, {"y": (1, 2, "height", "width")}
    return onnx.model(nodes, {"w": CONSTANTS["w"], "b": CONSTANTS["b"].astype(np.float32)}, *shapes)


def test_opencv_runs_what_was_written():
    network = cv2.dnn.readNetFromONNX(np.frombuffer(small_model(), np.uint8))
    image = np.random.default_rng(0).normal(size=(5, 7)).astype(np.float32)
    network.setInput(image[None, None])
    found = network.forward()[0]
    for channel in range(2):
        wanted = cv2.filter2D(image, -1, CONSTANTS["w"][channel, 0], borderType=cv2.BORDER_CONSTANT)
        np.testing.assert_allclose(found[channel], wanted + float(CONSTANTS["b"][channel]), rtol=1e-5, atol=1e-5)


def test_constants_come_back_with_their_types():
    text = onnx.model([], CONSTANTS, {}, {})
    found = onnx.read_constants(text, "net.onnx")
    assert found.keys() == CONSTANTS.keys()
    for name, values in CONSTANTS.items():
        assert found[name].dtype == values.dtype
        np.testing.assert_array_equal(found[name], values)


def test_damaged_files_are_refused_in_words():
    text = onnx.model([], CONSTANTS, {}, {})
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(300):
        damaged = bytearray(text)
        for place in rng.integers(0, len(text), 3):
            damaged[place] = rng.integers(256)
        damaged = damaged[: rng.integers(1, len(text) + 1)]
        try:
            onnx.read_constants(bytes(damaged), "net.onnx")
        except BadInput as error:
            assert "net.onnx" in str(error)
            refused += 1
    assert refused > 100
    with pytest.raises(BadInput):
        onnx.read_constants(b"", "net.onnx")


@pytest.mark.parametrize("number", [0, 1, 127, 128, 300, 2**40])
def test_whole_numbers_of_any_length(number):
    assert onnx.field(5, number)[0] == 5 << 3
    ((found_number, content),) = onnx._fields(onnx.field(5, number))
    assert (found_number, content) == (5, number)
