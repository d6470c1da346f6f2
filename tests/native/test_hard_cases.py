"""Numbers name the cases of the registry of hard cases: what must stay finite, exact or the same to the bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from splat_scenes import NEAR, arrays_of, camera_at, double, native_view, scene

from cotton3dg import _native
from cotton3dg.core.scene import Camera, Gaussians
from cotton3dg.splat import ops
from cotton3dg.splat.autograd import rasterize_values

RATES = ops.LearningRates(1e-3, 1e-3, 5e-3, 0.05, 2.5e-3, 1.25e-4)
SPECIAL = np.array(
    [0, -0.0, 1e-45, -1e-45, 1e-38, 1e-30, -1e-30, 1e-20, 1e-6, 1, -1, 50, -50, 90, -90, 1e6, 1e30, -1e30]
    + [3e38, -3e38, np.inf, -np.inf, np.nan],
    np.float32,
)


def target_of(camera: Camera, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (camera.height, camera.width, 3)).astype(np.uint8)


def step(
    gaussians: Gaussians, camera: Camera, **options
) -> tuple[ops.StepReport, ops.AdamState, ops.DensityStatistics]:
    adam, statistics = ops.AdamState.zeros(gaussians), ops.DensityStatistics.zeros(len(gaussians))
    options = {"sh_degree": 3, "learning_rates": RATES, "near_su": NEAR, "target": target_of(camera)} | options
    return ops.train_step(gaussians, adam, statistics, camera, **options), adam, statistics


def all_finite(*arrays: np.ndarray) -> bool:
    return all(np.isfinite(a).all() for a in arrays)


def assert_step_stays_finite(gaussians: Gaussians, camera: Camera) -> ops.StepReport:
    """Takes a step; what was finite before must be finite after."""
    before = [a.copy() for a in arrays_of(gaussians)]
    report, adam, statistics = step(gaussians, camera)
    for old, new in zip(before, arrays_of(gaussians), strict=True):
        assert np.isfinite(new[np.isfinite(old)]).all()
    assert all_finite(*arrays_of(adam.first), *arrays_of(adam.second), *statistics.as_arrays())
    return report


@pytest.mark.parametrize("slot", ["means", "quats", "log_scales", "opacity_logits", "sh"])
def test_poisoned_parameters_do_no_harm(slot: str) -> None:
    """Cases 2, 3, 8, 9, 15: one poisoned number neither spreads nor hides its neighbours."""
    camera = camera_at(40, 30)
    clean = ops.render(scene(20, seed=0)[1:], camera, near_su=NEAR)
    for value in SPECIAL:
        gaussians = scene(20, seed=0)
        getattr(gaussians, slot).reshape(20, -1)[0, -1] = value
        rendered = ops.render(gaussians, camera, near_su=NEAR)
        assert all_finite(rendered.image, rendered.transmittance, rendered.depth), value
        assert rendered.n_visible + sum(rendered.culled.values()) == 20
        if not np.isfinite(value):
            assert rendered.culled["non_finite"] == 1
            assert np.array_equal(rendered.image, clean.image)
        report = assert_step_stays_finite(gaussians, camera)
        assert report.finite, value


@pytest.mark.parametrize("seed", range(100))
def test_random_extreme_scenes_stay_finite(seed: int) -> None:
    """Any mixture of special values in all slots."""
    rng = np.random.default_rng(seed)
    gaussians = scene(30, seed)
    for array in arrays_of(gaussians):
        poisoned = rng.random(array.shape) < 0.05
        array[poisoned] = rng.choice(SPECIAL, poisoned.sum())
    camera = camera_at(int(rng.integers(1, 60)), int(rng.integers(1, 60)), angle=rng.uniform(-3, 3))
    rendered = ops.render(gaussians, camera, near_su=NEAR)
    assert all_finite(rendered.image, rendered.transmittance, rendered.depth)
    assert_step_stays_finite(gaussians, camera)


def test_valid_extremes_stay_visible() -> None:
    """Culling everything is no way to pass: a huge, a tiny and a tiny-quaternion Gaussian are drawn."""
    camera = camera_at(31, 31)
    for log_scale, quat in ((25.0, 1.0), (90.0, 1.0), (-30.0, 1.0), (-90.0, 1.0), (-2.0, 1e-20), (-2.0, 1e20)):
        gaussians = scene(1, seed=0)
        gaussians.means[:] = 0
        gaussians.opacity_logits[:] = 4
        gaussians.log_scales[:] = log_scale
        gaussians.quats[:] *= quat
        rendered = ops.render(gaussians, camera, near_su=NEAR)
        assert rendered.n_visible == 1
        assert rendered.transmittance.min() < 0.5, (log_scale, quat)


def test_zero_quaternion_is_culled_and_counted() -> None:
    """Case 8."""
    gaussians = scene(5, seed=0)
    gaussians.quats[2] = 0
    assert ops.render(gaussians, camera_at(20, 20), near_su=NEAR).culled["degenerate"] == 1


def test_needles_match_double() -> None:
    """Case 4: sigma up to 1e4 px across an image, at any angle."""
    camera = camera_at(64, 64)
    for seed, length in enumerate((1.0, 10.0, 100.0, 400.0)):
        gaussians = scene(8, seed)
        gaussians.log_scales[:] = np.log([length, 1e-5, 1e-5])
        single = _native.render(arrays_of(gaussians), native_view(camera), 0, np.zeros(3, np.float32), 1)[0]
        exact = _native.render(double(gaussians), native_view(camera), 0, np.zeros(3), 1)[0]
        differs = np.abs(single - exact).max(-1) > 1e-3
        assert differs.mean() <= 1e-3
        assert abs(float((single - exact).mean())) < 1e-4


def test_gaussian_at_the_camera_centre_is_culled() -> None:
    """Case 6."""
    camera = camera_at(20, 20)
    gaussians = scene(3, seed=0)
    gaussians.means[1] = camera.centre
    rendered = ops.render(gaussians, camera, near_su=NEAR)
    assert rendered.culled["behind"] == 1
    gradients = ops.loss_and_gradients(gaussians, camera, target_of(camera), near_su=NEAR)
    assert gradients.finite
    assert not gradients.v_means[1].any()


def test_alpha_cap_has_no_gradient() -> None:
    """Cases 10, 11: an opaque Gaussian over every pixel passes no gradient to its opacity."""
    camera = camera_at(4, 4)
    gaussians = scene(1, seed=0)
    gaussians.means[:] = 0
    gaussians.log_scales[:] = 5
    gaussians.opacity_logits[:] = 30
    gradients = ops.loss_and_gradients(gaussians, camera, target_of(camera), sh_degree=0, near_su=NEAR)
    assert not gradients.v_opacity_logits.any()
    assert not gradients.v_means.any()
    assert gradients.v_sh.any()


def test_a_stack_of_opaque_gaussians_stops() -> None:
    """Cases 12, 13: with alpha at the cap three Gaussians end a pixel, and those behind get no gradient at all."""
    camera = camera_at(8, 8)
    gaussians = scene(16, seed=0)
    gaussians.means[:] = 0
    gaussians.means[:, 2] = np.linspace(-0.5, 0.5, 16)
    gaussians.log_scales[:] = 5
    gaussians.opacity_logits[:] = 30
    rendered = ops.render(gaussians, camera, near_su=NEAR)
    np.testing.assert_allclose(rendered.transmittance, 0.01**2, rtol=1e-3)
    gradients = ops.loss_and_gradients(gaussians, camera, target_of(camera), near_su=NEAR)
    reached = np.abs(gradients.v_sh).sum((1, 2)) > 0
    assert reached[:2].all()
    assert not reached[3:].any()


def test_equal_depths_are_drawn_in_row_order() -> None:
    """Case 15: the first of two coincident opaque Gaussians hides the second."""
    camera = camera_at(9, 9)
    gaussians = scene(2, seed=0, coefficients=1)
    gaussians.means[:] = 0
    gaussians.log_scales[:] = 3
    gaussians.opacity_logits[:] = 30
    gaussians.sh[0], gaussians.sh[1] = 1.0, -1.0
    first = ops.render(gaussians, camera, near_su=NEAR).image
    second = ops.render(gaussians[::-1], camera, near_su=NEAR).image
    assert first.mean() > 0.7
    assert second.mean() < 0.3


@pytest.mark.parametrize("logit", [-5.6, -5.5413, -5.5412, -5.0, -500.0])
def test_faint_gaussians(logit: float) -> None:
    """Case 17: opacity below 1/255 is culled and counted; just above it is kept."""
    gaussians = scene(1, seed=0)
    gaussians.means[:] = 0
    gaussians.opacity_logits[:] = logit
    faint = bool(1 / (1 + np.exp(-np.float64(np.float32(logit)))) < 1 / 255)
    assert ops.render(gaussians, camera_at(20, 20), near_su=NEAR).culled["faint"] == faint


def test_ssim_of_flat_and_tiny_images() -> None:
    """Case 19."""
    for size in ((1, 1), (3, 10), (10, 3), (40, 40)):
        for level in (0, 128, 255):
            target = np.full((*size, 3), level, np.uint8)
            for image in (target / np.float32(255), np.full((*size, 3), 0.3, np.float32)):
                report, v_image = ops.image_loss(image.astype(np.float32), target)
                assert report["ssim"] <= 1 + 1e-6
                assert all_finite(v_image)
    same = np.full((20, 20, 3), 77, np.uint8)
    assert ops.image_loss((same / 255).astype(np.float64), same)[0]["ssim"] == pytest.approx(1, abs=1e-9)


def test_nothing_visible_gives_the_background() -> None:
    """Case 20: no Gaussians, or all behind the camera."""
    camera = camera_at(17, 9)
    behind = scene(4, seed=0)
    behind.means[:, 2] = -10
    for gaussians in (behind[:0], behind):
        rendered = ops.render(gaussians, camera, background=(0.25, 0.5, 0.75))
        assert np.array_equal(rendered.image, np.broadcast_to(np.float32([0.25, 0.5, 0.75]), (9, 17, 3)))
        assert (rendered.transmittance == 1).all()
        assert not rendered.depth.any()
        report, _, statistics = step(gaussians, camera)
        assert report.finite
        assert report.n_visible == 0
        assert not statistics.count.any()
        assert len(ops.accumulate_weights(gaussians, camera, np.ones((9, 17), np.uint16)).rows) == 0
        assert ops.render_values(gaussians, camera, np.zeros((len(gaussians), 7), np.float32)).image.shape == (9, 17, 7)


@pytest.mark.parametrize("size", [(1, 1), (1, 300), (257, 2), (15, 16), (17, 33), (257, 257)])
def test_odd_sizes_crop_the_same_image(size: tuple[int, int]) -> None:
    """Cases 16, 21: an image is the top-left part of a larger one, whatever its tiles."""
    width, height = size
    camera = replace(camera_at(300, 300), width=width, height=height)
    gaussians = scene(30, seed=1)
    gaussians.log_scales[:] -= 1.5  # small enough that the frozen Jacobian beyond the frustum plays no part
    wide = replace(camera, width=300, height=300)
    image, whole = (ops.render(gaussians, c, near_su=NEAR).image for c in (camera, wide))
    assert image.shape == (height, width, 3)
    differs = np.abs(image - whole[:height, :width]).max(-1) > 2e-3
    assert differs.mean() < 0.2


def test_threads_do_not_change_a_bit() -> None:
    """Case 29."""
    camera = camera_at(150, 90)
    gaussians = scene(5000, seed=3)
    ids = np.random.default_rng(0).integers(0, 5, (90, 150)).astype(np.uint16)
    values = np.random.default_rng(1).normal(size=(5000, 6)).astype(np.float32)
    seen = set()
    for threads in (1, 2, 3, 4, 8, 1, 2):
        work = gaussians[:]
        work = Gaussians(*(a.copy() for a in arrays_of(work)))
        rendered = ops.render(work, camera, threads=threads, near_su=NEAR)
        weights = ops.accumulate_weights(work, camera, ids, threads=threads, near_su=NEAR)
        blended = ops.render_values(work, camera, values, threads=threads, near_su=NEAR).image
        v_values = ops.values_gradient(work, camera, blended, threads=threads, near_su=NEAR)
        report, adam, statistics = step(work, camera, threads=threads)
        everything = [rendered.image, rendered.depth, weights.total, weights.weights, blended, v_values]
        everything += [*arrays_of(work), *arrays_of(adam.first), *arrays_of(adam.second), *statistics.as_arrays()]
        seen.add((b"".join(a.tobytes() for a in everything), repr(report)))
    assert len(seen) == 1


def test_a_step_that_is_not_finite_changes_nothing() -> None:
    """Case 54: a NaN background stands for any unknown cause."""
    camera = camera_at(30, 20)
    gaussians = scene(20, seed=0)
    before = gaussians.sha256()
    report, adam, statistics = step(gaussians, camera, background=(np.nan, 0.0, 0.0))
    assert not report.finite
    assert gaussians.sha256() == before
    assert not adam.steps.any()
    assert not statistics.count.any()
    assert not statistics.grad_px.any()


def test_power_of_two_scaling_changes_no_bit() -> None:
    """Case 5: the near plane scales with the scene."""
    camera = camera_at(60, 40)
    gaussians = scene(200, seed=5)
    reference = ops.render(gaussians, camera)
    for factor in (2.0**-10, 2.0**10):
        scaled = Gaussians(
            gaussians.means * np.float32(factor),
            gaussians.quats,
            gaussians.log_scales + np.float32(np.log(factor)),
            gaussians.opacity_logits,
            gaussians.sh,
        )
        pose = camera.cam_from_scene.copy()
        pose[:, 3] *= factor
        rendered = ops.render(scaled, replace(camera, cam_from_scene=pose))
        np.testing.assert_allclose(rendered.image, reference.image, atol=2e-3)
        assert rendered.culled == reference.culled
        np.testing.assert_allclose(rendered.depth, reference.depth * factor, rtol=2e-3)


def test_permutation_and_invisible_gaussians_change_no_bit() -> None:
    camera = camera_at(60, 40)
    gaussians = scene(300, seed=6)
    reference = ops.render(gaussians, camera, near_su=NEAR)
    order = np.random.default_rng(0).permutation(300)
    assert np.array_equal(ops.render(gaussians[order], camera, near_su=NEAR).image, reference.image)
    hidden = scene(50, seed=7)
    hidden.means[:, 2] = -20
    both = Gaussians(*(np.concatenate(pair) for pair in zip(arrays_of(hidden), arrays_of(gaussians), strict=True)))
    assert np.array_equal(ops.render(both, camera, near_su=NEAR).image, reference.image)


def test_weights_are_those_that_rendering_uses() -> None:
    camera = camera_at(70, 50)
    gaussians = scene(200, seed=8)
    rng = np.random.default_rng(0)
    ids = (rng.integers(0, 9, (50, 70)) * rng.integers(0, 2, (50, 70))).astype(np.uint16)
    ids[:20, :20] = 700
    found = ops.accumulate_weights(gaussians, camera, ids, near_su=NEAR)
    order = np.lexsort((found.ids, found.rows))
    assert np.array_equal(order, np.arange(len(order)))
    assert len(set(zip(found.rows.tolist(), found.ids.tolist(), strict=True))) == len(found.rows)
    dense = np.zeros((200, 701), np.float32)
    dense[found.rows, found.ids] = found.weights
    for mask_id in (1, 5, 700):
        indicator = (ids == mask_id).astype(np.float32)[..., None]
        expected = ops.values_gradient(gaussians, camera, indicator, near_su=NEAR)[:, 0]
        np.testing.assert_allclose(dense[:, mask_id], expected, rtol=1e-5, atol=1e-6)
    rendered = ops.render(gaussians, camera, near_su=NEAR)
    assert found.total.sum() == pytest.approx(float((1 - rendered.transmittance).sum()), rel=1e-5)
    assert all(found.ids > 0)


def test_instruction_sets_agree() -> None:
    camera = camera_at(80, 60)
    gaussians = scene(500, seed=9)
    chosen = _native.instruction_set()
    images = []
    try:
        for name in _native.instruction_sets():
            _native.use_instruction_set(name)
            images.append(ops.loss_and_gradients(gaussians, camera, target_of(camera), near_su=NEAR))
    finally:
        _native.use_instruction_set(chosen)
    for other in images[1:]:
        assert other.loss == pytest.approx(images[0].loss, rel=1e-5)
        difference = np.linalg.norm(other.v_means - images[0].v_means) / np.linalg.norm(images[0].v_means)
        assert difference < 1e-3


def test_wrong_arrays_are_refused() -> None:
    camera = camera_at(10, 10)
    gaussians = scene(3, seed=0)
    means, *others = arrays_of(gaussians)
    view = native_view(camera)
    black = np.zeros(3, np.float32)
    with pytest.raises(TypeError, match="quats"):
        _native.render((means, others[0].astype(np.float64), *others[1:]), view, 0, black, 1)
    with pytest.raises(ValueError, match="quats"):
        _native.render((means, others[0][:2].copy(), *others[1:]), view, 0, black, 1)
    with pytest.raises(TypeError, match="means"):
        _native.render((means[:, ::-1], *others), view, 0, black, 1)
    with pytest.raises(ValueError, match="sh_degree"):
        _native.render(arrays_of(gaussians), view, 4, black, 1)
    with pytest.raises(ValueError, match="target"):
        ops.loss_and_gradients(gaussians, camera, np.zeros((5, 5, 3), np.uint8))
    with pytest.raises(ValueError, match="weight"):
        ops.loss_and_gradients(gaussians, camera, target_of(camera), weight=np.zeros((10, 10), np.float32))
    with pytest.raises(ValueError, match="positive"):
        native_view(camera, near_su=0.0)


def test_autograd_of_values() -> None:
    camera = camera_at(24, 18)
    gaussians = scene(20, seed=10)
    values = torch.rand(20, 2, requires_grad=True)
    image = rasterize_values(values, gaussians, camera, np.ones(2, np.float32), near_su=NEAR)
    v_image = torch.rand(18, 24, 2)
    (image * v_image).sum().backward()
    expected = ops.values_gradient(gaussians, camera, v_image.numpy(), near_su=NEAR)
    np.testing.assert_array_equal(values.grad.numpy(), expected)


def test_training_fits_an_image() -> None:
    """Adam on a made view: the loss falls to well under half, and the statistics count what was seen."""
    camera = camera_at(48, 32)
    target = (np.clip(ops.render(scene(60, seed=12), camera, near_su=NEAR).image, 0, 1) * 255).astype(np.uint8)
    gaussians = scene(60, seed=12)
    gaussians.means[:] += np.random.default_rng(0).normal(0, 0.05, (60, 3)).astype(np.float32)
    gaussians.sh[:, 0] += 0.3
    adam, statistics = ops.AdamState.zeros(gaussians), ops.DensityStatistics.zeros(60)
    losses = [
        ops.train_step(
            gaussians, adam, statistics, camera, target, sh_degree=0, learning_rates=RATES, near_su=NEAR
        ).loss
        for _ in range(150)
    ]
    assert losses[-1] < 0.4 * losses[0]
    assert adam.steps.max() == 150
    assert np.array_equal(adam.steps, statistics.count)
    longer = adam.extended(3)
    assert len(longer.steps) == 63
    assert not longer.first.means[60:].any()
    assert np.array_equal(longer[:60].second.sh, adam.second.sh)
