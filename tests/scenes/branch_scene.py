# SPDX-License-Identifier: Apache-2.0
"""A plant of known tubes: stem, fruiting branches with kinks at known nodes, bolls with burs, a leaf; cm, foot at 0."""

from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from cotton3dg.core.plant_map import PlantMap
from cotton3dg.plant_map.map_plant import map_places
from cotton3dg.plant_map.wood import thinned

CLAMP_CM = 5.0


@dataclass(frozen=True)
class BranchScene:
    """Places on the surface of the wood, as trained Gaussians lie, and what is true of them."""

    places: np.ndarray
    bolls: list
    """Id, centre, diameter."""
    stem: np.ndarray
    branches: list
    """(N, 3) centre lines, from below."""
    nodes: list
    """Path lengths of the nodes of each branch."""


def line(*knots, spacing=0.1):
    """Points along straight pieces."""
    pieces = [
        np.linspace(a, b, max(2, int(np.linalg.norm(np.subtract(b, a)) / spacing)), endpoint=False)
        for a, b in pairwise(knots)
    ]
    return np.vstack([*pieces, knots[-1]])


def tube_places(curve, radius, rng, per_cm=40):
    """Places on the surface of a tube."""
    lengths = np.append(0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1)))
    at = rng.uniform(0, lengths[-1], int(per_cm * lengths[-1]))
    points = np.column_stack([np.interp(at, lengths, axis) for axis in curve.T])
    tangents = np.column_stack([np.interp(at, lengths, axis) for axis in np.gradient(curve, axis=0).T])
    across = np.cross(tangents, rng.normal(size=points.shape))
    return points + radius * across / np.linalg.norm(across, axis=1, keepdims=True)


def zigzag(foot, azimuth, rise, internodes, turn=0.35):
    """Knots of a sympodium."""
    knots = [np.asarray(foot, float)]
    for k, length in enumerate(internodes):
        heading = azimuth + turn * (-1) ** k
        step = np.array([np.cos(heading) * np.cos(rise), np.sin(heading) * np.cos(rise), np.sin(rise)])
        knots.append(knots[-1] + length * step)
    return knots


def bur_places(foot, axis, rng, diameter=4.5):
    """Carpels that spread from the foot of a boll around its lint."""
    centre = foot + 0.5 * diameter * axis
    ways = rng.normal(size=(160, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    ways = ways[ways @ axis < 0.1]
    return centre + 0.5 * diameter * ways, centre


@cache
def branch_scene():
    rng = np.random.default_rng(0)
    stem = line((0, 0, 0), (0.5, 0.2, 30), (0.3, 0.0, 60))
    feet = (20, 28, 36, 45, 52)
    internodes = [(9, 6, 4), (8, 5, 3.5), (7, 4.5), (5, 3.5), (4, 2.5)]
    branches, nodes, bolls, places = [], [], [], [tube_places(stem[stem[:, 2] > CLAMP_CM], 0.7, rng, 80)]
    bearing = {0: (0, 1), 2: (0,), 3: (0,), 4: ()}
    for number, (height, lengths) in enumerate(zip(feet, internodes, strict=True)):
        foot = stem[np.argmin(np.abs(stem[:, 2] - height))]
        knots = zigzag(foot, 2.4 * number, np.radians(40), lengths)
        # A dry tip past the last node.
        knots.append(knots[-1] + 0.8 * (knots[-1] - knots[-2]) / np.linalg.norm(knots[-1] - knots[-2]))
        branches.append(line(*knots))
        nodes.append(np.cumsum(lengths))
        places.append(tube_places(branches[-1], 0.18, rng))
        for site in bearing.get(number, ()):
            node, axis = knots[site + 1], np.array([0.2, -0.1, 1.0]) / np.linalg.norm([0.2, -0.1, 1.0])
            foot_of_boll = node + 1.6 * axis
            bur, centre = bur_places(foot_of_boll, axis, rng)
            places += [tube_places(line(node, foot_of_boll), 0.18, rng), bur]
            bolls.append((len(bolls) + 1, centre, 4.5))
    # A leaf on its stalk: a curled blade.
    stalk = line(stem[150], stem[150] + (4.0, 2.0, 0.5))
    u, v = rng.uniform(-1, 1, (2, 600))
    blade = stalk[-1] + np.column_stack([2.5 + 2.5 * u, 2.2 * v, -1.5 - 0.4 * v**2 - 0.5 * u])
    places += [tube_places(stalk, 0.12, rng, 25), blade]
    everything = np.vstack(places)
    return BranchScene(everything + rng.normal(0, 0.03, everything.shape), bolls, stem, branches, nodes)


@cache
def mapped() -> PlantMap:
    """The scene's plant map."""
    scene = branch_scene()
    return map_places(thinned(scene.places, 0.25), scene.bolls)
