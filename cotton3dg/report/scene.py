# SPDX-License-Identifier: Apache-2.0
"""The plant in 3D for the page: its splats, a body for each boll, the skeleton, a picture for browsers without 3D."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from ..core.bolls import BollInstance
from ..core.measurements import Scale
from ..core.plant_map import PlantMap
from ..core.scene import Camera, Float64, Gaussians
from ..geometry.camera_orbit import Orbit
from ..geometry.polylines import length_of
from ..traits.surface import sample_visible_surface, surface_rows
from .figures import Picture, colour_of, encode, render_photo
from .frame import Frame

FAINT: Final = 0.05
"""Gaussians below this opacity are haze."""
GROUND_CM: Final = 6.0
"""Whatever lies on the table, from a little below its top up to this height, is shown as its surroundings."""
OUTLYING_PCT: Final = 1.0
"""Share of the plant's Gaussians at either end of an axis that the first view may cut off."""
PICTURE_PX: Final = (900, 600)
PICTURE_FIELD_RAD: Final = 0.6
"""Angle from the picture's top to its bottom; that of templates/orbit.js."""
PAPER: Final = (0.914, 0.906, 0.878)
"""Colour behind the plant, --scene in templates/style.css."""


def boll_bodies(drawn: Gaussians, bolls: list[BollInstance], volumes: dict[int, float], frame: Frame) -> list[Any]:
    """A convex body for each boll, as large as its measured volume where that is known; a ball if it has no body.

    Args:
        drawn: all Gaussians, as wide as they are drawn. volumes: boll -> volume in the cube of the page's unit.
    """
    size = float(np.cbrt(np.linalg.det(frame.page_from_scene)))
    bodies = []
    for boll in bolls:
        own = drawn[boll.indices]
        corners = _convex_body(frame.places(sample_visible_surface(own[surface_rows(own)], 0.5)), volumes, boll.boll_id)
        middle = corners.mean(axis=0) if len(corners) else frame.places(boll.centre[None])[0]
        bodies.append(
            {
                "id": boll.boll_id,
                "colour": "rgb({},{},{})".format(*colour_of(boll.boll_id)),
                "centre": np.round(middle, 3).tolist(),
                "radius": round(boll.diameter_su * size / 2, 3),
                "corners": [encode(axis.astype(np.float32)) for axis in corners.T],
            }
        )
    return bodies


def _convex_body(points: Float64, volumes: dict[int, float], boll: int) -> Float64:
    """(C, 3) corners of the hull of (P, 3) points, grown to the boll's volume; none if they have no volume."""
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return np.zeros((0, 3))
    corners = points[hull.vertices]
    middle = corners.mean(axis=0)
    growth = (volumes[boll] / hull.volume) ** (1 / 3) if boll in volumes else 1.0
    grown: Float64 = middle + (corners - middle) * growth
    return grown


def skeleton_lines(plant_map: PlantMap) -> list[dict[str, Any]]:
    """A line for the stem and for each branch with the stalks of its bolls, cm; null separates one from the next."""
    lines = []
    for axis in plant_map.axes:
        pieces = [axis.curve, *(boll.stalk for boll in plant_map.bolls if boll.branch == axis.rank)]
        places = np.vstack([np.vstack([piece, np.full((1, 3), np.nan)]) for piece in pieces])
        coordinates = [[None if np.isnan(x) else round(float(x), 2) for x in column] for column in places.T]
        what = "Stem" if axis.rank == 0 else f"Branch {axis.rank}"
        bolls = f", bolls {', '.join(map(str, axis.bolls))}" if axis.bolls else ", no bolls"
        text = f"{what}: {length_of(axis.curve):.1f} cm{'' if axis.rank == 0 else ', ' + axis.kind}{bolls}"
        red, green, blue = (90, 60, 30) if axis.rank == 0 else colour_of(axis.rank)
        lines.append(
            {
                "name": what,
                "text": text,
                "bolls": list(axis.bolls),
                "places": coordinates,
                "colour": f"rgb({red},{green},{blue})",
            }
        )
    return lines


def shown_rows(
    gaussians: Gaussians, plant: NDArray[np.bool_], scale: Scale | None, orbit: Orbit, frame: Frame
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(N,) Gaussians of the plant, and those of the plant, of the table's top and of what lies on it.

    Without a known plant, all that is near the orbit's centre.
    """
    opaque = gaussians.opacities > FAINT
    if not plant.any():
        near = opaque & (np.linalg.norm(gaussians.means - orbit.centre, axis=1) < 0.5 * orbit.radius)
        return near, near
    if scale is None:
        return plant & opaque, plant & opaque
    corners = frame.places(scale.corners)
    places = frame.places(gaussians.means)
    x, y = (corners[1] - corners[0])[:2], (corners[3] - corners[0])[:2]
    shares = (places[:, :2] - corners[0, :2]) @ np.linalg.inv(np.stack([x, y]))
    low = (places[:, 2] > -1) & (places[:, 2] < GROUND_CM) & (shares > 0).all(axis=1) & (shares < 1).all(axis=1)
    return plant & opaque, (plant | low) & opaque


def box_of(places: Float64) -> Float64:
    """(2, 3) least and greatest coordinates of (N, 3) places, without the outermost."""
    box: Float64 = np.percentile(places, [OUTLYING_PCT, 100 - OUTLYING_PCT], axis=0)
    return box


def side_picture(shown: Gaussians, box: Float64, frame: Frame) -> Picture:
    """What the 3D view shows first, for browsers that have none and for paper."""
    width, height = PICTURE_PX
    focal = height / 2 / np.tan(PICTURE_FIELD_RAD / 2)
    extent = box[1] - box[0]
    deep = np.hypot(extent[0], extent[1])
    forward, up = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    distance = deep / 3 + 1.05 * max(focal * extent[2] / height, focal * deep / width)
    eye = box.mean(axis=0) - distance * forward
    axes = np.stack([np.cross(forward, up), -up, forward])
    turn = axes @ frame.page_from_scene
    size = float(np.cbrt(np.linalg.det(frame.page_from_scene)))
    # The camera's unit may be any; in su its rotation has no scale.
    pose = np.column_stack([turn / size, axes @ (frame.offset - eye) / size])
    camera = Camera("side", width, height, focal, focal, width / 2, height / 2, pose)
    return render_photo(shown, camera, PAPER)
