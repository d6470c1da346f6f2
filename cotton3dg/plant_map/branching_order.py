# SPDX-License-Identifier: Apache-2.0
"""From the paths of a skeleton to the map that a breeder draws: stem, branches by rank, each boll on its branch."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from ..core.plant_map import Axis, BollOnMap, PlantMap
from ..core.scene import Float64
from ..geometry.polylines import (
    angle_deg,
    direction,
    length_of,
    nearest_on,
    path_lengths,
    place_at,
    resampled,
)
from .positions import STEP_CM, Sited, bends_deg, infer_positions, sharpest
from .skeleton import PETIOLE_CM, SPACING_CM, RawAxis
from .untangle import STALK_CM, leaves_low, untangle_paths
from .wood import BollBody, WoodCloud

TERMINAL_STALK_CM: Final = 2.0
"""Assumed distance of a branch's last node from its last boll's foot, if the branch goes on into the boll's stalk."""
SHORT_BRANCH_CM: Final = 2.0
"""Least length of a path to a boll that is a branch, on a vegetative branch, where all bolls hang on such branches."""
SUB_BRANCH_CM: Final = 3.5
"""Least length of a branch on a branch. Shorter paths are scars and dry tips."""
NO_WAY_CM: Final = 1.0
"""A boll whose path from the stem is shorter does not have a branch there: it hangs on a branch beside it, ..."""
BRANCH_BESIDE_CM: Final = 3.0
"""... if one is this near to its foot, else on the stem. The same holds for a boll that seems to hang on a vegetative
branch."""
TIP_CM: Final = 3.0
"""Distance from the stem's tip within which a boll sits on the stem."""
CARPEL_CM: Final = 4.5
"""Length by which a path may go on past a boll's foot to be a carpel of its bur."""
CARPEL_REACH: Final = 1.3
"""Distance from the boll's middle, in diameters, within which such a path ends."""
BASE_CM: Final = 2.0
"""The straight piece of a branch next to its parent, which is continued into the parent's centre line."""
BESIDE_CM: Final = 0.4
"""Distance from the parent's wood at which this piece begins."""
BRANCH_RADIUS_CM: Final = 0.2
SEEN_CM: Final = 0.5
UPRIGHT_DEG: Final = 55.0
RISING_DEG: Final = 35.0
"""Steepness of a vegetative branch's outer half if it bears nothing, and if it has one branch."""
VEGETATIVE_CM: Final = 12.0
NODE_BEND_DEG: Final = 20.0
"""Bend of a seemingly vegetative branch that ends in a boll, where its last fruiting branch leaves: the vegetative
branch itself is straight, and the fruiting branch bends once more at its boll."""


@dataclass
class _Branch:
    """A branch on its way to its place in the order."""

    curve: Float64
    parent: int
    """Index among the branches; -1 = the stem."""
    ends_in_boll: int = 0
    stalks: list[tuple[int, float, Float64]] = field(default_factory=list)
    """Index of the boll from 1, path length of its node on the branch, and its stalk (N, 3)."""


def draw_map(cloud: WoodCloud, raw: list[RawAxis], stem_radius: float) -> PlantMap:
    """The map of a skeleton.

    Args:
        raw: the stem, then the paths that leave it or each other. stem_radius: cm, in its lower half.
    """
    if not raw:
        return PlantMap((), (), "no_stem")
    ways = _without_carpels(untangle_paths(raw), cloud.bolls)
    stem = ways[0].curve
    branches, on_stem = _sorted_out(ways, cloud)
    for branch in branches:
        parent = stem if branch.parent < 0 else branches[branch.parent].curve
        radius = stem_radius if branch.parent < 0 else BRANCH_RADIUS_CM
        shift = length_of(branch.curve)
        branch.curve = with_straight_base(branch.curve, parent, radius)
        shift = length_of(branch.curve) - shift
        branch.stalks = [(boll, max(node + shift, 0.0), stalk) for boll, node, stalk in branch.stalks]
    kinds = [_kind(branch, branches, index, stem) for index, branch in enumerate(branches)]
    branches, kinds = _borne_by_branches(branches, kinds)
    branches, kinds = _without_bare_twigs(branches, kinds)
    order = sorted(range(len(branches)), key=lambda i: (float(branches[i].curve[0, 2]), i))
    ranks = {index: rank for rank, index in enumerate(order, start=1)} | {-1: 0}
    seen = cloud.places
    axes = [Axis(0, "stem", -1, stem, _unknown(stem), _seen_share(stem, seen), _ids(cloud, on_stem))]
    bolls = [
        _boll_on_map(cloud.bolls[boll - 1], 0, rank, Sited(node, 0, np.nan), stalk, [])
        for rank, (boll, node, stalk) in enumerate(sorted(on_stem, key=lambda item: item[1]), start=1)
    ]
    curves = [branch.curve for branch in branches]
    heights = [float(branch.curve[0, 2]) for branch in branches if branch.parent < 0]
    low, high = min(heights, default=0.0), float(stem[-1, 2])
    for index in order:
        branch = branches[index]
        own = sorted(branch.stalks, key=lambda item: (item[1], item[0]))
        axis = Axis(
            ranks[index],
            kinds[index],
            ranks[branch.parent],
            branch.curve,
            _unknown(branch.curve),
            _seen_share(branch.curve, seen),
            _ids(cloud, own),
        )
        axes.append(axis)
        up = np.clip((branch.curve[0, 2] - low) / max(high - low, 1.0), 0, 1)
        nodes, feet = [node for _, node, _ in own], np.array([stalk[-1] for _, _, stalk in own])
        sited = infer_positions(branch.curve, nodes, feet, float(up), kinds[index] == "fruiting")
        others = [curve for other, curve in enumerate(curves) if other != index] + [stem]
        for rank, ((boll, _, stalk), site) in enumerate(zip(own, sited, strict=True), start=1):
            bolls.append(_boll_on_map(cloud.bolls[boll - 1], axis.rank, rank, site, stalk, others))
    return PlantMap(tuple(axes), tuple(sorted(bolls, key=lambda boll: boll.boll_id)))


def _without_carpels(ways: list[RawAxis], bolls: tuple[BollBody, ...]) -> list[RawAxis]:
    """The paths, where those that run past a boll's foot into a carpel end at the foot."""
    for number, way in enumerate(ways):
        if number == 0 or way.boll:
            continue
        for child in ways:
            if child.parent != number or not child.boll or length_of(child.curve) > 1.5:
                continue
            body = bolls[child.boll - 1]
            node = nearest_on(way.curve, child.curve[:1])[1][0]
            beyond = length_of(way.curve) - node
            if beyond < CARPEL_CM and np.linalg.norm(way.curve[-1] - body.centre) < CARPEL_REACH * body.diameter:
                way.curve = way.curve[path_lengths(way.curve) <= node + 1e-9]
                way.curve = np.vstack([way.curve, child.curve[-1:]])
                way.boll, child.boll = child.boll, 0
                break
    return ways


def _sorted_out(ways: list[RawAxis], cloud: WoodCloud) -> tuple[list[_Branch], list[tuple[int, float, Float64]]]:
    """Branches and the bolls on the stem itself, separated from stalks, carpels, scars and leaf stalks."""
    stem = ways[0].curve
    branches: list[_Branch] = []
    index_of = {0: -1}
    on_stem: list[tuple[int, float, Float64]] = []
    at_stem: list[RawAxis] = []
    bearing = {way.parent for way in ways[1:] if way.boll}
    for number, way in enumerate(ways):
        if number == 0 or len(way.curve) < 2:
            continue
        length, parent = length_of(way.curve), index_of.get(way.parent)
        if parent is None:
            # A path that leaves a stalk or scar belongs to the branch that bears the stalk or scar.
            parent = index_of[number] = _bearer(ways, number, index_of)
        mother = stem if parent < 0 else branches[parent].curve
        node = float(nearest_on(mother, way.curve[:1])[1][0])
        if way.boll:
            at_tip = parent < 0 and length_of(stem) - node < TIP_CM
            if length < STALK_CM and (parent >= 0 or at_tip):
                target = on_stem if parent < 0 else branches[parent].stalks
                target.append((way.boll, node, way.curve))
                continue
            if length < NO_WAY_CM and parent < 0:
                at_stem.append(way)
                continue
        elif (number not in bearing and np.isfinite(ways[way.parent].bare_cm)) or _is_no_branch(
            way, parent, length, length_of(stem) - node, number in bearing, cloud.bolls
        ):
            continue
        index_of[number] = len(branches)
        branch = _Branch(way.curve, parent, way.boll)
        branches.append(_bearing_at_tip(branch) if way.boll else branch)
    for way in at_stem:
        if not _hung_beside(way.boll, way.curve, branches):
            on_stem.append((way.boll, float(nearest_on(stem, way.curve[:1])[1][0]), way.curve))
    return branches, on_stem


def _borne_by_branches(branches: list[_Branch], kinds: list[str]) -> tuple[list[_Branch], list[str]]:
    """Vegetative branches bear fruiting branches and no bolls. A boll that seems to hang on one hangs on a fruiting
    branch beside it, or its stalk, or the outer end of the supposed vegetative branch, is a branch of its own."""
    fruiting = [branch for branch, kind in zip(branches, kinds, strict=True) if kind == "fruiting"]
    found: list[_Branch] = []
    for index, (branch, kind) in enumerate(zip(branches, kinds, strict=True)):
        if kind != "vegetative":
            continue
        stalks, branch.stalks = branch.stalks, []
        if branch.ends_in_boll and (last := _last_bend(branch.curve)):
            lengths, boll = path_lengths(branch.curve), branch.ends_in_boll
            found.append(_bearing_at_tip(_Branch(branch.curve[lengths >= last], index, boll)))
            branch.curve, branch.ends_in_boll = branch.curve[lengths <= last], 0
            stalks = [stalk for stalk in stalks if stalk[0] != boll]
        for boll, node, stalk in stalks:
            if length_of(stalk) > SHORT_BRANCH_CM and length_of(branch.curve) - node > TIP_CM:
                curve = with_straight_base(stalk, branch.curve, BRANCH_RADIUS_CM)
                found.append(_bearing_at_tip(_Branch(curve, index, boll)))
            elif not _hung_beside(boll, stalk, fruiting + found):
                branch.stalks.append((boll, node, stalk))
    return [*branches, *found], [*kinds, *["fruiting"] * len(found)]


def _last_bend(curve: Float64) -> float:
    """Path length of the first sharp bend of a branch's outer end, where another may have left it; 0 = none."""
    bends = bends_deg(curve)
    beyond = length_of(curve) - np.arange(len(bends)) * STEP_CM
    sharp = sharpest(bends) & (bends > NODE_BEND_DEG) & (beyond > SUB_BRANCH_CM) & (beyond < VEGETATIVE_CM)
    return float(np.argmax(sharp)) * STEP_CM


def _hung_beside(boll: int, stalk: Float64, branches: list[_Branch]) -> bool:
    """Hang a boll on the branch that comes nearest to its foot, if one is near enough."""
    beside = [nearest_on(branch.curve, stalk[-1:]) for branch in branches]
    nearest = min(range(len(branches)), key=lambda index: beside[index][0][0], default=None)
    if nearest is None or beside[nearest][0][0] > BRANCH_BESIDE_CM:
        return False
    node = float(beside[nearest][1][0])
    way = np.vstack([place_at(branches[nearest].curve, node), stalk[-1]])
    branches[nearest].stalks.append((boll, node, resampled(way, SPACING_CM)))
    return True


def _without_bare_twigs(branches: list[_Branch], kinds: list[str]) -> tuple[list[_Branch], list[str]]:
    """Fruiting branches do not bear branches: a bare twig on one is a stalk, a scar or wood of another branch."""
    kept = list(range(len(branches)))
    for index in sorted(kept, key=lambda index: length_of(branches[index].curve)):
        branch = branches[index]
        bears = branch.stalks or any(branches[other].parent == index for other in kept)
        if branch.parent >= 0 and not bears and kinds[branch.parent] == "fruiting":
            kept.remove(index)
    new = {old: number for number, old in enumerate(kept)} | {-1: -1}
    for index in kept:
        branches[index].parent = new[branches[index].parent]
    return [branches[index] for index in kept], [kinds[index] for index in kept]


def _bearing_at_tip(branch: _Branch) -> _Branch:
    """The branch with its last boll on it, at whose foot it ends."""
    lengths = path_lengths(branch.curve)
    node = max(lengths[-1] - TERMINAL_STALK_CM, 0.5 * lengths[-1])
    branch.stalks.append((branch.ends_in_boll, node, branch.curve[lengths >= node]))
    return branch


def _bearer(ways: list[RawAxis], number: int, index_of: dict[int, int]) -> int:
    parent = ways[number].parent
    while parent not in index_of:
        parent = ways[parent].parent
    return index_of[parent]


def _is_no_branch(
    way: RawAxis, parent: int, length: float, below_tip: float, bears: bool, bolls: tuple[BollBody, ...]
) -> bool:
    """Whether a path without a boll at its end is a scar, a leaf's stalk or a carpel."""
    if bears:
        return False
    near_boll = any(np.linalg.norm(way.curve[-1] - body.centre) < CARPEL_REACH * body.diameter for body in bolls)
    if (parent >= 0 or below_tip < TIP_CM) and length < CARPEL_CM and near_boll:
        return True
    return way.bare_cm < PETIOLE_CM or (parent >= 0 and length < SUB_BRANCH_CM)


def with_straight_base(curve: Float64, parent: Float64, radius: float) -> Float64:
    """The curve from its parent's centre line on. Shortest paths keep to the parent for a while, branches do not.

    The straight piece next to the parent's wood is continued to where it comes nearest to the parent's centre line.
    """
    away, _ = nearest_on(parent, curve)
    outside = np.flatnonzero(away > radius + BESIDE_CM)
    if not len(outside) or len(curve) - outside[0] < 3:
        return curve
    start = int(outside[0])
    lengths = path_lengths(curve)
    piece = curve[start : int(np.searchsorted(lengths, lengths[start] + BASE_CM)) + 1]
    if len(piece) < 3:
        return curve
    middle = piece.mean(axis=0)
    way = np.linalg.svd(piece - middle)[2][0]
    way *= np.sign(way @ (piece[-1] - piece[0])) or 1.0
    first = middle + ((piece[0] - middle) @ way) * way
    # Backwards along the line, up to twice the distance to the parent.
    backwards = first - np.linspace(0, 2 * away[start] + 1.5, 60)[:, None] * way
    gaps, stations = nearest_on(parent, backwards)
    best = int(np.argmin(gaps))
    foot = place_at(parent, float(stations[best]))
    return resampled(np.vstack([foot, curve[start:]]), SPACING_CM)


def base_angle_deg(curve: Float64, parent: Float64) -> float:
    """Angle between the first 3 cm of a branch and its parent's direction at its foot."""
    station = float(nearest_on(parent, curve[:1])[1][0])
    along = direction(parent, max(station - 2.0, 0.0), min(station + 2.0, length_of(parent)))
    return angle_deg(along, direction(curve, 0.0, min(3.0, length_of(curve))))


def _kind(branch: _Branch, branches: list[_Branch], index: int, stem: Float64) -> str:
    """The kind of a branch. A vegetative one rises, bears branches itself, and leaves the stem low.

    One boll on it may hang elsewhere; several may if it rises steeply and bears as many branches.

    On a branch that bears bolls itself, bare branches are parts that hang around these.
    """
    if branch.parent >= 0 or length_of(branch.curve) < VEGETATIVE_CM:
        return "fruiting"
    outer = direction(branch.curve, 0.5 * length_of(branch.curve), length_of(branch.curve))
    rise_deg = np.degrees(np.arcsin(np.clip(outer[2], -1, 1)))
    low = leaves_low(branch.curve, stem)
    own = [other for other in branches if other.parent == index and length_of(other.curve) > STALK_CM]
    branching = sum(bool(other.stalks) or not branch.stalks for other in own)
    if len(branch.stalks) > max(1, branching if rise_deg > RISING_DEG else 0):
        return "fruiting"
    upright = rise_deg > UPRIGHT_DEG and not branch.stalks
    return "vegetative" if low and (branching > 1 or (branching and rise_deg > RISING_DEG) or upright) else "fruiting"


def _boll_on_map(
    body: BollBody, branch: int, rank: int, site: Sited, stalk: Float64, others: list[Float64]
) -> BollOnMap:
    own = max(length_of(stalk), 0.3)
    foot = stalk[-1:]
    other = min((float(nearest_on(curve, foot)[0][0]) for curve in others), default=np.inf)
    confidence = 1.0 if not np.isfinite(other) else other**2 / (own**2 + other**2)
    return BollOnMap(body.boll_id, branch, rank, stalk, site.path_cm, site.position, site.confidence, float(confidence))


def _seen_share(curve: Float64, places: Float64) -> float:
    """Share of a curve's points next to which wood was seen."""
    from scipy.spatial import cKDTree

    return float(np.mean(cKDTree(places).query(curve)[0] < SEEN_CM + 0.4))


def _unknown(curve: Float64) -> Float64:
    return np.full(len(curve), np.nan)


def _ids(cloud: WoodCloud, stalks: list[tuple[int, float, Float64]]) -> tuple[int, ...]:
    return tuple(cloud.bolls[boll - 1].boll_id for boll, _, _ in stalks)
