# SPDX-License-Identifier: Apache-2.0
"""A defoliated cotton plant, grown from a seed.

A bent stem bears fruiting branches that rise and zigzag, 3/8 of a turn apart (the phyllotaxis of Gossypium); each open
boll is 4 or 5 locks of lint over the star of its dry carpels (the bur) on a peduncle; a few dry leaves remain. On
natural plants `architecture` places the branches. Lengths are metres, z points up, z = 0 is the table top.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..command_options import SimulateOptions
from ..core.scene import Float64
from .architecture import (
    PEDUNCLE_RADII,
    STEM_RADII,
    TWIG_RADII,
    Axis,
    FruitingSite,
    grow_axes,
    swollen_radii,
)
from .mesh import Mesh, SolidNoise, merge, smooth_curve, tube, unit
from .organs import LINT_CENTRE, WOOD, Boll, Site, dry_leaves, open_boll, weather
from .varied_bolls import draw_kind, grow_boll


@dataclass(frozen=True)
class PlantMeshes:
    """All meshes of one plant; boll ids are 1, 2, ... in the order of `bolls`."""

    wood: Mesh
    """Stem, branches, peduncles and petioles."""
    leaves: Mesh
    bolls: tuple[Boll, ...]
    stem_base: Float64
    """(3,) where the stem meets the table."""
    axes: tuple[Axis, ...]
    """The stem, the branches, then the peduncle of each boll, in the order of `bolls`."""
    positions: tuple[int | None, ...]
    """Fruiting position of each boll, 1 next to the stem; None on a simple plant (it bears where cotton would not)."""

    @property
    def parts(self) -> list[Mesh]:
        """Every mesh: wood, leaves, then lint and bur of boll 1, of boll 2, ..."""
        return [self.wood, self.leaves, *(mesh for boll in self.bolls for mesh in (boll.lint, boll.bur))]

    @property
    def vertices(self) -> Float64:
        """(V, 3) of all meshes."""
        return np.concatenate([mesh.vertices for mesh in self.parts])


@dataclass(frozen=True)
class Branch:
    curve: Float64
    bolls: int
    touching: bool


def grow_plant(options: SimulateOptions) -> PlantMeshes:
    """The plant of a seed.

    Args:
        options: `seed`, `bolls` (0 = 8 to 20, drawn), `clustered`, the share of the bolls that touch others near
            the top, `contact`, how close these are, `stem_cm` (0 = 56 to 80, drawn), changes of the plant: `picked`,
            `turned_deg`; `boll_kind`, `hanging`.
    """
    rng = np.random.default_rng([options.seed, 1])
    noise = SolidNoise(rng)
    count = options.bolls or int(rng.integers(8, 21))
    diameters = np.clip(rng.normal(0.047, 0.007, count), 0.034, 0.062)
    base = np.append(rng.uniform(-0.04, 0.04, 2), 0.0)
    drawn = rng.uniform(0.56, 0.80)
    grow = _natural_plant if options.architecture == "natural" else _simple_plant
    grown = grow(rng, base, options.stem_cm / 100 or drawn, diameters, options)
    leaves, petioles = dry_leaves(rng, noise, grown.axes[0].curve)
    stalks = [peduncle_axis(site, owner) for site, owner in zip(grown.sites, grown.owners, strict=True)]
    stem, *twigs = [wood_of(axis, 12 if number else 24) for number, axis in enumerate(grown.axes)]
    wood = merge([stem, *grown.stubs, *twigs, *(wood_of(stalk, 10) for stalk in stalks), *petioles])
    roots = wood.vertices[:, 2].clip(min=0)
    wood = weather(replace(wood, vertices=np.column_stack([wood.vertices[:, :2], roots])), noise, 0.5)
    plant = PlantMeshes(
        wood,
        weather(leaves, noise, 0.45),
        _bolls(rng, noise, grown.sites, options),
        base,
        (*grown.axes, *stalks),
        tuple(grown.positions),
    )
    return _turned(_picked(plant, options.picked), np.deg2rad(options.turned_deg))


def _bolls(
    rng: np.random.Generator, noise: SolidNoise, sites: list[Site], options: SimulateOptions
) -> tuple[Boll, ...]:
    """One boll at each site, of the kind that the plant bears; the rest of the plant is the same with any kind.

    The number, roundness and distance of separate locks differ from boll to boll.
    """
    if options.boll_kind == "plain":
        return tuple(open_boll(rng, noise, site) for site in sites)
    of_kind = np.random.default_rng([options.seed, 7])
    if options.boll_kind == "separate":
        drawn = (draw_kind(of_kind, "separate", options.hanging) for _ in sites)
        return tuple(grow_boll(of_kind, noise, site, kind) for site, kind in zip(sites, drawn, strict=True))
    kind = draw_kind(of_kind, options.boll_kind)
    return tuple(grow_boll(of_kind, noise, site, kind) for site in sites)


def _picked(plant: PlantMeshes, n: int) -> PlantMeshes:
    """The plant without its last n bolls; their stalks stay as wood, but are not peduncles of bolls."""
    left = max(len(plant.bolls) - n, 0)
    axes = plant.axes[: len(plant.axes) - len(plant.bolls) + left]
    return replace(plant, bolls=plant.bolls[:left], axes=axes, positions=plant.positions[:left])


def _turned(plant: PlantMeshes, angle: float) -> PlantMeshes:
    """The plant turned about the vertical through its foot, counter-clockwise seen from above, rad."""
    if not angle:
        return plant
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    stays = plant.stem_base - plant.stem_base @ rotation.T

    def turned(mesh: Mesh) -> Mesh:
        return replace(mesh, vertices=mesh.vertices @ rotation.T + stays)

    return replace(
        plant,
        wood=turned(plant.wood),
        leaves=turned(plant.leaves),
        bolls=tuple(Boll(turned(boll.lint), turned(boll.bur)) for boll in plant.bolls),
        axes=tuple(replace(axis, curve=axis.curve @ rotation.T + stays) for axis in plant.axes),
    )


@dataclass(frozen=True)
class _Grown:
    """A plant without leaves and bolls."""

    axes: list[Axis]
    sites: list[Site]
    owners: list[int]
    """Axis of each site."""
    positions: list[int | None]
    """Fruiting position of each site."""
    stubs: list[Mesh]
    """Wood that is not an axis of its own."""


def _simple_plant(
    rng: np.random.Generator, base: Float64, height: float, diameters: Float64, options: SimulateOptions
) -> _Grown:
    """A branch for each boll or two; the first of the bearers is the stem's own tip."""
    stem = stem_curve(rng, base, height)
    branches = fruiting_branches(rng, stem, len(diameters), round(options.clustered * len(diameters)))
    obstacles = np.concatenate([stem, *(branch.curve for branch in branches)])
    sites: list[Site] = []
    owners: list[int] = []
    for number, branch in enumerate(branches):
        neighbours: list[Site] = []
        for place in range(branch.bolls):
            diameter = float(diameters[len(sites)])
            site = boll_site(rng, branch, place, diameter, sites, neighbours, obstacles, options.contact)
            sites.append(site)
            owners.append(number)
            if branch.touching:
                neighbours.append(site)
    axes = [Axis("stem", None, stem, swollen_radii(len(stem), *STEM_RADII))]
    for branch in branches[1:]:
        radii = swollen_radii(len(branch.curve), *TWIG_RADII)
        axes.append(Axis("fruiting", 0, branch.curve, radii))
    stubs = [twig(branch.curve, *TWIG_RADII) for branch in branches[:1]]
    return _Grown(axes, sites, owners, [None] * len(sites), stubs)


def _natural_plant(
    rng: np.random.Generator, base: Float64, height: float, diameters: Float64, options: SimulateOptions
) -> _Grown:
    """A branch at every node, with bolls at some of its sites; bolls hang clear of each other and of the wood."""
    axes, kept = grow_axes(rng, base, height, len(diameters), options)
    obstacles = np.concatenate([axis.curve for axis in axes])
    sites: list[Site] = []
    for site, diameter in zip(kept, diameters, strict=False):
        sites.append(free_site(rng, site.node, site.along, float(diameter), sites, [], obstacles))
    stubs = _scars(rng, axes, kept)
    return _Grown(axes, sites, [site.axis for site in kept], [site.position for site in kept], stubs)


def _scars(rng: np.random.Generator, axes: list[Axis], kept: list[FruitingSite]) -> list[Mesh]:
    """Stubs of some millimetres where sites lost their bolls."""
    taken = {(site.axis, site.position) for site in kept}
    stubs = []
    for number, axis in enumerate(axes):
        for position, node in enumerate(axis.nodes if axis.kind == "fruiting" else (), start=1):
            if (number, position) not in taken:
                foot = axis.at(node)
                tip = foot + unit(rng.normal(0, 1, 3) + (0, 0, 0.7)) * rng.uniform(0.003, 0.006)
                curve = smooth_curve([foot, tip], 0.002)
                stubs.append(tube(curve, np.full(len(curve), 0.0012), np.tile(WOOD, (len(curve), 1)), 8))
    return stubs


def stem_curve(rng: np.random.Generator, base: Float64, height: float) -> Float64:
    """A slightly bent, slightly zigzagging curve; its knots are the nodes, 4 to 5 cm apart."""
    nodes = round(height / 0.045)
    up = np.linspace(0, 1, nodes + 1)
    lean, bow = rng.normal(0, 0.02, 2), rng.normal(0, 0.018, 2)
    sideways = up[:, None] ** 2 * lean + np.sin(np.pi * up)[:, None] * bow
    sideways[1:] += rng.normal(0, 0.0012, (nodes, 2))
    return smooth_curve(base + np.column_stack([sideways, up * height]), 0.004)


def fruiting_branches(rng: np.random.Generator, stem: Float64, count: int, clustered: int) -> list[Branch]:
    """The stem's tip and fruiting branches that bear `count` bolls, `clustered` of them in touching groups on top."""
    groups: list[int] = []
    while sum(groups) < clustered:
        groups.append(int(rng.integers(2, 5)))
    if groups:
        groups[-1] = max(2, groups[-1] - (sum(groups) - clustered))
    singles = max(count - sum(groups), 0)
    if sum(groups) > count:
        groups[-1] -= sum(groups) - count
    loads: list[int] = []
    while sum(loads) < singles:
        loads.append(min(2 if rng.random() < 0.3 else 1, singles - sum(loads)))

    turn = rng.uniform(0, 2 * np.pi)
    bearers = [(load, False) for load in loads] + [(group, True) for group in groups]
    heights = np.linspace(0.30, 0.97, max(len(bearers) - 1, 1)) + rng.uniform(-0.015, 0.015, max(len(bearers) - 1, 1))
    branches = [Branch(stem[-12:], *bearers[-1])] if bearers else []
    for order, (height, (load, touching)) in enumerate(zip(heights, bearers[:-1], strict=False)):
        node = stem[round(min(height, 0.99) * (len(stem) - 1))]
        azimuth = turn + order * 2 * np.pi * 3 / 8 + rng.normal(0, 0.25)
        length = (0.26 - 0.19 * height) * rng.uniform(0.75, 1.2) * (1.25 if load > 1 else 1.0)
        branches.append(Branch(_branch_curve(rng, node, azimuth, length), load, touching))
    return branches


def _branch_curve(rng: np.random.Generator, node: Float64, azimuth: float, length: float) -> Float64:
    """(N, 3) m. Sympodial growth: every internode of about 5 cm turns to the other side; the branch rises, then
    flattens."""
    internodes = max(2, round(length / 0.05))
    rise = np.deg2rad(rng.uniform(32, 58))
    side = rng.choice([-1, 1])
    points = [node]
    for k in range(internodes):
        heading = azimuth + side * (-1) ** k * rng.uniform(0.12, 0.30)
        slope = rise * (1 - 0.25 * k / internodes)
        step = np.array([np.cos(heading) * np.cos(slope), np.sin(heading) * np.cos(slope), np.sin(slope)])
        points.append(points[-1] + step * length / internodes)
    return smooth_curve(points, 0.004)


def boll_site(
    rng: np.random.Generator,
    branch: Branch,
    place: int,
    diameter: float,
    sites: list[Site],
    neighbours: list[Site],
    obstacles: Float64,
    contact: float = 0.90,
) -> Site:
    """A free place at the branch's tip (or, for a second boll, half way along it)."""
    at_tip = place == 0 or branch.touching
    node = branch.curve[-1 if at_tip else len(branch.curve) // 2]
    along = unit(branch.curve[-1] - branch.curve[-4])
    return free_site(rng, node, along, diameter, sites, neighbours, obstacles, contact)


def free_site(
    rng: np.random.Generator,
    node: Float64,
    along: Float64,
    diameter: float,
    sites: list[Site],
    neighbours: list[Site],
    obstacles: Float64,
    contact: float = 0.90,
) -> Site:
    """The best of 300 random places beside a node.

    A good place keeps the boll clear of the others (or, in a cluster, just touching a neighbour) and of the wood.

    Args:
        along: (3,) unit vector, the way out.
        contact: least distance of the centres of touching bolls, in their mean diameter.
    """
    tries = 300
    directions = unit(along + np.array([0, 0, 0.25]) + rng.normal(0, 0.45, (tries, 3)))
    gaps = np.full(len(sites), 1.12)
    if neighbours:
        beside = neighbours[int(rng.integers(len(neighbours)))]
        reach = 0.5 * (diameter + beside.diameter) * rng.uniform(contact, 0.97, (tries, 1))
        centres = beside.centre + reach * unit(rng.normal(0, 1, (tries, 3)) + 0.4 * along)
        gaps[[i for i, site in enumerate(sites) if any(site is other for other in neighbours)]] = contact
    else:
        centres = node + directions * (LINT_CENTRE * diameter + rng.uniform(0.012, 0.03, (tries, 1)))

    lengths = np.linalg.norm(centres - node, axis=1) - LINT_CENTRE * diameter
    badness = np.maximum(0.010 - lengths, 0) + 0.1 * np.maximum(lengths - 0.03, 0)
    for site, gap in zip(sites, gaps, strict=True):
        wanted = gap * 0.5 * (diameter + site.diameter)
        badness += np.maximum(wanted - np.linalg.norm(centres - site.centre, axis=1), 0)
    far = obstacles[np.linalg.norm(obstacles - node, axis=1) > 0.03]
    closest = np.linalg.norm(centres[:, None] - far[None, ::2], axis=2).min(axis=1)
    badness += np.maximum(0.55 * diameter - closest, 0)
    best = int(np.argmin(badness))
    axis = unit(unit(centres[best] - node) + rng.normal(0, 0.12, 3))
    return Site(node, centres[best], axis, diameter)


def twig(curve: Float64, thick: float, thin: float, sides: int = 12) -> Mesh:
    """A tapered branch, swollen at its foot."""
    return tube(curve, swollen_radii(len(curve), thick, thin), np.tile(WOOD, (len(curve), 1)), sides)


def wood_of(axis: Axis, sides: int) -> Mesh:
    return tube(axis.curve, axis.radii, np.tile(WOOD, (len(axis.curve), 1)), sides)


def peduncle(site: Site) -> Mesh:
    return wood_of(peduncle_axis(site, 0), 10)


def peduncle_axis(site: Site, parent: int) -> Axis:
    """The stalk from a node to the foot of its boll's bur."""
    foot = site.centre - site.axis * LINT_CENTRE * site.diameter
    bend = 0.5 * (site.node + foot) - 0.15 * np.linalg.norm(foot - site.node) * site.axis
    curve = smooth_curve([site.node, bend, foot], 0.003)
    return Axis("peduncle", parent, curve, np.linspace(*PEDUNCLE_RADII, len(curve)))
