# SPDX-License-Identifier: Apache-2.0
"""Pairs the parts of paths anew where branches touch or fork, so that each branch goes on straight.

Shortest paths go from one branch into another wherever these touch, and at a fork the longest path takes the parent's
inner part, whichever of the two it continues. Wood goes on straight, so at every touch and fork the parts are paired
anew if that saves bends. `loops` has already handled the touches that close a loop of wood.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..core.scene import Float64
from ..geometry.polylines import angle_deg, direction, length_of, nearest_on, path_lengths, resampled
from .skeleton import PETIOLE_CM, SPACING_CM, RawAxis

TOUCH_CM: Final = 2.0
"""Largest distance of the centre lines of branches that may touch."""
ENDS_CM: Final = 2.0
"""Largest distance from the touch of the end of a path that took nothing over; `STALK_CM` if it found a boll there."""
STALK_CM: Final = 5.0
"""Longest stalk of a boll on a branch. A longer path to a boll is a branch of its own."""
BESIDE_CM: Final = 4.0
"""Largest distance of a fork that belongs to the touch."""
INNER_CM: Final = 1.5
"""Distance from its foot within which a path only touches its parent."""
TWIG_CM: Final = 3.5
"""Longest outer part that is a stalk, scar or tip, and may bend freely; `STALK_CM` if it leads to a boll."""
TIP_CM: Final = 2.0
TIP_GAIN_DEG: Final = 15.0
"""Least length of a tip that is the parent's own if it goes on where the parent pointed, and the bend that this has to
save: the top of a vegetative branch is shorter than the last branch that leaves it."""
LEAST_BLADE_CM: Final = 1.0
"""Least length of a blade at the end of a tip."""
AROUND_CM: Final = 0.8
WINDOW_CM: Final = 3.0
"""Distance from the place where paths meet at which directions are taken, and length of the piece for them."""
DEAD_END_DEG: Final = 40.0
"""Bend that is as unlikely as a branch that ends at a touch, ..."""
BOLL_END_DEG: Final = 15.0
"""... and bend that is as unlikely as one that ends there with a boll."""
VEGETATIVE_FOOT: Final = 0.5
"""Vegetative branches leave the stem in its lower half. Others do not bear branches, ..."""
BEARING_DEG: Final = 40.0
"""... and one that does is as unlikely as this bend."""
GAIN_DEG: Final = 8.0
"""Bends that a new pairing must save at least."""
MOST: Final = 100
_GONE: Final = -2
"""Parent of a path that is now a part of another one."""


@dataclass(frozen=True)
class _Pairing:
    """Another pairing of the parts that meet at a place."""

    gain_deg: float
    apply: Callable[[], None]


def untangle_paths(raw: list[RawAxis]) -> list[RawAxis]:
    """The paths, paired so that they go on straight; the stem stays first."""
    ways = [replace(way) for way in raw]
    touches = _Touches()
    for _ in range(MOST):
        better = (pairing for pairing in _pairings(ways, touches) if pairing.gain_deg >= GAIN_DEG)
        best = max(better, key=lambda pairing: pairing.gain_deg, default=None)
        if best is None:
            break
        best.apply()
        ways = _without_rests(ways)
    return ways


def _apart(ways: list[RawAxis], one: int, other: int) -> bool:
    """Whether neither of two paths grows on the other."""
    return (
        one != other
        and ways[other].parent != _GONE
        and not (_descends(ways, one, other) or _descends(ways, other, one))
    )


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
    """Whether the part beyond a path length is more than a stalk of a boll or a leaf, a scar or a tip."""
    is_leaf = way.bare_cm - station < PETIOLE_CM
    return not is_leaf and length_of(way.curve) - station > (STALK_CM if way.boll else TWIG_CM)


def _is_tip(way: RawAxis) -> bool:
    """Whether a path may be the end of its parent: it is neither a boll's stalk nor a leaf's."""
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
    """Places where paths touch. They are searched once for each pair of curves, because most curves do not change."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, int, bool], tuple[Float64, Float64, tuple[float, float] | None]] = {}

    def between(self, way: RawAxis, other: RawAxis) -> tuple[float, float] | None:
        key = id(way.curve), id(other.curve), bool(other.boll)
        if key not in self._known:
            # The curves are kept; otherwise a new curve might get the id of a deleted one.
            self._known[key] = way.curve, other.curve, _touch(way, other)
        return self._known[key][2]


def _touch(way: RawAxis, other: RawAxis) -> tuple[float, float] | None:
    """Path lengths of the touch along a path and along another that ends beside it; None if they do not touch."""
    lengths = path_lengths(other.curve)
    tail = lengths > max(lengths[-1] - (STALK_CM if other.boll else ENDS_CM), INNER_CM)
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
    return station, float(lengths[tail][nearest])


def _at_touch(
    ways: list[RawAxis],
    number: int,
    other: int,
    touch: tuple[float, float],
    forks: list[tuple[int, float]],
    odd_deg: float,
) -> Iterator[_Pairing]:
    """Pairings in which the other path goes on into this one's outer part, or into a child that leaves at the touch.

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
    """Exchange a path's outer part and its child."""
    way, its = ways[number], ways[child]
    inner, outer = _cut(way.curve, station)
    later = [index for index, where in _children(ways, number) if where > station and index != child]
    grandchildren = [index for index, _ in _children(ways, child)]
    ways[number] = replace(way, curve=joined_straight(inner, its.curve), boll=its.boll, bare_cm=its.bare_cm + station)
    ways[child] = RawAxis(outer, number, way.boll, way.bare_cm - station)
    for index in later:
        ways[index].parent = child
    for index in grandchildren:
        ways[index].parent = number


def _hand_over(ways: list[RawAxis], number: int, station: float, other: int, end: float) -> None:
    """Give the outer part of a path, with all that hangs on it, to the other path; this path ends there."""
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
    """Let a path go on into another one's child, and take over the child's own children."""
    _append(ways, number, end, ways[child].curve, child)
    _adopt(ways, child, number)
    ways[child].parent = _GONE


def _append(ways: list[RawAxis], number: int, end: float, curve: Float64, taken: int) -> None:
    """Let a path go on into a curve, with the end of the curve's former path; its own last stalk stays as a child."""
    way = ways[number]
    inner, stalk = _cut(way.curve, end)
    if way.boll:
        ways.append(RawAxis(stalk, number, way.boll))
    its = ways[taken]
    ways[number] = replace(way, curve=joined_straight(inner, curve), boll=its.boll, bare_cm=its.bare_cm + end)


def _adopt(ways: list[RawAxis], child: int, parent: int) -> None:
    for way in ways:
        if way.parent == child:
            way.parent = parent


def _without_rests(ways: list[RawAxis]) -> list[RawAxis]:
    kept = [number for number, way in enumerate(ways) if way.parent != _GONE]
    new = {old: number for number, old in enumerate(kept)} | {-1: -1}
    return [replace(ways[old], parent=new[ways[old].parent]) for old in kept]


def _children(ways: list[RawAxis], number: int) -> list[tuple[int, float]]:
    """Index and path length of the foot of each path that leaves a path."""
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


def joined_straight(first: Float64, second: Float64) -> Float64:
    """Join both curves, straight across the end of one and the start of the other, which the touch has bent."""
    return resampled(
        np.vstack([first[:-2], second[2:]] if min(len(first), len(second)) > 4 else [first, second]), SPACING_CM
    )
