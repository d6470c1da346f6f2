"""Ways that go astray where branches touch or fork get back what goes on straight.

Shortest paths go from one branch into another wherever these touch, and at a fork the longest way takes the parent's
inner part, whichever of the two it continues. Wood goes on straight: at every touch and fork the parts are paired anew
if that saves bends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ..core.scene import Float64
from ..geometry.polylines import angle_deg, direction, length_of, nearest_on, path_lengths, resampled
from .skeleton import PETIOLE_CM, SPACING_CM, RawAxis

TOUCH_CM = 2.0
"""Centre lines that come as near may belong to branches that touch."""
ENDS_CM = 2.0
"""A way that took nothing over ends so near to the touch, ..."""
LAST_BOLL_CM = 5.0
"""... or, if it found a boll there, its stalk is no longer."""
BESIDE_CM = 4.0
"""A fork so near belongs to the touch."""
INNER_CM = 1.5
"""Nearer to its foot a way touches nothing but its parent."""
OUTER_CM = 3.5
"""Shorter outer parts are stalks, scars and dry tips, which bend as they like."""
TIP_CM, TIP_GAIN_DEG = 2.0, 15.0
"""But a tip as long as this that goes on where the parent pointed is the parent's own if that saves such a bend: the
top of a vegetative branch is shorter than the last branch that leaves it."""
LEAST_BLADE_CM = 1.0
"""What is broad over less at the end of a tip is no blade."""
AROUND_CM, WINDOW_CM = 0.8, 3.0
"""Directions are taken so far from where ways meet, over such a piece."""
FOLLOWED_CM, AHEAD_CM, FEWEST_AHEAD = 8.0, 1.2, 4
"""Wood is followed so far from a tip, by so many places within reach of it, ..."""
ALONG_CM = 0.6
"""... until another way lies so near."""
STALK_CM = 2.0
"""Of a way that ends at a boll, so much is taken for the stalk, and the branch may go on before it."""
DEAD_END_DEG = 40.0
"""A branch that ends at a touch is as unlikely as such a bend, ..."""
BOLL_END_DEG = 15.0
"""... and one that ends there with a boll as this."""
VEGETATIVE_FOOT = 0.5
"""Vegetative branches leave the stem in its lower half. Others bear no branches, ..."""
BEARING_DEG = 40.0
"""... and one that does is as unlikely as such a bend."""
GAIN_DEG = 8.0
"""Bends that a new pairing must save at least."""
MOST = 100
_GONE = -2
"""Parent of a way that is part of another one now."""


@dataclass(frozen=True)
class _Pairing:
    """Another pairing of what meets somewhere."""

    gain_deg: float
    apply: Callable[[], None]


def untangled(raw: list[RawAxis], wood: Float64) -> list[RawAxis]:
    """The ways, paired so that they go on straight; the stem comes first, as it came.

    Args:
        wood: (N, 3) places of wood.
    """
    ways = _extended([replace(way) for way in raw], wood)
    touches = _Touches()
    for _ in range(MOST):
        better = (pairing for pairing in _pairings(ways, touches) if pairing.gain_deg >= GAIN_DEG)
        best = max(better, key=lambda pairing: pairing.gain_deg, default=None)
        if best is None:
            break
        best.apply()
        ways = _without_rests(ways)
    return ways


def _extended(ways: list[RawAxis], wood: Float64) -> list[RawAxis]:
    """Ways that end where the wood goes on, for what follows was reached sooner through another branch, go on to it."""
    tree = cKDTree(wood)
    curves = _Curves(ways)
    for number in range(1, len(ways)):
        way = ways[number]
        others = [other for other in range(1, len(ways)) if _apart(ways, number, other)]
        bare = way.curve if not way.boll else _cut(way.curve, length_of(way.curve) - STALK_CM)[0]
        if np.isfinite(way.bare_cm) or not others or length_of(bare) < INNER_CM:
            continue
        onward = _followed_wood(bare, wood, tree, curves, set(others))
        if onward is None:
            continue
        if way.boll:
            ways.append(RawAxis(way.curve[len(bare) - 1 :], number, way.boll))
        ways[number] = replace(way, curve=resampled(np.vstack([bare, onward]), SPACING_CM), boll=0)
        for other in others:
            # What was traced the wrong way round, from the touch inwards, lies on the way now.
            its = ways[other]
            along = nearest_on(onward, its.curve, TOUCH_CM)[0] < ALONG_CM
            if len(onward) > 2 and along.mean() > 0.5 and length_of(its.curve) < length_of(onward) + ALONG_CM:
                _adopt(ways, other, number)
                ways[other].parent = number if its.boll else _GONE
                if its.boll:
                    ways[other].curve = its.curve[min(np.flatnonzero(along)[-1], len(its.curve) - 2) :]
    return _without_rests(ways)


def _apart(ways: list[RawAxis], one: int, other: int) -> bool:
    """Whether neither of two ways grows on the other."""
    return (
        one != other
        and ways[other].parent != _GONE
        and not (_descends(ways, one, other) or _descends(ways, other, one))
    )


class _Curves:
    """Points of all ways as they are at first, to tell which of them are near a place."""

    def __init__(self, ways: list[RawAxis]) -> None:
        self._tree = cKDTree(np.vstack([way.curve for way in ways]))
        self._owners = np.repeat(np.arange(len(ways)), [len(way.curve) for way in ways])
        self._beyond = np.concatenate([length_of(way.curve) - path_lengths(way.curve) for way in ways])

    def near(self, place: Float64) -> list[tuple[int, float]]:
        """Number of each way within `ALONG_CM`, and how much of it lies beyond its nearest point there, cm."""
        rows = np.array(self._tree.query_ball_point(place, ALONG_CM), np.int64)
        rows = rows[np.argsort(np.linalg.norm(self._tree.data[rows] - place, axis=1), kind="stable")]
        owners, first = np.unique(self._owners[rows], return_index=True)
        return [(int(owner), float(self._beyond[rows[row]])) for owner, row in zip(owners, first, strict=True)]


def _followed_wood(curve: Float64, wood: Float64, tree: cKDTree, curves: _Curves, others: set[int]) -> Float64 | None:
    """(N, 3) where wood goes on from a curve's tip until it meets another curve; None where it meets none.

    One that it meets at its tip comes from the other side, and is passed.

    Args:
        others: numbers of the ways that may be met.
    """
    place, way = curve[-1], direction(curve, max(length_of(curve) - WINDOW_CM, 0.0), length_of(curve))
    passed: list[Float64] = []
    head_on: set[int] = set()
    for _ in range(round(FOLLOWED_CM / SPACING_CM)):
        near = wood[tree.query_ball_point(place, AHEAD_CM)] - place
        ahead = near[near @ way > 0.7 * np.linalg.norm(near, axis=1)]
        ahead = ahead[ahead @ way > 0.5 * SPACING_CM]
        if len(ahead) < FEWEST_AHEAD or not np.isfinite(way).all():
            return None
        onward = ahead.mean(axis=0) / np.linalg.norm(ahead.mean(axis=0))
        way = way + 0.3 * (onward - way)
        way = way / np.linalg.norm(way)
        place = place + SPACING_CM * way
        passed.append(place)
        met = {number: beyond for number, beyond in curves.near(place) if number in others - head_on}
        if any(beyond >= ALONG_CM for beyond in met.values()):
            return np.array(passed)
        head_on |= set(met)
    return None


def _pairings(ways: list[RawAxis], touches: _Touches) -> Iterator[_Pairing]:
    for number, way in enumerate(ways):
        if number == 0:
            continue
        children = [
            (child, station)
            for child, station in _children(ways, number)
            if station > INNER_CM and _is_long(way, station)
        ]
        forks = [(child, station) for child, station in children if _is_long(ways[child])]
        yield from (_at_fork(ways, number, child, station) for child, station in forks)
        tips = (_at_fork(ways, number, *fork) for fork in children if fork not in forks and _is_tip(ways[fork[0]]))
        yield from (pairing for pairing in tips if pairing.gain_deg >= TIP_GAIN_DEG)
        for other in range(1, len(ways)):
            if not _apart(ways, number, other):
                continue
            touch = touches.between(way, ways[other])
            if touch is not None and min(way.bare_cm - touch[0], ways[other].bare_cm) > PETIOLE_CM:
                near = [(child, station) for child, station in forks if abs(station - touch[0]) < BESIDE_CM]
                may_bear = way.parent == 0 and leaves_low(way.curve, ways[0].curve)
                odd = 0.0 if may_bear else BEARING_DEG
                yield from _at_touch(ways, number, other, touch, near, odd)


def leaves_low(curve: Float64, stem: Float64) -> bool:
    """Whether a branch of the stem leaves it where vegetative ones do."""
    return bool(curve[0, 2] < stem[0, 2] + VEGETATIVE_FOOT * (stem[-1, 2] - stem[0, 2]))


def _is_long(way: RawAxis, station: float = 0.0) -> bool:
    """Whether what lies beyond a path length is no mere stalk, of a boll or a leaf, scar or tip."""
    is_leaf = way.bare_cm - station < PETIOLE_CM
    return not is_leaf and length_of(way.curve) - station > (LAST_BOLL_CM if way.boll else OUTER_CM)


def _is_tip(way: RawAxis) -> bool:
    """Whether a way may be the end of its parent, neither a boll's stalk nor a leaf's."""
    length = length_of(way.curve)
    return not way.boll and length > TIP_CM and way.bare_cm > length - LEAST_BLADE_CM


def _at_fork(ways: list[RawAxis], number: int, child: int, station: float) -> _Pairing:
    """The child goes on where the parent's inner part points, and the parent's outer part leaves it."""
    way = ways[number]
    gain = _bend(way.curve, station, way.curve, station) - _bend(way.curve, station, ways[child].curve, 0.0)

    def apply() -> None:
        _exchange(ways, number, station, child)

    return _Pairing(gain, apply)


class _Touches:
    """Where ways touch, looked for once for each pair of curves: most stay as they are."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, int, bool], tuple[Float64, Float64, tuple[float, float] | None]] = {}

    def between(self, way: RawAxis, other: RawAxis) -> tuple[float, float] | None:
        key = id(way.curve), id(other.curve), bool(other.boll)
        if key not in self._known:
            # The curves are kept, or another one might get the number of one that is gone.
            self._known[key] = way.curve, other.curve, _touch(way, other)
        return self._known[key][2]


def _touch(way: RawAxis, other: RawAxis) -> tuple[float, float] | None:
    """Path lengths, along a way and along another that ends beside it, of where they touch; None where they do not."""
    length = length_of(other.curve)
    tail = path_lengths(other.curve) > length - (LAST_BOLL_CM if other.boll else ENDS_CM)
    tail &= path_lengths(other.curve) > INNER_CM
    if not tail.any():
        return None
    low, high = way.curve.min(axis=0) - TOUCH_CM, way.curve.max(axis=0) + TOUCH_CM
    if not ((other.curve[tail] > low) & (other.curve[tail] < high)).all(axis=1).any():
        return None
    away, stations = nearest_on(way.curve, other.curve[tail])
    nearest = int(np.argmin(away))
    station = float(stations[nearest])
    if away[nearest] > TOUCH_CM or not INNER_CM < station < length_of(way.curve) - ENDS_CM:
        return None
    return station, float(path_lengths(other.curve)[tail][nearest])


def _at_touch(
    ways: list[RawAxis],
    number: int,
    other: int,
    touch: tuple[float, float],
    forks: list[tuple[int, float]],
    odd_deg: float,
) -> Iterator[_Pairing]:
    """The other way goes on into this one's outer part, or into a child that leaves at the touch.

    Args:
        odd_deg: the bend that is as unlikely as a child of this way.
    """
    station, end = touch
    way, its = ways[number], ways[other]
    ends = BOLL_END_DEG if its.boll else DEAD_END_DEG
    straight = _bend(way.curve, station, way.curve, station)
    taken = _bend(its.curve, end, way.curve, station)

    def take_outer() -> None:
        _hand_over(ways, number, station, other, end)

    yield _Pairing(straight + ends - taken - DEAD_END_DEG, take_outer)
    for child, fork in forks:
        # Branches that cross at a small angle run side by side between the touch and the fork.
        before, after = min(station, fork), max(station, fork)
        its_own = ways[child].curve
        leaves = _bend(way.curve, before, its_own, 0.0)

        def take_child(child: int = child) -> None:
            _take(ways, other, end, child)

        def take_both(child: int = child, fork: float = fork) -> None:
            _exchange(ways, number, fork, child)
            _take(ways, other, end, child)

        onward = _bend(its.curve, end, its_own, 0.0)
        yield _Pairing(ends + min(leaves, DEAD_END_DEG) + odd_deg - DEAD_END_DEG - onward, take_child)
        straight, taken = (_bend(curve, at, way.curve, after) for curve, at in ((way.curve, before), (its.curve, end)))
        yield _Pairing(straight + ends + odd_deg - taken - leaves, take_both)


def _exchange(ways: list[RawAxis], number: int, station: float, child: int) -> None:
    """A way's outer part and its child change places."""
    way, its = ways[number], ways[child]
    inner, outer = _cut(way.curve, station)
    later = [index for index, where in _children(ways, number) if where > station and index != child]
    grandchildren = [index for index, _ in _children(ways, child)]
    ways[number] = replace(way, curve=_joined(inner, its.curve), boll=its.boll, bare_cm=its.bare_cm + station)
    ways[child] = RawAxis(outer, number, way.boll, way.bare_cm - station)
    for index in later:
        ways[index].parent = child
    for index in grandchildren:
        ways[index].parent = number


def _hand_over(ways: list[RawAxis], number: int, station: float, other: int, end: float) -> None:
    """The outer part of a way, and what hangs on it, becomes the other way's; this one ends there."""
    way = ways[number]
    inner, outer = _cut(way.curve, station)
    later = [index for index, where in _children(ways, number) if where > station]
    ways[number] = replace(way, curve=inner, boll=0, bare_cm=np.inf)
    rest = len(ways)
    ways.append(RawAxis(outer, number, way.boll, way.bare_cm - station))
    _append(ways, other, end, outer, rest)
    ways[rest].parent = _GONE
    for index in later:
        ways[index].parent = other


def _take(ways: list[RawAxis], number: int, end: float, child: int) -> None:
    """A way goes on into another one's child, and bears what that bears."""
    _append(ways, number, end, ways[child].curve, child)
    _adopt(ways, child, number)
    ways[child].parent = _GONE


def _append(ways: list[RawAxis], number: int, end: float, curve: Float64, taken: int) -> None:
    """A way goes on into a curve, with the end of the way that this was; its own last stalk stays as a child."""
    way = ways[number]
    inner, stalk = _cut(way.curve, end)
    if way.boll:
        ways.append(RawAxis(stalk, number, way.boll))
    ways[number] = replace(way, curve=_joined(inner, curve), boll=ways[taken].boll, bare_cm=ways[taken].bare_cm + end)


def _adopt(ways: list[RawAxis], child: int, parent: int) -> None:
    for way in ways:
        if way.parent == child:
            way.parent = parent


def _without_rests(ways: list[RawAxis]) -> list[RawAxis]:
    kept = [number for number, way in enumerate(ways) if way.parent != _GONE]
    new = {old: number for number, old in enumerate(kept)} | {-1: -1}
    return [replace(ways[old], parent=new[ways[old].parent]) for old in kept]


def _children(ways: list[RawAxis], number: int) -> list[tuple[int, float]]:
    """Index and path length of the foot of each way that leaves a way."""
    own = [index for index, way in enumerate(ways) if way.parent == number]
    if not own:
        return []
    stations = nearest_on(ways[number].curve, np.array([ways[index].curve[0] for index in own]))[1]
    return [(index, float(station)) for index, station in zip(own, stations, strict=True)]


def _descends(ways: list[RawAxis], number: int, ancestor: int) -> bool:
    while number > 0:
        number = ways[number].parent
        if number == ancestor:
            return True
    return False


def _bend(first: Float64, end: float, second: Float64, start: float) -> float:
    """Angle, degrees, between a curve before a path length and another one after a path length."""
    before = direction(first, max(end - AROUND_CM - WINDOW_CM, 0.0), max(end - AROUND_CM, 0.1))
    after = direction(second, start + AROUND_CM, min(start + AROUND_CM + WINDOW_CM, length_of(second)))
    return angle_deg(before, after)


def _cut(curve: Float64, station: float) -> tuple[Float64, Float64]:
    lengths = path_lengths(curve)
    row = int(np.clip(np.searchsorted(lengths, station), 1, len(curve) - 2))
    return curve[: row + 1], curve[row:]


def _joined(first: Float64, second: Float64) -> Float64:
    """Straight across the last and first of both, which the touch has bent."""
    return resampled(
        np.vstack([first[:-2], second[2:]] if min(len(first), len(second)) > 4 else [first, second]), SPACING_CM
    )
