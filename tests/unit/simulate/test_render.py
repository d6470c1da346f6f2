# SPDX-License-Identifier: Apache-2.0
"""Images of a simulated plant against its cameras and bolls."""

import cv2
import numpy as np
import pytest
from scenes.simulated_plant import SMALL, small

from cotton3dg.simulate.camera_effects import film
from cotton3dg.simulate.render import develop, instance_ids, render
from cotton3dg.simulate.truth import plant_truth


def test_masks_lie_where_the_bolls_project():
    plant, scene, path = small()
    records = plant_truth(plant, SMALL)["bolls"]
    seen = set()
    for frame in range(0, SMALL.frames, 3):
        camera = path.at(frame)
        ids = instance_ids(scene, camera)
        assert ids.dtype == np.uint16
        assert ids.shape == (108, 192)
        for record in records:
            rows, columns = np.nonzero(ids == record["id"])
            if len(rows) < 6:
                continue
            seen.add(record["id"])
            pixels, depths = camera.project(np.array([record["centre_xyz_m"]]))
            radius = 0.005 * record["max_diameter_cm"] * camera.fx / depths[0]
            offsets = np.hypot(columns + 0.5 - pixels[0, 0], rows + 0.5 - pixels[0, 1])
            assert offsets.max() < radius + 1.5
            assert offsets.mean() < 0.9 * radius
    assert seen == {1, 2, 3, 4}


def test_lint_is_bright_and_the_room_is_textured():
    _, scene, path = small()
    image, ids = film(scene, path, 2, SMALL), instance_ids(scene, path.at(2))
    assert np.median(image[cv2.erode(ids, np.ones((3, 3))) > 0].min(axis=1)) > 120
    assert (image == 255).all(axis=2).mean() < 0.02
    keypoints = cv2.SIFT_create().detect(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), None)
    assert len(keypoints) > 150
    quarters = {(int(point.pt[0] // 96), int(point.pt[1] // 54)) for point in keypoints}
    assert len(quarters) == 4


def test_supersampling_converges():
    _, scene, path = small()
    camera = path.at(7)
    reference = render(scene, camera, supersampling=6)
    errors = [np.abs(render(scene, camera, supersampling=n) - reference).mean() for n in (1, 2, 4)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[1] < 0.02


def test_noise_has_the_sigma_that_was_asked_for():
    light = np.full((200, 200, 3), 0.2, np.float32)
    noisy = develop(light, noise=4.0, rng=np.random.default_rng(0))
    assert noisy.std() == pytest.approx(4.0, rel=0.03)
    assert noisy.mean() == pytest.approx(develop(light).mean(), abs=0.5)


def test_distortion_is_that_of_opencv():
    _, scene, path = small()
    camera, k1 = path.at(3), -0.15
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    bent, ideal = render(scene, camera, k1=k1), render(scene, camera)
    # OpenCV counts pixels from their centres.
    matrix[:2, 2] -= 0.5
    straight = cv2.undistort(bent, matrix, np.array([k1, 0, 0, 0]))
    corner = np.s_[5:35, 8:50]
    assert np.abs(straight - ideal)[corner].mean() < 0.4 * np.abs(bent - ideal)[corner].mean()
