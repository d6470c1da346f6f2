"""Training of the bolls' network, from nothing or from weights that there are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional
from torch.utils.data import DataLoader, Dataset

from ..core.training_picture import CLASSES, LINT, NOT_LINT, UNKNOWN, TrainingPicture
from .bolls import OFFSET_PX
from .bolls_network import BollsNetwork

LEARNING_RATE = 2e-3
WARM_UP = 100
FALL = 0.3
"""Share of the steps in which the learning rate falls."""
WEIGHT_DECAY = 1e-4
CLASS_WEIGHTS = (1.0, 2.0, 1.5, 1.5, 1.5)
"""Lint matters most, and most of a picture is none of the plant."""
TERMS = {"classes": 1.0, "middles": 1.5, "borders": 0.3, "sizes": 0.3}
BORDER_PX = 2
"""Distance from another boll within which a pixel of lint is on the border."""
CHECKPOINT_STEPS = 200

Draw = Callable[[int], TrainingPicture]
"""The picture of a number; the same one each time."""


@dataclass(frozen=True)
class TrainingSettings:
    steps: int
    batch: int = 8
    learning_rate: float = LEARNING_RATE
    seed: int = 0
    workers: int = 1
    """Processes that make pictures beside the one that trains."""
    frozen_norms: bool = False
    """Whether normalisation stays as it is, for weights that were read from a file and for small sets."""


@dataclass(frozen=True)
class TrainingReport:
    step: int
    losses: dict[str, float]
    """Mean of each term since the last report."""


class _Pictures(Dataset[tuple[NDArray, ...]]):
    """Pictures by number as arrays that a batch can be made of."""

    def __init__(self, draw: Draw, first: int, count: int):
        self.draw, self.first, self.count = draw, first, count

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> tuple[NDArray, ...]:
        cv2.setNumThreads(1)
        picture = self.draw(self.first + index)
        return (picture.image.transpose(2, 0, 1).copy(), *targets(picture))


def targets(picture: TrainingPicture) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.bool_]]:
    """What the network should say of each pixel.

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
    weights = torch.tensor(CLASS_WEIGHTS, device=maps.device)
    known = classes.long().masked_fill(classes == NOT_LINT, UNKNOWN)
    summed = functional.cross_entropy(logits, known, weights, ignore_index=UNKNOWN, reduction="sum")
    total = weights[known[known != UNKNOWN]].sum()
    bare = classes == NOT_LINT
    if bare.any():
        # Some class that is not lint: what is left of the probability.
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
    """Train in place; a report every `CHECKPOINT_STEPS` steps, when the state of things is also saved.

    Args:
        draw: makes picture number n; step s learns from numbers s * batch to (s + 1) * batch - 1.
        checkpoint: what was begun there is gone on with, to the same step; None = begin anew and save nothing.
    """
    torch.manual_seed(settings.seed)
    device = next(network.parameters()).device
    optimiser = torch.optim.AdamW(network.parameters(), settings.learning_rate, weight_decay=WEIGHT_DECAY)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimiser, lambda step: _rate(step, settings.steps))
    first = 0
    if checkpoint is not None and checkpoint.is_file():
        state = torch.load(checkpoint, map_location=device, weights_only=True)
        network.load_state_dict(state["network"])
        optimiser.load_state_dict(state["optimiser"])
        schedule.load_state_dict(state["schedule"])
        first = int(state["step"])
    pictures = _Pictures(draw, first * settings.batch, (settings.steps - first) * settings.batch)
    batches = DataLoader(
        pictures, settings.batch, num_workers=settings.workers, prefetch_factor=4 if settings.workers else None
    )
    sums: dict[str, float] = {}
    network.train(not settings.frozen_norms)
    for step, batch in enumerate(batches, start=first + 1):
        images, classes, wanted, border = (part.to(device) for part in batch)
        terms = losses(network(images.float()), classes, wanted, border)
        total = sum(TERMS[name] * term for name, term in terms.items())
        optimiser.zero_grad(set_to_none=True)
        total.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimiser.step()
        schedule.step()
        for name, term in terms.items():
            sums[name] = sums.get(name, 0.0) + float(term.detach())
        if step % CHECKPOINT_STEPS == 0 or step == settings.steps:
            done = (step - 1) % CHECKPOINT_STEPS + 1
            yield TrainingReport(step, {name: value / done for name, value in sums.items()})
            sums = {}
            if checkpoint is not None:
                _save(checkpoint, network, optimiser, schedule, step)
    network.eval()


def _rate(step: int, steps: int) -> float:
    """Share of the learning rate: a short rise, the same for long, then a fall to nothing.

    What was learnt before the fall does not depend on the number of steps, so a training may be made longer.
    """
    rise, fall = min(WARM_UP, steps), (1 - FALL) * steps
    return min((step + 1) / rise, 1.0) * min((steps - step) / max(steps - fall, 1), 1.0)


def _save(
    path: Path,
    network: BollsNetwork,
    optimiser: torch.optim.Optimizer,
    schedule: torch.optim.lr_scheduler.LRScheduler,
    step: int,
) -> None:
    partial = path.with_suffix(".partial")
    torch.save(
        {
            "network": network.state_dict(),
            "optimiser": optimiser.state_dict(),
            "schedule": schedule.state_dict(),
            "step": step,
        },
        partial,
    )
    partial.replace(path)
