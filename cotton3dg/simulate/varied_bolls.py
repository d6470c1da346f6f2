# SPDX-License-Identifier: Apache-2.0
"""Open bolls of every kind that plants bear: with separate locks, tight, fluffy, drooping, torn by storms, half open,
yellowed, dirty.

Networks learn from plants on which many bolls are of another kind than their neighbours; a plant of `simulate` bears
one kind if an option names it. Lengths are metres; a boll's frame has z along its axis and its foot at the origin.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..core.scene import Float64
from .mesh import Mesh, SolidNoise, icosphere, merge, rotation_to, unit
from .organs import LINT, LINT_CENTRE, Boll, Site, carpel, cup, weather


@dataclass(frozen=True)
class BollKind:
    """The common properties of the locks of one boll; lengths in its diameters."""

    locks: int
    width: float
    """Half-width of a lock."""
    length: float
    """Half-length of a lock."""
    spread: float
    """Distance of the locks from the axis."""
    lean: float
    """rad by which locks lean outwards."""
    droop: float
    """How far the locks' ends are drawn down."""
    hang: float
    """0 = the locks stand, 1 = they hang from where they grow."""
    puff: float
    fray: float
    lint: tuple[float, float, float]
    """Linear RGB albedo."""
    trash: float
    """Share of the lint under bits of leaf."""
    openness: float
    """1 = the carpels lie flat, 0 = they stand up around the lint."""
    rise: float = LINT_CENTRE
    """Height of the locks' middles over the foot of the bur."""
    loose: float = 0.0
    """Share of the locks that hang out of a boll whose others stand."""
    apart: bool = False
    """Whether the carpels' points stand between the locks; else they are behind them."""


KINDS: Final = {
    "separate": 0.37,
    "usual": 0.2,
    "tight": 0.06,
    "fluffy": 0.13,
    "drooping": 0.08,
    "hanging": 0.08,
    "torn": 0.04,
    "half_open": 0.04,
}
"""How often each kind is drawn."""


def draw_kind(rng: np.random.Generator, name: str | None = None, hanging: float = 0.25) -> BollKind:
    """A kind at random, common ones most often; with a name, one of the many variants with this name.

    Args:
        hanging: share of the kinds with separate locks that let some locks hang.
    """
    name = name or str(rng.choice(list(KINDS), p=list(KINDS.values())))
    width, length, spread, lean = 0.245, 0.345, 0.235, rng.uniform(0.15, 0.40)
    droop, hang, puff, fray, openness = 0.0, 0.0, 0.28, 1.0, rng.uniform(0.6, 1.0)
    if name == "tight":
        width, length, spread, lean, puff = 0.22, 0.33, 0.2, rng.uniform(0.0, 0.15), 0.15
    elif name == "fluffy":
        width, length, spread, lean = rng.uniform(0.29, 0.36), rng.uniform(0.36, 0.46), 0.22, rng.uniform(0.1, 0.5)
        puff, fray = rng.uniform(0.2, 0.5), rng.uniform(1, 2.5)
    elif name == "drooping":
        droop, puff, fray = rng.uniform(0.3, 2.2), rng.uniform(0.2, 0.45), rng.uniform(1, 2.5)
        width, length = rng.uniform(0.24, 0.32), rng.uniform(0.36, 0.6)
    elif name == "hanging":
        hang, droop, spread = rng.uniform(0.4, 1.0), rng.uniform(0, 0.5), rng.uniform(0.1, 0.2)
        width, length = rng.uniform(0.22, 0.32), rng.uniform(0.45, 0.9)
    elif name == "torn":
        droop, puff, fray = rng.uniform(0.0, 1.2), rng.uniform(0.3, 0.7), rng.uniform(2, 4)
        spread, lean = rng.uniform(0.2, 0.4), rng.uniform(0.2, 0.9)
    elif name == "half_open":
        width, length, spread, lean = 0.19, 0.28, 0.17, 0.05
        openness = rng.uniform(0.0, 0.4)
    cream, dull = rng.beta(1.2, 4), rng.beta(1.2, 5)
    lint = np.array(LINT) * rng.uniform(0.92, 1.1) * (1 - 0.45 * dull) * (1, 1 - 0.10 * cream, 1 - 0.35 * cream)
    kind = BollKind(
        locks=int(rng.choice([3, 4, 5], p=[0.12, 0.55, 0.33])),
        width=width * rng.uniform(0.9, 1.1),
        length=length * rng.uniform(0.9, 1.1),
        spread=spread * rng.uniform(0.85, 1.15),
        lean=lean,
        droop=droop,
        hang=hang,
        puff=puff * rng.uniform(0.2, 1.3),
        fray=fray * rng.uniform(0.1, 1.4),
        lint=(float(lint[0]), float(lint[1]), float(lint[2])),
        trash=float(rng.choice([0, 0.005, 0.02, 0.08], p=[0.6, 0.22, 0.12, 0.06])),
        openness=openness,
    )
    return _set_apart(rng, kind, hanging) if name == "separate" else kind


def _set_apart(rng: np.random.Generator, kind: BollKind, hanging: float) -> BollKind:
    """The kind with a gap between its locks; roundness, length and opening of the locks are drawn.

    Locks that lean outwards come nearest below their middles: ellipsoids of half-width w and half-length l, their
    middles s from the boll's axis, touch where w = sqrt(s^2 - (l sin(lean))^2) sin(pi / locks).
    """
    gap, half_turn = rng.uniform(0.9, 1.6), np.sin(np.pi / kind.locks)
    openness = rng.beta(1.6, 0.9)
    # Fully open, the locks end a little beyond the boll's own radius.
    spread = 0.61 / (1 + half_turn / gap) * (0.7 + 0.3 * openness)
    width = spread * half_turn / gap * rng.uniform(0.75, 1.0)
    length = width * (1 + 1.2 * rng.beta(0.9, 1.8))
    lean = np.arcsin(min(np.sin(rng.uniform(0.3, 1.1) * openness), 0.6 * spread / length))
    torn, hangs = rng.random() < 0.15, rng.random() < hanging
    return replace(
        kind,
        width=width * float(np.sqrt(1 - (length * np.sin(lean) / spread) ** 2)),
        length=length,
        spread=spread,
        lean=float(lean),
        fray=rng.uniform(2, 4) if torn else kind.fray,
        openness=openness,
        rise=0.12 + length * float(np.cos(lean)),
        loose=rng.uniform(0.2, 0.8) if hangs else 0.0,
        apart=True,
    )


def grow_boll(rng: np.random.Generator, noise: SolidNoise, site: Site, kind: BollKind) -> Boll:
    """Lint and bur of a boll at its site."""
    d = site.diameter
    pose = rotation_to(site.axis, rng.uniform(0, 2 * np.pi))
    foot = site.centre - site.axis * LINT_CENTRE * d
    down = pose.T @ (0.0, 0.0, -1.0)
    angles = 2 * np.pi * (np.arange(kind.locks) + rng.normal(0, 0.08, kind.locks)) / kind.locks
    torn_off = rng.random(kind.locks) < 0.06
    if torn_off.all():
        torn_off[0] = False
    left = angles[~torn_off]
    locks = [_lock(rng, noise, angle, d, _hung(rng, kind) if kind.loose else kind, down) for angle in left]
    lint = merge(locks).moved(pose, foot)
    points = angles + np.pi / kind.locks if kind.apart else angles
    carpels = [_raise(carpel(rng, angle, d), kind.openness, angle, d) for angle in points]
    bur = merge([cup(d), *carpels]).moved(pose, foot)
    bur = replace(bur, colours=(bur.colours * rng.uniform(0.5, 1.8) * rng.uniform(0.85, 1.15, 3)).clip(0, 0.7))
    return Boll(_soil(rng, noise, weather(lint, noise, 0.05), kind.trash), weather(bur, noise, 0.5))


def _hung(rng: np.random.Generator, kind: BollKind) -> BollKind:
    """The kind of one lock of a boll that lets some hang: drawn out and down, or as the others."""
    if rng.random() > kind.loose:
        return kind
    return replace(
        kind, hang=rng.uniform(0.5, 1.0), length=kind.length * rng.uniform(1.1, 1.7), droop=rng.uniform(0, 0.3)
    )


def _lock(rng: np.random.Generator, noise: SolidNoise, angle: float, d: float, kind: BollKind, down: Float64) -> Mesh:
    """One lock: a frayed ellipsoid whose upper part, where it droops, follows a curve towards the ground."""
    sphere, triangles = icosphere(4)
    half = np.array([kind.width, kind.width * rng.uniform(0.85, 1.1), kind.length]) * d * rng.uniform(0.88, 1.12, 3)
    where = sphere * half + rng.uniform(0, 1, 3)
    puffs = np.abs(noise(where, 0.42 * d))
    fray = kind.fray * (0.035 * noise(where, 0.11 * d) + 0.022 * noise(where, 0.045 * d))
    shape = sphere * half * (0.92 + kind.puff * (puffs - 0.08) + fray)[:, None]
    cos, sin = np.cos(angle), np.sin(angle)
    about = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    stands = unit(np.array([np.sin(kind.lean + rng.normal(0, 0.08)), 0, 1]))
    axis = unit((1 - kind.hang) * stands + kind.hang * (about @ down) + (1e-3, 0, 0))
    middle = np.array([kind.spread * d, 0, kind.rise * d * rng.uniform(0.94, 1.08)])
    middle += kind.hang * max(half[2] - 0.25 * d, 0) * axis
    shape = (shape @ rotation_to(axis).T + middle) @ about
    if kind.droop:
        # The end that is farthest along gravity and outwards hangs: it moves down by the square of how far it is.
        outwards = unit(down + 0.6 * np.array([cos, sin, 0.0]) + rng.normal(0, 0.2, 3))
        reach = shape @ outwards
        reach = ((reach - reach.min()) / np.ptp(reach)).clip(0, 1)
        hang = kind.droop * d * rng.uniform(0.5, 1.2)
        narrow = 1 - 0.35 * min(kind.droop, 1) * reach[:, None] ** 2
        middle = shape.mean(axis=0)
        shape = middle + (shape - middle) * narrow + hang * reach[:, None] ** 2 * down
        shape += 0.10 * d * noise(shape + 3.0, 0.8 * d)[:, None] * reach[:, None] * rng.normal(0, 1, 3)
    colours = np.array(kind.lint) * (0.93 + 0.14 * puffs.clip(0, 0.5) + 0.5 * fray / max(kind.fray, 1))[:, None]
    return Mesh(shape, triangles, colours.clip(0, 0.95))


def _raise(mesh: Mesh, openness: float, angle: float, d: float) -> Mesh:
    """A carpel turned up towards the boll's axis about its foot: by 70 degrees where it is not open at all."""
    turn = np.deg2rad(70) * (1 - openness)
    tangent = np.array([-np.sin(angle), np.cos(angle), 0.0])
    hinge = 0.05 * d * np.array([np.cos(angle), np.sin(angle), 0.0])
    k = np.array([[0, -tangent[2], tangent[1]], [tangent[2], 0, -tangent[0]], [-tangent[1], tangent[0], 0]])
    rotation = np.eye(3) - np.sin(turn) * k + (1 - np.cos(turn)) * k @ k
    return replace(mesh, vertices=(mesh.vertices - hinge) @ rotation.T + hinge)


def _soil(rng: np.random.Generator, noise: SolidNoise, lint: Mesh, share: float) -> Mesh:
    """Lint with bits of leaf and dust where a fine noise is highest."""
    if not share:
        return lint
    specks = noise(lint.vertices + rng.uniform(0, 1, 3), 0.007) + 0.5 * noise(lint.vertices, 0.003)
    dirty = specks > np.quantile(specks, 1 - share)
    return replace(lint, colours=np.where(dirty[:, None], (0.16, 0.10, 0.05), lint.colours))
