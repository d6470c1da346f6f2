# SPDX-License-Identifier: Apache-2.0
"""Finds the scale by sections of the table's points, without photos.

`scale_from_central_section` is that of Cotton3DGaussians, 2.5: an oriented box around the table's cloud, 11 sections
along it, a second oriented box around the central section. Its length L is the table's width, so that β = L / 60 cm;
the 120 cm of the other side are not used. The paper leaves three things open. Here the cloud of the table consists of
the points on its plane, inside its rectangle and a rim; the oriented box is the tightest one; and the error of β is the
scatter of all sections' lengths, at least 1 %.

`scale_from_all_sections` also uses the rest: medians over sections along both sides, and both known lengths.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float64
from ..geometry.boxes import Box, min_area_rectangle, standing_box
from ..geometry.planes import TOLERANCE as ON_PLANE
from .rectangle import Rectangle
from .references import LEAST_ERROR, NoReference, Reference

SECTIONS: Final = 11
LEAST_POINTS: Final = 20
"""Least number of points in a section; fewer do not reach from edge to edge."""
RIM: Final = 0.1
"""Width of the rim around the rectangle in which points still belong to the table, in widths of the table."""
TRIM: Final = 0.002
"""Share of a section's points at either end that count as floaters."""
MAX_ERROR: Final = 0.05
POINT_PX: Final = 3
LEAST_ERROR_OF_ONE: Final = 0.01
"""Least relative error of the central section. No other length checks it, and points end before an edge or lie beyond
it."""


@dataclass(frozen=True)
class TableSections:
    """The table's cloud in 11 sections along its oriented box."""

    cloud: Float64
    """(N, 3) su, in the frame of the table's rectangle."""
    box: Box
    number: NDArray[np.int64]
    """(N,) section of each point, 0 to 10."""
    boxes: tuple[Box | None, ...]
    """The box around each section; None for a section with too few points."""

    @property
    def central(self) -> Box | None:
        return self.boxes[SECTIONS // 2]


def cut_table(points: NDArray[Any], table: Rectangle, radius: float) -> TableSections | NoReference:
    """Box and sections of the table's cloud.

    Args:
        points: (N, 3) su. table: roughly where it is. radius: of the cameras' orbit, su.
    """
    cloud = _points_on_table(points, table, radius)
    if len(cloud) < LEAST_POINTS:
        return NoReference("too few points lie on the table")
    box = standing_box(cloud)
    along = (cloud - box.centre) @ box.axes[0] / max(box.sides[0], np.finfo(float).tiny) + 0.5
    number = np.clip(np.floor(along * SECTIONS), 0, SECTIONS - 1).astype(np.int64)
    parts = (cloud[number == k] for k in range(SECTIONS))
    boxes = tuple(standing_box(part) if len(part) >= LEAST_POINTS else None for part in parts)
    return TableSections(cloud, box, number, boxes)


def scale_from_central_section(sections: TableSections, width_cm: float) -> Reference | NoReference:
    """The known width over the length of the central section's box (Cotton3DGaussians, 2.5: 1 / β)."""
    if sections.central is None:
        return NoReference("too few points lie on the middle of the table")
    length_su = float(sections.central.sides[0])
    lengths = np.array([box.sides[0] for box in sections.boxes if box])
    spread = 1.4826 * float(np.median(np.abs(lengths / length_su - 1)))
    if spread > MAX_ERROR:
        return NoReference(f"the sections of the table are {spread:.0%} longer or shorter than the central one")
    evidence = {"width_su": length_su, "spread": spread, "sections": len(lengths)}
    return Reference("sections", width_cm / length_su, max(spread, LEAST_ERROR_OF_ONE), evidence)


def scale_from_all_sections(
    points: NDArray[Any], table: Rectangle, length_cm: float, width_cm: float, radius: float
) -> Reference | NoReference:
    """The mean of the ratios of the table's known to its measured length and width.

    Sections are cut along both sides. Those that run along the table give its length, those that run across it give its
    width, each as the median over the sections.

    Args:
        points: (N, 3) su. table: roughly where it is. radius: of the cameras' orbit, su.
    """
    flat = _points_on_table(points, table, radius)[:, :2]
    sizes, spreads = [], []
    for along in (0, 1):
        extents = measure_sections(flat, along, table.sides[2 * (1 - along) :][:2])
        if len(extents) < SECTIONS / 2:
            return NoReference("too few points lie on the table")
        sizes.append(float(np.median(extents)))
        spreads.append(1.4826 * float(np.median(np.abs(extents / sizes[-1] - 1))))
    ratios = np.array([length_cm, width_cm]) / sizes
    mean = float(ratios.mean())
    error = max(float(abs(ratios[0] - ratios[1])) / 2 / mean, *spreads, LEAST_ERROR)
    if error > MAX_ERROR:
        return NoReference(f"length and width of the table's sections disagree by {2 * error:.0%}")
    evidence = {"length_su": sizes[0], "width_su": sizes[1], "spread": spreads}
    return Reference("all-sections", mean, error, evidence)


def measure_sections(flat: Float64, along: int, limits: Float64) -> Float64:
    """Lengths along axis `along` of the boxes around up to 11 sections that lie side by side across it.

    Args:
        flat: (N, 2) places on the table. limits: (2,) of the table on the other axis.
    """
    edges = np.linspace(limits[0], limits[1], SECTIONS + 1)
    extents = []
    for low, high in pairwise(edges):
        section = flat[(flat[:, 1 - along] >= low) & (flat[:, 1 - along] < high)]
        if len(section) < LEAST_POINTS:
            continue
        ends = np.quantile(section[:, along], [TRIM, 1 - TRIM])
        box = min_area_rectangle(section[(section[:, along] >= ends[0]) & (section[:, along] <= ends[1])])
        extents.append(float(box.sides[int(np.abs(box.axes[:, along]).argmax())]))
    return np.array(extents)


def _points_on_table(points: NDArray[Any], table: Rectangle, radius: float) -> Float64:
    """(N, 3) su in the frame of the rectangle: the points on its plane, inside it or on a rim around it."""
    places = table.places(points)
    rim = RIM * table.width
    x, y = places[:, 0], places[:, 1]
    inside = (x > table.sides[0] - rim) & (x < table.sides[1] + rim)
    inside &= (y > table.sides[2] - rim) & (y < table.sides[3] + rim)
    on_table: Float64 = places[inside & (np.abs(places[:, 2]) < ON_PLANE * radius)]
    return on_table


def draw_sections(sections: TableSections, width_px: int = 960) -> NDArray[np.uint8]:
    """(H, W, 3) the table's cloud from above, a colour a section, the central section's box (as in Fig. 5 c and d)."""
    import cv2

    # From above: the box's longest axis to the right, the next one upwards.
    x, y, thin = sections.box.axes
    axes = np.stack([x, y if thin[2] < 0 else -y])
    half = 0.55 * sections.box.sides[:2]
    px_per_su = (width_px - 1) / (2 * half[0])

    def pixels(points: NDArray[Any]) -> NDArray[np.int32]:
        from_corner = (points - sections.box.centre) @ axes.T + half
        rounded: NDArray[np.int32] = np.round(from_corner * px_per_su).astype(np.int32)
        return rounded

    canvas = np.full((max(2, round(2 * half[1] * px_per_su)), width_px, 3), 255, np.uint8)
    # Single pixels would hardly show.
    places = np.clip(pixels(sections.cloud), 0, (width_px - POINT_PX, len(canvas) - POINT_PX))
    # Alternating, so that neighbours differ; the central one stands out.
    colours = np.array([[120, 140, 160], [180, 195, 205]], np.uint8)[sections.number % 2]
    colours[sections.number == SECTIONS // 2] = (220, 120, 0)
    for dx, dy in np.ndindex(POINT_PX, POINT_PX):
        canvas[places[:, 1] + dy, places[:, 0] + dx] = colours
    if sections.central:
        outline = pixels(_base(sections.central)).reshape(-1, 1, 2)
        cv2.polylines(canvas, [outline], True, (160, 0, 160), 2, cv2.LINE_AA)
    return canvas


def _base(box: Box) -> Float64:
    """(4, 3) corners of the face that the two longer sides of a box span, through its middle."""
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    return box.centre + signs * box.sides[:2] @ box.axes[:2]
