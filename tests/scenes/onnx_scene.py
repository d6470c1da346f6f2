# SPDX-License-Identifier: Apache-2.0
"""A YOLO segmentation network small enough to be worked out by hand, as an ONNX file.

It sees 64 x 64 px in 16 cells: a cell is an object as sure as it is bright, in a box as large as the cell, and its mask
is what is brighter than half.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cotton3dg.io import onnx

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
        onnx.node("Conv", ["images", "square", "half"], "prototypes", strides=[4, 4], kernel_shape=[4, 4]),
        onnx.node("Conv", ["images", "cell"], "brightness", strides=[CELL, CELL], kernel_shape=[CELL, CELL]),
        onnx.node("Reshape", ["brightness", "line"], "scores"),
        onnx.node("Concat", ["boxes", "scores", "coefficients"], "predictions", axis=1),
    ]
    shapes = {"predictions": (1, 6, N_CELLS), "prototypes": (1, 1, SIDE // 4, SIDE // 4)}
    inputs = {"images": (1, 3, SIDE, SIDE)}
    path.write_bytes(onnx.model(nodes, constants, inputs, {name: shapes[name] for name in outputs}))
    return path
