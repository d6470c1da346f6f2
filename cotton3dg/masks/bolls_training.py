# SPDX-License-Identifier: Apache-2.0
"""Training of the bolls' network, from nothing or from given weights."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Final
from zipfile import BadZipFile

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from ..core.machine import one_thread_each
from ..core.training_picture import CLASSES, LINT, NOT_LINT, UNKNOWN, TrainingPicture
from ..errors import BadInput
from .bolls import OFFSET_PX
from .bolls_network import BollsNetwork

LEARNING_RATE: Final = 2e-3
ENCODER_RATE: Final = 0.15
"""Learning rate of the pretrained encoder, relative to that of the decoder."""
FROZEN_BLOCKS: Final = 3
"""Number of the encoder's blocks that stay fixed, besides its stem. The first filters suit all images and are the most
expensive to train."""
WARM_UP: Final = 100
FALL: Final = 0.3
"""Share of the steps in which the learning rate falls."""
WEIGHT_DECAY: Final = 1e-4
MEMORY: Final = 0.998
"""Share of the mean of the weights that a step keeps. The result is the mean of some 500 steps, which is better than
any single step (Polyak averaging)."""
TERMS: Final = {"classes": 1.0, "middles": 1.5, "borders": 0.3, "sizes": 0.3}
BORDER_PX: Final = 2
"""Distance from another boll within which a pixel of lint is on the border."""
CHECKPOINT_STEPS: Final = 200
BATCHES_AHEAD: Final = 4

Draw = Callable[[int], TrainingPicture]
"""The picture of a number; the same one each time."""


@dataclass(frozen=True)
class TrainingSettings:
    steps: int
    batch: int = 8
    learning_rate: float = LEARNING_RATE
    seed: int = 0
    makers: int = 1
    """Threads that make pictures beside the one that trains. (Processes would be forked while OpenCV's threads run.)"""
    frozen_norms: bool = False
    """Whether normalisation stays as it is, for weights that were read from a file and for small sets."""
    pretrained: bool = True
    """Whether the encoder is pretrained: its normalisation and first blocks stay, the rest learns slowly."""
    bfloat16: bool = False
    """Whether convolutions run in 16 bits: as good, and twice as fast on processors with such instructions."""


@dataclass(frozen=True)
class TrainingReport:
    step: int
    losses: dict[str, float]
    """Mean of each term since the last report."""


def targets(picture: TrainingPicture) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.bool_]]:
    """The outputs that the network should have for each pixel.

    Returns:
        classes (H, W); x and y of the way to the middle and the size, px (3, H, W), 0 where no boll is; on a border
        (H, W).
    """
    height, width = picture.ids.shape
    ids = picture.ids
    table = np.zeros((len(picture.diameters_px) + 1, 3), np.float32)
    table[1:] = np.column_stack([picture.centres_px, picture.diameters_px])
    wanted = table[ids].transpose(2, 0, 1)
    y, x = np.mgrid[:height, :width].astype(np.float32) + np.float32(0.5)
    wanted[0] -= x
    wanted[1] -= y
    wanted *= ids > 0
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * BORDER_PX + 1, 2 * BORDER_PX + 1))
    largest = cv2.dilate(ids, disc)
    smallest = cv2.erode(np.where(ids > 0, ids, np.iinfo(np.uint16).max).astype(np.uint16), disc)
    return picture.classes, wanted, (ids > 0) & ((largest != ids) | (smallest != ids))


def losses(maps: Tensor, classes: Tensor, wanted: Tensor, border: Tensor) -> dict[str, Tensor]:
    """Each term of the loss for (B, CHANNELS, H/2, W/2) maps and full-size targets."""
    maps = functional.interpolate(maps, scale_factor=2, mode="bilinear", align_corners=False)
    logits = maps[:, : len(CLASSES)]
    known = classes.long().masked_fill(classes == NOT_LINT, UNKNOWN)
    summed = functional.cross_entropy(logits, known, ignore_index=UNKNOWN, reduction="sum")
    total = (known != UNKNOWN).sum()
    bare = classes == NOT_LINT
    if bare.any():
        # The probability of all classes that are not lint is the remainder.
        of_pixel = logits.movedim(1, -1)[bare]
        others = torch.cat([of_pixel[:, :LINT], of_pixel[:, LINT + 1 :]], dim=1)
        summed = summed + (of_pixel.logsumexp(dim=1) - others.logsumexp(dim=1)).sum()
        total = total + bare.sum()
    terms = {"classes": summed / total.clamp(min=1)}
    own = (classes == LINT) & (wanted[:, 2] > 0)
    if not own.any():
        return terms | dict.fromkeys(("middles", "borders", "sizes"), maps.sum() * 0)
    way, edge, size = maps[:, len(CLASSES) : len(CLASSES) + 2], maps[:, len(CLASSES) + 2], maps[:, len(CLASSES) + 3]
    diameter = wanted[:, 2][own]
    error = (way * OFFSET_PX - wanted[:, :2]).abs().sum(dim=1)[own]
    terms["middles"] = (error / diameter).mean()
    terms["borders"] = functional.binary_cross_entropy_with_logits(
        edge[own], border[own].float(), pos_weight=torch.tensor(3.0, device=maps.device)
    )
    terms["sizes"] = (size[own] - torch.log2(diameter / OFFSET_PX)).abs().mean()
    return terms


def train(
    network: BollsNetwork, draw: Draw, settings: TrainingSettings, checkpoint: Path | None = None
) -> Iterator[TrainingReport]:
    """Train in place; every `CHECKPOINT_STEPS` steps the function yields a report and saves the state of the training.

    At the end the network has the mean of its weights over the last steps.

    Args:
        draw: makes picture number n; step s learns from numbers s * batch to (s + 1) * batch - 1.
        checkpoint: file of an interrupted training, which goes on from there to the same step; None = begin anew and
            save nothing.
    """
    torch.manual_seed(settings.seed)
    device = next(network.parameters()).device
    optimiser = _make_optimiser(network, settings)
    first, mean = 0, {name: values.clone() for name, values in network.state_dict().items()}
    if checkpoint is not None and checkpoint.is_file():
        first = _resume(checkpoint, network, mean, optimiser)
    sums: dict[str, float] = {}
    if settings.pretrained and not settings.frozen_norms:
        network.train_decoder()
    else:
        network.train(not settings.frozen_norms)
    for step, batch in _batches(draw, range(first + 1, settings.steps + 1), settings):
        images, classes, wanted, border = (part.to(device) for part in batch)
        with torch.autocast(device.type, torch.bfloat16, enabled=settings.bfloat16):
            maps = network(images.float())
        terms = losses(maps.float(), classes, wanted, border)
        total = sum(TERMS[name] * term for name, term in terms.items())
        for group in optimiser.param_groups:
            group["lr"] = group["peak"] * _rate(step - 1, settings.steps)
        optimiser.zero_grad(set_to_none=True)
        total.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimiser.step()
        _follow(mean, network, step)
        for name, term in terms.items():
            sums[name] = sums.get(name, 0.0) + float(term.detach())
        if step % CHECKPOINT_STEPS == 0 or step == settings.steps:
            done = (step - 1) % CHECKPOINT_STEPS + 1
            yield TrainingReport(step, {name: value / done for name, value in sums.items()})
            sums = {}
            if checkpoint is not None:
                _save(checkpoint, network, mean, optimiser, step)
    network.load_state_dict(mean)
    network.eval()


def _make_optimiser(network: BollsNetwork, settings: TrainingSettings) -> torch.optim.Optimizer:
    """AdamW. The first blocks of a pretrained encoder are frozen; its other blocks learn slowly and without decay."""
    rate = settings.learning_rate
    if not settings.pretrained:
        return torch.optim.AdamW([{"params": list(network.parameters()), "peak": rate}], weight_decay=WEIGHT_DECAY)
    encoder = network.encoder()
    for layer in encoder[: FROZEN_BLOCKS + 1]:
        layer.requires_grad_(False)
    slow = [values for layer in encoder[FROZEN_BLOCKS + 1 :] for values in layer.parameters()]
    known = {id(values) for layer in encoder for values in layer.parameters()}
    rest = [values for values in network.parameters() if id(values) not in known]
    groups = [
        {"params": slow, "peak": ENCODER_RATE * rate, "weight_decay": 0.0},
        {"params": rest, "peak": rate, "weight_decay": WEIGHT_DECAY},
    ]
    return torch.optim.AdamW(groups)


@torch.no_grad()
def _follow(mean: dict[str, Tensor], network: BollsNetwork, step: int) -> None:
    """Update the mean of the weights after a step. Early on it is the mean of all steps."""
    share = 1 - min(MEMORY, step / (step + 10))
    for name, values in network.state_dict().items():
        if values.is_floating_point():
            mean[name].lerp_(values, share)
        else:
            mean[name].copy_(values)


@torch.no_grad()
def restore_norms(network: BollsNetwork, draw: Draw, pictures: int = 72) -> None:
    """Give the decoder's normalisations, which were folded into convolutions (`from_onnx`), the statistics of pictures,
    so that training can continue; the network's output stays the same."""
    images = np.stack([draw(number).image.transpose(2, 0, 1) for number in range(pictures)])
    batch = torch.from_numpy(images).to(next(network.parameters()).device).float()
    network.eval()

    def restore(layer: nn.Module, _: object, out: Tensor) -> None:
        norm, (variance, average) = norms[layer], torch.var_mean(out, dim=(0, 2, 3), correction=0)
        deviation = torch.sqrt(norm.running_var + norm.eps)
        norm.bias.add_(norm.weight * (average - norm.running_mean) / deviation)
        norm.weight.mul_(torch.sqrt(variance + norm.eps) / deviation)
        norm.running_mean.copy_(average)
        norm.running_var.copy_(variance)

    norms = {layer.conv: layer.norm for layer in network.decoder()}
    hooks = [convolution.register_forward_hook(restore) for convolution in norms]
    network(batch)
    for hook in hooks:
        hook.remove()


def _batches(
    draw: Draw, steps: range, settings: TrainingSettings
) -> Iterator[tuple[int, tuple[Tensor, Tensor, Tensor, Tensor]]]:
    """The images and `targets` of each step, prepared in advance."""

    def made(step: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        numbers = range((step - 1) * settings.batch, step * settings.batch)
        pictures = [draw(number) for number in numbers]
        images = np.stack([picture.image.transpose(2, 0, 1) for picture in pictures])
        classes, wanted, border = (np.stack(part) for part in zip(*map(targets, pictures), strict=True))
        return torch.from_numpy(images), torch.from_numpy(classes), torch.from_numpy(wanted), torch.from_numpy(border)

    if not settings.makers:
        yield from ((step, made(step)) for step in steps)
        return
    with one_thread_each(), ThreadPoolExecutor(settings.makers) as pool:
        ahead: deque[Future[tuple[Tensor, Tensor, Tensor, Tensor]]] = deque()
        waiting = iter(steps)
        for step in steps:
            ahead.extend(pool.submit(made, later) for later in islice(waiting, BATCHES_AHEAD - len(ahead)))
            yield step, ahead.popleft().result()


def _rate(step: int, steps: int) -> float:
    """Share of the learning rate: a short rise, the same for long, then a fall to nothing.

    The training before the fall does not depend on the number of steps, so it may be made longer.
    """
    rise, fall = min(WARM_UP, steps), (1 - FALL) * steps
    return min((step + 1) / rise, 1.0) * min((steps - step) / max(steps - fall, 1), 1.0)


def _save(
    path: Path, network: BollsNetwork, mean: dict[str, Tensor], optimiser: torch.optim.Optimizer, step: int
) -> None:
    """Save weights, their mean, statistics and the optimiser's state as plain arrays, which cannot hold code."""
    arrays = {f"network/{name}": values.cpu().numpy() for name, values in network.state_dict().items()}
    arrays |= {f"mean/{name}": values.cpu().numpy() for name, values in mean.items()}
    for number, state in optimiser.state_dict()["state"].items():
        arrays |= {f"optimiser/{number}/{name}": values.cpu().numpy() for name, values in state.items()}
    partial = path.with_suffix(".partial.npz")
    np.savez(partial, step=step, **arrays)
    partial.replace(path)


def _resume(path: Path, network: BollsNetwork, mean: dict[str, Tensor], optimiser: torch.optim.Optimizer) -> int:
    """Take over what `_save` wrote, and return the step after which it was written.

    Raises:
        BadInput: the file is damaged, or of another network.
    """
    try:
        with np.load(path, allow_pickle=False) as arrays:
            named = {name: torch.from_numpy(arrays[name]) for name in arrays.files}
        network.load_state_dict({name.split("/")[1]: v for name, v in named.items() if name.startswith("network/")})
        for name, values in mean.items():
            values.copy_(named[f"mean/{name}"])
        state: dict[int, dict[str, Tensor]] = {}
        for name, values in named.items():
            if name.startswith("optimiser/"):
                _, number, part = name.split("/")
                state.setdefault(int(number), {})[part] = values
        optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})
        return int(named["step"])
    except (ValueError, KeyError, RuntimeError, OSError, BadZipFile) as error:
        raise BadInput(f"{path} cannot be gone on with; remove it to train anew") from error
