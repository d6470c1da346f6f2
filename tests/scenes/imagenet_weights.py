# SPDX-License-Identifier: Apache-2.0
"""Random weights under the names, and in the shapes, of the published EfficientNet-Lite0."""

import numpy as np
import torch

STAGES = ((1, 3, 1, 16), (2, 3, 6, 24), (2, 5, 6, 40), (3, 3, 6, 80), (3, 5, 6, 112), (4, 5, 6, 192), (1, 3, 6, 320))
"""Blocks, side of their depthwise filters, expansion, channels."""


def published_weights() -> dict[str, torch.Tensor]:
    generator = torch.Generator().manual_seed(3)
    named: dict[str, torch.Tensor] = {}

    def conv(name: str, norm: str, *shape: int) -> None:
        named[f"{name}.weight"] = torch.randn(shape, generator=generator) / np.sqrt(np.prod(shape[1:]))
        for key in ("weight", "bias", "running_mean", "running_var"):
            named[f"{norm}.{key}"] = torch.rand(shape[0], generator=generator) + 0.5

    conv("_conv_stem", "_bn0", 32, 3, 3, 3)
    number, incoming = 0, 32
    for count, side, expansion, outgoing in STAGES:
        for _ in range(count):
            wide, name = incoming * expansion, f"_blocks.{number}."
            if expansion > 1:
                conv(name + "_expand_conv", name + "_bn0", wide, incoming, 1, 1)
            conv(name + "_depthwise_conv", name + "_bn1", wide, 1, side, side)
            conv(name + "_project_conv", name + "_bn2", outgoing, wide, 1, 1)
            number, incoming = number + 1, outgoing
    return named
