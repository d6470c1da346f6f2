# SPDX-License-Identifier: Apache-2.0
"""The axes of a plant: stem, branches and peduncles, as breeders map them.

A simple plant has a branch for each boll or two (`plant.fruiting_branches`). A natural one is grown here node by node:
vegetative branches (monopodia) low on the stem, above them a fruiting branch (sympodium) at every node, whose
internodes shorten outwards and upwards and whose sites keep or lose their boll. Lengths are metres, z points up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from ..command_options import SimulateOptions
from ..core.scene import Float64
from .mesh import smooth_curve, unit

Kind = Literal["stem", "fruiting", "vegetative", "peduncle"]
STEM_RADII: Final = (0.0075, 0.0026)
TWIG_RADII: Final = (0.0034, 0.0019)
PEDUNCLE_RADII: Final = (0.0017, 0.0026)
PHYLLOTAXIS: Final = 2 * np.pi * 3 / 8
"""Turn from a node to the next in Gossypium."""
THINNEST: Final = 0.00075
RETENTION: Final = (1.0, 0.55, 0.3, 0.2)
"""Probability that a site keeps its boll, relative to a first position (COTMAP: these bear two thirds to three
quarters)."""
INTERNODE: Final = 0.045
CROSSING: Final = 0.66
"""Place at which a branch touches another, as a share of its length."""
TURNS: Final = 200
"""Steps of a turn until branches touch."""


@dataclass(frozen=True)
class Axis:
    """One stretch of wood: a stem, a branch or a peduncle."""

    kind: Kind
    parent: int | None
    """Index of the axis on which it grows; None for the stem."""
    curve: Float64
    """(N, 3) m, from its foot on the parent's centre line."""
    radii: Float64
    """(N,) m."""
    nodes: tuple[float, ...] = ()
    """Path lengths from its foot at which something grows or grew: branches, bolls, scars, m."""

    @property
    def stations(self) -> Float64:
        """(N,) path length of each point of the curve from the foot, m."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.curve, axis=0), axis=1))])

    def at(self, station: float) -> Float64:
        """(3,) the place at a path length from the foot."""
        return np.array([np.interp(station, self.stations, axis) for axis in self.curve.T])


@dataclass(frozen=True)
class FruitingSite:
    """Where a boll grows or might have grown."""

    axis: int
    """Index of the branch."""
    position: int
    """1 next to the stem, 2, ... outwards."""
    node: Float64
    along: Float64
    """(3,) unit vector outwards along the branch."""


def swollen_radii(n: int, thick: float, thin: float) -> Float64:
    """(n,) radii of a tapered branch, swollen at its foot."""
    s = np.linspace(0, 1, n)
    return thick + (thin - thick) * s + 0.35 * thin * np.exp(-s * n / 3)


def grow_axes(
    rng: np.random.Generator, base: Float64, height: float, bolls: int, options: SimulateOptions
) -> tuple[list[Axis], list[FruitingSite]]:
    """Stem and branches of a natural plant, and the sites that keep a boll, from below.

    Args:
        bolls: as many sites are kept, unless there are fewer.
        options: `vegetative`, `barren`, `broken`, `crossing` and `lean`.
    """
    stem = _stem(rng, base, height, np.deg2rad(options.lean))
    axes, sites = [stem], list[FruitingSite]()
    turn = rng.uniform(0, 2 * np.pi)
    first = int(rng.integers(5, 8))
    low = sorted(rng.permutation(np.arange(1, first))[: options.vegetative].tolist())
    for node, station in enumerate(stem.nodes):
        azimuth = turn + node * PHYLLOTAXIS + rng.normal(0, 0.2)
        if node in low:
            _add_vegetative(rng, axes, sites, station, azimuth)
        elif node >= first and station < 0.97 * stem.stations[-1]:
            up = (station - stem.nodes[first]) / (stem.stations[-1] - stem.nodes[first])
            _add_fruiting(rng, axes, sites, 0, station, azimuth, up, rng.random() < options.broken)
    crossed: set[int] = set()
    for _ in range(options.crossing):
        _cross(axes, sites, crossed)
    return axes, _kept(rng, axes, sites, bolls, options.barren)


def _stem(rng: np.random.Generator, base: Float64, height: float, lean: float) -> Axis:
    """Leans at its foot and rights itself by half; its knots are the nodes."""
    nodes = round(height / INTERNODE)
    up = np.cumsum(np.append(0.0, rng.uniform(0.75, 1.25, nodes)))
    up /= up[-1]
    azimuth, bow = rng.uniform(0, 2 * np.pi), rng.normal(0, 0.018, 2)
    out = np.tan(lean) * height * (up - 0.25 * up**2)
    sideways = out[:, None] * np.array([np.cos(azimuth), np.sin(azimuth)]) + np.sin(np.pi * up)[:, None] * bow
    sideways[1:] += rng.normal(0, 0.0015, (nodes, 2))
    knots = base + np.column_stack([sideways, up * height])
    curve = smooth_curve(knots, 0.004)
    return Axis("stem", None, curve, swollen_radii(len(curve), *STEM_RADII), stations_of(curve, knots[1:]))


def _add_fruiting(
    rng: np.random.Generator,
    axes: list[Axis],
    sites: list[FruitingSite],
    parent: int,
    station: float,
    azimuth: float,
    up: float,
    broken: bool,
) -> None:
    """A sympodium: every internode turns to the other side of the way out.

    Args:
        up: 0 at the lowest fruiting branch, 1 at the parent's tip.
    """
    count = int(np.clip(round(rng.normal(3.6 - 2.4 * up, 0.6)), 1, 4))
    internode = (0.095 - 0.06 * up) * rng.uniform(0.8, 1.2)
    rise, side = np.deg2rad(rng.uniform(20, 50)), rng.choice([-1, 1])
    foot = axes[parent].at(station)
    knots = [foot]
    for k in range(count + 1):
        heading = azimuth + side * (-1) ** k * rng.uniform(0.16, 0.36)
        slope = rise * (1 - 0.3 * k / (count + 1)) + rng.normal(0, 0.05)
        step = np.array([np.cos(heading) * np.cos(slope), np.sin(heading) * np.cos(slope), np.sin(slope)])
        # Past the last site a dry tip remains.
        knots.append(knots[-1] + step * (internode if k < count else rng.uniform(0.004, 0.018)))
        internode *= rng.uniform(0.6, 0.8)
    curve = smooth_curve(knots, 0.004)
    nodes = stations_of(curve, np.array(knots[1:-1]))
    thick = 0.0021 + 0.0012 * (1 - up) * rng.uniform(0.7, 1.2)
    if broken:
        end = rng.uniform(0.45, 0.85) * _length(curve)
        curve = curve[: max(3, int(np.searchsorted(Axis("fruiting", 0, curve, curve[:, 0]).stations, end)))]
        nodes = tuple(node for node in nodes if node < _length(curve))
    axes.append(Axis("fruiting", parent, curve, swollen_radii(len(curve), thick, THINNEST), nodes))
    for position, node in enumerate(nodes, start=1):
        row = int(np.argmin(np.abs(axes[-1].stations - node)))
        along = unit(curve[min(row + 1, len(curve) - 1)] - curve[max(row - 2, 0)])
        sites.append(FruitingSite(len(axes) - 1, position, axes[-1].at(node), along))


def _add_vegetative(
    rng: np.random.Generator, axes: list[Axis], sites: list[FruitingSite], station: float, azimuth: float
) -> None:
    """A monopodium: it leaves the stem at a wide angle, grows upright and bears fruiting branches of its own."""
    length = rng.uniform(0.22, 0.40)
    slopes = np.deg2rad(np.linspace(rng.uniform(25, 45), rng.uniform(60, 80), max(4, round(length / INTERNODE))))
    headings = azimuth + rng.normal(0, 0.06, len(slopes))
    steps = np.column_stack([np.cos(headings) * np.cos(slopes), np.sin(headings) * np.cos(slopes), np.sin(slopes)])
    knots = axes[0].at(station) + np.vstack([np.zeros(3), np.cumsum(steps, axis=0) * length / len(slopes)])
    curve = smooth_curve(knots, 0.004)
    own = len(axes)
    radii = swollen_radii(len(curve), rng.uniform(0.0032, 0.0045), 0.0011)
    axes.append(Axis("vegetative", 0, curve, radii, stations_of(curve, knots[1:-1])))
    for number, node in enumerate(axes[own].nodes):
        if number >= 1 and rng.random() < 0.6:
            outwards = azimuth + rng.choice([-1, 1]) * rng.uniform(0.6, 1.6)
            _add_fruiting(rng, axes, sites, own, node, outwards, 0.55 + 0.4 * node / _length(curve), False)


def _cross(axes: list[Axis], sites: list[FruitingSite], crossed: set[int]) -> None:
    """Turn a fruiting branch about its foot until it touches another. The pair is the one with the least turn at which
    wood does not pass through wood.

    Args:
        crossed: branches that already touch another; both of the pair are added.
    """
    turns: list[tuple[float, int, int, Float64]] = []
    free = [i for i, axis in enumerate(axes) if axis.kind == "fruiting" and i not in crossed]
    for bent in (i for i in free if _length(axes[i].curve) > 0.08):
        curve = axes[bent].curve
        reach = curve[round(CROSSING * (len(curve) - 1))] - curve[0]
        for other in (i for i in free if i != bent):
            ways = axes[other].curve[len(axes[other].curve) // 3 :] - curve[0]
            row = int(np.argmin(np.abs(np.linalg.norm(ways, axis=1) - np.linalg.norm(reach))))
            touching = axes[bent].radii[-1] + axes[other].radii[-1]
            if abs(np.linalg.norm(ways[row]) - np.linalg.norm(reach)) > 2 * touching:
                continue
            turn = float(np.arccos(np.clip(unit(ways[row]) @ unit(reach), -1, 1)))
            turns.append((turn, bent, other, unit(np.cross(unit(reach), unit(ways[row])))))
    for turn, bent, other, normal in sorted(turns, key=lambda found: found[:3]):
        branch, rotation = _touching(axes[bent], axes[other], turn, normal)
        if rotation is not None and not _passes_through(branch, axes[bent], [a for a in axes if a is not axes[bent]]):
            break
    else:
        return
    crossed |= {bent, other}
    axes[bent] = branch
    foot = branch.curve[0]
    for number, site in enumerate(sites):
        if site.axis == bent:
            sites[number] = replace(site, node=foot + rotation @ (site.node - foot), along=rotation @ site.along)


def _touching(branch: Axis, other: Axis, turn: float, normal: Float64) -> tuple[Axis, Float64 | None]:
    """The branch turned about its foot until it touches another, and the rotation; None if it never does.

    Args:
        turn: angle at which it would reach into the other's middle.
    """

    def turned(angle: float) -> tuple[Axis, Float64]:
        rotation = Rotation.from_rotvec(normal * angle).as_matrix()
        return replace(branch, curve=branch.curve[0] + (branch.curve - branch.curve[0]) @ rotation.T), rotation

    angles = np.linspace(0, turn, TURNS)
    inside = [_gap(turned(angle)[0], other) < 0 for angle in angles]
    if inside[0] or not any(inside):
        return branch, None
    return turned(angles[inside.index(True) - 1])


def _passes_through(branch: Axis, before: Axis, others: list[Axis]) -> bool:
    """Whether the wood of a turned branch reaches into other wood more than it did before."""
    return any(_gap(branch, other) < min(_gap(before, other), 0.0) for other in others)


def _gap(branch: Axis, other: Axis) -> float:
    """Least distance between the bark of two axes, m, without the first two centimetres of the branch; below 0 they
    reach into each other."""
    outer = branch.stations > 0.02
    between = cdist(branch.curve[outer], other.curve) - branch.radii[outer, None] - other.radii
    return float(between.min(initial=np.inf))


def _kept(
    rng: np.random.Generator, axes: list[Axis], sites: list[FruitingSite], bolls: int, barren: float
) -> list[FruitingSite]:
    """The sites that keep a boll: none on a share of the branches, first positions before others."""
    fruiting = [i for i, axis in enumerate(axes) if axis.kind == "fruiting"]
    empty = set(rng.permutation(fruiting)[: round(barren * len(fruiting))].tolist())
    open_sites = [site for site in sites if site.axis not in empty]
    weights = np.array([RETENTION[site.position - 1] for site in open_sites])
    # Drawing without replacement by exponential keys (Efraimidis and Spirakis 2006).
    keys = rng.exponential(1.0, len(open_sites)) / weights
    return [open_sites[i] for i in sorted(np.argsort(keys, kind="stable")[:bolls].tolist())]


def stations_of(curve: Float64, knots: Float64) -> tuple[float, ...]:
    """Path length from the curve's start to its point nearest to each knot."""
    stations = Axis("stem", None, curve, curve[:, 0]).stations
    return tuple(float(stations[row]) for row in cdist(knots, curve).argmin(axis=1))


def _length(curve: Float64) -> float:
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())
