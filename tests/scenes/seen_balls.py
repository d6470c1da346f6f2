# SPDX-License-Identifier: Apache-2.0
"""Balls of lint and what views from around would say of them, as far as bolls are told apart by it; lengths in cm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cotton3dg.cluster.hough_voting import Votes
from cotton3dg.cluster.lint_in_space import LintInSpace

from .splat_scenes import round_gaussians

FAR, PIXEL = 100.0, 0.2


@dataclass(frozen=True)
class Ball:
    centre: tuple[float, float, float]
    radius: float
    aim: tuple[float, float, float] | None = None
    """Where its votes go; None = to its centre."""
    said: float = 4.0
    """Width that votes give its boll."""
    probability: float = 0.9


def look(balls: list[Ball], angle: float, scatter: float) -> Votes:
    """What a view from far away says."""
    out = np.array([np.cos(angle), np.sin(angle), 0.0])
    right, up = np.array([-out[1], out[0], 0.0]), np.array([0.0, 0.0, 1.0])
    centres = np.array([ball.centre for ball in balls])
    low, high = centres.min() - 5, centres.max() + 5
    v, u = np.meshgrid(*2 * [np.arange(low, high, PIXEL)], indexing="ij")
    across = (u[..., None] - centres @ right) ** 2 + (v[..., None] - centres @ up) ** 2
    nearer = np.array([ball.radius for ball in balls]) ** 2 - across
    depths = np.where(nearer > 0, centres @ -out - np.sqrt(nearer.clip(0)), np.inf)
    pixels = np.nonzero(np.isfinite(depths.min(axis=-1)))
    own = depths.argmin(axis=-1)[pixels]
    surfaces = u[pixels][:, None] * right + v[pixels][:, None] * up - depths.min(axis=-1)[pixels][:, None] * out
    aims = np.array([ball.aim or ball.centre for ball in balls])[own] + np.random.default_rng(0).normal(
        0, scatter, (len(own), 3)
    )
    rays = aims - FAR * out
    said = np.array([ball.said for ball in balls])[own]
    return Votes(
        places=aims.astype(np.float32),
        surfaces=surfaces.astype(np.float32),
        rays=(rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32),
        eye=FAR * out,
        diameters=said.astype(np.float32),
        probabilities=np.array([ball.probability for ball in balls], np.float32)[own],
        weights=(PIXEL**2 / (np.pi / 4 * said**2)).astype(np.float32),
    )


def see(balls: list[Ball], views: int = 12, scatter: float = 0.2) -> tuple[list[Votes], LintInSpace]:
    """Votes from all around, with a standard deviation, and the lint."""
    shell = np.random.default_rng(1).normal(size=(300, 3))
    shell /= np.linalg.norm(shell, axis=1, keepdims=True)
    places = np.concatenate([np.array(ball.centre) + ball.radius * shell for ball in balls])
    lint = LintInSpace(round_gaussians(places, 0.1), np.ones(len(places), np.float32), np.zeros(3, np.float32))
    return [look(balls, 2 * np.pi * k / views, scatter) for k in range(views)], lint
