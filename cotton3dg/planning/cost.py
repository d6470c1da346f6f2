"""What a run will take: seconds of each stage from the number of images, their size, steps and Gaussians.

Every term is work (images, pixels, pairs, steps) times what a unit of it took on the machine that the constants were
measured on, 2 cores of an AMD EPYC (Zen 4) with AVX2. Another machine differs by two factors, which `calibrate`
measures: one for the splatting core, one for everything else.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..core.machine import usable_cores
from ..files.images import fitted_size, image_size, list_images
from ..options import TrainOptions
from ..splat.densify import scheduled_count
from ..splat.initialise import FILL_SHARE, START_SHARE
from ..splat.trainer import DENSIFY_FROM, DENSIFY_UNTIL, levels
from ..stages.masks import VOTING_VIEWS
from ..stages.sfm import PHOTO_FEATURES, PHOTO_SIZE, VIDEO_FEATURE_SIDE
from ..workspace import Workspace

FEATURES_PER_MP = 5700
"""Features that a megapixel has, unless there is a limit."""
USUAL_FRAMES = 900
"""Of a video that does not say how long it is: half a minute."""
SLICES = 20
"""Parts of a training over which its number of Gaussians is taken as constant."""


@dataclass(frozen=True)
class Footage:
    """What there is to be read."""

    frames: int
    width: int
    height: int
    is_video: bool = True


@dataclass(frozen=True)
class Machine:
    """How long this machine takes, relative to the one that the constants were measured on."""

    cores: float
    """That really work at once."""
    splatting: float = 1.0
    imaging: float = 1.0


@dataclass(frozen=True)
class Cost:
    """Seconds of one core, of work that all cores share and of work that one must do alone."""

    shared_s: float
    alone_s: float = 0.0

    @property
    def cpu_s(self) -> float:
        return self.shared_s + self.alone_s

    def seconds(self, cores: float) -> float:
        """On the clock of an idle machine."""
        return self.alone_s + self.shared_s / cores

    def times(self, factor: float) -> Cost:
        return Cost(self.shared_s * factor, self.alone_s * factor)


def footage(workspace: Workspace) -> Footage:
    """What the capture holds, without decoding it.

    Raises:
        MissingInput, BadInput: there is none, or it cannot be read.
    """
    from ..files import video

    source = workspace.capture()
    if source.is_dir():
        images = list_images(source)
        size = image_size(images[0].read_bytes()) if images else None
        return Footage(len(images), *(size or (VIDEO_FEATURE_SIDE, VIDEO_FEATURE_SIDE)), is_video=False)
    facts = video.probe(source)
    frames = facts.duration_s * facts.fps
    return Footage(max(1, round(frames)) if math.isfinite(frames) else USUAL_FRAMES, facts.width, facts.height)


def costs(options: Mapping[str, Any], source: Footage, machine: Machine | None = None) -> dict[str, Cost]:
    """Stage -> what it takes with these options of all stages; `report` is the page and the start of the program."""
    machine = machine or Machine(len(usable_cores()))
    images = min(options["frames"].count, source.frames)
    width, height = fitted_size(source.width, source.height, options["frames"].max_side)
    image_mp = width * height / 1e6
    views = min(options["masks"].views, images)
    train_mp = _megapixels(width, height, options["train"].max_side)
    segment_mp = _megapixels(width, height, options["segment"].max_side)
    millions = options["train"].max_gaussians / 1e6
    imaging = {
        "frames": Cost(2.5 + 0.045 * source.frames * source.width * source.height / 1e6),
        "sfm": _structure(images, width, height, options["sfm"], ordered=source.is_video),
        # Views vote on what is lint, whether they get masks or not.
        "masks": Cost((0.16 + 0.05 * image_mp) * min(max(views, VOTING_VIEWS), images) + 0.36 * image_mp * views),
        "cluster": Cost(0.0, 0.5),
        "scale": Cost(0.0, 2.8),
        "traits": Cost(0.0, 1.5 + 28 * millions),
        "report": Cost(0.0, 8.0),
    }
    splatting = {
        "train": Cost((0.05 + 0.22 * train_mp) * images + _training(options["train"], width, height)),
        "segment": Cost(_segmentation(options["segment"], views, segment_mp, millions)),
    }
    return {stage: cost.times(machine.imaging) for stage, cost in imaging.items()} | {
        stage: cost.times(machine.splatting) for stage, cost in splatting.items()
    }


def seconds(by_stage: Mapping[str, Cost], cores: float) -> float:
    """Of all stages together, on the clock of an idle machine."""
    return sum(cost.seconds(cores) for cost in by_stage.values())


def _megapixels(width: int, height: int, max_side: int) -> float:
    width, height = fitted_size(width, height, max_side)
    return width * height / 1e6


def _structure(images: int, width: int, height: int, options: Any, *, ordered: bool) -> Cost:
    """Features of each image, matches of each pair, and cameras placed one after the other."""
    mp = _megapixels(width, height, VIDEO_FEATURE_SIDE * (1 if ordered else PHOTO_SIZE))
    wanted = options.max_features * (1 if ordered else PHOTO_FEATURES)
    fullness = min(wanted, FEATURES_PER_MP * mp) / 2048
    pairs = images * options.overlap if ordered else images * (images - 1) / 2
    return Cost((0.05 + 0.55 * mp) * images + 0.05 * fullness**2 * pairs, 0.005 * fullness**2 * images**2)


def _training(options: TrainOptions, width: int, height: int) -> float:
    """CPU-seconds of all steps: each costs by its pixels and by the Gaussians there are by then."""
    longer = min(options.max_side, max(width, height))
    full_mp = _megapixels(width, height, options.max_side)
    ends = levels(longer, options.steps)
    start = (START_SHARE + FILL_SHARE) * options.max_gaussians
    # A fifth of a Gaussian's time, at degree 3, goes into its colour and the optimiser of it.
    per_million = 0.4 + 0.006 * (options.sh_degree + 1) ** 2
    total = 0.0
    for i in range(SLICES):
        share = (i + 0.5) / SLICES
        factor = next(factor for until, factor in ends if share * options.steps < until or factor == 1)
        grown = (share - DENSIFY_FROM) / (DENSIFY_UNTIL - DENSIFY_FROM)
        millions = scheduled_count(round(start), options.max_gaussians, grown) / 1e6
        total += options.steps / SLICES * (0.15 * full_mp / factor**2 + per_million * millions)
    return total


def _segmentation(options: Any, views: int, mp: float, millions: float) -> float:
    """CPU-seconds: lifting the masks, and for the other methods the optimisation besides."""
    lifting = (0.06 * mp + 0.19 * millions) * views
    if options.method == "probability":
        return lifting + 0.004 * options.steps
    if options.method == "affinity":
        return lifting + 0.02 * options.feature_steps
    return lifting
