# SPDX-License-Identifier: Apache-2.0
"""Scenes for training networks: a varied plant, leaves, closed bolls, and white things that are not lint.

All meshes of a scene are merged; every vertex has a class, every triangle the boll whose lint it belongs to. Metres,
z up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float64
from ..core.training_picture import CLASSES
from .distractors import draw_handling, draw_thing
from .foliage import STRAW, bracted_boll, empty_bracts, flower, lint_wisps, palmate_leaf
from .mesh import Mesh, SolidNoise, merge, rotation_to, sheet, smooth_curve, tube, unit
from .organs import LEAF, LINT_CENTRE, WOOD, Site, leaf, weather
from .plant import Branch, boll_site, fruiting_branches, peduncle, stem_curve, twig
from .varied_bolls import draw_kind, grow_boll

OTHER, LINT, BUR, WOOD_CLASS, LEAF_CLASS = range(len(CLASSES))


@dataclass(frozen=True)
class TrainingScene:
    """Everything that stands before the background."""

    mesh: Mesh
    classes: NDArray[np.uint8]
    """(V,) index into `CLASSES`."""
    boll_ids: NDArray[np.uint16]
    """(T,) boll whose lint a triangle belongs to, 1, 2, ...; 0 = none."""
    centres: Float64
    """(B, 3) m, middle of each boll's lint."""
    diameters: Float64
    """(B,) m, of a ball with the volume of the lint's bounding ellipsoid."""
    targets: Float64
    """(K, 3) m, places of interest: bolls, and things that may look like bolls."""


@dataclass(frozen=True)
class Crowd:
    """The number of bolls in a scene, and their distances."""

    bolls: int
    clustered: float
    """Share of them that stand in groups."""
    contact: float
    """Distance of the middles in a group, in diameters."""


class _Parts:
    """Meshes of a scene as they come, with their classes."""

    def __init__(self) -> None:
        self.meshes: list[Mesh] = []
        self.classes: list[int] = []
        self.bolls: list[int] = []
        self.targets: list[Float64] = []

    def add(self, mesh: Mesh, kind: int, boll: int = 0, target: bool = False) -> None:
        self.meshes.append(mesh)
        self.classes.append(kind)
        self.bolls.append(boll)
        if target:
            self.targets.append(mesh.vertices.mean(axis=0))


def build_scene(seed: int, crowd: Crowd | None = None) -> TrainingScene:
    """The scene of a seed; one in eight has no open boll.

    Args:
        crowd: None = drawn from the seed.
    """
    rng = np.random.default_rng([seed, 11])
    noise = SolidNoise(rng)
    parts = _Parts()
    count = 0 if rng.random() < 0.12 else int(rng.integers(1, 13))
    closed = int(rng.integers(1, 8)) if rng.random() < (0.9 if not count else 0.4) else 0
    clustered = rng.choice([0.0, rng.uniform(0.3, 1.0)])
    contact = rng.uniform(0.66, 0.97)
    if crowd is not None:
        count, clustered, contact = crowd.bolls, crowd.clustered, crowd.contact
    base = np.zeros(3)
    stem = stem_curve(rng, base, rng.uniform(0.25, 0.5) if count < 7 else rng.uniform(0.4, 0.8))
    branches = fruiting_branches(rng, stem, max(count + closed, 1), round(clustered * count))
    sites = _sites(rng, stem, branches, count + closed, contact)
    wood = np.array(WOOD) * rng.uniform(0.5, 2.2) * rng.uniform(0.85, 1.15, 3)
    twigs = [twig(branch.curve, 0.0034, 0.0019) for branch in branches]
    grown = merge([twig(stem, 0.0075, 0.0026, sides=16), *twigs, *(peduncle(site) for site in sites)])
    parts.add(weather(replace(grown, colours=np.tile(wood, (len(grown.vertices), 1))), noise, 0.5), WOOD_CLASS)

    open_sites = set(rng.permutation(len(sites))[:count].tolist()) if closed else set(range(len(sites)))
    kind = draw_kind(rng)
    ids = 0
    for number, site in enumerate(sites if count + closed else []):
        if number in open_sites:
            ids += 1
            boll = grow_boll(rng, noise, site, kind if rng.random() < 0.5 else draw_kind(rng))
            parts.add(boll.lint, LINT, ids, target=True)
            parts.add(boll.bur, BUR)
        else:
            pose = rotation_to(site.axis, rng.uniform(0, 2 * np.pi))
            foot = site.centre - LINT_CENTRE * site.diameter * site.axis
            closed_one = empty_bracts if rng.random() < 0.25 else bracted_boll
            parts.add(closed_one(rng, noise, site.diameter).moved(pose, foot), BUR, target=True)
    _add_foliage(parts, rng, noise, stem, branches)
    _add_wisps(parts, rng, noise, [stem, *(branch.curve for branch in branches)])
    plant = np.concatenate([mesh.vertices for mesh in parts.meshes])
    _add_things(parts, rng, noise, plant)
    return _assemble(parts, ids)


def _sites(rng: np.random.Generator, stem: Float64, branches: list[Branch], count: int, contact: float) -> list[Site]:
    """Where bolls grow; of the sizes of one plant."""
    typical = rng.uniform(0.036, 0.058)
    obstacles = np.concatenate([stem, *(branch.curve for branch in branches)])
    sites: list[Site] = []
    for branch in branches:
        neighbours: list[Site] = []
        for place in range(branch.bolls):
            if len(sites) == count:
                return sites
            diameter = float(typical * np.clip(rng.normal(1, 0.14), 0.6, 1.4))
            site = boll_site(rng, branch, place, diameter, sites, neighbours, obstacles, contact)
            sites.append(site)
            if branch.touching:
                neighbours.append(site)
    return sites


def _add_foliage(
    parts: _Parts, rng: np.random.Generator, noise: SolidNoise, stem: Float64, branches: list[Branch]
) -> None:
    """Add none to many leaves on stem and branches, curled up by drought or alive; flowers among living ones."""
    count = int(rng.choice([0, 2, 6, 16], p=[0.25, 0.3, 0.25, 0.2]) * rng.uniform(0.6, 1.5))
    alive = rng.choice([0.0, 0.5, 1.0])
    curves = [stem, *(branch.curve for branch in branches)]
    for _ in range(count):
        curve = curves[int(rng.integers(len(curves)))]
        node = curve[int(rng.uniform(0.2, 1.0) * (len(curve) - 1))]
        azimuth = rng.uniform(0, 2 * np.pi)
        out = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        foot = node + out * rng.uniform(0.02, 0.08) + (0, 0, rng.uniform(-0.01, 0.03))
        stalk = smooth_curve([node, 0.5 * (node + foot) + (0, 0, 0.008), foot], 0.004)
        parts.add(tube(stalk, np.full(len(stalk), 0.0012), np.tile(WOOD, (len(stalk), 1)), 8), WOOD_CLASS)
        pose = rotation_to(unit(out + np.array([0, 0, rng.uniform(-1.4, 0.3)])), rng.uniform(0, 2 * np.pi))
        if rng.random() < alive:
            parts.add(palmate_leaf(rng, noise).moved(pose, foot), LEAF_CLASS, target=rng.random() < 0.3)
            if rng.random() < 0.1:
                parts.add(flower(rng, noise).moved(pose, node), OTHER, target=True)
        else:
            blade = leaf(rng, noise)
            bleached = rng.beta(0.6, 2.0)
            colour = ((1 - bleached) * np.array(LEAF) + bleached * 1.4 * STRAW) * rng.uniform(0.3, 1.9)
            blade = replace(blade, colours=np.tile(colour, (len(blade.vertices), 1)))
            parts.add(weather(blade, noise, 0.4).moved(pose, foot), LEAF_CLASS, target=rng.random() < 0.2)


def _add_wisps(parts: _Parts, rng: np.random.Generator, noise: SolidNoise, curves: list[Float64]) -> None:
    """Add strands of lint on the wood, in some scenes.

    They have the class `OTHER`, because all lint is divided among bolls, and these strands belong to none.
    """
    for _ in range(int(rng.choice([0, 3, 10], p=[0.65, 0.25, 0.1]))):
        curve = curves[int(rng.integers(len(curves)))]
        node = curve[int(rng.uniform(0.2, 1.0) * (len(curve) - 1))]
        parts.add(lint_wisps(rng, noise).moved(np.eye(3), node), OTHER, target=rng.random() < 0.3)


def _add_things(parts: _Parts, rng: np.random.Generator, noise: SolidNoise, plant: Float64) -> None:
    """Add other things, most of them white, beside, before or behind the plant."""
    low, high = plant.min(axis=0), plant.max(axis=0)
    if rng.random() < 0.35:
        parts.add(_table_top(rng, noise), OTHER)
    for _ in range(int(rng.choice([0, 1, 3, 6], p=[0.4, 0.25, 0.2, 0.15]))):
        shape, colour = draw_handling(rng) if rng.random() < 0.35 else draw_thing(rng)
        angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(0.05, 0.35)
        middle = np.array([np.cos(angle) * away, np.sin(angle) * away, rng.uniform(low[2], high[2])])
        mesh = shape(rng, noise, colour).moved(
            rotation_to(rng.normal(0, 1, 3) if rng.random() < 0.5 else (0, 0, 1)), middle
        )
        # A thing inside a boll would be neither a thing nor a boll.
        if np.linalg.norm(np.array(parts.targets or [np.full(3, 9.0)]) - middle, axis=1).min() > 0.07:
            parts.add(weather(mesh, noise, rng.uniform(0, 0.15)), OTHER, target=True)


def _table_top(rng: np.random.Generator, noise: SolidNoise) -> Mesh:
    s, t = np.meshgrid(np.linspace(-0.5, 0.5, 160), np.linspace(-0.5, 0.5, 100), indexing="ij")
    surface = np.stack([1.2 * s, 0.6 * t, 0 * s - 0.002], axis=-1)
    tint = rng.uniform(0.1, 0.85) * rng.uniform(0.8, 1.0, 3)
    blotches = 1 + 0.3 * noise(surface.reshape(-1, 3), 0.08).reshape(s.shape)
    return sheet(surface, (tint * blotches[..., None]).clip(0, 0.92), 0.01)


def _assemble(parts: _Parts, bolls: int) -> TrainingScene:
    whole = merge(parts.meshes)
    counts = [len(mesh.vertices) for mesh in parts.meshes]
    faces = [len(mesh.triangles) for mesh in parts.meshes]
    lint = {number: mesh.vertices for number, mesh in zip(parts.bolls, parts.meshes, strict=True) if number}
    boxes = np.array([np.ptp(lint[number], axis=0) for number in range(1, bolls + 1)]).reshape(-1, 3)
    centres = [0.5 * (lint[n].min(axis=0) + lint[n].max(axis=0)) for n in range(1, bolls + 1)]
    targets = parts.targets or [whole.vertices.mean(axis=0)]
    return TrainingScene(
        mesh=replace(whole, colours=whole.colours.clip(0, 0.95)),
        classes=np.repeat(parts.classes, counts).astype(np.uint8),
        boll_ids=np.repeat(parts.bolls, faces).astype(np.uint16),
        centres=np.array(centres).reshape(-1, 3),
        diameters=np.cbrt(boxes.prod(axis=1)),
        targets=np.array(targets),
    )
