# SPDX-License-Identifier: Apache-2.0
"""Plot of accuracy against time: one dot per setting, one colour per sweep, the front of settings worth choosing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

LABEL_PLACES: Final = (("left", 7, 4), ("left", 7, -10), ("right", -7, 4), ("right", -7, -10), ("left", 7, -19))
"""Beside a dot: alignment, and distance in points. A label is left out if others stand at all of them."""


@dataclass(frozen=True)
class Dot:
    """One setting."""

    series: str
    label: str
    seconds: float
    value: float
    on_front: bool


@dataclass(frozen=True)
class Panel:
    """One measure of accuracy."""

    title: str
    dots: Sequence[Dot]


def write_tradeoff(path: Path, panels: Sequence[Panel], time_axis: str) -> None:
    """Save the panels side by side; values are finite and seconds above 0."""
    plot_tradeoff(panels, time_axis).savefig(path, format="png")


def plot_tradeoff(panels: Sequence[Panel], time_axis: str) -> Figure:
    """The plot of at least one panel."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure  # without pyplot, which would look for a screen

    shades = colormaps["tab20"](range(20))  # dark and light by turns
    figure = Figure((7.5 * len(panels), 6.6), layout="constrained")
    series = dict.fromkeys(dot.series for panel in panels for dot in panel.dots)
    colours = dict(zip(series, cycle((*shades[::2], *shades[1::2])), strict=False))
    drawn = list(zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True))
    for axes, panel in drawn:
        _draw(axes, panel, colours, time_axis)
    handles = {dots.get_label(): dots for axes, _ in drawn for dots in axes.collections}
    figure.legend(handles=[handles[name] for name in series], loc="outside lower left", ncols=8, frameon=False)
    figure.draw_without_rendering()  # only the final layout shows where labels meet
    for axes, panel in drawn:
        taken: list[Bbox] = []
        for dot in sorted(panel.dots, key=lambda dot: not dot.on_front):
            _label(axes, dot, colours[dot.series], taken)
    return figure


def _draw(axes: Axes, panel: Panel, colours: dict[str, tuple[float, ...]], time_axis: str) -> None:
    from matplotlib.ticker import LogLocator

    axes.set(title=panel.title, xlabel=time_axis, xscale="log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5, 7)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(LogLocator(subs=()))
    axes.grid(color="0.9")
    axes.margins(0.1)
    front = sorted((dot for dot in panel.dots if dot.on_front), key=lambda dot: dot.seconds)
    ring = {"marker": "o", "markersize": 10, "markerfacecolor": "none"}
    front_s, front_values = [dot.seconds for dot in front], [dot.value for dot in front]
    axes.step(front_s, front_values, where="post", color="0.1", linewidth=1, **ring)
    for name, colour in colours.items():
        dots = [dot for dot in panel.dots if dot.series == name]
        axes.scatter([d.seconds for d in dots], [d.value for d in dots], color=[colour], label=name, zorder=3)


def _label(axes: Axes, dot: Dot, colour: tuple[float, ...], taken: list[Bbox]) -> None:
    """The label beside its dot, at the first place that no other label has taken."""
    for side, dx, dy in LABEL_PLACES:
        words = axes.annotate(
            dot.label, (dot.seconds, dot.value), (dx, dy), textcoords="offset points", ha=side, size=8, color=colour
        )
        box = words.get_window_extent()
        if not box.count_overlaps(taken):
            taken.append(box)
            return
        words.remove()
