# SPDX-License-Identifier: Apache-2.0
"""Colours of points, from the photos that show them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from cotton3dg.io.images import write_image
from cotton3dg.sfm.colours import colour_points


def test_points_have_the_mean_colour_of_their_places(tmp_path: Path) -> None:
    """Each image has a colour of its own, and one channel that rises to the right."""
    what = pycolmap.SyntheticDatasetOptions()
    what.num_rigs, what.num_frames_per_rig, what.num_points3D = 1, 4, 100
    model = pycolmap.synthesize_dataset(what)
    images = {image_id: model.image(image_id) for image_id in model.reg_image_ids()}
    (camera,) = model.cameras.values()
    for image_id, image in images.items():
        picture = np.full((camera.height, camera.width, 3), 20 * image_id, np.uint8)
        picture[:, :, 2] = np.round((np.arange(camera.width) + 0.5) * 255 / camera.width)
        image.name = f"{image_id}.png"
        write_image(tmp_path / image.name, picture)
    colour_points(model, tmp_path)
    assert model.num_points3D() > 50
    for point in model.points3D.values():
        shown = [element.image_id for element in point.track.elements]
        right = [images[e.image_id].points2D[e.point2D_idx].xy[0] for e in point.track.elements]
        expected = [20 * np.mean(shown), 20 * np.mean(shown), 255 * np.mean(right) / camera.width]
        assert point.color == pytest.approx(expected, abs=1.1)


def test_a_model_without_points_has_no_colours(tmp_path: Path) -> None:
    what = pycolmap.SyntheticDatasetOptions()
    what.num_rigs, what.num_frames_per_rig, what.num_points3D = 1, 3, 20
    model = pycolmap.synthesize_dataset(what)
    for point in list(model.point3D_ids()):
        model.delete_point3D(point)
    colour_points(model, tmp_path)  # whose images need not be there, then
    assert model.num_points3D() == 0 and model.num_reg_images() == 3
