"""Training of the network of lint's edges (`lint_edges.py`) on images of simulated plants with true masks.

Simulated bolls are lit too evenly: the undersides of real ones lie in warm shade. So most bolls of a picture are shaded
from one side, and the probabilities of lint, those by other images and that by this one, are less sure there.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Final

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from ..core.scene import Float32
from ..io import onnx
from .lint_edges import CHANNELS, describe

WIDTH: Final = 24
"""Channels between the convolutions."""
DEPTH: Final = 3
"""Convolutions of 3 x 3 before the last one."""
BATCH: Final = 24
PIECE_PX: Final = 48
LEARNING_RATE: Final = 4e-3
"""The largest learning rate."""
FOUND: Final = 0.3
"""Least share of a patch of rendered lint that is true, and of a patch of true lint that is rendered: the others are
false or missed bolls, which edges have nothing to do with."""
BESIDE_PX: Final = 8.0
"""How far the shade of a boll reaches beyond its lint."""


@dataclass(frozen=True)
class EdgePicture:
    """An image with the network's inputs, and the truth."""

    image: NDArray[np.uint8]
    """(H, W, 3) sRGB."""
    share: Float32
    """(H, W) rendered share of lint."""
    likely: Float32
    """(H, W) probability of lint by this image alone."""
    true: NDArray[np.uint16]
    """(H, W) ids of the bolls."""


@dataclass(frozen=True)
class _Lesson:
    """A varied picture, as the training uses it."""

    channels: Float32
    """(CHANNELS + 2, H, W) the network's inputs, the truth, and whether the truth is known there."""
    edges: NDArray[np.int64]
    """(K, 2) row and column of pixels around edges."""


def build_network() -> nn.Sequential:
    """(B, CHANNELS, H, W) of `lint_edges.describe` -> (B, 1, H, W) logit of lint."""
    layers: list[nn.Module] = []
    for number in range(DEPTH):
        layers += [nn.Conv2d(WIDTH if number else CHANNELS, WIDTH, 3, padding=1), nn.ReLU()]
    return nn.Sequential(*layers, nn.Conv2d(WIDTH, 1, 1))


def to_onnx(network: nn.Sequential) -> bytes:
    """The network as an ONNX file that OpenCV runs."""
    nodes: list[bytes] = []
    constants: dict[str, NDArray[np.float32]] = {}
    x = "described"
    for number, layer in enumerate(network):
        name = f"layer{number}"
        if isinstance(layer, nn.Conv2d):
            assert layer.bias is not None
            constants |= {name + ".w": layer.weight.detach().numpy(), name + ".b": layer.bias.detach().numpy()}
            side = layer.kernel_size[0]
            nodes.append(
                onnx.node(
                    "Conv",
                    [x, name + ".w", name + ".b"],
                    name,
                    kernel_shape=[side, side],
                    strides=[1, 1],
                    pads=[side // 2] * 4,
                    dilations=[1, 1],
                    group=1,
                )
            )
        else:
            nodes.append(onnx.node("Relu", [x], name))
        x = name
    shapes = {"described": (1, CHANNELS, "height", "width")}, {x: (1, 1, "height", "width")}
    return onnx.model(nodes, constants, *shapes, name="edges")


def train_edges(pictures: Iterable[EdgePicture], steps: int, seed: int = 0) -> nn.Sequential:
    """The network that these pictures teach; the same for the same pictures, seed and threads.

    Args:
        steps: each learns from `BATCH` pieces around edges.
    """
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    lessons = [_learnable(picture, rng) for picture in pictures]
    lessons = [lesson for lesson in lessons if len(lesson.edges)]
    network = build_network()
    optimiser = torch.optim.AdamW(network.parameters(), LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, LEARNING_RATE, steps)
    for _ in range(steps):
        pieces = np.stack([_cut(lessons[number], rng) for number in rng.integers(len(lessons), size=BATCH)])
        inputs, true, known = torch.from_numpy(pieces).split([CHANNELS, 1, 1], dim=1)
        loss = functional.binary_cross_entropy_with_logits(network(inputs), true, reduction="none") * known
        optimiser.zero_grad()
        loss.mean().backward()
        optimiser.step()
        schedule.step()
    return network.eval()


def varied(picture: EdgePicture, rng: np.random.Generator) -> EdgePicture:
    """The picture in another light, as another camera takes it, and with less or more known of it."""
    light = np.power(picture.image / np.float32(255), np.exp(rng.normal(0, 0.3)), dtype=np.float32)
    light, shade = _shaded(light, picture.true, rng)
    if rng.random() < 0.5:
        light = cv2.GaussianBlur(light, (0, 0), rng.uniform(0.3, 1.0)).astype(np.float32)
    light = light + np.float32(rng.uniform(0, 0.02)) * rng.standard_normal(light.shape, np.float32)
    share = _logit(picture.share) * np.exp(rng.normal(0, 0.2)) + rng.normal(-0.3, 0.7) - rng.uniform(0, 3) * shade
    likely = _logit(picture.likely) + rng.normal(-0.2, 0.7) - rng.uniform(0, 4) * shade
    image = np.round(255 * light.clip(0, 1)).astype(np.uint8)
    return replace(picture, image=image, share=_probability(share), likely=_probability(likely))


def _shaded(light: Float32, true: NDArray[np.uint16], rng: np.random.Generator) -> tuple[Float32, Float32]:
    """The picture with most bolls shaded from about one side, mostly warmly, and how much (H, W), 0..1."""
    shade, colour = np.zeros(true.shape, np.float32), np.ones(light.shape, np.float32)
    if rng.random() < 0.1:
        return light, shade
    side, warmth, strength = rng.normal(np.pi / 2, 0.5), rng.uniform(-0.05, 0.35), rng.uniform(0.2, 0.85)
    away = cv2.distanceTransform((true == 0).astype(np.uint8), cv2.DIST_L2, 5)
    owners = _nearest_bolls(true)
    for boll in np.unique(true[true > 0]):
        if rng.random() < 0.15:
            continue
        lines, columns = np.nonzero(true == boll)
        radius, angle = np.sqrt(len(lines) / np.pi) + 2, side + rng.normal(0, 0.4)
        y, x = np.nonzero((owners == boll) & (away < BESIDE_PX))
        across = ((x - columns.mean()) * np.cos(angle) + (y - lines.mean()) * np.sin(angle)) / radius
        begins, softness = rng.uniform(-0.3, 0.8), rng.uniform(0.06, 0.25)
        shade[y, x] = (strength * rng.uniform(0.6, 1.2) / (1 + np.exp((begins - across) / softness))).clip(0, 0.85)
        colour[y, x] = np.exp(warmth * shade[y, x, None] * np.array([1, 0, -1.3]))
    shade = cv2.GaussianBlur(shade, (0, 0), 0.7).astype(np.float32)
    return light * (1 - shade[..., None]) * colour, shade


def _nearest_bolls(ids: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """The boll (H, W) that is nearest to each pixel."""
    _, places = cv2.distanceTransformWithLabels(
        (ids == 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    boll_of_place = np.zeros(places.max() + 1, np.uint16)
    boll_of_place[places[ids > 0]] = ids[ids > 0]
    return boll_of_place[places]


def _learnable(picture: EdgePicture, rng: np.random.Generator) -> _Lesson:
    seen = varied(picture, rng)
    true, rendered = picture.true > 0, picture.share > 0.5
    strange = _hardly_covered(rendered, true) | _hardly_covered(true, rendered)
    known = cv2.dilate(strange.astype(np.uint8), np.ones((5, 5), np.uint8)) == 0
    edges = np.argwhere((seen.share > 0.05) & (seen.share < 0.95) & known)
    inputs = describe(seen.image, seen.share, seen.likely)
    return _Lesson(np.concatenate([inputs, true[None], known[None]]).astype(np.float32), edges)


def _hardly_covered(patches: NDArray[np.bool_], by: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The connected patches that lie almost wholly outside of the other mask."""
    count, labels = cv2.connectedComponents(patches.astype(np.uint8))
    all_px, shared_px = np.bincount(labels.ravel(), minlength=count), np.bincount(labels[by], minlength=count)
    alone: NDArray[np.bool_] = patches & (shared_px < FOUND * all_px)[labels]
    return alone


def _cut(lesson: _Lesson, rng: np.random.Generator) -> Float32:
    """A piece (CHANNELS + 2, PIECE_PX, PIECE_PX) around some edge, or its mirror image; pixels beyond the picture have
    no weight."""
    middle, shape = lesson.edges[rng.integers(len(lesson.edges))], np.array(lesson.channels.shape[1:])
    low = np.clip(middle - PIECE_PX // 2, 0, np.maximum(shape - PIECE_PX, 0))
    piece = lesson.channels[:, low[0] : low[0] + PIECE_PX, low[1] : low[1] + PIECE_PX]
    piece = np.pad(piece, [(0, 0), *((0, PIECE_PX - side) for side in piece.shape[1:])])
    return piece[..., ::-1] if rng.integers(2) else piece


def _logit(probability: Float32) -> Float32:
    bounded = probability.clip(1e-3, 1 - 1e-3)
    return np.asarray(np.log(bounded / (1 - bounded)), np.float32)


def _probability(logit: NDArray[Any]) -> Float32:
    return np.asarray(1 / (1 + np.exp(-logit)), np.float32)
