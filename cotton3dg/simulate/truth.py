# SPDX-License-Identifier: Apache-2.0
"""The truth about a simulated plant and its filming, computed from the meshes and the path of the camera."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.distance import pdist

from ..command_options import SimulateOptions
from ..core.scene import Camera, Float64
from .architecture import Axis
from .camera import Orbit
from .plant import PlantMeshes
from .room import TABLE_HEIGHT, TUBE

UNITS: Final = (
    "plant dimensions in cm, volumes in cm3, coordinates in metres "
    "(z up, table top z=0, table long side along x, origin = table centre)"
)
DEFINITIONS: Final = {
    "centre_xyz_m": "centroid of the convex hull of the lint",
    "diameter_cm": "mean calliper width of the lint hull",
    "visible_pixel_max": "largest pixel count of this id over the instance masks",
    "plant_height_cm": "zmax - zmin of all plant meshes (stem foot at z=0)",
    "canopy": "minimum-area rectangle of the horizontal projection of all plant meshes",
    "skeleton": (
        "axes of wood: stem, fruiting and vegetative branches, peduncles; parent = id of the axis it grows on; "
        "points_m from its foot on the parent's centre line to its tip, radius_mm at each, nodes_m = path lengths there"
    ),
    "axis": "id of the branch (or stem) that bears the boll; its peduncle is the axis with that boll_id",
    "position": "fruiting position, 1 = next to the stem; null on a simple plant",
}
CONVENTION: Final = (
    "camera_to_world 4x4, OpenCV axes (x right, y down, z forward), metres, world as in truth.json; "
    "pixel (0,0) is the top-left corner of the top-left pixel (its centre is 0.5, 0.5), as in COLMAP"
)
MASKS_NOTE: Final = (
    "16-bit PNG, value = boll id (lint only), 0 = background; "
    "key = file, value = 0-based frame index in video.mp4 and cameras.json"
)


def plant_truth(
    plant: PlantMeshes, options: SimulateOptions, masks: Mapping[int, NDArray[np.uint16]] | None = None
) -> dict[str, Any]:
    """The content of truth.json.

    Args:
        masks: true instance ids of some frames, for `visible_pixel_max`.
    """
    vertices = plant.vertices
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    length, width = rectangle_sides(vertices[:, :2])
    seen = np.zeros(len(plant.bolls) + 1, np.int64)
    for ids in (masks or {}).values():
        seen = np.maximum(seen, np.bincount(ids.ravel(), minlength=len(seen)))
    stalks = [axis for axis in plant.axes if axis.kind == "peduncle"]
    first_stalk = len(plant.axes) - len(stalks)
    bolls = []
    for boll_id, boll in enumerate(plant.bolls, start=1):
        lint = ConvexHull(boll.lint.vertices)
        both = ConvexHull(np.concatenate([boll.lint.vertices, boll.bur.vertices]))
        bolls.append(
            {
                "id": boll_id,
                "centre_xyz_m": _round(hull_centroid(lint), 5),
                "convex_volume_cm3": round(lint.volume * 1e6, 3),
                "convex_volume_with_bur_cm3": round(both.volume * 1e6, 3),
                "diameter_cm": round(100 * mean_width(lint), 3),
                "max_diameter_cm": round(100 * float(pdist(lint.points[lint.vertices]).max()), 3),
                "visible_pixel_max": int(seen[boll_id]),
                "axis": stalks[boll_id - 1].parent,
                "position": plant.positions[boll_id - 1],
            }
        )
    return {
        "units": UNITS,
        "seed": options.seed,
        "preset": "simulate",
        "plant_height_cm": round(100 * float(high[2] - low[2]), 3),
        "canopy_length_cm": round(100 * length, 3),
        "canopy_width_cm": round(100 * width, 3),
        "canopy_size_cm": round(50 * (length + width), 3),
        "boll_count": len(bolls),
        "total_boll_convex_volume_cm3": round(sum(boll["convex_volume_cm3"] for boll in bolls), 3),
        "table": {
            "length_cm": options.table_length_cm,
            "width_cm": options.table_width_cm,
            "height_cm": 100 * TABLE_HEIGHT,
        }
        if options.table
        else None,
        "clamp_tube_height_cm": 100 * TUBE,
        "stem_base_xyz_m": _round(plant.stem_base, 5),
        "plant_bbox_m": {"min": _round(low, 5), "max": _round(high, 5)},
        "definitions": DEFINITIONS,
        "bolls": bolls,
        "skeleton": [_axis_record(number, axis, first_stalk) for number, axis in enumerate(plant.axes)],
        "bolls_never_visible_in_masks": [boll["id"] for boll in bolls if not boll["visible_pixel_max"]],
    }


def _axis_record(number: int, axis: Axis, first_stalk: int) -> dict[str, Any]:
    return {
        "id": number,
        "kind": axis.kind,
        "parent": axis.parent,
        "boll_id": number - first_stalk + 1 if axis.kind == "peduncle" else None,
        "points_m": _round(axis.curve, 5),
        "radius_mm": _round(1000 * axis.radii, 3),
        "nodes_m": _round(np.array(axis.nodes), 5),
    }


def camera_truth(path: Orbit, options: SimulateOptions, exposures_ev: list[float]) -> dict[str, Any]:
    """The content of cameras.json; poses are those at the middle of the exposure."""
    cameras = path.cameras()
    first = cameras[0]
    lens = {"fx": first.fx, "fy": first.fy, "cx": first.cx, "cy": first.cy}
    size = {"width": first.width, "height": first.height}
    return {
        "convention": CONVENTION,
        "model": "OPENCV",
        **size,
        **lens,
        "distortion": {"k1": options.distortion, "k2": 0.0, "p1": 0.0, "p2": 0.0},
        "fps": 30,
        "shutter_fraction_of_frame": options.blur,
        "orbit_radius_m": round(path.radius, 3),
        "spp": options.supersampling**2,
        "frames": [
            {
                "frame": frame,
                "camera_to_world": _round(world_from_camera(camera), 8),
                **lens,
                **size,
                "distortion": [options.distortion, 0.0, 0.0, 0.0, 0.0],
                "exposure_ev": round(exposure_ev, 4),
            }
            for frame, (camera, exposure_ev) in enumerate(zip(cameras, exposures_ev, strict=True))
        ],
    }


def world_from_camera(camera: Camera) -> Float64:
    """(4, 4) inverse of the camera's pose."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = camera.rotation.T, camera.centre
    return pose


def hull_centroid(hull: ConvexHull) -> Float64:
    """(3,) centroid of a convex hull's body."""
    inside = hull.points[hull.vertices].mean(axis=0)
    corners = hull.points[hull.simplices] - inside
    volumes = np.abs(np.linalg.det(corners))
    centroid: Float64 = inside + (volumes[:, None] * corners.sum(axis=1)).sum(axis=0) / (4 * volumes.sum())
    return centroid


def mean_width(hull: ConvexHull) -> float:
    """Mean calliper width of a convex body, from its edges.

    Minkowski: the mean width is 1/(4 pi) times the sum over edges of length times the angle between their two faces'
    normals.
    """
    normals = hull.equations[:, :3]
    total = 0.0
    for face, (corners, neighbours) in enumerate(zip(hull.simplices, hull.neighbors, strict=True)):
        for opposite, other in enumerate(neighbours):
            if other > face:
                start, end = hull.points[np.delete(corners, opposite)]
                angle = np.arccos(np.clip(normals[face] @ normals[other], -1, 1))
                total += np.linalg.norm(end - start) * angle
    return float(total / (4 * np.pi))


def rectangle_sides(points: Float64) -> tuple[float, float]:
    """Longer and shorter side of the minimum-area rectangle around (N, 2) points; one side lies on a hull edge."""
    hull = ConvexHull(points)
    corners = points[hull.vertices]
    edges = np.roll(corners, -1, axis=0) - corners
    edges /= np.linalg.norm(edges, axis=1, keepdims=True)
    along, across = corners @ edges.T, corners @ (edges[:, ::-1] * (-1, 1)).T
    sides = np.stack([np.ptp(along, axis=0), np.ptp(across, axis=0)])
    best = sides[:, np.argmin(sides.prod(axis=0))]
    return float(best.max()), float(best.min())


def _round(array: Float64, digits: int) -> Any:
    return np.round(array, digits).tolist()
