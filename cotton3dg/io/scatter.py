# SPDX-License-Identifier: Apache-2.0
"""Measured against true values as a PNG: points, the 1:1 line, the regression line and the figures beside them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_scatter(path: Path, title: str, true: NDArray[Any], measured: NDArray[Any], notes: list[str]) -> None:
    """Save the plot.

    Args:
        title: with the unit. true, measured: (N,) finite, N > 0. notes: lines for the corner.
    """
    plot_scatter(title, true, measured, notes).savefig(path, format="png")


Band = tuple[NDArray[Any], NDArray[Any], NDArray[Any]]
"""Places along x, the line there, and half of the interval around it."""


def write_fit(
    path: Path, title: str, name: str, x: NDArray[Any], y: NDArray[Any], band: Band, notes: list[str]
) -> None:
    """Save points with a fitted line and its prediction interval.

    Args:
        title: with the unit. name: of x. x, y: (N,) finite, N > 0. notes: lines for the corner.
    """
    from matplotlib.figure import Figure

    along, line, half = band
    figure = Figure((7.2, 5.4), layout="constrained")
    axes = figure.add_subplot(title=title, xlabel=name, ylabel=title.split(maxsplit=1)[0])
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    axes.fill_between(along, line - half, line + half, color="C1", alpha=0.15, linewidth=0)
    axes.plot(along, line, color="C1", linewidth=1)
    axes.scatter(x, y)
    axes.text(0.03, 0.97, "\n".join(notes), transform=axes.transAxes, verticalalignment="top")
    figure.savefig(path, format="png")


def plot_scatter(title: str, true: NDArray[Any], measured: NDArray[Any], notes: list[str]) -> Figure:
    """The plot; both axes have the same scale, so that the 1:1 line is a diagonal."""
    from matplotlib.figure import Figure  # without pyplot, which would look for a screen

    values = np.concatenate([true, measured])
    margin = 0.05 * float(np.ptp(values) or abs(values[0]) or 1.0)
    limits = (float(values.min()) - margin, float(values.max()) + margin)
    figure = Figure((7.2, 7.2), layout="constrained")
    axes = figure.add_subplot(title=title, xlabel="true", ylabel="measured", xlim=limits, ylim=limits, aspect="equal")
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    axes.plot(limits, limits, color="0.5", linewidth=1)
    axes.scatter(true, measured)
    if np.ptp(true) > 0:
        slope, start = np.polyfit(true, measured, 1)
        axes.plot(limits, start + slope * np.array(limits), color="C1", linewidth=1)
    axes.text(0.03, 0.97, "\n".join(notes), transform=axes.transAxes, verticalalignment="top")
    return figure
