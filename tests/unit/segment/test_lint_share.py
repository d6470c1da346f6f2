# SPDX-License-Identifier: Apache-2.0
"""How much each Gaussian is lint."""

import numpy as np
import pytest
from lint_curve import LintExamples, fit_curve, write_curve
from scenes.boll_scene import CENTRES, cameras, maps_of, masks_of, model

from cotton3dg.segment.lint_share import LintCurve, average_lint, gather_lint, read_curve


def test_the_curve_is_one_half_at_its_edge_and_rises():
    curve = LintCurve(edge=0.4, steepness=15)
    shares = curve.shares(np.array([0, 0.3, 0.4, 0.5, 1]))
    assert shares[2] == 0.5
    assert (np.diff(shares) > 0).all()
    assert shares[1] == pytest.approx(1 - shares[3])


def test_bolls_are_lint_by_the_mean_of_all_views():
    gaussians, bolls = model()
    rng = np.random.default_rng(0)
    seen = [
        maps_of(camera, ids, rng) for camera, ids in zip(cameras(), masks_of(gaussians, bolls, cameras()), strict=True)
    ]
    means = average_lint(seen, cameras(), gaussians)
    one = average_lint(seen[:1], cameras()[:1], gaussians)
    assert means[bolls > 0].mean() > 0.5 > means[bolls == 0].mean()
    assert not np.allclose(one, means)
    left = gaussians.means[:, 0] < CENTRES[:, 0].mean()
    shares = gather_lint(seen, cameras(), gaussians, left)
    assert not shares[~left].any()
    np.testing.assert_array_equal(shares[left], read_curve().shares(means)[left])


def test_the_fit_finds_the_curve_that_the_examples_follow(tmp_path):
    true = LintCurve(edge=0.37, steepness=9)
    rng = np.random.default_rng(0)

    def plant(n):
        means = rng.uniform(0.02, 1, n)
        return LintExamples(means, true.shares(means).astype(np.float64), rng.uniform(1, 9, n))

    fitted = fit_curve([plant(300), plant(5000)])
    assert fitted.edge == pytest.approx(true.edge, abs=0.002)
    assert fitted.steepness == pytest.approx(true.steepness, abs=0.05)
    write_curve(tmp_path / "curve.toml", fitted, 2)
    assert read_curve(tmp_path / "curve.toml") == fitted


def test_each_plant_has_the_same_say():
    def plant(edge, n):
        means = np.linspace(0.02, 1, n)
        return LintExamples(means, (means > edge).astype(np.float64), np.ones(n))

    few = fit_curve([plant(0.3, 100), plant(0.5, 100)])
    many = fit_curve([plant(0.3, 100), plant(0.5, 4000)])
    assert many.edge == pytest.approx(few.edge, abs=0.01)
