"""The scale from the table's points alone, cut into sections (seed paper Cotton3DGaussians).

The paper measures the table by oriented bounding boxes of 11 sections of its points and takes the mean of the two
ratios of known to measured sides. It does not say along which side the sections are cut: here along both, so that those
that run along the table give its length and those that run across its width, each as the median over its sections.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float64
from ..geometry.boxes import min_area_rectangle
from ..geometry.planes import TOLERANCE as ON_PLANE
from .rectangle import Rectangle
from .references import LEAST_ERROR, NoReference, Reference

SECTIONS = 11
LEAST_POINTS = 20
"""In a section; fewer do not reach from edge to edge."""
TRIM = 0.002
"""Share of a section's points at either end that are taken for floaters."""
MAX_ERROR = 0.05


def scale_from_sections(
    points: NDArray, table: Rectangle, length_cm: float, width_cm: float, radius: float
) -> Reference | NoReference:
    """The mean of the ratios of the table's known to its measured length and width.

    Args:
        points: (N, 3) su. table: roughly where it is. radius: of the cameras' orbit, su.
    """
    places = table.places(points)
    places = places[np.abs(places[:, 2]) < ON_PLANE * radius]
    rim = 0.1 * table.width
    x, y = places[:, 0], places[:, 1]
    inside = (x > table.sides[0] - rim) & (x < table.sides[1] + rim)
    inside &= (y > table.sides[2] - rim) & (y < table.sides[3] + rim)
    flat = places[inside, :2]
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
    return Reference("sections", mean, error, evidence)


def measure_sections(flat: Float64, along: int, limits: NDArray) -> Float64:
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
