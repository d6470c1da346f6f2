# SPDX-License-Identifier: Apache-2.0
"""The checked face of the native core: what it refuses, weights, instruction sets, Adam."""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import adam as reference
import numpy as np
import pytest
from scenes.differentiation import loss_and_gradients
from scenes.splat_scenes import NEAR, RATES, arrays_of, camera_at, native_view, scene, step, target_of
from scipy import sparse

from cotton3dg import _native
from cotton3dg.core.scene import Gaussians
from cotton3dg.gaussians import rasterizer


def test_weights_are_those_that_rendering_uses() -> None:
    camera = camera_at(70, 50)
    gaussians = scene(200, seed=8)
    rng = np.random.default_rng(0)
    ids = (rng.integers(0, 9, (50, 70)) * rng.integers(0, 2, (50, 70))).astype(np.uint16)
    ids[:20, :20] = 700
    found = rasterizer.accumulate_weights(gaussians, camera, ids, near_su=NEAR)
    order = np.lexsort((found.ids, found.rows))
    assert np.array_equal(order, np.arange(len(order)))
    assert len(set(zip(found.rows.tolist(), found.ids.tolist(), strict=True))) == len(found.rows)
    dense = np.zeros((200, 701), np.float32)
    dense[found.rows, found.ids] = found.weights
    pixels = np.stack(np.meshgrid(np.arange(70), np.arange(50)), axis=-1).reshape(-1, 2)
    rays = rasterizer.ray_weights(gaussians, camera, pixels, near_su=NEAR)
    weights = sparse.csr_matrix((rays.weights, rays.rows, rays.starts), shape=(len(pixels), 200)).astype(np.float64)
    for mask_id in (1, 5, 700):
        expected = weights.T @ (ids.ravel() == mask_id)
        np.testing.assert_allclose(dense[:, mask_id], expected, rtol=1e-5, atol=1e-6)
    rendered = rasterizer.render(gaussians, camera, near_su=NEAR)
    assert found.total.sum() == pytest.approx(float((1 - rendered.transmittance).sum()), rel=1e-5)
    assert all(found.ids > 0)


def test_instruction_sets_agree() -> None:
    """Images, gradients and statistics to 1e-5 of their length, whatever the processor."""
    camera = camera_at(80, 60)
    gaussians = scene(500, seed=9)
    chosen = _native.instruction_set()
    results = []
    try:
        for name in _native.instruction_sets():
            _native.use_instruction_set(name)
            rendered = rasterizer.render(gaussians, camera, near_su=NEAR)
            gradients = loss_and_gradients(gaussians, camera, target_of(camera), near_su=NEAR)
            results.append({"image": rendered.image, "depth": rendered.depth} | asdict(gradients))
    finally:
        _native.use_instruction_set(chosen)
    for other in results[1:]:
        for name, expected in results[0].items():
            assert np.linalg.norm(other[name] - expected) <= 1e-5 * np.linalg.norm(expected), name


@pytest.mark.skipif(platform.machine() != "x86_64" or sys.platform != "linux", reason="asks Linux on x86-64")
def test_every_instruction_set_of_the_processor_is_found() -> None:
    flags = set(re.findall(r"^flags\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.M)[0].split())
    sets = {"baseline": set(), "avx2": {"avx2", "fma"}, "avx512": {"avx512f", "avx512dq", "avx512bw", "avx512vl"}}
    assert _native.instruction_sets() == [name for name, needed in sets.items() if needed <= flags]


@pytest.mark.parametrize("name", [*_native.instruction_sets(), "abacus"])
def test_the_environment_chooses_the_instruction_set(name: str) -> None:
    program = "from cotton3dg import _native; print(_native.instruction_set())"
    environment = os.environ | {"COTTON3DG_ISA": name}
    run = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False)
    if name == "abacus":
        assert run.returncode != 0
        assert "no instruction set 'abacus' on this processor; it has baseline" in run.stderr
    else:
        assert run.stdout.strip() == name


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
        loss_and_gradients(gaussians, camera, np.zeros((5, 5, 3), np.uint8))
    with pytest.raises(ValueError, match="rate_factors"):
        step(gaussians, camera, rate_factors=np.ones((2, 2), np.float32))
    with pytest.raises(ValueError, match="positive"):
        native_view(camera, near_su=0.0)


@pytest.mark.parametrize("most", [None, 3.5], ids=["one rate", "rates of their own"])
def test_steps_are_those_of_the_reference(most: float | None) -> None:
    """Four views, some Gaussians hidden in some of them; a band of the colour joins with each view."""
    factors = None if most is None else np.random.default_rng(1).uniform(1, most, (60, 2)).astype(np.float32)
    longer = dict(zip(("means", "log_scales"), np.ones((2, 60)) if factors is None else factors.T, strict=True))
    rates, gaussians = RATES, scene(60, seed=12)
    gaussians.means[:20] *= np.float32(0.1)
    gaussians.means[50:, 2] = -9  # behind the first camera
    adam, statistics = rasterizer.AdamState.zeros(gaussians), rasterizer.DensityStatistics.zeros(60)
    moments = [[np.zeros(a.shape) for a in arrays_of(gaussians)] for _ in range(2)]
    expected, steps = [a.astype(np.float64) for a in arrays_of(gaussians)], np.zeros((60, 4), int)
    for number in range(4):
        camera = camera_at(24, 18, angle=number)
        options = {"sh_degree": number, "near_su": NEAR}
        gradients = loss_and_gradients(gaussians, camera, target_of(camera), **options)
        seen = gradients.weight > 0
        steps[seen, : number + 1] += 1
        for i, name in enumerate(("means", "quats", "log_scales", "opacity_logits", "sh")):
            counts, rows = steps[:, 0], np.ix_(seen)
            if name != "sh":
                rate = np.full(60, getattr(rates, name)) * longer.get(name, 1)
            else:
                rate = np.broadcast_to(np.where(np.arange(16) == 0, rates.sh0, rates.sh_rest)[:, None], (60, 16, 3))
                counts = np.repeat(steps, (1, 3, 5, 7), axis=1)[:, :, None]
                rows = np.ix_(seen, np.arange(16) < (number + 1) ** 2)
            state = expected[i], getattr(gradients, f"v_{name}").astype(np.float64), moments[0][i], moments[1][i]
            stepped = reference.adam(*(a[rows] for a in (*state, counts, rate)), rates)
            for array, new in zip((expected[i], moments[0][i], moments[1][i]), stepped, strict=True):
                array[rows] = new
        options |= {"learning_rates": rates, "rate_factors": factors}
        rasterizer.train_step(gaussians, adam, statistics, camera, target_of(camera), **options)
        for array, twin in zip(arrays_of(gaussians), expected, strict=True):
            np.testing.assert_allclose(array, twin, rtol=2e-6, atol=2e-6)
            twin[...] = array  # a rounding must not become another gradient in the next view
    assert 0 < steps[:, 0].min() < steps[:, 0].max() == 4
    assert np.array_equal(adam.steps, steps)


def test_the_weight_of_a_gaussian_is_the_same_at_every_size_of_the_image() -> None:
    """Windows of density control may lie across a change of resolution."""
    gaussians, weights = scene(60, seed=12), []
    for width, height in ((160, 120), (320, 240)):
        statistics = step(Gaussians(*(a.copy() for a in arrays_of(gaussians))), camera_at(width, height))[2]
        weights.append(statistics.weight)
    shown = weights[1] > 1e-3
    assert shown.sum() > 20
    np.testing.assert_allclose(weights[0][shown], weights[1][shown], rtol=0.1)


def test_training_fits_an_image() -> None:
    """Adam on a made view: the loss falls to well under half, and the statistics count what was seen."""
    camera = camera_at(48, 32)
    target = (np.clip(rasterizer.render(scene(60, seed=12), camera, near_su=NEAR).image, 0, 1) * 255).astype(np.uint8)
    gaussians = scene(60, seed=12)
    gaussians.means[:] += np.random.default_rng(0).normal(0, 0.05, (60, 3)).astype(np.float32)
    gaussians.sh[:, 0] += 0.3
    adam, statistics = rasterizer.AdamState.zeros(gaussians), rasterizer.DensityStatistics.zeros(60)
    losses = [
        rasterizer.train_step(
            gaussians, adam, statistics, camera, target, sh_degree=0, learning_rates=RATES, near_su=NEAR
        ).loss
        for _ in range(150)
    ]
    assert losses[-1] < 0.4 * losses[0]
    assert adam.steps.max() == 150
    assert np.array_equal(adam.steps[:, 0], statistics.count)
    assert not adam.steps[:, 1:].any()
    rows, continued = np.array([5, 5, 3, 59]), np.array([False, True, True, False])
    later = adam.carried_over(rows, continued)
    assert np.array_equal(later.steps[1:3], adam.steps[[5, 3]])
    assert np.array_equal(later.second.sh[1:3], adam.second.sh[[5, 3]])
    assert not later.first.means[~continued].any()
    assert not later.steps[~continued].any()


def test_packs_out_of_view_are_counted_as_one_by_one() -> None:
    """The core skips packs of neighbours that are all out of view; mixed with others nothing may be told otherwise."""
    camera = camera_at(64, 48)
    gaussians = scene(800, seed=21)
    groups = np.split(np.arange(800), 8)
    gaussians.means[groups[1]] += camera.centre.astype(np.float32) * 3  # behind the camera
    gaussians.means[groups[2], 0] += 50  # outside, far
    gaussians.means[groups[3], 0] = np.linspace(-6, 6, 100)  # across the edges
    gaussians.means[groups[4], 0] += 50
    gaussians.opacity_logits[groups[4]] = -9  # faint
    gaussians.means[groups[5], 1] += 50
    gaussians.quats[groups[5]] = 0  # without a direction
    gaussians.means[groups[6], 1] += 50
    gaussians.log_scales[groups[6][::3]] = np.nan
    gaussians.means[groups[7], 0] += 50
    gaussians.log_scales[groups[7]] = 4  # so large that they reach into the image
    mixed = np.random.default_rng(0).permutation(800)
    grouped, shuffled = (rasterizer.render(g, camera, near_su=NEAR) for g in (gaussians, gaussians[mixed]))
    assert grouped.culled == shuffled.culled
    assert all(grouped.culled.values())
    assert grouped.n_visible == shuffled.n_visible
    alone = [rasterizer.render(gaussians[k : k + 1], camera, near_su=NEAR).culled for k in range(800)]
    assert grouped.culled == {reason: sum(each[reason] for each in alone) for reason in grouped.culled}
