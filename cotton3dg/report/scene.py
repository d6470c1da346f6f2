"""The plant in 3D for the page: points of the model, a body for each boll, the table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from ..core.bolls import BollInstance
from ..core.measurements import Scale
from ..core.plant_map import PlantMap
from ..core.scene import Float64, Gaussians
from ..geometry.camera_orbit import Orbit
from ..geometry.polylines import length_of
from ..traits.surface import sample_visible_surface, surface_rows
from .figures import colour_of, encode

MAX_PLANT_POINTS: Final = 20_000
MAX_GROUND_POINTS: Final = 6_000
GROUND_CM: Final = 6.0
"""Whatever lies on the table, from a little below its top up to this height, is shown as its surroundings."""


@dataclass(frozen=True)
class Frame:
    """The coordinates of the page: those of bolls.csv in cm where there is a scale, else around the orbit's axis."""

    page_from_scene: Float64
    """(3, 3) rotation times the scale."""
    offset: Float64
    """(3,) in the page's unit."""
    unit: str

    def places(self, points: NDArray[Any]) -> Float64:
        """(N, 3) of (N, 3) scene points."""
        return np.asarray(points, np.float64) @ self.page_from_scene.T + self.offset

    @property
    def origin(self) -> Float64:
        """(3,) su of its origin: where the stem meets the table, if the bolls or the plant show it."""
        return np.linalg.inv(self.page_from_scene) @ -self.offset


def plant_frame(scale: Scale | None, orbit: Orbit, centres: Float64, centres_cm: Float64, plant: NDArray[Any]) -> Frame:
    """Coordinates for the page.

    Args:
        centres: (B, 3) su of the bolls, and centres_cm: (B, 3) of the same from the table; rows of NaN are unknown.
        plant: (P, 3) su, points of the plant; their lowest tenth gives its foot if no boll does.
    """
    if scale is None:
        helper = np.eye(3)[np.abs(orbit.axis).argmin()]
        x = np.cross(helper, orbit.axis)
        x /= np.linalg.norm(x)
        axes = np.stack([x, np.cross(orbit.axis, x), orbit.axis])
        return Frame(axes, -axes @ orbit.centre, "scene units")
    axes = scale.cm_from_scene
    foot = scale.corners.mean(axis=0)
    if len(plant):
        foot = np.median(plant[np.argsort(plant @ scale.up)[: max(1, len(plant) // 10)]], axis=0)
    offset = -axes @ foot
    known = np.isfinite(centres_cm).all(axis=1) if len(centres_cm) else np.zeros(0, bool)
    if known.any():
        offset = np.median(centres_cm[known] - centres[known] @ axes.T, axis=0)
    offset[2] = scale.plane[3] * scale.cm_per_su
    return Frame(axes, offset, "cm")


def boll_bodies(drawn: Gaussians, bolls: list[BollInstance], volumes: dict[int, float], frame: Frame) -> list[Any]:
    """A convex body for each boll, as large as its measured volume where that is known.

    Args:
        drawn: all Gaussians, as wide as they are drawn. volumes: boll -> volume in the cube of the page's unit.
    """
    bodies = []
    for boll in bolls:
        own = drawn[boll.indices]
        own = own[surface_rows(own)]
        points = frame.places(sample_visible_surface(own, 0.5))
        try:
            hull = ConvexHull(points)
        except (QhullError, ValueError):
            continue
        middle = points[hull.vertices].mean(axis=0)
        growth = (volumes[boll.boll_id] / hull.volume) ** (1 / 3) if boll.boll_id in volumes else 1.0
        rows = np.full(len(points), -1)
        rows[hull.vertices] = np.arange(len(hull.vertices))
        corners = middle + (points[hull.vertices] - middle) * growth
        bodies.append(
            {
                "id": boll.boll_id,
                "colour": "rgb({},{},{})".format(*colour_of(boll.boll_id)),
                "centre": np.round(middle, 3).tolist(),
                "corners": [encode(axis.astype(np.float32)) for axis in corners.T],
                "triangles": [encode(axis.astype(np.int32)) for axis in rows[hull.simplices].T],
            }
        )
    return bodies


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


def thin_points(gaussians: Gaussians, rows: NDArray[np.bool_], most: int, frame: Frame) -> dict[str, Any]:
    """At most `most` of the Gaussians as points with their own colours; chosen at random, with a fixed seed."""
    chosen = np.flatnonzero(rows & gaussians.finite_rows)
    if len(chosen) > most:
        chosen = np.sort(np.random.default_rng(0).choice(chosen, most, replace=False))
    shown = gaussians[chosen]
    return {
        "n": len(chosen),
        "places": [encode(axis.astype(np.float32)) for axis in frame.places(shown.means).T],
        "colours": encode((shown.colours * 255).astype(np.uint8)),
    }


def describe_scene(
    gaussians: Gaussians,
    plant: NDArray[np.bool_],
    lint: NDArray[np.bool_],
    scale: Scale | None,
    orbit: Orbit,
    frame: Frame,
) -> dict[str, Any]:
    """Points of the plant, of its bolls and of what lies on the table.

    Without a known plant, all that is near the orbit's centre.

    Args:
        plant, lint: (N,) which Gaussians are the plant, and which are bolls.
    """
    opaque = gaussians.opacities > 0.3
    known = plant.any()
    if not known:
        plant = np.linalg.norm(gaussians.means - orbit.centre, axis=1) < 0.5 * orbit.radius
    data: dict[str, Any] = {
        "unit": frame.unit,
        "plant": thin_points(gaussians, plant & opaque & ~lint, MAX_PLANT_POINTS, frame),
        "lint": thin_points(gaussians, lint & opaque, MAX_PLANT_POINTS, frame),
    }
    if scale is not None and known:
        corners = frame.places(scale.corners)
        places = frame.places(gaussians.means)
        x, y = (corners[1] - corners[0])[:2], (corners[3] - corners[0])[:2]
        shares = (places[:, :2] - corners[0, :2]) @ np.linalg.inv(np.stack([x, y]))
        low = (places[:, 2] > -1) & (places[:, 2] < GROUND_CM) & (shares > 0).all(axis=1) & (shares < 1).all(axis=1)
        data["ground"] = thin_points(gaussians, low & opaque & ~plant, MAX_GROUND_POINTS, frame)
        data["table"] = np.round(corners, 2).tolist()
    return data
