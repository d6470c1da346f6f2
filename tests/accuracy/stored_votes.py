# SPDX-License-Identifier: Apache-2.0
"""What tells the bolls of a plant apart, with the truth, in one file: so that fitting and judging take seconds.

A plant is a folder where `cotton3dg masks` and `cotton3dg scale` are through, with `truth.json`, `cameras.json` and
`instances/` in it or in another folder (`true_scene.true_plant`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from true_scene import TruePlant, cm_from_scene, true_bolls_cm, true_masks

from cotton3dg.cluster.hough_voting import DEEPER, LEAST_PROBABILITY, LEAST_SHARE, Votes, cast_votes
from cotton3dg.cluster.lint_in_space import LintInSpace
from cotton3dg.core.network_maps import Maps
from cotton3dg.core.scene import Camera, Gaussians
from cotton3dg.gaussians import rasterizer
from cotton3dg.geometry.camera_orbit import fit_orbit, within_orbit
from cotton3dg.io.colmap import read_cameras
from cotton3dg.io.ply import read_gaussians
from cotton3dg.io.saving import file_sha256
from cotton3dg.schemas.network_maps import read_maps
from cotton3dg.schemas.scale import ScaleInfo
from cotton3dg.segment.lint_share import EDGE, STEEPNESS, gather_lint

LINT_SHARE = 0.02
"""Least share of lint of the Gaussians that are kept: those that any measure of lint in space reads have more."""


@dataclass(frozen=True)
class StoredVotes:
    """What `separate_bolls` is given, and what it should find."""

    votes: list[Votes]
    lint: LintInSpace
    cm_per_su: float | None
    true_ids: NDArray[np.int64]
    """(N,) true boll of each Gaussian, 0 = most of what it shows is none's."""
    true_cm: NDArray[np.float64]
    """(B, 3) centres of the true bolls in the true world."""
    cm_from_scene: NDArray[np.float64]
    """(3, 4)."""

    @cached_property
    def up(self) -> tuple[float, ...]:
        """(3,) upwards in the scene; what is measured with it can be cached."""
        return tuple(self.cm_from_scene[2, :3].tolist())


def open_votes(plant: TruePlant, folder: Path) -> StoredVotes:
    """From `folder`, if they are of this model, these maps and these constants; else gathered and kept there."""
    kept = folder / f"{plant.run.plant_id}.npz"
    constants = (EDGE, STEEPNESS, LEAST_SHARE, LEAST_PROBABILITY, DEEPER)
    made_of = f"{file_sha256(plant.run.gaussians_ply)} {file_sha256(plant.run.masks_json)} {constants}"
    if not kept.is_file() or _load(kept, ["made_of"])["made_of"] != made_of:
        folder.mkdir(parents=True, exist_ok=True)
        _save(kept, gather_votes(plant), made_of)
    return _read(kept)


def gather_votes(plant: TruePlant) -> StoredVotes:
    """What the maps of a plant say."""
    model, cameras = read_gaussians(plant.run.gaussians_ply), read_cameras(plant.run.undistorted / "sparse")
    maps, views = open_maps(plant)
    inside = within_orbit(model.means, cameras, fit_orbit(cameras))
    lint = LintInSpace.of(model, gather_lint(maps, views, model, inside))
    votes = [cast_votes(of_image, camera, lint) for of_image, camera in zip(maps, views, strict=True)]
    scale = ScaleInfo.load(plant.run.scale_json)
    true_cm = true_bolls_cm(plant)
    weights, total = true_weights(plant, model, len(true_cm))
    true_ids = np.where(2 * weights.sum(axis=1) > total, weights.argmax(axis=1), 0)
    kept = (lint.shares > LINT_SHARE) & np.isfinite(lint.gaussians.means).all(axis=1)
    slim = LintInSpace(model[kept], lint.shares[kept], lint.origin)
    return StoredVotes(votes, slim, scale.cm_per_su, true_ids[kept], true_cm, cm_from_scene(plant))


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


def _save(path: Path, stored: StoredVotes, made_of: str) -> None:
    rows = {
        f"votes_{item.name}": np.concatenate([getattr(view, item.name) for view in stored.votes])
        for item in fields(Votes)
        if item.name != "eye"
    }
    model = {f"model_{item.name}": getattr(stored.lint.gaussians, item.name) for item in fields(Gaussians)}
    np.savez(
        path,
        made_of=made_of,
        eyes=[view.eye for view in stored.votes],
        counts=[len(view.rays) for view in stored.votes],
        shares=stored.lint.shares,
        origin=stored.lint.origin,
        cm_per_su=np.nan if stored.cm_per_su is None else stored.cm_per_su,
        true_ids=stored.true_ids,
        true_cm=stored.true_cm,
        cm_from_scene=stored.cm_from_scene,
        **rows,
        **model,
    )


def _read(path: Path) -> StoredVotes:
    kept = _load(path)
    ends = np.cumsum(kept["counts"])[:-1]
    names = [item.name for item in fields(Votes) if item.name != "eye"]
    rows = {name: np.split(kept[f"votes_{name}"], ends) for name in names}
    votes = [
        Votes(
            eye=kept["eyes"][k],
            **{name: parts[k] for name, parts in rows.items()},
        )
        for k in range(len(kept["eyes"]))
    ]
    model = Gaussians(**{name[len("model_") :]: kept[name] for name in kept if name.startswith("model_")})
    cm_per_su = float(kept["cm_per_su"])
    return StoredVotes(
        votes,
        LintInSpace(model, kept["shares"], kept["origin"]),
        cm_per_su if np.isfinite(cm_per_su) else None,
        kept["true_ids"],
        kept["true_cm"],
        kept["cm_from_scene"],
    )


def _load(path: Path, names: list[str] | None = None) -> dict[str, Any]:
    with np.load(path) as kept:
        return {name: kept[name] for name in names or kept.files}
