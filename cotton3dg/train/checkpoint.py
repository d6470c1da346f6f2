# SPDX-License-Identifier: Apache-2.0
"""A training between two steps on disk, from which it goes on as if it had never stopped."""

from __future__ import annotations

import json
import logging
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Gaussians
from ..errors import BadInput
from ..gaussians.state import AdamState, DensityStatistics
from ..gaussians.views import View
from ..io.arrays import read_arrays
from .trainer import Fit, Training

log = logging.getLogger("cotton3dg")


def write_training(path: Path, training: Training, key: str, view: View | None = None) -> None:
    """Save as an uncompressed .npz of plain arrays; `facts` is JSON with everything that is not an array.

    Args:
        key: what the training depends on; only a reader with the same key gets it back.
        view: is saved, too, if the file is kept for a step with it.
    """
    fit, adam = training.fit, training.adam
    facts = {name: value for name, value in vars(training).items() if name not in ("fit", "adam", "statistics")}
    facts |= {"key": key, "fit": {name: value for name, value in vars(fit).items() if name != "gaussians"}}
    arrays: dict[str, NDArray[Any]] = {"adam_steps": adam.steps}
    for prefix, gaussians in (("", fit.gaussians), ("first_", adam.first), ("second_", adam.second)):
        arrays |= {prefix + name: array for name, array in vars(gaussians).items()}
    arrays |= {f"statistics_{name}": array for name, array in vars(training.statistics).items()}
    if view:
        camera = asdict(view.camera)
        arrays |= {"image": view.image, "cam_from_scene": camera.pop("cam_from_scene")}
        facts["camera"] = camera
    with path.open("wb") as file:
        np.savez(file, facts=np.array(json.dumps(facts)), **arrays)  # type: ignore[arg-type]


def read_training(path: Path, key: str) -> Training | None:
    """What `write_training` saved; None when there is nothing, it is damaged, or belongs to another `key`."""
    if not path.exists():
        return None
    try:
        arrays = read_arrays(path)
        facts = json.loads(str(arrays["facts"]))
        if facts.pop("key") != key:
            log.warning(
                "train: %s is of another version, other options or other images; training starts from the beginning",
                path.name,
            )
            return None
        state, first, second = (_read_gaussians(arrays, prefix) for prefix in ("", "first_", "second_"))
        statistics = DensityStatistics(*(arrays[f"statistics_{item.name}"] for item in fields(DensityStatistics)))
        fit = facts.pop("fit")
        fit["rejected"] = [(step, name) for step, name in fit["rejected"]]
        return Training(
            fit=Fit(state, **fit), adam=AdamState(first, second, arrays["adam_steps"]), statistics=statistics, **facts
        )
    except (BadInput, ValueError, KeyError, TypeError, AttributeError) as error:
        log.warning("train: %s cannot be used (%s); training starts from the beginning", path.name, error)
        return None


def _read_gaussians(arrays: dict[str, NDArray[Any]], prefix: str) -> Gaussians:
    return Gaussians(*(arrays[prefix + item.name] for item in fields(Gaussians)))
