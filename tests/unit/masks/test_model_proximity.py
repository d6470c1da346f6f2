"""What a model of the room of lint_scene tells about its bolls."""

import numpy as np
import pytest
from scenes.lint_scene import BOLLS, RADIUS, orbit_cameras, photo, room_model, table_points
from scipy import ndimage

from cotton3dg.core.scene import Gaussians
from cotton3dg.evaluation.masks import score_masks
from cotton3dg.geometry.camera_orbit import fit_orbit
from cotton3dg.masks.detect_lint import detect_lint
from cotton3dg.masks.model_proximity import ModelProximity
from cotton3dg.masks.voxel_voting import LintVolume


def volume() -> LintVolume:
    """The bolls in voxels of 4 mm."""
    offsets = np.argwhere(np.ones((15, 15, 15), bool)) - 7
    ball = offsets[np.linalg.norm(0.004 * offsets, axis=1) <= RADIUS]
    voxels = np.concatenate([np.round(centre / 0.004).astype(np.int64) + ball for centre in BOLLS])
    bolls = np.repeat(np.arange(1, len(BOLLS) + 1, dtype=np.int32), len(ball))
    affine = np.column_stack([0.004 * np.eye(3), np.zeros(3)])
    return LintVolume(voxels, affine, bolls, np.ones(len(voxels), np.float32))


@pytest.fixture(scope="module")
def model():
    return room_model()


@pytest.fixture(scope="module")
def views():
    cameras = orbit_cameras(24)
    return cameras, [photo(camera) for camera in cameras]


def test_bolls_are_near_and_the_wall_and_the_table_are_not(model, views) -> None:
    proximity = ModelProximity(model, volume(), 2.0)
    for camera, (_, ids) in list(zip(*views, strict=True))[::6]:
        shares, places = proximity.seen(camera)
        inside = ndimage.binary_erosion(ids > 0, iterations=2)
        assert np.percentile(shares[inside], 5) > 0.9  # the stem hides some
        assert shares[~ndimage.binary_dilation(ids > 0, iterations=12)].max() < 0.1
        away = np.linalg.norm(places[inside][:, None] - BOLLS, axis=2).min(axis=1)
        assert away.max() < 1.3 * RADIUS
        assert (proximity.bolls(places[inside]) == ids[inside]).mean() > 0.97


def test_a_damaged_gaussian_is_nowhere_near(model, views) -> None:
    damaged = Gaussians(model.means.copy(), model.quats, model.log_scales, model.opacity_logits, model.sh)
    damaged.means[::500] = np.nan
    shares, places = ModelProximity(damaged, volume(), 2.0).seen(views[0][0])
    assert np.isfinite(shares).all() and np.isfinite(places).all()


def test_bolls_are_found_with_a_model_as_well(model, views) -> None:
    cameras, taken = views
    images, truths = zip(*taken, strict=True)
    masks = detect_lint(
        images, cameras, fit_orbit(cameras), table_points(), [camera.name for camera in cameras], gaussians=model
    )
    pairs = [(masks.ids[camera.name], truth) for camera, truth in zip(cameras, truths, strict=True)]
    scores, miou = score_masks(pairs)
    assert scores[1].f1 > 0.98
    assert miou > 0.85


def test_a_model_too_coarse_to_tell_has_no_say(model, views) -> None:
    cameras, taken = views
    images = [image for image, _ in taken]
    given = images, cameras, fit_orbit(cameras), table_points(), [camera.name for camera in cameras[::6]]
    coarse = Gaussians(
        model.means, model.quats, model.log_scales + np.float32(np.log(30)), model.opacity_logits, model.sh
    )
    expected, found = detect_lint(*given), detect_lint(*given, gaussians=coarse)
    assert all((found.ids[name] == expected.ids[name]).all() for name in expected.ids)
    assert any((ids > 0).any() for ids in expected.ids.values())
