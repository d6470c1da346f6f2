"""Lifted masks and bolls on disk: selections.npz, bolls.json and labels.npy."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import BollInstance, BollSelection, LiftedMasks
from ..errors import BadInput
from .arrays import read_array, read_arrays


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
    """Read what `write_lifted` saved.

    Raises:
        BadInput: not such a file, or its arrays do not belong together.
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


def boll_facts(boll: BollInstance) -> dict[str, object]:
    """One boll of bolls.json."""
    return {
        "id": boll.boll_id,
        "centre_su": [float(x) for x in boll.centre],
        "diameter_su": boll.diameter_su,
        "n_gaussians": len(boll.indices),
        "views": list(boll.views),
        "confidence": boll.confidence,
        "flags": list(boll.flags),
    }


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
    try:
        table = json.loads(bolls_json.read_text(encoding="utf-8"))
        labels = read_array(labels_npy)
        bolls = [
            BollInstance(
                boll["id"],
                np.flatnonzero(labels == boll["id"]),
                tuple(boll["views"]),
                np.array(boll["centre_su"], np.float64),
                float(boll["diameter_su"]),
                float(boll["confidence"]),
                tuple(boll["flags"]),
            )
            for boll in table["bolls"]
        ]
        return bolls, str(table["gaussians_sha256"])
    except (BadInput, OSError, ValueError, KeyError, TypeError) as error:
        raise BadInput(f"{bolls_json.name} is damaged ({error}); make it again with `cotton3dg cluster`") from error
