# SPDX-License-Identifier: Apache-2.0
"""Models of Hugging Face's transformers from local folders, without network."""

from __future__ import annotations

import json
import os
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float32
from ..errors import BadInput, EnvironmentUnusable, MissingInput
from .weight_files import demand_trust

MEAN, STD = np.array([[0.485, 0.456, 0.406], [0.229, 0.224, 0.225]], np.float32)
"""Mean and standard deviation of ImageNet's red, green and blue, with which SAM and Grounding DINO were trained."""


def model_kind(folder: Path, option: str, kinds: Collection[str]) -> str:
    """`model_type` of the model in a folder.

    Args:
        option: that named the folder, for messages. kinds: that will do.
    Raises:
        MissingInput, BadInput: no folder, no config.json in it, or a model of another kind.
    """
    if not folder.is_dir():
        raise MissingInput(
            f"{folder} is not a folder; give a folder with config.json and model.safetensors as {option}"
        )
    config = folder / "config.json"
    if not config.is_file():
        raise MissingInput(f"{folder} has no config.json; copy the whole folder of the model from Hugging Face")
    try:
        kind = json.loads(config.read_bytes())["model_type"]
    except (ValueError, KeyError, TypeError) as error:
        raise BadInput(f"config.json in {folder.name} is damaged; copy the model's folder again") from error
    if kind not in kinds:
        raise BadInput(f"{folder.name} holds a model of kind {kind!r}; {option} takes {' or '.join(sorted(kinds))}")
    return str(kind)


def load_model(class_name: str, folder: Path, *, trusted: bool) -> Any:
    """A model of one of transformers' classes, ready to run.

    Args:
        trusted: whether pickled weights (.bin) will do; those in .safetensors always do.
    Raises:
        EnvironmentUnusable: no transformers. MissingInput: no weights. BadUsage: pickled ones. BadInput: damaged ones.
    """
    model_class = transformers_class(class_name)
    pickled = not list(folder.glob("*.safetensors"))
    if pickled and not list(folder.glob("*.bin")):
        raise MissingInput(f"{folder} has no model.safetensors; copy the whole folder of the model from Hugging Face")
    if pickled:
        demand_trust(f"the model in {folder.name}", trusted, "save it as .safetensors")
    try:
        model, loading_info = model_class.from_pretrained(
            folder, local_files_only=True, use_safetensors=not pickled, output_loading_info=True
        )
    # Damaged weights make the readers raise almost any exception.
    except Exception as error:
        raise BadInput(f"the model in {folder.name} cannot be read ({error!r:.80}); copy its folder again") from error
    if lacking := len(loading_info["missing_keys"]) + len(loading_info["mismatched_keys"]):
        raise BadInput(f"the weights in {folder.name} lack {lacking} parts of the model; copy its folder again")
    return model.eval()


def transformers_class(name: str) -> Any:
    """A class of transformers, offline and quiet.

    Raises:
        EnvironmentUnusable: the package is not installed, too old for the class, or does not load.
    """
    os.environ.update({"HF_HUB_OFFLINE": "1", "TRANSFORMERS_OFFLINE": "1", "HF_HUB_DISABLE_TELEMETRY": "1"})
    try:
        import transformers
    except ImportError as error:
        raise EnvironmentUnusable(
            f"{error.name or 'transformers'} is not installed; run pip install 'cotton3dg[sam]'"
        ) from error
    transformers.utils.logging.set_verbosity_error()
    transformers.utils.logging.disable_progress_bar()
    try:
        return getattr(transformers, name)
    # transformers imports a class at its first use, with everything that the class imports in turn.
    except (ImportError, AttributeError, RuntimeError) as error:
        raise EnvironmentUnusable(
            f"transformers {transformers.__version__} does not load {name} ({error!r:.80}); run pip install -U "
            "'cotton3dg[sam]', with torchvision from the same index as torch or not at all"
        ) from error


def normalise(image: NDArray[np.uint8], height: int, width: int) -> Float32:
    """(3, height, width) of an image (H, W, 3): resized, and its colours relative to those of ImageNet."""
    import cv2

    shrinks = height < image.shape[0]
    resized = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    values = (resized.astype(np.float32) / 255 - MEAN) / STD
    return np.ascontiguousarray(values.transpose(2, 0, 1))
