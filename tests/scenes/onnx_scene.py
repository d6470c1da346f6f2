"""A YOLO segmentation network small enough to be worked out by hand, as an ONNX file written without the onnx package.

It sees 64 x 64 px in 16 cells: a cell is an object as sure as it is bright, in a box as large as the cell, and its mask
is what is brighter than half. The file format: https://github.com/onnx/onnx/blob/main/onnx/onnx.proto.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

SIDE, CELL = 64, 16
N_CELLS = (SIDE // CELL) ** 2


def write_bright_cells(path: Path, outputs: tuple[str, ...] = ("predictions", "prototypes"), gain: float = 1.0) -> Path:
    """Save the network; `gain` multiplies the mask coefficients."""
    row, column = np.divmod(np.arange(N_CELLS), SIDE // CELL)
    boxes = np.stack([(column + 0.5) * CELL, (row + 0.5) * CELL, *np.full((2, N_CELLS), CELL)])[None]
    constants = {
        "boxes": boxes.astype(np.float32),
        "coefficients": np.full((1, 1, N_CELLS), gain, np.float32),
        "cell": np.full((1, 3, CELL, CELL), 1 / (3 * CELL**2), np.float32),
        "square": np.full((1, 3, 4, 4), 1 / 48, np.float32),
        "half": np.array([-0.5], np.float32),
        "line": np.array([1, 1, N_CELLS], np.int64),
    }
    nodes = [
        node("Conv", ["images", "square", "half"], "prototypes", strides=[4, 4], kernel_shape=[4, 4]),
        node("Conv", ["images", "cell"], "brightness", strides=[CELL, CELL], kernel_shape=[CELL, CELL]),
        node("Reshape", ["brightness", "line"], "scores"),
        node("Concat", ["boxes", "scores", "coefficients"], "predictions", axis=1),
    ]
    shapes = {"predictions": (1, 6, N_CELLS), "prototypes": (1, 1, SIDE // 4, SIDE // 4)}
    graph = b"".join(field(1, item) for item in nodes) + field(2, b"bright cells")
    graph += b"".join(field(5, tensor(name, values)) for name, values in constants.items())
    graph += field(11, value("images", (1, 3, SIDE, SIDE)))
    graph += b"".join(field(12, value(name, shapes[name])) for name in outputs)
    path.write_bytes(field(1, 8) + field(7, graph) + field(8, field(1, b"") + field(2, 13)))
    return path


def field(number: int, content: int | bytes) -> bytes:
    """A protobuf field: a whole number, or bytes with their length."""
    if isinstance(content, int):
        return varint(number << 3) + varint(content)
    return varint(number << 3 | 2) + varint(len(content)) + content


def varint(number: int) -> bytes:
    coded = b""
    while True:
        number, low = number >> 7, number & 0x7F
        coded += bytes([low | (0x80 if number else 0)])
        if not number:
            return coded


def node(kind: str, inputs: list[str], output: str, **attributes: int | list[int]) -> bytes:
    coded = b"".join(field(1, name.encode()) for name in inputs) + field(2, output.encode())
    coded += field(3, output.encode()) + field(4, kind.encode())
    for name, content in attributes.items():
        numbers = [field(3, content), field(20, 2)] if isinstance(content, int) else [field(8, i) for i in content]
        numbers += [] if isinstance(content, int) else [field(20, 7)]
        coded += field(5, field(1, name.encode()) + b"".join(numbers))
    return coded


def tensor(name: str, values: np.ndarray) -> bytes:
    kind = {"float32": 1, "int64": 7}[values.dtype.name]
    dims = b"".join(field(1, side) for side in values.shape)
    return dims + field(2, kind) + field(8, name.encode()) + field(9, values.tobytes())


def value(name: str, shape: tuple[int, ...]) -> bytes:
    dims = b"".join(field(1, field(1, side)) for side in shape)
    return field(1, name.encode()) + field(2, field(1, field(1, 1) + field(2, dims)))
