# SPDX-License-Identifier: Apache-2.0
"""Training of YOLO segmentation networks through ultralytics (AGPL-3.0), and their export to ONNX."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any, Final

from ..command_options import MasksTrainOptions
from ..core.runs import Progress
from ..errors import BadUsage, EnvironmentUnusable, MissingInput, StageFailed
from .weight_files import demand_trust
from .yolo_networks import ultralytics_model

BATCH: Final = 16
"""Images a step, as in the paper."""
OPSET: Final = 17
"""Version of ONNX's operators that OpenCV's importer knows."""


def train_yolo(folder: Path, options: MasksTrainOptions, progress: Progress) -> tuple[Path, dict[str, float]]:
    """Train on folder/dataset; the weights that are best on the held-out images become folder/best.pt.

    Returns:
        The weights, and their accuracy on the held-out images as ultralytics measures it.
    Raises:
        BadUsage: no model to start from. MissingInput, BadInput, EnvironmentUnusable: it cannot be used.
    """
    import torch

    model = ultralytics_model(_start(options))
    _check_torchvision()

    def epoch_done(trainer: Any) -> None:
        progress(min(trainer.epoch + 1, options.epochs), options.epochs, "epochs")

    model.add_callback("on_fit_epoch_end", epoch_done)
    try:
        model.train(
            data=str(folder / "dataset" / "data.yaml"),
            imgsz=options.image_size,
            batch=options.batch or BATCH,
            epochs=options.epochs,
            seed=options.seed,
            hsv_v=options.brightness,
            degrees=options.rotation,
            scale=options.rescaling,
            project=str(folder.resolve()),
            name="run",
            exist_ok=True,
            device=None if torch.cuda.is_available() else "cpu",
            workers=0,
            deterministic=True,
            plots=False,
            verbose=False,
        )
    except Exception as error:
        raise StageFailed(
            f"ultralytics could not train: {error!r:.200}; try a smaller --batch or --image-size"
        ) from error
    best = folder / "best.pt"
    shutil.copyfile(folder / "run" / "weights" / "best.pt", best)
    accuracy = {key: round(float(value), 4) for key, value in model.trainer.metrics.items()}
    shutil.rmtree(folder / "run")
    return best, accuracy


def export_onnx(weights: Path, image_size: int) -> Path:
    """Write the network of a .pt beside it as .onnx, for square frames of `image_size` px.

    Raises:
        EnvironmentUnusable: the package onnx is missing.
    """
    try:
        import onnx  # noqa: F401
    except ImportError as error:
        raise EnvironmentUnusable("onnx is not installed; run pip install 'cotton3dg[yolo]'") from error
    return Path(
        ultralytics_model(weights).export(format="onnx", imgsz=image_size, opset=OPSET, simplify=False, verbose=False)
    )


def _start(options: MasksTrainOptions) -> str:
    """The checkpoint to fine-tune, or the name of an architecture."""
    weights = Path(options.weights)
    if not options.weights:
        raise BadUsage(
            "no model to start from; give --weights with a pretrained YOLO11-seg .pt, or yolo11n-seg.yaml to start "
            "from nothing"
        )
    if weights.suffix == ".yaml":
        return options.weights
    if weights.suffix != ".pt":
        raise BadUsage(f"{weights.name} is neither .pt nor .yaml; training starts from one of these")
    if not weights.is_file():
        raise MissingInput(f"{weights} is not there; nothing is downloaded, so copy the checkpoint to this machine")
    demand_trust(weights.name, options.trust_weights, "start from an architecture, e.g. yolo11n-seg.yaml")
    return str(weights)


def _check_torchvision() -> None:
    """ultralytics trains with torchvision, which only loads beside the torch that it was built for."""
    try:
        import torchvision  # noqa: F401
    except (ImportError, RuntimeError) as error:
        raise EnvironmentUnusable(
            f"torchvision does not load ({error!r:.60}); install torch and torchvision from one index, see pytorch.org"
        ) from error
