# SPDX-License-Identifier: Apache-2.0
"""The plant map of a real plant beside its internodes, measured by hand.

    python tests/accuracy/real_internodes.py FOLDER

FOLDER is where real_captures.py ran the set `romi` (tests/testdata/real_plant of romi/plant-3d-vision: photos of an
Arabidopsis before black cloth by an arm whose positions are known, and `measures.json`, 29 internodes in mm). The arm
gives the scale; the plant is what is yellow near the middle of its circle and hangs together. It is a third as large as
cotton in all that the map asks for, so it is mapped three times as large. What leaves its stem is paired with what was
measured, in order, for the likeliest height of the first. Prints the pairs and writes FOLDER/internodes.png.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from real_captures import fit_to_arm
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from cotton3dg.core.scene import Float64
from cotton3dg.geometry.polylines import length_of, nearest_on
from cotton3dg.io.ply import read_gaussians
from cotton3dg.plant_map.map_plant import map_places
from cotton3dg.plant_map.wood import wood_places
from cotton3dg.workspace import Workspace

LARGER = 3.0
YELLOW, BRIGHT, OPAQUE = 0.2, 0.4, 0.2
"""Red and green are so much more than blue, and so bright, in what is so opaque."""
REACH_CM, ROSETTE_CM = 9.0, 20.0
"""Beside the middle of the circle, and below it: what is lower is the rosette."""
ABOVE_CM = 12.0
HANGS_TOGETHER_CM = 1.0
FAR_CM = 5.0
SKIPPED_CM = 0.6
"""What a pair that is none costs, on either side."""


def plant_places(workspace: Workspace, source: Path) -> Float64:
    """(N, 3) cm, places along the Gaussians of the plant, `LARGER` times as large."""
    fitted, _, arm_cm = fit_to_arm(workspace, source)
    if fitted is None:
        raise SystemExit("the cameras do not fit the arm's positions")
    matrix, gaussians = fitted.matrix(), read_gaussians(workspace.gaussians_ply)
    middle = np.append(arm_cm[:, :2].mean(axis=0), 0.0)
    places = gaussians.means @ matrix[:, :3].T + matrix[:, 3] - middle
    red, green, blue = np.clip(gaussians.colours, 0, 1).T
    yellow = (np.minimum(red, green) - blue > YELLOW) & (0.5 * (red + green) > BRIGHT) & (gaussians.opacities > OPAQUE)
    near = (np.hypot(*places[:, :2].T) < REACH_CM) & (places[:, 2] > -ROSETTE_CM) & (places[:, 2] < ABOVE_CM)
    foot = np.linalg.solve(matrix[:, :3], middle - matrix[:, 3])
    return largest_part(wood_places(gaussians[yellow & near], LARGER * matrix[:, :3], foot), LARGER * HANGS_TOGETHER_CM)


def largest_part(places: Float64, reach: float) -> Float64:
    """Those of (N, 3) places that hang together by steps of at most `reach`: the most."""
    near = cKDTree(places).sparse_distance_matrix(cKDTree(places), reach)
    parts = connected_components(near, directed=False)[1]
    return places[parts == np.bincount(parts).argmax()]


def paired(mine: Float64, theirs: Float64) -> tuple[float, list[tuple[int, int]]]:
    """The cheapest pairs in order: what they are apart, and `SKIPPED_CM` for each that has none."""
    cost = np.zeros((len(mine) + 1, len(theirs) + 1))
    cost[:, 0], cost[0] = SKIPPED_CM * np.arange(len(mine) + 1), SKIPPED_CM * np.arange(len(theirs) + 1)
    for i, j in np.ndindex(len(mine), len(theirs)):
        apart = cost[i, j] + abs(mine[i] - theirs[j])
        cost[i + 1, j + 1] = min(apart, SKIPPED_CM + min(cost[i, j + 1], cost[i + 1, j]))
    i, j, pairs = len(mine), len(theirs), list[tuple[int, int]]()
    while i and j:
        if np.isclose(cost[i, j], cost[i - 1, j - 1] + abs(mine[i - 1] - theirs[j - 1])):
            i, j = i - 1, j - 1
            pairs.append((i, j))
        elif np.isclose(cost[i, j], cost[i - 1, j] + SKIPPED_CM):
            i -= 1
        else:
            j -= 1
    return float(cost[-1, -1]), pairs[::-1]


def draw(places: NDArray, curves: list[Float64], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 2, figsize=(9, 12))
    for axis, side in zip(axes, "xy", strict=True):
        column = "xy".index(side)
        axis.scatter(places[:, column] / LARGER, places[:, 2] / LARGER, s=1, c="0.75")
        for curve in curves:
            axis.plot(curve[:, column] / LARGER, curve[:, 2] / LARGER, lw=1.5)
        axis.set(aspect="equal", xlabel=f"{side}, cm", ylabel="z, cm")
    figure.tight_layout()
    figure.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    places = plant_places(Workspace(folder / "runs" / "romi"), folder / "romi")
    plant_map = map_places(places, [])
    if not plant_map.axes:
        raise SystemExit(f"no map: {plant_map.reason}")
    stem = plant_map.axes[0].curve
    feet = [nearest_on(stem, axis.curve[:1])[1][0] / LARGER for axis in plant_map.branches if axis.parent == 0]
    mine = np.sort(np.array(feet, np.float64))
    internodes = 0.1 * np.array(json.loads((folder / "romi" / "measures.json").read_text())["internodes"])
    theirs = np.cumsum(np.append(0.0, internodes))
    # Where the first was measured is not known.
    _, pairs, shift = min((*paired(mine, theirs + shift), shift) for shift in np.arange(-6.0, 6.0, 0.05))
    for i, j in pairs:
        print(f"{j + 1:3d}  by hand {theirs[j]:5.1f} cm, here {mine[i] - shift:5.1f}")
    own = np.diff([mine[i] for i, _ in pairs])
    hand = np.diff([theirs[j] for _, j in pairs])
    print(f"{len(pairs)} of {len(theirs)} found, {len(mine) - len(pairs)} more; stem {length_of(stem) / LARGER:.1f} cm")
    first, second = np.triu_indices(len(pairs), 1)
    ways = np.array([[mine[pairs[b][0]] - mine[pairs[a][0]], theirs[pairs[b][1]] - theirs[pairs[a][1]]]
                     for a, b in zip(first, second, strict=True)])  # fmt: skip
    ratios = np.divide(*ways[ways[:, 1] >= FAR_CM].T)
    print(
        f"along the stem, from any found to any other at least {FAR_CM:g} cm on: {100 * (np.median(ratios) - 1):+.1f} %"
        f" in the middle; from the first to the last {own.sum():.2f} cm, by hand {hand.sum():.2f}"
    )
    print(
        f"from one found to the next: {10 * np.abs(own - hand).mean():.1f} mm off on average,"
        f" {10 * np.median(np.abs(own - hand)):.1f} in the middle; mean {10 * own.mean():.2f} mm, by hand"
        f" {10 * hand.mean():.2f}"
    )
    draw(places, [axis.curve for axis in plant_map.axes], folder / "internodes.png")


if __name__ == "__main__":
    main()
