# SPDX-License-Identifier: Apache-2.0
"""Opens the loops of wood that touching branches close, so that each branch goes on straight.

Shortest paths open a loop where the two ways round it are equally long, which is seldom where branches touch. The piece
between is then traced the wrong way round, and the piece beyond the touch goes to the branch that reached it first.
Here every loop is opened anew at one of its forks, so that the resulting branches are the most likely: few bends, few
dead ends, and no branches on fruiting branches.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import reduce
from itertools import pairwise, product
from typing import Final

import numpy as np

from ..core.scene import Float64
from ..geometry.polylines import angle_deg, direction, length_of, nearest_on, piece_between, resampled
from .graph import MergedNumbers
from .skeleton import PETIOLE_CM, SPACING_CM, Meeting, RawAxis
from .untangle import (
    AROUND_CM,
    BEARING_DEG,
    BOLL_END_DEG,
    DEAD_END_DEG,
    GAIN_DEG,
    STALK_CM,
    TWIG_CM,
    joined_straight,
    leaves_low,
)

ONE_FORK_CM: Final = 2.0
"""Largest distance of forks on a path that count as one."""
SAME_CM: Final = 0.01
"""The same distance on the stem."""
WINDOW_CM: Final = 2.5
"""Length of the piece over which a direction is taken, `AROUND_CM` from a fork."""
MOST_DEG: Final = 80.0
"""Bend beyond which bends do not become less likely."""
ROUNDS: Final = 3
HANGING_DEG: Final = 3.0
"""Bend that is as unlikely as each centimetre between a branch and the foot of a stalk or twig that hangs on it at a
fork. Where branches with bolls touch, each gets the bolls that are nearer to it."""
HANGING_CM: Final = 3.0
"""Length of the branch on either side of the fork that counts for this."""
MOST_ARMS: Final = 5
"""Largest number of a fork's arms besides the two of the loop; a fork with more stays as it is."""

Arm = tuple[int, int]
"""A segment and one of its ends, 0 or 1."""
Opening = frozenset[Arm]
"""An opening of a loop: the arms of a fork that separate from the rest."""


@dataclass(frozen=True)
class _Segment:
    """A piece of a way between two forks."""

    way: int
    start: float
    end: float
    """Path lengths of start and end on the path."""


@dataclass
class _Line:
    """A branch as it comes out of the forks."""

    parent: int
    arms: list[Arm] = field(default_factory=list)
    """Where it enters each of its segments."""


def open_loops(ways: list[RawAxis], meetings: list[Meeting]) -> list[RawAxis]:
    """The paths, with every loop that the meetings close opened so that the branches go on straight."""
    if not meetings:
        return ways
    return _Forks(ways, meetings).best()


def _arms_of(forks: dict[Arm, int]) -> dict[int, list[Arm]]:
    """The arms that come together in each fork."""
    arms: dict[int, list[Arm]] = {}
    for arm, fork in forks.items():
        arms.setdefault(fork, []).append(arm)
    return arms


class _Forks:
    """Segments of paths, and the forks where they come together."""

    def __init__(self, ways: list[RawAxis], meetings: list[Meeting]) -> None:
        stubs = [RawAxis(resampled(meeting.link, SPACING_CM), 0) for meeting in meetings if meeting.one == 0]
        self.ways, self.n_ways = [*ways, *stubs], len(ways)
        """The paths, followed by the remaining stubs of branches beside the stem."""
        self.segments: list[_Segment] = []
        self.first: dict[Arm, int] = {}
        """The fork of each arm in the given paths."""
        self._angles: dict[tuple[Arm, Arm], float] = {}
        self._distances: dict[tuple[Arm, Arm, Arm], float] = {}
        forks = MergedNumbers()
        self.root = forks.new()
        events: list[list[tuple[float, int]]] = [[] for _ in self.ways]
        """Path length and number of each fork on each way."""
        self._place_feet_and_tips(events, forks)
        tips = {own[0][1] for own in events[1:]}
        ends = list(self._place_meetings(events, forks, meetings))
        self._cut(events, forks, tips)
        loose = {end for pair in ends for end in pair} & tips
        self.loose = {arm for arm, number in self.first.items() if number in loose}
        """Arms at tips where the wood goes on by a meeting."""
        self.first = {arm: forks.of(number) for arm, number in self.first.items()}
        self.ends_of = [(forks.of(one), forks.of(other)) for one, other in ends]
        """The forks that each meeting joins."""

    def _place_feet_and_tips(self, events: list[list[tuple[float, int]]], forks: MergedNumbers) -> None:
        for own, way in zip(events[1:], self.ways[1:], strict=True):
            own += [(length_of(way.curve), forks.new()), (0.0, forks.new())]
        for number, way in enumerate(self.ways[1:], start=1):
            foot = events[number][1][1]
            if way.parent == 0:
                forks.merge(self.root, foot)
            else:
                on_parent = self._event(events, forks, way.parent, way.curve[0])
                forks.merge(on_parent, foot)

    def _event(self, events: list[list[tuple[float, int]]], forks: MergedNumbers, way: int, place: Float64) -> int:
        """Add a fork on a path, nearest to a place and not quite at an end; its number."""
        station = float(nearest_on(self.ways[way].curve, place[None])[1][0])
        events[way].append((min(station, events[way][0][0] - 0.1), forks.new()))
        return events[way][-1][1]

    def _place_meetings(
        self, events: list[list[tuple[float, int]]], forks: MergedNumbers, meetings: list[Meeting]
    ) -> Iterator[tuple[int, int]]:
        """The two forks of each meeting."""
        stub = self.n_ways
        for meeting in meetings:
            if meeting.one == 0:
                one, stub = events[stub][0][1], stub + 1
            else:
                one = self._tip_or_event(events, forks, meeting.one, meeting.link[0])
            yield one, self._tip_or_event(events, forks, meeting.other, meeting.link[-1])

    def _tip_or_event(
        self, events: list[list[tuple[float, int]]], forks: MergedNumbers, way: int, place: Float64
    ) -> int:
        length, tip = events[way][0]
        station = float(nearest_on(self.ways[way].curve, place[None])[1][0])
        if not self.ways[way].boll and station > length - ONE_FORK_CM:
            return tip
        return self._event(events, forks, way, place)

    def _cut(self, events: list[list[tuple[float, int]]], forks: MergedNumbers, tips: set[int]) -> None:
        """Merge forks that are near each other on a path, and cut the paths at all forks."""
        for own in events[1:]:
            for (before, one), (after, other) in pairwise(sorted(own)):
                at_root = forks.of(self.root) in (forks.of(one), forks.of(other))
                if other not in tips and after - before <= (SAME_CM if at_root else ONE_FORK_CM):
                    forks.merge(one, other)
        self.root = forks.of(self.root)
        for number, own in enumerate(events):
            for (before, one), (after, other) in pairwise(sorted(own)):
                if forks.of(one) != forks.of(other):
                    self.first[len(self.segments), 0], self.first[len(self.segments), 1] = one, other
                    self.segments.append(_Segment(number, before, after))

    def best(self) -> list[RawAxis]:
        """The paths of the likeliest openings, chosen for each loop in turn while the others keep their last one."""
        state: list[Opening | None] = [None] * len(self.ends_of)
        cost, lines = self._judged(self._forks(state))
        for _ in range(ROUNDS):
            before = cost
            for number in range(len(state)):
                tried = [
                    (*self._judged(self._forks(other)), other)
                    for opening in self._openings(state, number)
                    for other in [[*state[:number], opening, *state[number + 1 :]]]
                ]
                best = min(tried, key=lambda item: item[0], default=None)
                if best is not None and best[0] < cost - GAIN_DEG:
                    cost, lines, state = best
            if cost == before:
                break
        return self._ways(lines) if any(state) else self.ways[: self.n_ways]

    def _forks(self, state: list[Opening | None]) -> dict[Arm, int]:
        """The fork of each arm with these openings of the loops."""
        forks, new = dict(self.first), 1 + max(self.first.values())
        for number, opening in enumerate(state):
            if opening is None:
                continue
            self._join(forks, number)
            for arm in opening:
                forks[arm] = new
            new += 1
        return forks

    def _join(self, forks: dict[Arm, int], number: int) -> None:
        one, other = self.ends_of[number]
        for arm, fork in forks.items():
            if fork == other:
                forks[arm] = one

    def _openings(self, state: list[Opening | None], number: int) -> Iterator[Opening]:
        """All ways to open the loop of one meeting, the other loops being open."""
        forks = self._forks([*state[:number], None, *state[number + 1 :]])
        to_root = self._to_root(forks)
        one, other = self.ends_of[number]
        ways = [self._upwards(forks, to_root, end) for end in (one, other)]
        if not all(ways) or one == other:
            return
        shared = {forks[arm[0], 1 - arm[1]] for arm in ways[0]} & {forks[arm[0], 1 - arm[1]] for arm in ways[1]}
        inner = [self._before(forks, way, shared) for way in ways]
        if not all(inner):
            return
        self._join(forks, number)
        at = _arms_of(forks)
        yield from self._parted(at[one], inner[0][0], inner[1][0])
        for way in inner:
            for outer, arm in pairwise(way):
                yield from self._parted(at[forks[arm]], arm, (outer[0], 1 - outer[1]))

    @staticmethod
    def _parted(arms: list[Arm], one: Arm, other: Arm) -> Iterator[Opening]:
        """All ways to divide the arms of a fork that separate the two of the loop."""
        rest = [arm for arm in arms if arm not in (one, other)]
        if len(rest) <= MOST_ARMS:
            for chosen in product((False, True), repeat=len(rest)):
                yield frozenset([other, *(arm for arm, taken in zip(rest, chosen, strict=True) if taken)])

    def _to_root(self, forks: dict[Arm, int]) -> dict[int, Arm]:
        """For each fork that is reached, its arm towards the stem."""
        at = _arms_of(forks)
        towards: dict[int, Arm] = {}
        waiting = [self.root]
        while waiting:
            fork = waiting.pop()
            for segment, end in at.get(fork, []):
                far = forks[segment, 1 - end]
                if far != self.root and far not in towards and towards.get(fork) != (segment, end):
                    towards[far] = (segment, 1 - end)
                    waiting.append(far)
        return towards

    @staticmethod
    def _upwards(forks: dict[Arm, int], to_root: dict[int, Arm], fork: int) -> list[Arm]:
        """The arms that lead from a fork to the stem."""
        way = []
        while fork in to_root:
            way.append(to_root[fork])
            fork = forks[to_root[fork][0], 1 - to_root[fork][1]]
        return way

    @staticmethod
    def _before(forks: dict[Arm, int], way: list[Arm], shared: set[int]) -> list[Arm]:
        """The part of a way to the stem before it comes to a shared fork."""
        kept = []
        for arm in way:
            kept.append(arm)
            if forks[arm[0], 1 - arm[1]] in shared:
                break
        return kept

    def _judged(self, forks: dict[Arm, int]) -> tuple[float, list[_Line]]:
        """How unlikely the resulting branches are, degrees, and the branches."""
        at = _arms_of(forks)
        cost, lines = 0.0, list[_Line]()
        waiting = [(arm, -1, False) for arm in sorted(at.get(self.root, []))]
        seen = 0
        while waiting:
            arm, parent, is_twig = waiting.pop()
            line = _Line(parent)
            number = len(lines)
            lines.append(line)
            may_bear = parent < 0 and leaves_low(self.ways[self.segments[arm[0]].way].curve, self.ways[0].curve)
            while True:
                line.arms.append(arm)
                seen += 1
                if seen > len(self.segments):
                    return np.inf, lines  # a loop is left
                entered = (arm[0], 1 - arm[1])
                fork = forks[entered]
                if fork == self.root:
                    return np.inf, lines
                outs = [other for other in at[fork] if other != entered]
                if not outs:
                    is_boll = self._is_boll(entered)
                    if not is_twig or entered in self.loose or not self._is_tip(entered):
                        cost += BOLL_END_DEG if is_boll else DEAD_END_DEG
                    break
                long = [other for other in outs if not self._is_twig(forks, at, other)]
                onward = self._onward(entered, long or outs, bool(long))
                if long:
                    cost += min(self._bend(entered, onward), MOST_DEG)
                for other in outs:
                    if other != onward:
                        cost += BEARING_DEG * (other in long and not may_bear)
                        cost += HANGING_DEG * self._away_cm(entered, onward, other)
                        waiting.append((other, number, other not in long))
                arm = onward
        return (cost if seen == len(self.segments) else np.inf), lines

    def _onward(self, entered: Arm, outs: list[Arm], straight: bool) -> Arm:
        """The arm into which a branch goes on: that of its own path, unless another is clearly straighter."""
        if straight:
            bends = {arm: self._bend(entered, arm) for arm in outs}
            least = min(bends, key=lambda arm: (bends[arm], arm))
        else:
            bends = dict.fromkeys(outs, 0.0)
            least = max(outs, key=lambda arm: (self._is_boll((arm[0], 1 - arm[1])), self._length(arm), arm))
        own = [arm for arm in outs if self._continues(entered, arm)]
        return own[0] if own and bends[own[0]] < bends[least] + GAIN_DEG else least

    def _continues(self, entered: Arm, arm: Arm) -> bool:
        one, other = self.segments[entered[0]], self.segments[arm[0]]
        return one.way == other.way and entered[1] != arm[1]

    def _is_twig(self, forks: dict[Arm, int], at: dict[int, list[Arm]], arm: Arm) -> bool:
        """Whether an arm only leads to a stalk, scar, dry tip or leaf."""
        far = (arm[0], 1 - arm[1])
        if len(at[forks[far]]) > 1 or forks[far] == self.root:
            return False
        segment = self.segments[arm[0]]
        is_leaf = arm[1] == 0 and self.ways[segment.way].bare_cm - segment.start < PETIOLE_CM
        return is_leaf or self._length(arm) <= (STALK_CM if self._is_boll(far) else TWIG_CM)

    def _is_tip(self, arm: Arm) -> bool:
        """Whether a way ends here."""
        segment = self.segments[arm[0]]
        return arm[1] == 1 and segment.end > length_of(self.ways[segment.way].curve) - 1e-6

    def _is_boll(self, arm: Arm) -> bool:
        """Whether a way ends here with a boll."""
        return self._is_tip(arm) and self.ways[self.segments[arm[0]].way].boll > 0

    def _length(self, arm: Arm) -> float:
        segment = self.segments[arm[0]]
        return segment.end - segment.start

    def _away_cm(self, entered: Arm, onward: Arm, hanging: Arm) -> float:
        """Distance, cm, from the branch that goes on at a fork to the beginning of an arm that hangs there."""
        key = entered, onward, hanging
        if key not in self._distances:
            branch = np.vstack([self._beginning(entered)[::-1], self._beginning(onward)])
            self._distances[key] = float(nearest_on(branch, self._beginning(hanging)[:1])[0][0])
        return self._distances[key]

    def _beginning(self, arm: Arm) -> Float64:
        """(N, 3) cm, of a segment from a fork on."""
        segment = self.segments[arm[0]]
        curve, start, end = self.ways[segment.way].curve, segment.start, segment.end
        if arm[1] == 0:
            return piece_between(curve, start, min(start + HANGING_CM, end))
        return piece_between(curve, end, max(end - HANGING_CM, start))

    def _bend(self, entered: Arm, arm: Arm) -> float:
        key = entered, arm
        if key not in self._angles:
            self._angles[key] = angle_deg(-self._outwards(entered), self._outwards(arm))
        return self._angles[key]

    def _outwards(self, arm: Arm) -> Float64:
        """(3,) unit vector from a fork into a segment, or beyond a short one along its path."""
        segment = self.segments[arm[0]]
        curve = self.ways[segment.way].curve
        length = length_of(curve)
        if arm[1] == 0:
            start = min(segment.start + AROUND_CM, length - 0.1)
            return direction(curve, start, min(start + WINDOW_CM, length))
        start = max(segment.end - AROUND_CM, 0.1)
        return -direction(curve, max(start - WINDOW_CM, 0.0), start)

    def _ways(self, lines: list[_Line]) -> list[RawAxis]:
        found, index_of = [self.ways[0]], {-1: 0}
        for number, line in enumerate(lines):
            if len(line.arms) == 1 and self.segments[line.arms[0][0]].way >= self.n_ways:
                continue  # a stub from which no path goes on
            index_of[number] = len(found)
            pieces: list[tuple[int, float, float]] = []
            for segment, end in line.arms:
                its = self.segments[segment]
                start, stop = (its.start, its.end) if end == 0 else (its.end, its.start)
                if pieces and pieces[-1][0] == its.way and (pieces[-1][1] < pieces[-1][2]) == (end == 0):
                    pieces[-1] = (its.way, pieces[-1][1], stop)
                else:
                    pieces.append((its.way, start, stop))
            curves = [piece_between(self.ways[way].curve, start, stop) for way, start, stop in pieces]
            curve = reduce(joined_straight, curves)
            last, start, stop = pieces[-1]
            way = self.ways[last]
            at_tip = stop > length_of(way.curve) - 1e-6
            bare_cm = way.bare_cm - max(start, stop) + length_of(curve) if at_tip else np.inf
            found.append(RawAxis(curve, index_of[line.parent], way.boll if at_tip else 0, bare_cm))
        return found
