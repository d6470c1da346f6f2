# SPDX-License-Identifier: Apache-2.0
"""The truth of a simulated plant, recomputed by other means."""

import cv2
import numpy as np
import open3d as o3d
import pytest
from scenes.simulated_plant import SMALL, signed_volume, small_plant

from cotton3dg.simulate.truth import plant_truth


def test_truth_agrees_with_other_ways_to_compute_it():
    plant = small_plant()
    truth = plant_truth(plant, SMALL)
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for boll, record in zip(plant.bolls, truth["bolls"], strict=True):
        lint = boll.lint.vertices
        for points, key in (
            (lint, "convex_volume_cm3"),
            (np.concatenate([lint, boll.bur.vertices]), "convex_volume_with_bur_cm3"),
        ):
            cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
            hull, _ = cloud.compute_convex_hull()
            hull.orient_triangles()
            assert record[key] == pytest.approx(1e6 * abs(hull.get_volume()), rel=1e-3)
        along = lint @ directions.T
        assert record["diameter_cm"] == pytest.approx(100 * np.ptp(along, axis=0).mean(), rel=0.01)
        assert record["max_diameter_cm"] == pytest.approx(100 * np.ptp(along, axis=0).max(), rel=0.01)
        assert record["convex_volume_cm3"] > 1e6 * signed_volume(boll.lint) * 0.5
        # Points drawn inside the hull average to its centroid.
        box = rng.uniform(lint.min(axis=0), lint.max(axis=0), (40_000, 3))
        ray_scene = o3d.t.geometry.RaycastingScene()
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(lint))
        ray_scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(cloud.compute_convex_hull()[0]))
        inside = ray_scene.compute_occupancy(o3d.core.Tensor(box.astype(np.float32))).numpy() > 0
        np.testing.assert_allclose(record["centre_xyz_m"], box[inside].mean(axis=0), atol=3e-4)

    vertices = plant.vertices
    _, sides, _ = cv2.minAreaRect((100 * vertices[:, :2]).astype(np.float32))
    assert truth["canopy_length_cm"] == pytest.approx(max(sides), rel=1e-3)
    assert truth["canopy_width_cm"] == pytest.approx(min(sides), rel=1e-3)
    assert truth["canopy_size_cm"] == pytest.approx(sum(sides) / 2, rel=1e-3)
    assert vertices[:, 2].min() == 0
    assert truth["plant_height_cm"] == pytest.approx(100 * vertices[:, 2].max(), abs=1e-3)
    assert truth["boll_count"] == 4
    total = sum(record["convex_volume_cm3"] for record in truth["bolls"])
    assert truth["total_boll_convex_volume_cm3"] == pytest.approx(total)
