"""The bolls' network: from an image to classes, and for lint to the middle, the size and the borders of its boll.

A small encoder and decoder (He et al. 2016 for the blocks, Lin et al. 2017 for the way back up) with the heads of
Panoptic-DeepLab (Cheng et al. 2020): what each pixel is, and how far away the middle of its boll lies. Departures: no
map of middles is predicted, the pixels' own votes make one; the middle is that of the whole boll in space, seen or not,
so that views agree on it; and each pixel says how large its boll is. Torch trains it; OpenCV runs it (`bolls.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from ..errors import BadInput
from ..files import onnx
from .bolls import CHANNELS, REMEDY

WIDTHS: Final = (16, 32, 64, 128, 160)
"""Channels at 1/2, 1/4, 1/8, 1/16 and 1/32 of the image."""
BLOCKS: Final = (0, 1, 2, 2, 2)
"""Residual blocks there."""


class _Block(nn.Module):
    """Two 3 x 3 convolutions beside a shortcut."""

    def __init__(self, width: int):
        super().__init__()
        self.first, self.second = _Conv(width, width), _Conv(width, width, active=False)

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu(x + self.second(self.first(x)))


class _Conv(nn.Module):
    """A convolution, normalised over the batch, and a ReLU."""

    def __init__(self, incoming: int, outgoing: int, side: int = 3, stride: int = 1, active: bool = True):
        super().__init__()
        self.conv = nn.Conv2d(incoming, outgoing, side, stride, side // 2, bias=False)
        self.norm = nn.BatchNorm2d(outgoing)
        self.active = active

    def forward(self, x: Tensor) -> Tensor:
        x = self.norm(self.conv(x))
        return functional.relu(x) if self.active else x

    def folded(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Weights and biases of the one convolution that this is once it no longer learns."""
        norm = self.norm
        scale = norm.weight / torch.sqrt(norm.running_var + norm.eps)
        weight = self.conv.weight * scale[:, None, None, None]
        bias = norm.bias - norm.running_mean * scale
        return weight.detach().cpu().numpy(), bias.detach().cpu().numpy()

    def unfold(self, weight: NDArray, bias: NDArray) -> None:
        """Take over the weights of a folded convolution, as one whose normalisation changes nothing."""
        norm = self.norm
        with torch.no_grad():
            self.conv.weight.copy_(_as_tensor(weight, self.conv.weight))
            norm.bias.copy_(_as_tensor(bias, norm.bias))
            norm.weight.fill_(1.0)
            norm.running_mean.zero_()
            norm.running_var.fill_(1.0 - norm.eps)


class BollsNetwork(nn.Module):
    """(B, 3, H, W) RGB in 0..255, sides multiples of `bolls.STRIDE` -> (B, CHANNELS, H/2, W/2)."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = _Conv(3, WIDTHS[0], stride=2)
        self.down = nn.ModuleList(_Conv(a, b, stride=2) for a, b in pairwise(WIDTHS))
        self.blocks = nn.ModuleList(
            nn.ModuleList(_Block(w) for _ in range(n)) for w, n in zip(WIDTHS, BLOCKS, strict=True)
        )
        self.across = nn.ModuleList(_Conv(b, a, side=1) for a, b in pairwise(WIDTHS))
        self.up = nn.ModuleList(_Conv(w, w) for w in WIDTHS[:-1])
        self.head = nn.Conv2d(WIDTHS[0], CHANNELS, 3, padding=1)

    def forward(self, image: Tensor) -> Tensor:
        x = self.stem((image - 128) / 64)
        levels = []
        for level, blocks in enumerate(self.blocks):
            if level:
                x = self.down[level - 1](x)
            for block in blocks:
                x = block(x)
            levels.append(x)
        for level in reversed(range(len(levels) - 1)):
            coarse = functional.interpolate(self.across[level](x), scale_factor=2, mode="bilinear", align_corners=False)
            x = self.up[level](levels[level] + coarse)
        return self.head(x)

    def convolutions(self) -> dict[str, _Conv]:
        """All but the head by the name they have in a file."""
        named = {"stem": self.stem}
        named |= {f"down{level}": layer for level, layer in enumerate(self.down, start=1)}
        for level, blocks in enumerate(self.blocks):
            for k, block in enumerate(blocks):
                named |= {f"block{level}.{k}.1": block.first, f"block{level}.{k}.2": block.second}
        named |= {f"across{level}": layer for level, layer in enumerate(self.across)}
        return named | {f"up{level}": layer for level, layer in enumerate(self.up)}


def from_onnx(model: bytes, name: str) -> BollsNetwork:
    """The network of a file that `to_onnx` wrote, to be trained further with its normalisation as it is.

    Raises:
        BadInput: it is no such file.
    """
    constants = onnx.read_constants(model, name)
    network = BollsNetwork()
    try:
        for key, layer in network.convolutions().items():
            layer.unfold(constants[key + ".w"], constants[key + ".b"])
        with torch.no_grad():
            network.head.weight.copy_(_as_tensor(constants["maps.w"], network.head.weight))
            assert network.head.bias is not None
            network.head.bias.copy_(_as_tensor(constants["maps.b"], network.head.bias))
    except (KeyError, ValueError) as error:
        raise BadInput(f"{name} is no network of bolls; {REMEDY}") from error
    return network.eval()


def _as_tensor(values: NDArray, like: Tensor) -> Tensor:
    """The values as numbers of the shape that is wanted, or ValueError."""
    if values.shape != tuple(like.shape) or not np.isfinite(values).all():
        raise ValueError(f"{values.shape} instead of {tuple(like.shape)}, or not finite")
    return torch.from_numpy(values.astype(np.float32))


@dataclass
class _Graph:
    """An ONNX graph as it grows."""

    nodes: list[bytes]
    constants: dict[str, NDArray]
    half: bool

    def constant(self, name: str, values: NDArray) -> str:
        self.constants[name] = values.astype(np.float16) if self.half else values.astype(np.float32)
        return name

    def conv(self, x: str, layer: _Conv, name: str) -> str:
        weight, bias = layer.folded()
        side, stride = weight.shape[2], layer.conv.stride[0]
        return self._conv(x, weight, bias, name, side, stride, layer.active)

    def _conv(self, x: str, weight: NDArray, bias: NDArray, name: str, side: int, stride: int, active: bool) -> str:
        inputs = [x, self.constant(name + ".w", weight), self.constant(name + ".b", bias)]
        target = name + ".c" if active else name
        self.nodes.append(
            onnx.node(
                "Conv",
                inputs,
                target,
                kernel_shape=[side, side],
                strides=[stride, stride],
                pads=[side // 2] * 4,
                dilations=[1, 1],
                group=1,
            )
        )
        return self.apply("Relu", [target], name) if active else name

    def apply(self, kind: str, inputs: list[str], name: str, **attributes: str) -> str:
        self.nodes.append(onnx.node(kind, inputs, name, **attributes))
        return name


def to_onnx(network: BollsNetwork, *, half: bool = False) -> bytes:
    """The network as an ONNX file that OpenCV runs.

    Args:
        half: weights in 16 bits, which take half of the space.
    """
    network.eval()
    graph = _Graph([], {}, half)
    graph.constants["up.scales"] = np.array([1, 1, 2, 2], np.float32)
    # Not folded into the first convolution: its border of zeros stands for 128 in the image.
    graph.constants["shift"] = np.full((1, 1, 1, 1), -128, np.float32)
    graph.constants["gain"] = np.full((1, 1, 1, 1), 1 / 64, np.float32)
    x = graph.apply("Mul", [graph.apply("Add", ["image", "shift"], "shifted"), "gain"], "scaled")
    x = graph.conv(x, network.stem, "stem")
    levels = []
    for level, blocks in enumerate(network.blocks):
        if level:
            x = graph.conv(x, network.down[level - 1], f"down{level}")
        for k, block in enumerate(blocks):
            name = f"block{level}.{k}"
            inner = graph.conv(graph.conv(x, block.first, name + ".1"), block.second, name + ".2")
            x = graph.apply("Relu", [graph.apply("Add", [x, inner], name + ".sum")], name)
        levels.append(x)
    for level in reversed(range(len(levels) - 1)):
        across = graph.conv(x, network.across[level], f"across{level}")
        wide = graph.apply(
            "Resize",
            [across, "", "up.scales"],
            f"wide{level}",
            mode="linear",
            coordinate_transformation_mode="half_pixel",
        )
        x = graph.conv(graph.apply("Add", [levels[level], wide], f"sum{level}"), network.up[level], f"up{level}")
    weight, bias = network.head.weight.detach().cpu().numpy(), network.head.bias.detach().cpu().numpy()
    graph._conv(x, weight, bias, "maps", 3, 1, False)
    return onnx.model(
        graph.nodes,
        graph.constants,
        {"image": (1, 3, "height", "width")},
        {"maps": (1, CHANNELS, "half_height", "half_width")},
        name="bolls",
    )
