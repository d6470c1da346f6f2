# SPDX-License-Identifier: Apache-2.0
"""A network of bolls that calls lint what is bright, with weights set by hand."""

import numpy as np

from cotton3dg.core.training_picture import CLASSES, LINT
from cotton3dg.masks.bolls import OFFSET_PX
from cotton3dg.masks.bolls_network import GREY_RANGE, MIDDLE_GREY, BollsNetwork, to_onnx


def bright_network(diameter_px: float = 40.0, grey: float = 190.0) -> bytes:
    """As an ONNX file.

    Args:
        diameter_px: what it says of the size of every boll.
        grey: mean of RGB above which a pixel is lint.
    """
    network = BollsNetwork()
    for name, layer in network.convolutions().items():
        weight, bias = (np.zeros(tuple(p.shape), np.float32) for p in (layer.conv.weight, layer.norm.bias))
        middle = weight.shape[2] // 2
        if name == "stem":
            weight[0, :, middle, middle], bias[0] = 1 / (3 * GREY_RANGE), -MIDDLE_GREY / GREY_RANGE
        elif name in {"stage1.0.depthwise", "stage1.0.project"}:
            weight[0, 0, middle, middle] = 1
        layer.unfold(weight, bias)
    head = network.head
    head.weight.data.zero_()
    head.bias.data.zero_()
    head.weight.data[LINT, 0, 1, 1] = 40
    head.bias.data[LINT] = -40 * (grey - MIDDLE_GREY) / GREY_RANGE
    head.bias.data[2 : len(CLASSES)] = -20
    head.bias.data[len(CLASSES) + 3] = float(np.log2(diameter_px / OFFSET_PX))
    return to_onnx(network.eval())
