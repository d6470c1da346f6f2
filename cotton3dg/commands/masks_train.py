# SPDX-License-Identifier: Apache-2.0
"""Train a network that finds bolls. Not a stage of the pipeline: it makes weights for `masks --weights`.

bolls:  bolls.onnx   checkpoint.npz   scenes/   backgrounds/   training.json (images, options, accuracy on test images)
yolo:   best.pt   best.onnx (runs without ultralytics)   training.json
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from ..command_options import MasksTrainOptions
from ..core.bolls import MaskSet
from ..core.runs import Progress, silent
from ..core.training_picture import TrainingPicture
from ..errors import BadInput, BadUsage
from ..evaluation.masks import score_masks
from ..io.annotations import find_annotated_images, read_whole_masks
from ..io.images import read_image, write_image
from ..io.saving import explain_disk_errors, file_sha256, json_text, write_text_atomically
from ..io.yolo_labels import write_yolo_labels
from ..masks.annotated_pictures import AnnotatedPhoto, cut_picture
from ..masks.bolls import SHIPPED_FILE, BollNetwork, input_size
from ..masks.group_votes import group_votes
from ..masks.photometric_augmentation import augment
from ..masks.test_time_augmentation import predict_with_augmentation
from ..masks.train_yolo import export_onnx, train_yolo
from ..masks.weight_files import read_shipped
from ..option_rules import as_dict
from ..simulate.backgrounds import paint_backgrounds
from ..simulate.compositing import compose
from ..simulate.plates import Plate, load_plates, render_plates, save_plates

if TYPE_CHECKING:
    from ..masks.bolls_network import BollsNetwork

LEAST_IMAGES: Final = 2
BLUR_PX: Final = (0.5, 2.0)
"""Standard deviations of blurred copies, in images of the size that the model sees: the range of a moving phone."""
PICTURE_PX: Final = 192
PLATES_A_SCENE: Final = 20
SCENES_A_ROOM: Final = 10
"""Scenes for each set of backgrounds."""
JUDGING_SCENES: Final = 4
"""Simulated scenes for judging only, with numbers that no training reaches."""
FIRST_JUDGING_SCENE: Final = 1_000_000
JUDGING_PICTURES: Final = 64
BATCH: Final = 12
FINE_TUNING_RATE: Final = 2e-4

Draw = Callable[[np.random.Generator], TrainingPicture]
Start = Literal["nothing", "imagenet", "bolls"]
"""What a network knows before the training."""


def train(folder: Path, options: MasksTrainOptions, progress: Progress = silent) -> Path:
    """Train a network into `folder`.

    Returns:
        The weights.
    Raises:
        BadUsage: nothing to learn from, or the folder holds something else. BadInput: too few annotated images.
    """
    if not options.annotations and not (options.network == "bolls" and options.scenes):
        simulated = ", or simulate scenes with --scenes N" if options.network == "bolls" else ""
        raise BadUsage(f"no annotations were given; name their folders with --annotations DIR[,DIR ...]{simulated}")
    if folder.exists() and (not folder.is_dir() or (any(folder.iterdir()) and not (folder / "training.json").exists())):
        raise BadUsage(f"{folder} is not empty and holds no training; give a new folder")
    _refuse_other_training(folder, options)
    masks, photos = read_annotated(options)
    judging = _choose_to_judge(sorted(masks.ids), options) if options.annotations else set()
    with explain_disk_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        if not (folder / "training.json").exists():
            write_text_atomically(folder / "training.json", json_text({"finished": False}))
        make = _train_bolls if options.network == "bolls" else _train_yolo
        written, accuracy = make(folder, masks, photos, judging, options, progress)
        document = {
            "finished": True,
            "options": as_dict(options),
            "images": {name: "judges" if name in judging else "trains" for name in sorted(masks.ids)},
            "accuracy": accuracy,
            "sha256": {path.name: file_sha256(path) for path in written},
        }
        write_text_atomically(folder / "training.json", json_text(document))
    return written[0]


def _refuse_other_training(folder: Path, options: MasksTrainOptions) -> None:
    """Raise BadUsage where a finished training of other annotations, or of another network, would be replaced."""
    try:
        before = json.loads((folder / "training.json").read_text(encoding="utf-8")).get("options", {})
    except (OSError, ValueError, AttributeError):
        return
    for name in ("network", "annotations", "weights"):
        if before and before.get(name) != getattr(options, name):
            raise BadUsage(f"{folder} holds a training with --{name} {before.get(name)!r}; give a new folder")


def read_annotated(options: MasksTrainOptions) -> tuple[MaskSet, dict[str, Path]]:
    """Masks and photos of all annotated images, by stem; of several folders, with their number in front.

    Raises:
        BadInput: annotations without their image, or of another size.
    """
    masks, photos = MaskSet({}, {}), {}
    sources = [Path(part.strip()) for part in options.annotations.split(",") if part.strip()]
    classes = [name.strip() for name in options.classes.split(",") if name.strip()]
    for number, source in enumerate(sources):
        found = read_whole_masks(source, classes)
        images = find_annotated_images(source if source.is_dir() else source.parent)
        for stem, ids in found.ids.items():
            if stem not in images:
                raise BadInput(
                    f"{source.name} annotates {stem}, but the image is not there; put it beside the annotations"
                )
            name = stem if len(sources) == 1 else f"{number}_{stem}"
            masks.ids[name], photos[name] = ids, images[stem]
    return masks, photos


def _choose_to_judge(names: Sequence[str], options: MasksTrainOptions) -> set[str]:
    if len(names) < LEAST_IMAGES:
        raise BadInput(
            f"{len(names)} annotated image is not enough to train and to judge; annotate {LEAST_IMAGES} or more"
        )
    count = min(max(round(options.validation * len(names)), 1), len(names) - 1)
    chosen = np.random.default_rng(options.seed).permutation(len(names))[:count]
    return {names[i] for i in chosen}


def _train_bolls(
    folder: Path,
    masks: MaskSet,
    photos: Mapping[str, Path],
    judging: set[str],
    options: MasksTrainOptions,
    progress: Progress,
) -> tuple[list[Path], dict[str, Any]]:
    """Train bolls.onnx; return its accuracy on photos and simulated pictures outside the training data."""
    from ..masks.bolls_network import to_onnx
    from ..masks.bolls_training import LEARNING_RATE, TrainingSettings, restore_norms
    from ..masks.bolls_training import train as fit

    network, start = _open_start(options)  # before hours of rendering: its weights may be missing
    training: list[AnnotatedPhoto] = []
    judged: list[AnnotatedPhoto] = []
    for name in sorted(masks.ids):
        (judged if name in judging else training).append(_read_photo(name, photos[name], masks.ids[name]))
    draws: list[Draw] = [partial(cut_picture, photos=training, size=PICTURE_PX)] if training else []
    if options.scenes:
        plates, backgrounds = read_simulated(folder, range(options.scenes), progress)
        draws.append(partial(_simulated_picture, plates=plates, backgrounds=backgrounds))

    def draw(number: int) -> TrainingPicture:
        return draws[number % len(draws)](np.random.default_rng([options.seed, number]))

    fine_tuning = start == "bolls" and bool(training)
    if start == "bolls" and not fine_tuning:
        restore_norms(network, draw)
    settings = TrainingSettings(
        steps=options.steps,
        batch=options.batch or BATCH,
        learning_rate=FINE_TUNING_RATE if fine_tuning else LEARNING_RATE,
        seed=options.seed,
        frozen_norms=fine_tuning,
        pretrained=start != "nothing",
        bfloat16=_computes_bfloat16(),
    )
    for report in fit(network, draw, settings, folder / "checkpoint.npz"):
        worst = ", ".join(f"{name} {value:.3f}" for name, value in report.losses.items())
        progress(report.step, options.steps, f"loss: {worst}")
    weights = folder / "bolls.onnx"
    weights.write_bytes(to_onnx(network, half=True))
    reader = BollNetwork(weights.read_bytes(), weights.name)
    accuracy = {"photos": _measure_accuracy(reader, [(photo.image, photo.ids) for photo in judged])}
    if options.scenes:
        held = range(FIRST_JUDGING_SCENE, FIRST_JUDGING_SCENE + JUDGING_SCENES)
        plates, backgrounds = read_simulated(folder, held, progress)
        rng = np.random.default_rng([options.seed, 7])
        pictures = [compose(rng, plates, backgrounds, PICTURE_PX) for _ in range(JUDGING_PICTURES)]
        accuracy["simulated"] = _measure_accuracy(reader, [(picture.image, picture.ids) for picture in pictures])
    return [weights], accuracy


def _computes_bfloat16() -> bool:
    """Whether the machine has instructions for bfloat16 numbers."""
    import torch

    return torch.cuda.is_available() or bool(torch.cpu.get_capabilities().get("avx512_bf16"))


def read_simulated(folder: Path, scenes: range, progress: Progress = silent) -> tuple[list[Plate], NDArray[np.uint8]]:
    """Plates and backgrounds (B, H, W, 3) of scenes by number, made if the folder does not have them yet."""
    plates, backgrounds = [], []
    for kind in ("scenes", "backgrounds"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
    for done, number in enumerate(scenes):
        scene = folder / "scenes" / f"{number:07d}"
        if not scene.is_dir():
            progress(done, len(scenes), "scenes to learn from")
            save_plates(scene, render_plates(number, PLATES_A_SCENE))
        plates += load_plates(scene)
    for number in scenes[::SCENES_A_ROOM]:
        file = folder / "backgrounds" / f"{number:07d}.npy"
        if not file.is_file():
            partial_file = file.with_suffix(".partial.npy")
            np.save(partial_file, paint_backgrounds(number))
            partial_file.replace(file)
        backgrounds.append(np.load(file, allow_pickle=False))
    return plates, np.concatenate(backgrounds)


def _simulated_picture(
    rng: np.random.Generator, plates: Sequence[Plate], backgrounds: NDArray[np.uint8]
) -> TrainingPicture:
    return augment(rng, compose(rng, plates, backgrounds, PICTURE_PX))


def _open_start(options: MasksTrainOptions) -> tuple[BollsNetwork, Start]:
    """The network to begin with, and what it knows."""
    import torch

    from ..masks.bolls_network import BollsNetwork, from_onnx, load_imagenet
    from ..masks.weight_files import read_imagenet_weights

    torch.manual_seed(options.seed)
    start: Start
    if options.weights == "none":
        network, start = BollsNetwork(), "nothing"
    elif options.scenes and not options.annotations and not options.weights:
        network, start = BollsNetwork(), "imagenet"
        load_imagenet(network, read_imagenet_weights())
    else:
        path = Path(options.weights) if options.weights else SHIPPED_FILE
        network, start = from_onnx(path.read_bytes() if options.weights else read_shipped(path), path.name), "bolls"
    network = network.to(memory_format=torch.channels_last)
    return network.to("cuda" if torch.cuda.is_available() else "cpu"), start


def _read_photo(name: str, path: Path, ids: NDArray[np.uint16]) -> AnnotatedPhoto:
    """An annotated photo at the size that the network sees."""
    import cv2

    image = _find_image(name, path, ids)
    size = input_size(*ids.shape)
    return AnnotatedPhoto(
        cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.resize(ids, size, interpolation=cv2.INTER_NEAREST)
    )


def _find_image(name: str, path: Path, ids: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """The image of an annotation.

    Raises:
        BadInput: it has another size.
    """
    image = read_image(path)
    if image.shape[:2] != ids.shape:
        raise BadInput(
            f"{name} is {image.shape[1]} x {image.shape[0]} px, its annotation {ids.shape[1]} x {ids.shape[0]}"
        )
    return image


def _measure_accuracy(
    network: BollNetwork, judged: Sequence[tuple[NDArray[np.uint8], NDArray[np.uint16]]]
) -> dict[str, Any]:
    """Precision, recall and F1 by IoU, and mIoU, over images with their true ids."""
    # This judges the network alone, without the doubts of `single_image` about faint bolls among leaves.
    found = ((group_votes(predict_with_augmentation(image, network))[0], ids) for image, ids in judged)
    scores, miou = score_masks(found)
    table = {
        str(score.iou): {key: _round(getattr(score, key)) for key in ("precision", "recall", "f1")} for score in scores
    }
    return {"images": len(judged), "by_iou": table, "miou": _round(miou)}


def _round(value: float) -> float | None:
    return round(value, 4) if np.isfinite(value) else None


def _train_yolo(
    folder: Path,
    masks: MaskSet,
    photos: Mapping[str, Path],
    judging: set[str],
    options: MasksTrainOptions,
    progress: Progress,
) -> tuple[list[Path], dict[str, Any]]:
    """best.pt and best.onnx, and the accuracy that ultralytics reports."""
    write_dataset(folder / "dataset", masks, photos, judging, options, np.random.default_rng(options.seed))
    best, accuracy = train_yolo(folder, options, progress)
    return [best, export_onnx(best, options.image_size)], dict(accuracy)


def write_dataset(
    folder: Path,
    masks: MaskSet,
    photos: Mapping[str, Path],
    judging: set[str],
    options: MasksTrainOptions,
    rng: np.random.Generator,
) -> None:
    """Write images and labels as ultralytics reads them, with blurred copies of some training images."""
    import cv2

    for part in ("train", "val"):
        for kind in ("images", "labels"):
            (folder / kind / part).mkdir(parents=True, exist_ok=True)
    for name in sorted(masks.ids):
        ids = masks.ids[name]
        image = _find_image(name, photos[name], ids)
        part = "val" if name in judging else "train"
        write_image(folder / "images" / part / f"{name}.jpg", image)
        write_yolo_labels(folder / "labels" / part / f"{name}.txt", ids)
        if part == "train" and rng.random() < options.blur:
            sigma = rng.uniform(*BLUR_PX) * max(image.shape) / options.image_size
            write_image(folder / "images" / part / f"{name}_blurred.jpg", cv2.GaussianBlur(image, (0, 0), sigma))
            write_yolo_labels(folder / "labels" / part / f"{name}_blurred.txt", ids)
    document = f"path: {folder.resolve()}\ntrain: images/train\nval: images/val\nnames:\n  0: boll\n"
    (folder / "data.yaml").write_text(document, encoding="utf-8")
