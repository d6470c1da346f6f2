# SPDX-License-Identifier: Apache-2.0
"""Two films of one plant in one frame: the turn about the vertical, found from its bolls and branches.

In both plant frames z is up from the table top and the stem stands at the origin. Three things are unknown: how the
plant was turned between the films, how far the guessed foot of the stem is off its place, and whether the plant leans
differently. The module compares bolls and branches relative to the stem, which removes shift and lean; the candidate
is the turn at which most of them lie on each other. It accepts the candidate if chance does not do as well: it turns
each branch with its bolls by an angle of its own, many times, and looks for the best turn of such plants in the same
way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.plant_map import Axis, PlantMap
from ..core.scene import Float64
from ..geometry.polylines import resampled
from .align_bolls import APART_DEG, LEAST_LEAD, LEAST_SHARE, MOST_CHANCE, BollAlignment, align_by_bolls
from .match import match_bolls

Groups = list[list[Float64]]
"""Items of a plant in groups that turn together: a branch on the stem with all that it bears."""

STEP_DEG: Final = 2.0
NEAR_CM: Final = 1.5
"""Standard deviation of the places of one boll in two films, relative to the stem."""
CHANCE_FROM_CM: Final = 3.0
"""Distance from the stem at which the comparison of a branch begins: nearer to it, all turns are alike."""
FEWEST: Final = 3
"""Least number of bolls and branches that determine a turn."""
SHUFFLES: Final = 1999
MOST_LEAN_DEG: Final = 12.0
STEM_STEP_CM: Final = 4.0
STEM_WEIGHT: Final = 0.3
"""Weight of a place on the stem relative to a boll: the stem bends."""
WOOD_WEIGHT: Final = 0.05
"""Weight of a cm of a branch: its points slide along it."""
REFINEMENTS: Final = 6


@dataclass(frozen=True)
class Layout:
    """The parts of a plant that are compared, in its plant frame."""

    centres_cm: Float64
    """(B, 3) centres of its bolls; NaN if not known."""
    branch_of: tuple[int, ...]
    """The branch of each boll; 0 = on the stem or not known."""
    plant_map: PlantMap
    """A map without axes if the plant has none."""

    @property
    def stem(self) -> Float64:
        """(N, 3) cm; upright from the origin if the plant has no map."""
        return self.plant_map.stem.curve if self.plant_map.axes else np.array([[0, 0, 0], [0, 0, 1.0]])


@dataclass(frozen=True)
class Alignment:
    """The pose of one film's plant frame in that of another."""

    rotation: Float64
    """(3, 3)."""
    shift_cm: Float64
    """(3,)"""
    turn_deg: float
    """Turn of the plant on the table from the first film to this one, counter-clockwise seen from above. The ends of a
    table look alike, so the value may lack half a turn."""
    lean_deg: float
    """Angle between the two verticals: the change in the plant's lean."""
    n_items: int
    """Number of bolls and branches in the comparison."""
    support: float
    """Number of them that lie on each other, each weighted by how near it lies."""
    chance: float
    """Share of shuffled plants that fit as well; NaN if the user gave the turn."""

    def apply(self, points_cm: NDArray[Any]) -> Float64:
        """(N, 3) places of the other film in the frame of the first."""
        return np.reshape(points_cm, (-1, 3)) @ self.rotation.T + self.shift_cm


@dataclass(frozen=True)
class NoAlignment:
    """The films cannot be aligned."""

    reason: str


def align(a: Layout, b: Layout, reach_cm: float, turn_deg: float | None = None) -> Alignment | NoAlignment:
    """Lay b on a.

    Args:
        reach_cm: how far a boll may have moved.
        turn_deg: turn of the plant from a to b if it is known, to some 10 degrees and perhaps up to half a turn,
        because the ends of a table look alike; None = find it.
    """
    curves = [_turn_curves(a, b, by_stem) for by_stem in (True, False)]
    n_items = len(curves[0].sizes)
    if not n_items or not curves[0].n_targets:
        return NoAlignment("there are no bolls and branches in both films to align the plants by")
    # Relative to the stem if both films follow it alike, else relative to the foot.
    found = max(curves, key=lambda each: float(each.total(turn_deg).max()))
    total = found.total(turn_deg)
    best = int(total.argmax())
    away = np.abs(np.arange(len(total)) - best) * STEP_DEG
    others = np.where(np.minimum(away, 360 - away) > APART_DEG, total, 0.0)
    support, second = float(total[best]), float(others.max())
    doubt, chance = "", float("nan")
    if turn_deg is None and n_items < FEWEST:
        doubt = f"a film shows {n_items} bolls and branches, too few to tell the turn by"
    elif turn_deg is None:
        chance = found.chance(support)
        if chance > MOST_CHANCE:
            doubt = (
                f"no turn lays the two plants on each other: the best, {_signed(best)} degrees, fits {support:.1f} of "
                f"{n_items} bolls and branches, which chance does in {100 * chance:.0f} % of cases"
            )
        elif support - second < LEAST_LEAD:
            doubt = (
                f"two turns lay the plants on each other about as well, {_signed(best)} and "
                f"{_signed(int(others.argmax()))} degrees"
            )
    elif support < LEAST_LEAD:
        doubt = f"at a turn of {turn_deg:g} degrees no boll and no branch of the plants lie on each other"
    if doubt:
        by_bolls = align_by_bolls(a.centres_cm, b.centres_cm) if turn_deg is None else None
        return _without_foot(a, b, by_bolls) if by_bolls else NoAlignment(doubt)
    rotation, shift = _refine(a, b, np.radians(best * STEP_DEG), reach_cm)
    support = _support(a, b, rotation, shift)
    if support < LEAST_SHARE * n_items:
        return NoAlignment(
            f"even at the best turn, {_signed(best)} degrees, only {support:.1f} of {n_items} bolls and branches lie"
            " on each other"
        )
    lean = float(np.degrees(np.arccos(np.clip(rotation[2, 2], -1, 1))))
    turn = -float(np.degrees(_turn(rotation)))
    return Alignment(rotation, shift, turn, lean, n_items, support, chance)


def _without_foot(a: Layout, b: Layout, found: BollAlignment) -> Alignment:
    n_bolls = min(int(np.isfinite(layout.centres_cm).all(axis=1).sum()) for layout in (a, b))
    turn_deg = -float(np.degrees(_turn(about_vertical(found.angle))))
    rotation = about_vertical(found.angle)
    return Alignment(rotation, found.shift_cm, turn_deg, 0.0, n_bolls, found.support, found.chance)


def about_vertical(angle: float) -> Float64:
    """(3, 3) rotation about z, counter-clockwise seen from above, rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


# --------------------------------------------------------------- the turn
@dataclass(frozen=True)
class _Curves:
    """How well each item of one plant lies on the other plant, for each turn."""

    scores: Float64
    """(G, T) of each group, that is a branch with its bolls, at each turn: the sum over its items, 0..1 each."""
    sizes: tuple[int, ...]
    """Group of each item."""
    n_targets: int
    backwards: bool
    """Whether the first plant was turned instead of the second."""

    def total(self, around_deg: float | None = None) -> Float64:
        """(T,) total at each turn that takes the second plant back; -1 at a turn more than half `APART_DEG` away from
        the one that takes back `around_deg`, or half a turn more."""
        total: Float64 = self.scores.sum(axis=0)
        if self.backwards:
            total = np.roll(total[::-1], 1)
        if around_deg is not None:
            away = np.abs((np.arange(len(total)) * STEP_DEG + around_deg + 90) % 180 - 90)
            total = np.where(away <= 0.5 * APART_DEG, total, -1.0)
        return total

    def chance(self, reached: float) -> float:
        """Share of plants with randomly turned groups that reach as much at their best turn."""
        rng = np.random.default_rng(0)
        n_groups, n_turns = self.scores.shape
        turns = np.arange(n_turns)
        offsets = rng.integers(0, n_turns, (SHUFFLES, n_groups))
        beaten = 0
        for offset in offsets:
            rolled = self.scores[np.arange(n_groups)[:, None], (turns + offset[:, None]) % n_turns]
            beaten += int(rolled.sum(axis=0).max() >= reached)
        return (1 + beaten) / (1 + SHUFFLES)


def _turn_curves(a: Layout, b: Layout, by_stem: bool) -> _Curves:
    """Compare the plant with fewer items with the other; chance does less well than in the other direction."""
    turned, still, backwards = _fewer_first(_items(a, by_stem), _items(b, by_stem))
    targets = _targets(still)
    angles = np.radians(np.arange(0, 360, STEP_DEG))
    scores = np.array(
        [sum(_item_scores(item, targets[len(item) > 1], angles) for item in group) for group in turned]
    ).reshape(-1, len(angles))
    sizes = tuple(number for number, group in enumerate(turned) for _ in group)
    return _Curves(scores, sizes, sum(map(len, still)), backwards)


def _fewer_first(
    a: list[list[Float64]], b: list[list[Float64]]
) -> tuple[list[list[Float64]], list[list[Float64]], bool]:
    """The plant with fewer items, the other, and whether that is a before b."""
    backwards = sum(map(len, a)) < sum(map(len, b))
    return (a, b, True) if backwards else (b, a, False)


def _targets(groups: Groups) -> dict[bool, Float64]:
    """Targets for bolls (False) and for points of branches (True); at least one, which may be far from everything."""
    nowhere = np.full((1, 3), np.inf)
    return {
        many: np.vstack([*(item for group in groups for item in group if (len(item) > 1) == many), nowhere])
        for many in (False, True)
    }


def _support(a: Layout, b: Layout, rotation: Float64, shift: Float64) -> float:
    """How many items of the plant with fewer lie on those of the other in a common frame."""
    moved = [[item @ rotation.T + shift for item in group] for group in _items(b, by_stem=False)]
    fewer, more, _ = _fewer_first(_items(a, by_stem=False), moved)
    targets = _targets(more)
    return float(sum(_item_scores(item, targets[len(item) > 1], np.zeros(1))[0] for group in fewer for item in group))


def _items(layout: Layout, by_stem: bool) -> Groups:
    """Groups of items: a branch's points (N, 3), N > 1, and its bolls' centres (1, 3), relative to the stem."""
    groups: dict[tuple[str, int], list[Float64]] = {}
    first = _first_order(layout.plant_map)
    for axis in layout.plant_map.axes[1:]:
        points = _from_stem(resampled(axis.curve, 1.0), layout, by_stem)
        points = points[np.hypot(points[:, 0], points[:, 1]) > CHANCE_FROM_CM]
        if len(points) > 1:
            groups.setdefault(("branch", first[axis.rank]), []).append(points)
    known = np.isfinite(layout.centres_cm).all(axis=1)
    centres = _from_stem(np.nan_to_num(layout.centres_cm), layout, by_stem)
    for number in np.flatnonzero(known):
        branch = layout.branch_of[number]
        key = ("branch", first[branch]) if branch in first else ("boll", int(number))
        groups.setdefault(key, []).append(centres[number : number + 1])
    return list(groups.values())


def _first_order(plant_map: PlantMap) -> dict[int, int]:
    """Rank of a branch -> rank of the branch on the stem to which it belongs."""
    axis_of: dict[int, Axis] = {axis.rank: axis for axis in plant_map.axes}
    first = {}
    for rank in axis_of:
        at = rank
        while axis_of[at].parent > 0:
            at = axis_of[at].parent
        if rank:
            first[rank] = at
    return first


def _from_stem(points: NDArray[Any], layout: Layout, by_stem: bool) -> Float64:
    """(N, 3) points with x and y relative to the stem at their height or, above its tip, to the tip."""
    stem = layout.stem
    if not by_stem or not layout.plant_map.axes:
        return np.asarray(points, np.float64)
    rising = stem[np.argsort(stem[:, 2], kind="stable")]
    middle = np.column_stack([np.interp(points[:, 2], rising[:, 2], rising[:, axis]) for axis in (0, 1)])
    return np.column_stack([points[:, :2] - middle, points[:, 2]])


def _item_scores(item: Float64, targets: Float64, angles: Float64) -> Float64:
    """(T,) likeness, 0..1, of an item turned by each angle: mean over its points of how near the next target is."""
    c, s = np.cos(angles), np.sin(angles)
    x = c[:, None] * item[:, 0] - s[:, None] * item[:, 1]
    y = s[:, None] * item[:, 0] + c[:, None] * item[:, 1]
    turned = np.stack([x, y, np.broadcast_to(item[:, 2], x.shape)], axis=-1)
    squares = ((turned[:, :, None] - targets) ** 2).sum(axis=-1).min(axis=2)
    scores: Float64 = np.exp(-0.5 * squares / NEAR_CM**2).mean(axis=1)
    return scores


# --------------------------------------------------- shift and lean
def _refine(a: Layout, b: Layout, angle: float, reach_cm: float) -> tuple[Float64, Float64]:
    """Rotation and shift by matched bolls, by the stems at equal heights and by points of branches that are near."""
    rotation = about_vertical(angle)
    stem_a, stem_b = _stem_places(a, b)
    wood_a, wood_b = (_targets(_items(layout, by_stem=False))[True][:-1] for layout in (a, b))
    shift = stem_a.mean(axis=0) - stem_b.mean(axis=0) @ rotation.T if len(stem_a) else np.zeros(3)
    for round_ in range(REFINEMENTS):
        # The first matches allow larger distances, because the shift is not known yet.
        afar = 2.0 if round_ < 2 else 1.0
        pairs = match_bolls(a.centres_cm, b.centres_cm @ rotation.T + shift, afar * reach_cm)
        ends_a, ends_b = a.centres_cm[pairs[:, 0]], b.centres_cm[pairs[:, 1]]
        away = np.linalg.norm(ends_a - (ends_b @ rotation.T + shift), axis=1)
        # Bolls that moved by themselves carry no information on the frame.
        trusted = away <= max(2.5 * float(np.median(away)), 0.5) if len(away) else np.zeros(0, bool)
        near_a, near_b = _near_wood(wood_a, wood_b, rotation, shift, afar * NEAR_CM)
        to = np.vstack([ends_a[trusted], stem_a, near_a])
        source = np.vstack([ends_b[trusted], stem_b, near_b])
        if not trusted.sum() + len(near_a):
            break
        counts = trusted.sum(), len(stem_a), len(near_a)
        weights = np.repeat([1.0, STEM_WEIGHT, WOOD_WEIGHT], counts)
        fitted, moved = _fit(source, to, weights, rotation, leans=len(stem_a) > 0)
        if abs(_turn(about_vertical(-angle) @ fitted)) > np.radians(0.5 * APART_DEG):
            break  # the rest lies on the stem's line and does not determine a turn
        rotation, shift = fitted, moved
    return rotation, shift


def _near_wood(
    wood_a: Float64, wood_b: Float64, rotation: Float64, shift: Float64, reach_cm: float
) -> tuple[Float64, Float64]:
    """(W, 3) points of the branches of both that lie on each other."""
    if not (len(wood_a) and len(wood_b)):
        return np.zeros((0, 3)), np.zeros((0, 3))
    from scipy.spatial import cKDTree

    away, nearest = cKDTree(wood_a).query(wood_b @ rotation.T + shift)
    near = away <= reach_cm
    return wood_a[nearest[near]], wood_b[near]


def _turn(rotation: Float64) -> float:
    """The rotation's part about the vertical, rad."""
    return float(np.arctan2(rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1]))


def _stem_places(a: Layout, b: Layout) -> tuple[Float64, Float64]:
    """(S, 3) places of both stems at equal heights; none without both maps."""
    if not (a.plant_map.axes and b.plant_map.axes):
        return np.zeros((0, 3)), np.zeros((0, 3))
    low = max(stem[:, 2].min() for stem in (a.stem, b.stem))
    high = min(stem[:, 2].max() for stem in (a.stem, b.stem))
    heights = np.arange(low, high, STEM_STEP_CM)
    places = []
    for stem in (a.stem, b.stem):
        rising = stem[np.argsort(stem[:, 2], kind="stable")]
        places.append(
            np.column_stack([*(np.interp(heights, rising[:, 2], rising[:, axis]) for axis in (0, 1)), heights])
        )
    return places[0], places[1]


def _fit(source: Float64, to: Float64, weights: Float64, before: Float64, *, leans: bool) -> tuple[Float64, Float64]:
    """Least squares (Kabsch): about the vertical alone unless `leans`, or if the lean is too large for a plant."""
    share = weights / weights.sum()
    middle_s, middle_t = share @ source, share @ to
    s, t = source - middle_s, to - middle_t
    if leans:
        u, _, vt = np.linalg.svd((weights[:, None] * s).T @ t)
        turned = np.asarray(vt.T @ np.diag([1, 1, np.sign(np.linalg.det(vt.T @ u.T))]) @ u.T)
        if turned[2, 2] >= np.cos(np.radians(MOST_LEAN_DEG)):
            return turned, middle_t - turned @ middle_s
    sine = float((weights * (s[:, 0] * t[:, 1] - s[:, 1] * t[:, 0])).sum())
    cosine = float((weights * (s[:, 0] * t[:, 0] + s[:, 1] * t[:, 1])).sum())
    rotation = about_vertical(np.arctan2(sine, cosine)) if np.hypot(sine, cosine) > 0 else before
    return rotation, middle_t - rotation @ middle_s


def _signed(step: int) -> int:
    """Degrees of the plant's turn that a step takes back, -180..180."""
    return round((180 - step * STEP_DEG) % 360 - 180)
