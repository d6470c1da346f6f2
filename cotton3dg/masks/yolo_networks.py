# SPDX-License-Identifier: Apache-2.0
"""YOLO segmentation networks from files: .pt through ultralytics, .onnx through OpenCV."""

from __future__ import annotations

import logging
import os
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from ..core.scene import Float32
from ..errors import BadInput, BadUsage, EnvironmentUnusable, MissingInput
from .weight_files import demand_trust

AGPL_NOTICE: Final = (
    "this uses ultralytics, which is under the AGPL-3.0 (https://ultralytics.com/license): whoever passes on or serves "
    "a work built with it must pass on its source; .onnx weights run without ultralytics"
)

SWITCHES: Final = {"YOLO_OFFLINE": "1", "YOLO_AUTOINSTALL": "0", "YOLO_VERBOSE": "0"}
"""Read by ultralytics when it is imported: no network, no pip, no chatter."""


@dataclass(frozen=True)
class Network:
    """A network that is ready to run."""

    forward: Callable[[Float32], tuple[NDArray[Any], NDArray[Any]]]
    """From a square of pixels (1, 3, s, s) to predictions (1, C, A) and prototypes (1, M, s / 4, s / 4)."""
    class_names: Mapping[int, str] = field(default_factory=dict)
    """Names of the classes, where the file holds them."""
    notice: str = ""
    """Message to the user about the software that runs the network."""


def open_network(weights: Path, *, trusted: bool) -> Network:
    """The network of a .pt or .onnx file.

    Args:
        trusted: whether the user vouches for a .pt, which is a pickle.
    Raises:
        MissingInput: no such file. BadUsage: not trusted. BadInput: no segmentation model.
        EnvironmentUnusable: no ultralytics.
    """
    if not weights.is_file():
        raise MissingInput(f"{weights} is not there; give a YOLO segmentation model, .pt or .onnx, as --weights")
    if not weights.stat().st_size:
        raise BadInput(f"{weights.name} is empty; copy it again")
    if weights.suffix.lower() == ".onnx":
        return onnx_network(weights)
    if weights.suffix.lower() == ".pt":
        return ultralytics_network(weights, trusted=trusted)
    raise BadUsage(f"{weights.name} is neither .pt nor .onnx; give a YOLO segmentation model as --weights")


def onnx_network(weights: Path) -> Network:
    """A network that OpenCV runs."""
    import cv2

    try:
        net = cv2.dnn.readNetFromONNX(str(weights))
    except cv2.error as error:
        raise BadInput(f"{weights.name} is not an ONNX model that OpenCV can read; export it again") from error
    outputs = net.getUnconnectedOutLayersNames()
    if len(outputs) != 2:
        raise BadInput(
            f"{weights.name} has {len(outputs)} outputs where a segmentation model has 2 (predictions, prototypes); "
            "export a YOLO11-seg model with nms=False"
        )

    def forward(pixels: Float32) -> tuple[NDArray[Any], NDArray[Any]]:
        try:
            net.setInput(pixels)
            first, second = net.forward(outputs)
        except cv2.error as error:
            raise BadInput(
                f"{weights.name} does not run on {pixels.shape[3]} x {pixels.shape[2]} px; give the size that it was "
                "exported with as --image-size"
            ) from error
        return (first, second) if first.ndim == 3 else (second, first)

    return Network(forward)


def ultralytics_network(weights: Path, *, trusted: bool) -> Network:
    """A network that PyTorch runs, from a checkpoint of ultralytics."""
    demand_trust(weights.name, trusted, "use an .onnx export")
    if not zipfile.is_zipfile(weights):
        raise BadInput(f"{weights.name} is damaged or no checkpoint of ultralytics; copy it again")
    yolo = ultralytics_model(weights)
    import torch

    model = yolo.model.float().fuse(verbose=False).eval()
    model.model[-1].export = True  # plain predictions and prototypes, the same as in an ONNX export

    @torch.inference_mode()
    def forward(pixels: Float32) -> tuple[NDArray[Any], NDArray[Any]]:
        predictions, prototypes = model(torch.from_numpy(pixels))
        return predictions.numpy(), prototypes.numpy()

    return Network(forward, dict(model.names), AGPL_NOTICE)


def ultralytics_model(weights: Path | str) -> Any:
    """ultralytics' model of a checkpoint, or of the architecture that a .yaml names.

    Raises:
        EnvironmentUnusable: no ultralytics. BadInput: not a segmentation model.
    """
    yolo_class, name = load_ultralytics(), Path(weights).name
    try:
        model = yolo_class(str(weights))
    # A file that is not a checkpoint makes the reader raise almost any exception.
    except Exception as error:
        raise BadInput(f"{name} cannot be read by ultralytics ({error!r:.80}); give a YOLO11-seg checkpoint") from error
    if model.task != "segment":
        raise BadInput(f"{name} is a model for the task '{model.task}'; give one for segmentation, e.g. YOLO11-seg")
    return model


def load_ultralytics() -> Any:
    """The class YOLO, from an ultralytics that stays offline, installs nothing and reports nothing.

    Raises:
        EnvironmentUnusable: it is not installed.
    """
    import cv2
    import torch  # before ultralytics, which sets OMP_NUM_THREADS to 1  # noqa: F401

    os.environ.update(SWITCHES)
    os.environ.setdefault("YOLO_CONFIG_DIR", tempfile.mkdtemp(prefix="cotton3dg_yolo_"))
    threads = cv2.getNumThreads()
    try:
        from ultralytics import YOLO, settings
    except ImportError as error:
        raise EnvironmentUnusable(
            f"{error.name or 'ultralytics'} is not installed; run pip install 'cotton3dg[yolo]', or use an .onnx export"
        ) from error
    finally:
        cv2.setNumThreads(threads)
    logging.getLogger("ultralytics").setLevel(logging.ERROR)
    settings.update({name: False for name, value in settings.items() if isinstance(value, bool)})
    return YOLO


def class_numbers(network: Network, words: Sequence[str]) -> list[int]:
    """The classes that the user chose, by number; all of a network that only knows one.

    Raises:
        BadUsage: an unknown class, or no choice among several.
    """
    names = dict(network.class_names)
    numbers = {name: number for number, name in names.items()}
    chosen = []
    for word in words:
        if word not in numbers and not word.isdecimal():
            raise BadUsage(f"the model has no class {word!r}; it has {', '.join(list(numbers)[:8]) or 'numbers only'}")
        chosen.append(numbers[word] if word in numbers else int(word))
    if len(names) > 1 and not chosen:
        listed = ", ".join(list(numbers)[:8])
        raise BadUsage(f"the model knows {len(names)} classes ({listed}, ...); say which are bolls with --classes")
    return chosen
