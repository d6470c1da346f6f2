# SPDX-License-Identifier: Apache-2.0
"""Lifted masks and bolls on disk: selections.npz, bolls.json and labels.npy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import BollInstance, BollSelection, LeftOut, LiftedMasks
from ..core.scene import Float32, Gaussians
from ..errors import BadInput
from ..io.arrays import read_array, read_arrays
from .document import Document


@dataclass(frozen=True)
class BollMask:
    """A mask that shows a boll."""

    view: str
    mask_id: int


@dataclass(frozen=True)
class BollFacts:
    """One boll without its Gaussians; labels.npy marks these with its id."""

    id: int
    centre_su: tuple[float, ...]
    diameter_su: float
    n_gaussians: int
    views: tuple[str, ...]
    confidence: float
    flags: tuple[str, ...]
    masks: tuple[BollMask, ...]


@dataclass(frozen=True)
class BollsInfo(Document):
    """cluster/bolls.json."""

    REMEDY = "run `cotton3dg cluster --force`"

    gaussians_sha256: str
    """`Gaussians.sha256()` of the model that the bolls are part of."""
    bolls: tuple[BollFacts, ...]
    left_out: tuple[LeftOut, ...] = ()
    """What looks like lint and is not among the bolls."""
    halves: tuple[int, int] | None = None
    """Counts of bolls by every second image alone, and by the others."""
    joining: float = 0.0
    """Share of the parts of bolls that were joined to others."""


def describe_bolls(
    bolls: Sequence[BollInstance],
    gaussians_sha256: str,
    left_out: tuple[LeftOut, ...] = (),
    halves: tuple[int, int] | None = None,
    joining: float = 0.0,
) -> BollsInfo:
    """The document of some bolls."""
    facts = (
        BollFacts(
            boll.boll_id,
            tuple(float(x) for x in boll.centre),
            boll.diameter_su,
            len(boll.indices),
            boll.views,
            boll.confidence,
            boll.flags,
            tuple(BollMask(view, mask_id) for view, mask_id in boll.masks),
        )
        for boll in bolls
    )
    return BollsInfo(gaussians_sha256, tuple(facts), left_out, halves, joining)


def write_lifted(path: Path, lifted: LiftedMasks) -> None:
    """Save as an uncompressed .npz of plain arrays; `files` of it are listed in `read_lifted`."""
    selections = lifted.selections
    with path.open("wb") as file:
        np.savez(
            file,
            gaussians_sha256=np.array(lifted.gaussians_sha256),
            views=np.array(lifted.views, dtype=str),
            candidates=lifted.candidates,
            foreground=lifted.foreground,
            seen=lifted.seen,
            mask_views=np.array([lifted.views.index(s.view) for s in selections], np.int64),
            mask_ids=np.array([s.mask_id for s in selections], np.int64),
            mask_sizes=np.array([len(s.indices) for s in selections], np.int64),
            indices=np.concatenate([np.zeros(0, np.int64), *(s.indices for s in selections)]),
            weights=np.concatenate([np.zeros(0, np.float32), *(s.weights for s in selections)]),
        )


def read_lifted(path: Path) -> LiftedMasks:
    """Read the lifted masks that `write_lifted` saved.

    Raises:
        BadInput: it is not such a file, or its arrays do not belong together.
    """
    try:
        arrays = read_arrays(path)
        views = tuple(str(view) for view in arrays["views"])
        candidates, foreground, seen = arrays["candidates"], arrays["foreground"], arrays["seen"]
        stops = np.cumsum(arrays["mask_sizes"])[:-1]
        indices, weights = np.split(arrays["indices"], stops), np.split(arrays["weights"], stops)
        named = zip(arrays["mask_views"], arrays["mask_ids"], indices, weights, strict=bool(len(arrays["mask_ids"])))
        selections = tuple(BollSelection(views[v], int(m), rows, held) for v, m, rows, held in named)
        sha256 = str(arrays["gaussians_sha256"])
    except (BadInput, ValueError, KeyError, IndexError, TypeError) as error:
        raise BadInput(f"{path.name} is damaged ({error}); make it again with `cotton3dg segment`") from error
    if seen.shape != (len(views), len(candidates)) or foreground.shape != candidates.shape:
        raise BadInput(f"{path.name} has arrays of different length; make it again with `cotton3dg segment`")
    return LiftedMasks(sha256, views, candidates, foreground, seen, selections)


def write_lint_share(path: Path, shares: Float32, gaussians_sha256: str) -> None:
    """Save how much each Gaussian (N,) of a model is lint, as an uncompressed .npz."""
    with path.open("wb") as file:
        np.savez(file, gaussians_sha256=np.array(gaussians_sha256), shares=shares)


def read_lint_share(path: Path, gaussians: Gaussians) -> Float32:
    """(N,) how much each of these Gaussians is lint, as `write_lint_share` saved it.

    Raises:
        BadInput: the file is damaged, or belongs to another model.
    """
    arrays = read_arrays(path)
    if str(arrays.get("gaussians_sha256")) != gaussians.sha256():
        raise BadInput(f"{path.name} belongs to another model than gaussians.ply; run `cotton3dg segment` again")
    if arrays.get("shares", np.zeros(0)).shape != (len(gaussians),):
        raise BadInput(f"{path.name} is damaged; make it again with `cotton3dg segment`")
    return arrays["shares"].astype(np.float32)


def boll_labels(bolls: list[BollInstance], n: int) -> NDArray[np.int32]:
    """(N,) boll of each of n Gaussians, 0 = none."""
    labels = np.zeros(n, np.int32)
    for boll in bolls:
        labels[boll.indices] = boll.boll_id
    return labels


def read_bolls(bolls_json: Path, labels_npy: Path) -> tuple[list[BollInstance], str]:
    """The bolls that `cluster` saved and the SHA-256 of the Gaussians that their indices refer to.

    Raises:
        BadInput: one of the files is damaged.
    """
    info, labels = BollsInfo.load(bolls_json), read_array(labels_npy)
    bolls = [
        BollInstance(
            boll.id,
            np.flatnonzero(labels == boll.id),
            boll.views,
            np.array(boll.centre_su, np.float64),
            boll.diameter_su,
            boll.confidence,
            boll.flags,
            tuple((mask.view, mask.mask_id) for mask in boll.masks),
        )
        for boll in info.bolls
    ]
    return bolls, info.gaussians_sha256


def read_bolls_of(gaussians: Gaussians, bolls_json: Path, labels_npy: Path) -> list[BollInstance]:
    """The bolls that `cluster` saved for these Gaussians.

    Raises:
        BadInput: one of the files is damaged, or belongs to another model.
    """
    bolls, sha256 = read_bolls(bolls_json, labels_npy)
    if sha256 != gaussians.sha256():
        raise BadInput("bolls.json belongs to another model than gaussians.ply; run `cotton3dg cluster` again")
    return bolls
