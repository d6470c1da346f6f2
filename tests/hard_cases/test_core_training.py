# SPDX-License-Identifier: Apache-2.0
"""Hard cases 1, 18, 19 and 22 to 29: loss, optimiser, density control and training."""

from __future__ import annotations

import dataclasses
import itertools
import shutil
import subprocess
import threading
from pathlib import Path

import numpy as np
import pytest
import torch
from scenes.differentiation import image_loss
from scenes.documents import effects
from scenes.splat_scenes import NEAR, RATES, all_finite, arrays_of, camera_at, scene, step, target_of
from scenes.training_scene import OPTIONS, quality_db, training_scene

from cotton3dg import _native
from cotton3dg.core.scene import Gaussians
from cotton3dg.errors import OutOfResources
from cotton3dg.gaussians import rasterizer
from cotton3dg.geometry.camera_orbit import Orbit
from cotton3dg.segment.affinity import normalise
from cotton3dg.train import densify, trainer
from cotton3dg.train.initialise import place_gaussians
from cotton3dg.train.quality import metrics_of, outcome_of
from cotton3dg.train.schedule import SURROUNDINGS_LOG_SCALES, SURROUNDINGS_MEANS, rate_factors
from cotton3dg.train.trainer import fit

ROOT = Path(__file__).parents[2]
MOST_ADAM_STEP = 0.1 / np.sqrt(0.001)
"""Of Kingma and Ba 2015, section 2.1: no update is longer than rate * (1 - beta1) / sqrt(1 - beta2)."""


def test_case_01_a_hundred_identical_points_can_be_trained_from() -> None:
    _, views, _ = training_scene()
    start = place_gaussians(np.tile([0.1, 0.2, 0.3], (100, 1)), np.full((100, 3), 128, np.uint8), 0, 400, 0)
    assert np.isfinite(start.log_scales).all()
    result = fit(start, views, dataclasses.replace(OPTIONS, steps=60))
    assert result.gaussians.finite_rows.all()
    assert result.culled == {"non_finite": 0, "degenerate": 0}
    assert result.rejected == []


def test_case_02_culled_gaussians_are_counted_in_the_stages_record() -> None:
    start, views, _ = training_scene()
    start.log_scales[3, 0], start.quats[5] = np.inf, 0
    result = fit(start, views, dataclasses.replace(OPTIONS, steps=60))
    assert result.culled["non_finite"] >= 1
    assert result.culled["degenerate"] >= 1
    outcome = outcome_of(metrics_of(result, [], 1e-4), effects())
    assert "gaussians_culled" in outcome.flags
    assert f"{result.culled['degenerate']} degenerate" in outcome.warnings[0]


def test_case_18_faded_or_reset_opacities_recover() -> None:
    """Even the paper's hard reset to 0.01 leaves a scene that training brings back; what fades is pruned, counted."""
    start, views, held_out = training_scene()
    trained = fit(start, views, OPTIONS).gaussians
    before_db = quality_db(trained, held_out)

    def fade(gaussians: Gaussians) -> None:
        opacities = np.maximum(0.01 * gaussians.opacities.astype(np.float64), 1e-6)
        gaussians.opacity_logits[:] = np.log(opacities / (1 - opacities))

    for reset in (fade, lambda g: g.opacity_logits.fill(np.log(0.01 / 0.99))):
        spoilt = densify.concatenate([trained])
        reset(spoilt)
        assert quality_db(spoilt, held_out) < before_db - 5
        result = fit(spoilt, views, OPTIONS)
        assert quality_db(result.gaussians, held_out) > before_db - 2
        assert result.gaussians.finite_rows.all()
        assert len(result.gaussians) == len(spoilt) - result.n_pruned + result.n_split


def test_case_19_ssim_of_flat_and_tiny_images(record_property) -> None:
    largest = 0.0
    for size in itertools.product((1, 2, 3, 10, 11, 12, 40), repeat=2):
        for level in (0, 1, 128, 254, 255):
            target = np.full((*size, 3), level, np.uint8)
            for image in (target / np.float32(255), np.full((*size, 3), 0.3, np.float32), np.zeros((*size, 3))):
                report, v_image = image_loss(image.astype(np.float32), target)
                largest = max(largest, report["ssim"])
                assert all_finite(v_image, np.array(list(report.values())))
    record_property("largest SSIM (<= 1, to rounding)", largest)
    assert largest <= 1 + 1e-7
    same = np.full((20, 20, 3), 77, np.uint8)
    assert image_loss((same / 255).astype(np.float64), same)[0]["ssim"] == pytest.approx(1, abs=1e-9)


def test_case_22_masks_that_are_empty_full_or_of_another_size() -> None:
    camera, gaussians = camera_at(40, 30), scene(50, seed=1)
    nothing = rasterizer.accumulate_weights(gaussians, camera, np.zeros((30, 40), np.uint16), near_su=NEAR)
    assert len(nothing.rows) == 0
    everything = rasterizer.accumulate_weights(gaussians, camera, np.full((30, 40), 7, np.uint16), near_su=NEAR)
    np.testing.assert_allclose(everything.weights, everything.total[everything.total > 0], rtol=1e-6)
    assert np.array_equal(nothing.total, everything.total)
    with pytest.raises(ValueError, match="mask_ids"):
        rasterizer.accumulate_weights(gaussians, camera, np.zeros((40, 30), np.uint16))


def test_case_24_features_without_direction_stay_zero_without_gradient() -> None:
    rows = torch.tensor([[3.0, 4.0], [0.0, 0.0], [1e-20, 0.0], [1e-3, 0.0], [1e18, 1e18]], requires_grad=True)
    unit = normalise(rows)
    (unit * torch.tensor([1.0, -2.0])).sum().backward()
    torch.testing.assert_close(unit[0], torch.tensor([0.6, 0.8]))
    assert not unit[1:3].any()
    assert unit.norm(dim=1)[3:].tolist() == pytest.approx([1, 1], rel=1e-5)
    assert torch.isfinite(rows.grad).all()
    assert not rows.grad[1:3].any()
    assert rows.grad[3].norm() <= 2.5e3


def test_case_25_no_step_of_adam_is_longer_than_its_bound() -> None:
    """However small the gradient: weights down to 1e-4 behind opaque layers, colours from 1 to 1e-12."""
    camera, gaussians = camera_at(24, 18), scene(60, seed=3)
    gaussians.opacity_logits[:] = np.linspace(-5.5, 6, 60)
    gaussians.sh[:] *= np.geomspace(1, 1e-12, 60, dtype=np.float32)[:, None, None]
    adam, statistics = rasterizer.AdamState.zeros(gaussians), rasterizer.DensityStatistics.zeros(60)
    for _ in range(20):
        before = Gaussians(*(a.copy() for a in arrays_of(gaussians)))
        rasterizer.train_step(
            gaussians, adam, statistics, camera, target_of(camera), sh_degree=3, learning_rates=RATES, near_su=NEAR
        )
        moved = [np.abs(a - b).max() for a, b in zip(arrays_of(gaussians), arrays_of(before), strict=True)]
        limits = np.array([RATES.means, RATES.quats, RATES.log_scales, RATES.opacity_logits, RATES.sh0])
        assert (moved <= 1.01 * MOST_ADAM_STEP * limits + 1e-6).all()


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_case_25_the_first_steps_of_a_late_band_are_no_longer_than_its_rate(degree: int) -> None:
    """Its moments start at zero however many steps the Gaussian has taken without it."""
    camera, gaussians = camera_at(24, 18), scene(60, seed=3)
    adam, statistics = rasterizer.AdamState.zeros(gaussians), rasterizer.DensityStatistics.zeros(60)
    options = {"target": target_of(camera), "learning_rates": RATES, "near_su": NEAR}
    for _ in range(150):
        rasterizer.train_step(gaussians, adam, statistics, camera, sh_degree=degree - 1, **options)
    band = slice(degree**2, (degree + 1) ** 2)
    for _ in range(3):
        before = gaussians.sh[:, band].copy()
        rasterizer.train_step(gaussians, adam, statistics, camera, sh_degree=degree, **options)
        assert np.abs(gaussians.sh[:, band] - before).max() <= 1.05 * RATES.sh_rest


@pytest.mark.parametrize("distance", [20.0, 1e3, 1e25])
def test_case_25_steps_far_away_keep_their_limit(distance: float) -> None:
    """However far the region where steps stay short is; squares of the largest distance overflow."""
    camera, gaussians = camera_at(24, 18), scene(60, seed=3)
    orbit = Orbit(np.array([distance, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), 1.0, 1.0, 360.0, 0.0)
    before = Gaussians(*(a.copy() for a in arrays_of(gaussians)))
    step(gaussians, camera, rate_factors=rate_factors(gaussians.means, orbit))
    moved = [np.abs(a - b).max() for a, b in zip(arrays_of(gaussians), arrays_of(before), strict=True)]
    far = SURROUNDINGS_MEANS * RATES.means, RATES.quats, SURROUNDINGS_LOG_SCALES * RATES.log_scales
    limits = np.array([*far, RATES.opacity_logits, RATES.sh0])
    assert np.allclose(moved, limits, rtol=0.01)


def test_case_25_what_a_view_does_not_show_does_not_move() -> None:
    """Not even by momentum, which with an epsilon of 1e-15 would be a full step."""
    camera, gaussians = camera_at(24, 18), scene(60, seed=3)
    away = camera_at(24, 18, angle=np.pi)
    gaussians.means[:30, 2] = -9  # behind the first camera, in front of the second
    adam, statistics = rasterizer.AdamState.zeros(gaussians), rasterizer.DensityStatistics.zeros(60)
    options = {"sh_degree": 3, "learning_rates": RATES, "near_su": NEAR}
    for _ in range(5):
        rasterizer.train_step(gaussians, adam, statistics, away, target_of(away), **options)
    assert np.abs(adam.first.means[:30]).max() > 0
    before, counted = gaussians[:30].sha256(), adam.steps[:30].copy()
    for _ in range(5):
        rasterizer.train_step(gaussians, adam, statistics, camera, target_of(camera), **options)
    assert gaussians[:30].sha256() == before
    assert np.array_equal(adam.steps[:30], counted)
    assert (adam.steps[30:] > 5).any()


def test_case_25_longest_gradients_leave_finite_moments() -> None:
    camera, gaussians = camera_at(24, 18), scene(40, seed=3)
    gaussians.sh[:] = np.float32(1e5)
    gaussians.quats[:] *= np.float32(1e-25)  # its gradient grows as its length shrinks
    report, adam, _ = step(gaussians, camera)
    assert report.finite
    assert all_finite(*arrays_of(gaussians), *arrays_of(adam.first), *arrays_of(adam.second))


def test_case_25_a_gradient_that_is_not_finite_stops_its_own_gaussian_only() -> None:
    """In the camera's very centre the direction of view, and with it the colour, changes infinitely fast."""
    camera, gaussians = camera_at(24, 18), scene(40, seed=3)
    camera = dataclasses.replace(camera, cam_from_scene=np.eye(3, 4))
    gaussians.means[:, 2] += 3
    gaussians.means[7], gaussians.opacity_logits[7], gaussians.sh[7] = (0, 0, 2e-38), -1, 300
    gaussians.log_scales[7] = -30
    adam, statistics = rasterizer.AdamState.zeros(gaussians), rasterizer.DensityStatistics.zeros(40)
    options = {"sh_degree": 3, "learning_rates": RATES, "near_su": 1e-38}
    before = [a.copy() for a in arrays_of(gaussians)]
    for number in range(1, 21):
        report = rasterizer.train_step(gaussians, adam, statistics, camera, target_of(camera), **options)
        assert report.finite
        assert report.n_skipped == 1
        assert statistics.count.max() == number
    assert all(np.array_equal(new[7], old[7]) for new, old in zip(arrays_of(gaussians), before, strict=True))
    assert adam.steps[7].max() == statistics.count[7] == 0
    assert all_finite(*arrays_of(gaussians), *arrays_of(adam.first), *arrays_of(adam.second))
    assert all_finite(*vars(statistics).values())


def test_case_26_more_pairs_than_memory_are_an_error_not_a_crash() -> None:
    """1100 Gaussians over each of the 4 million tiles of a 32768 px image: more than 32 bits can number."""
    camera, gaussians = camera_at(32768, 32768), scene(1100, seed=0)
    gaussians.log_scales[:] = 3
    for call in (
        lambda: rasterizer.accumulate_weights(gaussians, camera, np.zeros((32768, 32768), np.uint16), near_su=NEAR),
        lambda: rasterizer.ray_weights(gaussians, camera, np.zeros((1, 2), int), near_su=NEAR),
    ):
        with pytest.raises(OutOfResources, match="fewer Gaussians or smaller images"):
            call()


@pytest.mark.parametrize(("mib", "enough"), [(20, False), (2000, True)])
def test_case_26_the_limit_follows_the_memory_there_is(mib: int, enough: bool) -> None:
    """Some 300,000 pairs take 24 MiB in a training step; the tables of a new thread are empty."""
    camera, gaussians = camera_at(640, 480), scene(250, seed=0)
    gaussians.log_scales[:], gaussians.opacity_logits[:] = 1, -4
    outcome: list[object] = []

    def take_step() -> None:
        try:
            outcome.append(step(gaussians, camera)[0])
        except OutOfResources as error:
            outcome.append(error)

    _native.for_tests.pretend_available_memory(mib * 2**20)
    try:
        thread = threading.Thread(target=take_step)
        thread.start()
        thread.join()
    finally:
        _native.for_tests.pretend_available_memory(-1)
    if enough:
        assert outcome[0].n_pairs > 250_000
        assert outcome[0].finite
    else:
        assert isinstance(outcome[0], OutOfResources)
        assert "fewer Gaussians or smaller images" in str(outcome[0])


def write_files(root: Path, files: dict[str, str]) -> str:
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return str(root)


GIB = 2**30
MEMINFO = {"proc/meminfo": f"MemTotal: {32 * 2**20} kB\nMemFree: 1 kB\nMemAvailable: {16 * 2**20} kB\n"}
CACHE = f"anon 5\ninactive_file {GIB}\ntotal_inactive_file {GIB}\n"
OF_THE_MACHINE, OF_THE_JOB, OF_THE_CONTAINER = 16 * GIB, 3 * GIB, 5 * GIB


@pytest.mark.parametrize(
    ("files", "available"),
    [
        ({}, 2**63 - 1),
        (MEMINFO, OF_THE_MACHINE),
        ({**MEMINFO, "proc/self/cgroup": "0::/job/step\n"}, OF_THE_MACHINE),
        (
            {
                **MEMINFO,
                "proc/self/cgroup": "0::/job/step\n",
                "sys/fs/cgroup/job/step/memory.max": "max\n",
                "sys/fs/cgroup/job/step/memory.current": f"{2 * GIB}\n",
                "sys/fs/cgroup/job/memory.max": f"{4 * GIB}\n",
                "sys/fs/cgroup/job/memory.current": f"{2 * GIB}\n",
                "sys/fs/cgroup/job/memory.stat": CACHE,
            },
            OF_THE_JOB,
        ),
        (
            {
                **MEMINFO,
                "proc/self/cgroup": "5:cpu,cpuacct:/\n4:memory:/docker/a:b\n0::/\n",
                "sys/fs/cgroup/memory/memory.limit_in_bytes": f"{6 * GIB}\n",
                "sys/fs/cgroup/memory/memory.usage_in_bytes": f"{2 * GIB}\n",
                "sys/fs/cgroup/memory/memory.stat": CACHE,
            },
            OF_THE_CONTAINER,
        ),
    ],
)
def test_case_26_the_memory_there_is_is_read_as_the_system_tells_it(
    tmp_path: Path, files: dict[str, str], available: int
) -> None:
    assert _native.for_tests.available_memory(write_files(tmp_path, files)) == available
    assert _native.for_tests.available_memory("") > 0


def test_case_26_the_budget_holds_when_everything_wants_to_split() -> None:
    start, views, _ = training_scene()
    start.log_scales[:] = 1.0  # all oversized: all come first
    counts: list[int] = []
    options = dataclasses.replace(OPTIONS, max_gaussians=250, steps=120)
    fit(start, views, options, watch=lambda _, gaussians: counts.append(len(gaussians)))
    assert max(counts) <= 250
    assert densify.scheduled_count(10**6, 2**40, 1.0) == 2**40


def test_case_27_poisoned_statistics_choose_nothing() -> None:
    gaussians, n = scene(50, seed=0), 50
    sums = np.resize(np.array([np.nan, np.inf, -np.inf, -1, 0, 1e38, 1], np.float32), n)
    counts = np.resize(np.array([0, 1, 2, 0, -1], np.int32), n)
    need = densify.growth_score(sums, counts)
    assert (np.isfinite(need) & (need >= 0)).all()
    keep = densify.find_contributing(sums, counts)
    assert keep.dtype == bool
    densified = densify.densify(gaussians, np.ones(n, bool), need, 70)
    assert densified.gaussians.finite_rows.all()
    assert n <= len(densified.gaussians) <= 70
    assert set(densified.rows[~densified.continued]) <= set(np.flatnonzero(need > 0))


def test_case_28_fast_math_is_forbidden() -> None:
    build = (ROOT / "native" / "CMakeLists.txt").read_text()
    flags = [line for line in build.splitlines() if not line.lstrip().startswith("#")]
    for flag in ("fast-math", "Ofast", "finite-math", "associative-math", "unsafe-math"):
        assert flag not in "\n".join(flags)
    assert "-ffp-contract=off" in build


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs a compiler")
@pytest.mark.parametrize(("flags", "recognised"), [(["-O2"], True), (["-O2", "-ffast-math"], False)])
def test_case_28_the_import_time_self_test_notices_fast_math(
    tmp_path: Path, flags: list[str], recognised: bool
) -> None:
    """A canary: the self-test itself, compiled with and without the flag that removes isnan."""
    (tmp_path / "main.cpp").write_text(
        '#include "self_test.h"\nint main() { return cotton::baseline::self_test() ? 0 : 42; }\n'
    )
    sources = ROOT / "native" / "src"
    command = ["g++", "-std=c++20", "-msse4.1", "-DCOTTON_ISA=baseline", *flags, f"-I{sources}"]
    subprocess.run(
        [*command, str(tmp_path / "main.cpp"), "-o", str(tmp_path / "canary")], check=True, capture_output=True
    )
    assert subprocess.run([str(tmp_path / "canary")], check=False).returncode == (0 if recognised else 42)


def test_case_29_training_does_not_depend_on_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every array of a whole training, by 1 to 16 threads."""
    start, views, _ = training_scene()
    options, honest, seen = dataclasses.replace(OPTIONS, steps=60), rasterizer.train_step, set()
    for threads in (1, 2, 3, 8, 16):
        monkeypatch.setattr(trainer, "train_step", lambda *a, t=threads, **k: honest(*a, **k, threads=t))
        seen.add(fit(start, views, options).gaussians.sha256())
    assert len(seen) == 1


def test_the_instruction_set_in_use_passes_its_self_test() -> None:
    assert _native.instruction_set() in _native.instruction_sets()
