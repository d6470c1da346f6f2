# SPDX-License-Identifier: Apache-2.0
"""Fit how a Gaussian's share of lint follows from what the network says of it (`cotton3dg/segment/lint_share.toml`).

The truth is the share of lint in the pixels that the Gaussian is drawn on, by the true masks of the film.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from true_scene import TruePlant, true_bolls_cm, true_masks

from cotton3dg.core.network_maps import Maps
from cotton3dg.core.scene import Camera, Gaussians
from cotton3dg.gaussians import rasterizer
from cotton3dg.geometry.camera_orbit import fit_orbit, within_orbit
from cotton3dg.io.colmap import read_cameras
from cotton3dg.io.ply import read_gaussians
from cotton3dg.io.saving import write_text_atomically
from cotton3dg.schemas.network_maps import read_maps
from cotton3dg.segment.lint_share import LintCurve, average_lint

LEAST_MEAN = 0.02
"""Gaussians of which the network says less are not lint, and teach nothing."""


class LintExamples(NamedTuple):
    """Gaussians of one plant, those that may be lint at all."""

    means: NDArray[np.float64]
    """(N,) mean probability of lint."""
    true: NDArray[np.float64]
    """(N,) share of lint in the pixels that each is drawn on."""
    weights: NDArray[np.float64]
    """(N,) how much of it the images show, px."""


def open_maps(plant: TruePlant) -> tuple[list[Maps], list[Camera]]:
    """What `masks` stored of the plant's images, and the cameras of these."""
    cameras = read_cameras(plant.run.undistorted / "sparse")
    seen = [camera for camera in cameras if plant.run.maps_npz(camera.name).is_file()]
    return [read_maps(plant.run.maps_npz(camera.name)) for camera in seen], seen


def true_weights(plant: TruePlant, gaussians: Gaussians, bolls: int) -> tuple[np.ndarray, np.ndarray]:
    """(N, bolls + 1) weight of each Gaussian in the pixels of each true boll, from column 1, and (N,) in all pixels."""
    cameras = read_cameras(plant.run.undistorted / "sparse")
    weights, total = np.zeros((len(gaussians), bolls + 1)), np.zeros(len(gaussians))
    for name, ids in true_masks(plant, cameras).items():
        camera = next(camera for camera in cameras if camera.name == name)
        held = rasterizer.accumulate_weights(gaussians, camera, ids)
        np.add.at(weights, (held.rows, held.ids), held.weights)
        total += held.total
    return weights, total


def gather_lint_examples(plant: TruePlant) -> LintExamples:
    """The Gaussians of a plant whose masks are made."""
    gaussians = read_gaussians(plant.run.gaussians_ply)
    cameras = read_cameras(plant.run.undistorted / "sparse")
    means = average_lint(*open_maps(plant), gaussians)
    weights, total = true_weights(plant, gaussians, len(true_bolls_cm(plant)))
    kept = within_orbit(gaussians.means, cameras, fit_orbit(cameras)) & (means > LEAST_MEAN) & (total > 0)
    return LintExamples(means[kept], weights[kept].sum(axis=1) / total[kept], total[kept])


def fit_curve(plants: Sequence[LintExamples]) -> LintCurve:
    """Logistic regression on the shares; each plant has the same say."""
    from scipy.optimize import minimize

    means, true = (np.concatenate([getattr(plant, name) for plant in plants]) for name in ("means", "true"))
    say = np.concatenate([plant.weights / plant.weights.sum() for plant in plants])

    def loss(values: np.ndarray) -> tuple[float, np.ndarray]:
        odds = values[0] + values[1] * means
        wrong = say * (1 / (1 + np.exp(-odds.clip(-50, 50))) - true)
        return float(say @ (np.logaddexp(0, odds) - true * odds)), np.array([wrong.sum(), wrong @ means])

    constant, steepness = minimize(loss, [-6.0, 15.0], jac=True, method="L-BFGS-B").x
    return LintCurve(round(float(-constant / steepness), 3), round(float(steepness), 2))


def write_curve(path: Path, curve: LintCurve, films: int) -> None:
    """As a person reads it."""
    lines = [
        "# The share of lint of a Gaussian: 1 / (1 + exp(steepness * (edge - mean probability of all views))).",
        f"# Fitted by `make same-boll` on {films} plants.",
        f"edge = {curve.edge}",
        f"steepness = {curve.steepness}",
    ]
    write_text_atomically(path, "\n".join([*lines, ""]))
