# SPDX-License-Identifier: Apache-2.0
"""The settings of a sweep, and why a plant's footage rules out some of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from .. import pipeline
from ..errors import unknown
from ..options import FINER_PRESETS, PRESETS, resolve
from ..stage import Footage
from ..workspace import Workspace
from .tables import TITLES

FACTORS: Final[dict[str, tuple[str, str, tuple[Any, ...]]]] = {
    "resolution": ("train", "max_side", (120, 240, 480, 960)),
    "steps": ("train", "steps", (50, 100, 200, 500, 1000, 2000, 3000, 5000, 7000, 10_000, 15_000, 20_000, 30_000)),
    "schedule": ("train", "steps", (250, 500, 1000, 2000, 3000, 7000, 15_000, 30_000)),
    "images": ("frames", "count", (25, 50, 75, 100, 150, 200, 250, 300)),
    "sh": ("train", "sh_degree", (0, 1, 2, 3)),
    "gaussians": ("train", "max_gaussians", (15_000, 30_000, 60_000, 150_000, 300_000, 1_000_000)),
    "views": ("masks", "views", (4, 8, 16, 36, 72)),
    "method": ("segment", "method", ("lint", "lift", "probability", "affinity")),
}
"""Sweep -> stage, option and values, coarse to fine. Besides, there are `style` and `preset`."""

CLUSTERED_BY: Final = {"affinity": "dbscan"}
"""Method of segment -> the method of cluster that was published with it; others use the base's."""

CHEAP: Final = ("resolution", "steps", "views")
"""Sweeps whose settings share the cameras, which take longest."""


PARTIAL_SHARE: Final = 0.6
"""Share of the frame's sides that `style partial` sees, as from a camera too near for the whole plant."""


@dataclass(frozen=True)
class Setting:
    """One line of a table."""

    sweep: str
    value: str
    options: dict[str, Any]
    """Options of all stages."""
    obstacle: str = ""
    """Why this plant does not allow the setting; empty if it does."""
    is_base: bool = False
    """Whether it is the base setting under another name."""
    passing: bool = False
    """Whether the sweep's only training passes through its model or ends with it."""
    partial: bool = False
    """Whether the video is cropped."""


def sweeps_of(texts: Sequence[str] | None) -> dict[str, tuple[str, ...]]:
    """Sweep -> its values, from `name` or `name=value,value`: all usual values for none, the cheap sweeps for nothing.

    Raises:
        BadUsage: a sweep does not exist.
    """
    sweeps: dict[str, tuple[str, ...]] = {}
    for text in texts or CHEAP:
        name, _, values = text.partition("=")
        if name not in (*TITLES, "all"):
            raise unknown(f"sweep {name!r}", name, (*TITLES, "all"))
        sweeps |= {each: tuple(values.split(",")) if values else () for each in (TITLES if name == "all" else [name])}
    return sweeps


def settings_of(
    sweep: str,
    plant: Workspace,
    preset: str,
    overrides: Mapping[str, Mapping[str, Any]],
    source: Footage,
    values: Sequence[str] = (),
    *,
    local: bool = False,
) -> list[Setting]:
    """The settings of a sweep, coarse to fine, that of the base among them.

    `steps` ends with the base's training, or with a longer one where `values` ask for more steps.

    Args:
        values: values to try instead of the usual ones.
        local: the plant was also filmed from close by, so that no crop has to replace that film.
    Raises:
        BadUsage: the option does not accept one of the values.
    """
    given = {stage: dict(own) for stage, own in overrides.items()}
    base = pipeline.stage_options(plant, preset, given)
    if sweep == "preset":
        # Other methods run only if the user names them; the finest comes last, as the reference for changes.
        ordered = [*(name for name in PRESETS if name not in FINER_PRESETS), *FINER_PRESETS]
        names = [name for name in ordered if name in (*(values or FINER_PRESETS), preset)]
        own = {name: pipeline.stage_options(plant, name, given) for name in names}
        return [
            Setting(sweep, name, options, obstacle_of(options, base, source), is_base=name == preset)
            for name, options in own.items()
        ]
    if sweep == "style":
        obstacle = "" if source.is_video or local else "only a video can be cropped"
        near = Setting(sweep, "local" if local else "partial", base, obstacle, partial=True)
        return [near, Setting(sweep, "whole", base, is_base=True)]
    stage, option, usual = FACTORS[sweep]
    base_value = getattr(base[stage], option)
    wanted = tuple(getattr(resolve(stage, {option: value}), option) for value in values) or usual
    if sweep == "steps":
        longest = max(base_value, *wanted) if values else base_value
        options = {**base, stage: replace(base[stage], steps=longest)}
        is_base = longest == base_value
        passed = [Setting(sweep, str(value), options, passing=True) for value in sorted(wanted) if value < longest]
        return [*passed, Setting(sweep, str(longest), options, is_base=is_base, passing=not is_base)]
    if base_value not in wanted:
        wanted = (*wanted, base_value)
    found = []
    for value in wanted if isinstance(base_value, str) else sorted(wanted):
        options = {**base, stage: replace(base[stage], **{option: value})}
        if sweep == "resolution" and value > base["frames"].max_side:
            # Take frames at the size of the row, else it would train on smaller ones than its name says.
            options["frames"] = replace(base["frames"], max_side=value)
        if sweep == "method" and "method" not in given.get("cluster", {}):
            options["cluster"] = replace(base["cluster"], method=CLUSTERED_BY.get(value, base["cluster"].method))
        obstacle = obstacle_of(options, base, source)
        found.append(Setting(sweep, str(value), options, obstacle, is_base=value == base_value))
    return found


def obstacle_of(options: Mapping[str, Any], base: Mapping[str, Any], source: Footage) -> str:
    """Why the footage does not allow these options, where they differ from the base's; empty if it does."""
    count, views, side = options["frames"].count, options["masks"].views, options["train"].max_side
    longer = max(source.width, source.height)
    if count > source.frames and count != base["frames"].count:
        return f"there are only {source.frames} images"
    if views > count and views != base["masks"].views:
        return f"only {count} images are taken"
    # Sizes beyond that of the images equal the images' size; the first such size stays, unless it needs larger frames.
    too_large = side > longer if side > base["frames"].max_side else side >= 2 * longer
    if too_large and side != base["train"].max_side:
        return f"the images have only {longer} px"
    return ""
