# SPDX-License-Identifier: Apache-2.0
"""The skeleton for other programs: a PLY of points and edges, and the plant map as an SVG drawing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ..core.plant_map import Axis, BollOnMap, PlantMap
from ..core.scene import Float64
from ..geometry.polylines import length_of
from .labels import CHARACTER, Labels, Spot, around, beside, text_box

INK: Final = "#222"
FRUITING: Final = "#7a4a1e"
VEGETATIVE: Final = "#4a7a2e"
BOLL: Final = "#1f5fa8"
PX_PER_CM: Final = 9.0
MARGIN_PX: Final = 30.0
"""Around the branches' ends; on either side the widest label of a branch comes on top."""
BOLL_PX: Final = 9.0
LETTER_PX: Final = 12
"""Size of the names of branches."""
Px = tuple[float, float]
"""A place on the drawing."""
LEADER_PX: Final = 6.0
"""Distance beyond which a line joins a boll to its label; for a branch, whose label stands off, three times as much."""
RISE: Final = np.tan(np.radians(18.0))
"""Slope at which all branches are drawn."""


def skeleton_ply(plant_map: PlantMap) -> str:
    """An ASCII PLY that Blender (edges) and CloudCompare (points) open, cm in the plant frame.

    Vertices have a radius (0 where unknown), the rank of their branch (0 = stem) and, on the stalk of a boll, its id.
    """
    lines: list[tuple[Float64, Float64, int, int]] = [
        (axis.curve, np.nan_to_num(axis.radii), axis.rank, 0) for axis in plant_map.axes
    ]
    lines += [(boll.stalk, np.zeros(len(boll.stalk)), boll.branch, boll.boll_id) for boll in plant_map.bolls]
    n, edges = sum(len(points) for points, *_ in lines), sum(max(len(points) - 1, 0) for points, *_ in lines)
    text = ["ply", "format ascii 1.0", "comment stem, branches and stalks of bolls, cm, z up", f"element vertex {n}"]
    text += [f"property float {name}" for name in ("x", "y", "z", "radius")]
    text += ["property int branch", "property int boll_id", f"element edge {edges}"]
    text += ["property int vertex1", "property int vertex2", "end_header"]
    for points, radii, branch, boll in lines:
        text += [f"{x:.4f} {y:.4f} {z:.4f} {r:.4f} {branch} {boll}" for (x, y, z), r in zip(points, radii, strict=True)]
    start = 0
    for points, *_ in lines:
        text += [f"{row} {row + 1}" for row in range(start, start + len(points) - 1)]
        start += len(points)
    return "\n".join([*text, ""])


def draw_map(plant_map: PlantMap, title: str = "", most_px: float = np.inf) -> str:
    """The plant map as breeders draw it, an SVG that prints on one page.

    The stem is upright. Branches leave it at their heights, alternately right and left in order of rank, with their
    true lengths. Circles are bolls with their ids; a circle is open if the boll may belong to another branch. The
    figure inside is the inferred fruiting position.

    Args:
        most_px: width that the drawing may have. All branches are narrowed alike to fit; letters and heights stay.
    """
    if not plant_map.axes:
        return ""
    places = _branch_places(plant_map)
    top = float(plant_map.stem.curve[-1, 2])
    ends = np.array([[0.0, 0.0], [0.0, top], *(end for _, end in places.values())])
    beyond = MARGIN_PX + max([0.0, *(CHARACTER * LETTER_PX * len(_name(axis)) for axis in plant_map.branches)])
    extent = np.ptp(ends[:, 0])
    across = min(PX_PER_CM, (most_px - 2 * beyond) / extent) if extent else PX_PER_CM
    left, right = ends[:, 0].min() * across - beyond, ends[:, 0].max() * across + beyond
    high = ends[:, 1].max() * PX_PER_CM + MARGIN_PX + (LETTER_PX if title else 0)

    def at(point: Float64) -> Px:
        return float(point[0] * across - left), float(high - point[1] * PX_PER_CM)

    width, height = right - left, high + MARGIN_PX
    svg = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" '
        f'style="--shape:{width / height:.4f}" role="img" '
        f'aria-label="Plant map: stem, {len(plant_map.branches)} branches, {len(plant_map.bolls)} bolls" '
        'font-family="sans-serif" font-size="13">'
    ]
    svg.append(f'<rect width="{width:.0f}" height="{height:.0f}" fill="#fff"/>')
    if title:
        svg.append(_text((width / 2, 24), title, "middle", INK, 16))
    labels = Labels()
    for mark in range(0, int(top) + 1, 10):
        y = high - mark * PX_PER_CM
        svg.append(f'<line x1="0" x2="{width:.1f}" y1="{y:.1f}" y2="{y:.1f}" stroke="#ddd" stroke-width="1"/>')
        svg.append(_text((4, y - 3), f"{mark} cm", "start", "#888", 11))
        labels.taken.append(text_box(4, y - 3, f"{mark} cm", "start", 11))
    lines = [(at(np.zeros(2)), at(np.array([0.0, top])), INK, 5.0)]
    for axis in plant_map.branches:
        start, end = places[axis.rank]
        lines.append((at(start), at(end), _colour(axis), 3 if axis.kind == "fruiting" else 4.5))
    for line in lines:
        svg.append(_line(*line))
        labels.add_line(*line[:2])
    middles = {boll.boll_id: at(_boll_place(boll, places)) for boll in plant_map.bolls}
    for boll in plant_map.bolls:
        x, y = middles[boll.boll_id]
        svg += _boll(boll, x, y)
        labels.taken.append((x - BOLL_PX, y - BOLL_PX, x + BOLL_PX, y + BOLL_PX))
    for axis in plant_map.branches:
        start, end = places[axis.rank]
        spots = beside(1 if end[0] >= start[0] else -1, LETTER_PX)
        svg += _label(labels, at(end), _name(axis), LETTER_PX, spots, _colour(axis))
    for boll_id, middle in middles.items():
        svg += _label(labels, middle, f"b{boll_id}", 11, around(BOLL_PX, 11), BOLL, BOLL_PX)
    return "\n".join([*svg, "</svg>"])


def _name(axis: Axis) -> str:
    return f"{axis.rank}{'' if axis.kind == 'fruiting' else ' veg.'} · {length_of(axis.curve):.0f} cm"


def _colour(axis: Axis) -> str:
    return FRUITING if axis.kind == "fruiting" else VEGETATIVE


def _label(
    labels: Labels, at: Px, text: str, size: int, spots: Sequence[Spot], colour: str, radius: float = 0
) -> list[str]:
    """A text at a free place, with a thin line to what it names, of a radius, if that is not beside the text."""
    spot = labels.place(at, text, size, spots)
    left, top, right, bottom = text_box(spot.x, spot.y, text, spot.anchor, size)
    way = np.clip(at, [left, top], [right, bottom]) - at
    away = float(np.hypot(*way))
    svg = []
    if away > (radius + LEADER_PX if radius else 3 * LEADER_PX):
        start, end = at + way * radius / away, at + way
        svg.append(_line((start[0], start[1]), (end[0], end[1]), colour, 0.8))
    return [*svg, _text((spot.x, spot.y), text, spot.anchor, colour, size)]


def _branch_places(plant_map: PlantMap) -> dict[int, tuple[Float64, Float64]]:
    """Rank -> start and end on the drawing, cm; a branch of a branch leaves it downwards and keeps its side."""
    places: dict[int, tuple[Float64, Float64]] = {}
    side = 1
    waiting: Sequence[Axis] = [axis for axis in plant_map.branches if axis.parent == 0]
    for axis in waiting:
        start = np.array([0.0, axis.curve[0, 2]])
        rise = RISE if axis.kind == "fruiting" else 1.6
        places[axis.rank] = start, start + _way(side, rise) * length_of(axis.curve)
        side = -side
    left = [axis for axis in plant_map.branches if axis.parent != 0]
    while left:
        ready = [axis for axis in left if axis.parent in places]
        if not ready:
            break
        for axis in ready:
            start, end = places[axis.parent]
            parent = plant_map.axes[axis.parent]
            gap = np.linalg.norm(parent.curve - axis.curve[0], axis=1)
            share = float(np.argmin(gap)) / max(len(parent.curve) - 1, 1)
            foot = start + share * (end - start)
            outwards = 1 if end[0] >= start[0] else -1
            places[axis.rank] = foot, foot + _way(outwards, 0.1) * length_of(axis.curve)
        left = [axis for axis in left if axis.rank not in places]
    return places


def _way(side: int, rise: float) -> Float64:
    way = np.array([side, rise])
    unit: Float64 = way / np.linalg.norm(way)
    return unit


def _boll_place(boll: BollOnMap, places: dict[int, tuple[Float64, Float64]]) -> Float64:
    """(2,) cm on the drawing."""
    if not boll.branch:
        return np.array([0.0, float(boll.stalk[0, 2])])
    start, end = places[boll.branch]
    length = float(np.linalg.norm(end - start))
    return np.asarray(start + (end - start) * min(boll.path_cm / max(length, 1e-6), 1.0))


def _boll(boll: BollOnMap, x: float, y: float) -> list[str]:
    inside, rim = ("#fff", BOLL) if boll.doubtful else (BOLL, "#fff")
    svg = [
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{BOLL_PX:g}" fill="{inside}" stroke="{rim}"><title>boll {boll.boll_id}'
        f"{', its branch is doubtful' if boll.doubtful else ''}</title></circle>"
    ]
    if boll.position:
        figure = f"{boll.position}" if boll.position < 3 else "3+"
        svg.append(_text((x, y + 4), figure, "middle", rim, 11))
    return svg


def _line(start: Px, end: Px, colour: str, width: float) -> str:
    return (
        f'<line x1="{start[0]:.1f}" y1="{start[1]:.1f}" x2="{end[0]:.1f}" y2="{end[1]:.1f}" stroke="{colour}" '
        f'stroke-width="{width:g}" stroke-linecap="round"/>'
    )


def _text(place: Px, text: str, anchor: str, colour: str, size: int) -> str:
    from xml.sax.saxutils import escape

    # A style, because the report's own style of texts overrides attributes.
    return (
        f'<text x="{place[0]:.1f}" y="{place[1]:.1f}" text-anchor="{anchor}" '
        f'style="fill:{colour};font-size:{size}px">{escape(text)}</text>'
    )
