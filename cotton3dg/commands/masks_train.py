"""Train YOLO on a lab's annotations. Not a stage of the pipeline: it makes weights for `masks --backend yolo`.

best.pt   best.onnx (runs without ultralytics)   training.json (images, options, accuracy on images kept back)
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..core.bolls import MaskSet
from ..core.progress import Progress, silent
from ..errors import BadInput, BadUsage
from ..files.annotations import annotated_images, read_masks
from ..files.images import read_image, write_image
from ..files.saving import explained_disk_errors, file_sha256, json_text, write_text_atomically
from ..files.yolo_labels import write_yolo_labels
from ..masks.train_yolo import export_onnx, train_yolo
from ..options import MasksTrainOptions, as_dict

LEAST_IMAGES = 2
BLUR_PX = (0.5, 2.0)
"""Standard deviations of blurred copies, of images as large as the model sees them: a moving phone's range."""


def train(folder: Path, options: MasksTrainOptions, progress: Progress = silent) -> Path:
    """Train a model into `folder`.

    Returns:
        The weights, best.pt.
    Raises:
        BadUsage: no annotations were named, or the folder holds something else. BadInput: too few annotated images.
    """
    if not options.annotations:
        raise BadUsage("no annotations were given; name their folders with --annotations DIR[,DIR ...]")
    if folder.exists() and (not folder.is_dir() or (any(folder.iterdir()) and not (folder / "training.json").exists())):
        raise BadUsage(f"{folder} is not empty and holds no training; give a new folder")
    masks, photos = annotated(options)
    names = sorted(masks.ids)
    if len(names) < LEAST_IMAGES:
        raise BadInput(
            f"{len(names)} annotated image is not enough to train and to judge; annotate {LEAST_IMAGES} or more"
        )
    rng = np.random.default_rng(options.seed)
    n_judging = min(max(round(options.validation * len(names)), 1), len(names) - 1)
    judging = {names[i] for i in rng.permutation(len(names))[:n_judging]}
    with explained_disk_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        write_text_atomically(folder / "training.json", json_text({"finished": False}))
        write_dataset(folder / "dataset", masks, photos, judging, options, rng)
        best, accuracy = train_yolo(folder, options, progress)
        onnx = export_onnx(best, options.image_size)
        document = {
            "finished": True,
            "options": as_dict(options),
            "images": {name: "judges" if name in judging else "trains" for name in names},
            "accuracy": accuracy,
            "sha256": {path.name: file_sha256(path) for path in (best, onnx)},
        }
        write_text_atomically(folder / "training.json", json_text(document))
    return best


def annotated(options: MasksTrainOptions) -> tuple[MaskSet, dict[str, Path]]:
    """Masks and photos of all annotated images, by stem; of several folders, with their number in front.

    Raises:
        BadInput: annotations without their image, or of another size.
    """
    masks, photos = MaskSet({}, {}), {}
    sources = [Path(part.strip()) for part in options.annotations.split(",") if part.strip()]
    classes = [name.strip() for name in options.classes.split(",") if name.strip()]
    for number, source in enumerate(sources):
        found = read_masks(source, classes=classes)
        images = annotated_images(source if source.is_dir() else source.parent)
        for stem, ids in found.ids.items():
            if stem not in images:
                raise BadInput(
                    f"{source.name} annotates {stem}, but the image is not there; put it beside the annotations"
                )
            name = stem if len(sources) == 1 else f"{number}_{stem}"
            masks.ids[name], photos[name] = ids, images[stem]
    return masks, photos


def write_dataset(
    folder: Path,
    masks: MaskSet,
    photos: Mapping[str, Path],
    judging: set[str],
    options: MasksTrainOptions,
    rng: np.random.Generator,
) -> None:
    """Images and labels as ultralytics reads them, with blurred copies of some that train."""
    import cv2

    for part in ("train", "val"):
        for kind in ("images", "labels"):
            (folder / kind / part).mkdir(parents=True, exist_ok=True)
    for name in sorted(masks.ids):
        image, ids = read_image(photos[name]), masks.ids[name]
        if image.shape[:2] != ids.shape:
            raise BadInput(
                f"{name} is {image.shape[1]} x {image.shape[0]} px, its annotation {ids.shape[1]} x {ids.shape[0]}"
            )
        part = "val" if name in judging else "train"
        write_image(folder / "images" / part / f"{name}.jpg", image)
        write_yolo_labels(folder / "labels" / part / f"{name}.txt", ids)
        if part == "train" and rng.random() < options.blur:
            sigma = rng.uniform(*BLUR_PX) * max(image.shape) / options.image_size
            write_image(folder / "images" / part / f"{name}_blurred.jpg", cv2.GaussianBlur(image, (0, 0), sigma))
            write_yolo_labels(folder / "labels" / part / f"{name}_blurred.txt", ids)
    document = f"path: {folder.resolve()}\ntrain: images/train\nval: images/val\nnames:\n  0: boll\n"
    (folder / "data.yaml").write_text(document, encoding="utf-8")
