"""Find the bolls in images from around the plant, or take over masks that were made elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import MaskSet
from ..core.outcome import StageOutcome
from ..core.progress import Progress, silent
from ..core.scene import Camera, Gaussians
from ..documents.masks import MaskedImage, MasksInfo
from ..errors import BadInput, BadUsage
from ..files.annotations import read_masks, undistort_ids
from ..files.colmap import read_cameras, read_points
from ..files.images import read_image, write_ids
from ..files.ply import read_gaussians
from ..files.prompt_table import read_prompts
from ..files.saving import file_sha256
from ..geometry.camera_orbit import azimuths, evenly_spaced, fit_orbit
from ..lifting.lift import within_orbit
from ..masks.bolls import SHIPPED_FILE, open_bolls
from ..masks.detect_bolls import detect_bolls
from ..masks.detect_lint import detect_lint
from ..masks.grounding_dino import find_boxes, open_grounding_dino
from ..masks.sam import Prompts, detect_sam, open_sam, prompts_around
from ..masks.yolo import detect_yolo
from ..masks.yolo_networks import Network, open_network
from ..options import MasksOptions, as_dict
from ..workspace import Workspace
from .stage import Cost, Stage, Work

MASK_BYTES = 2**18
"""Of one image's masks on the disk, generous."""
VOTING_VIEWS = 36
"""Views, where there are as many, that vote on where lint is, however few or many get masks: one every ten degrees."""

NO_LINT = (
    "no boll was found in any image; if the plant has open bolls, look at sfm/undistorted/images: the plant "
    "should stand in the middle of the orbit with its lint lit; or draw masks and use --backend import"
)
NOTHING_FOUND = {
    "bolls": NO_LINT,
    "lint": NO_LINT,
    "import": "none of the imported images has a mask; if the plant has open bolls, draw them",
}
NO_DETECTION = "the network found no boll in any image; if the plant has open bolls, try a lower --confidence or --tile"

Detector = Callable[[str, NDArray[np.uint8]], tuple[NDArray[np.uint16], dict[int, float]]]
"""From the name and the pixels of an image to ids and scores."""


@dataclass(frozen=True)
class Found:
    """Masks and how they came about."""

    masks: MaskSet
    notes: tuple[str, ...] = ()
    """What the user should know."""


def inputs(workspace: Workspace) -> list[Path]:
    return [workspace.undistorted, workspace.masks_input]


def named_files(workspace: Workspace, options: MasksOptions) -> list[Path]:
    """Weights, prompts and masks wherever they are: a network trained anew under the same name gives other masks; and
    the model, where `bolls` and `lint` look at it."""
    texts = (options.weights, options.detector, options.prompts, options.source)
    named = [_found_file(workspace, text) for text in texts if text]
    if options.backend == "bolls" and not options.weights:
        named.append(SHIPPED_FILE)
    by_model = options.backend in {"bolls", "lint"} or (options.backend == "sam" and not options.prompts)
    return [*named, workspace.gaussians_ply] if by_model else named


def run(workspace: Workspace, options: MasksOptions, progress: Progress = silent) -> StageOutcome:
    """Writes masks/<image>.png with 16-bit ids at the size of the undistorted image, and masks.json."""
    cameras = read_cameras(workspace.require(workspace.undistorted / "sparse", "sfm"))
    start = time.perf_counter()
    find = {
        "bolls": by_bolls,
        "lint": by_lint,
        "import": imported,
        "yolo": by_yolo,
        "sam": by_sam,
        "grounded-sam": by_text,
    }
    found = find[options.backend](workspace, options, cameras, progress)
    seconds, masks = time.perf_counter() - start, found.masks
    counts = {name: len(np.unique(ids[ids > 0])) for name, ids in masks.ids.items()}
    info = MasksInfo(
        options.backend,
        as_dict(options),
        _weights_sha256(workspace, options),
        seconds_per_image=round(seconds / max(len(counts), 1), 3),
        images=tuple(
            MaskedImage(name, counts[name], {str(k): score for k, score in masks.scores.get(name, {}).items()})
            for name in sorted(counts)
        ),
    )
    with workspace.writing("masks") as folder:
        for name, ids in masks.ids.items():
            write_ids(folder / workspace.mask_png(name).name, ids)
        info.save(folder / workspace.masks_json.name)
    summary = {
        "images": len(counts),
        "masks": sum(counts.values()),
        "masks_per_image": round(float(np.mean(list(counts.values()))), 1),
        "backend": options.backend,
    }
    if summary["masks"]:
        return StageOutcome(summary, (), found.notes)
    return StageOutcome(summary, ("no_masks",), (NOTHING_FOUND.get(options.backend, NO_DETECTION), *found.notes))


def by_bolls(workspace: Workspace, options: MasksOptions, cameras: Sequence[Camera], progress: Progress) -> Found:
    """Masks of the bolls' network, on views evenly spaced around the plant; by place, too, once there is a model."""
    network = open_bolls(_found_file(workspace, options.weights) if options.weights else None)
    views = _spaced(cameras, options)
    images = [read_image(workspace.undistorted_image(camera.name)) for camera in views]
    gaussians = _model(workspace)
    allowed = None if gaussians is None else within_orbit(gaussians.means, cameras, fit_orbit(cameras))
    return Found(detect_bolls(images, views, network, gaussians, allowed, progress))


def by_lint(workspace: Workspace, options: MasksOptions, cameras: Sequence[Camera], progress: Progress) -> Found:
    """Masks by colour and shape, on views evenly spaced around the plant; by distance, too, once there is a model."""
    orbit = fit_orbit(_several(cameras))
    angles = azimuths(cameras, orbit)
    many = evenly_spaced(angles, max(options.views, VOTING_VIEWS))
    few = many[evenly_spaced(angles[many], min(options.views, VOTING_VIEWS))]
    painted, voting = (many, few) if options.views > VOTING_VIEWS else (few, many)
    seen = [cameras[i] for i in many]
    images = [read_image(workspace.undistorted_image(camera.name)) for camera in seen]
    points = read_points(workspace.undistorted / "sparse")[0]
    names, voters = ({cameras[i].name for i in chosen} for chosen in (painted, voting))
    return Found(detect_lint(images, seen, orbit, points, names, progress, voters, _model(workspace)))


def by_yolo(workspace: Workspace, options: MasksOptions, cameras: Sequence[Camera], progress: Progress) -> Found:
    """Masks of a YOLO segmentation model."""
    network = open_network(_given(workspace, options.weights, "--weights"), trusted=options.trust_weights)
    classes = _class_numbers(network, options.classes)

    def detect(_: str, image: NDArray[np.uint8]) -> tuple[NDArray[np.uint16], dict[int, float]]:
        return detect_yolo(
            image,
            network,
            image_size=options.image_size,
            confidence=options.confidence,
            nms_iou=options.nms_iou,
            tile_px=options.tile,
            classes=classes,
        )

    notes = (network.notice,) if network.notice else ()
    return Found(_each(workspace, _spaced(cameras, options), detect, progress), notes)


def by_sam(workspace: Workspace, options: MasksOptions, cameras: Sequence[Camera], progress: Progress) -> Found:
    """Masks of SAM, prompted by the user's table or, without one, by the masks of `lint`."""
    segment = open_sam(_given(workspace, options.weights, "--weights"), trusted=options.trust_weights)
    if options.prompts:
        prompts = _table_prompts(_found_file(workspace, options.prompts), cameras)
        views = [camera for camera in cameras if camera.name in prompts]
    else:
        lint = by_lint(workspace, options, cameras, progress).masks
        prompts = {name: prompts_around(ids) for name, ids in lint.ids.items()}
        views = [camera for camera in cameras if camera.name in prompts]

    def detect(name: str, image: NDArray[np.uint8]) -> tuple[NDArray[np.uint16], dict[int, float]]:
        return detect_sam(image, segment, prompts[name], confidence=options.confidence, tile_px=options.tile)

    return Found(_each(workspace, views, detect, progress))


def by_text(workspace: Workspace, options: MasksOptions, cameras: Sequence[Camera], progress: Progress) -> Found:
    """Masks of SAM in the boxes that Grounding DINO finds for a text."""
    if not options.prompt.strip():
        raise BadUsage("--prompt is empty; say what to look for, e.g. --prompt 'cotton boll'")
    detector = _given(workspace, options.detector, "--detector")
    find = open_grounding_dino(detector, options.prompt, trusted=options.trust_weights)
    segment = open_sam(_given(workspace, options.weights, "--weights"), trusted=options.trust_weights)

    def detect(_: str, image: NDArray[np.uint8]) -> tuple[NDArray[np.uint16], dict[int, float]]:
        boxes = find_boxes(image, find, confidence=options.text_confidence, tile_px=options.tile)
        return detect_sam(image, segment, Prompts(boxes=boxes), confidence=options.confidence, tile_px=options.tile)

    return Found(_each(workspace, _spaced(cameras, options), detect, progress))


def imported(workspace: Workspace, options: MasksOptions, cameras: Sequence[Camera], _: Progress) -> Found:
    """The user's masks, fitted to the undistorted images.

    Raises:
        BadInput: masks of images that do not exist, or of another shape than these.
    """
    source = _found_file(workspace, options.source) if options.source else workspace.masks_input
    by_stem = {Path(camera.name).stem: camera for camera in cameras}
    sizes = {stem: (camera.height, camera.width) for stem, camera in by_stem.items()}
    found = read_masks(source, sizes, _listed(options.classes))
    unknown = sorted(found.ids.keys() - by_stem.keys())
    if unknown:
        raise BadInput(
            f"{len(unknown)} masks, e.g. {unknown[0]}, belong to no image with a pose "
            f"(e.g. {next(iter(by_stem))}); name masks like their images"
        )
    ids: dict[str, NDArray[np.uint16]] = {}
    for stem, mask in found.ids.items():
        camera = by_stem[stem]
        ids[camera.name] = undistort_ids(stem, mask, camera, workspace.sfm_model)
    masks = MaskSet(ids, {by_stem[stem].name: scores for stem, scores in found.scores.items()})
    empty = sorted(name for name, drawn in ids.items() if not drawn.any())
    if empty and len(empty) < len(ids):
        return Found(
            masks, (f"{len(empty)} of {len(ids)} imported images have no mask, e.g. {empty[0]}; true if no boll shows",)
        )
    return Found(masks)


def _model(workspace: Workspace) -> Gaussians | None:
    """The plant's model, once there is one."""
    return read_gaussians(workspace.gaussians_ply) if workspace.gaussians_ply.is_file() else None


def _several(cameras: Sequence[Camera]) -> Sequence[Camera]:
    if len(cameras) < 2:
        raise BadInput("only one image has a pose; bolls are found from several sides, so film a full turn")
    return cameras


def _spaced(cameras: Sequence[Camera], options: MasksOptions) -> list[Camera]:
    """Cameras evenly spaced around the plant."""
    angles = azimuths(cameras, fit_orbit(_several(cameras)))
    return [cameras[i] for i in evenly_spaced(angles, options.views)]


def _each(workspace: Workspace, views: Sequence[Camera], detect: Detector, progress: Progress) -> MaskSet:
    """The masks of views, one image at a time."""
    masks = MaskSet({}, {})
    for done, camera in enumerate(views):
        progress(done, len(views), camera.name)
        image = read_image(workspace.undistorted_image(camera.name))
        masks.ids[camera.name], masks.scores[camera.name] = detect(camera.name, image)
    return masks


def _given(workspace: Workspace, text: str, option: str) -> Path:
    """The file or folder of an option that this back end cannot do without."""
    if not text:
        raise BadUsage(f"this back end needs weights, and none are downloaded; give a local file or folder as {option}")
    return _found_file(workspace, text)


def _found_file(workspace: Workspace, text: str) -> Path:
    """A path relative to the plant's folder or, where there is none, to where the command runs."""
    beside = workspace.root / text
    return beside if beside.exists() else Path(text)


def _listed(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _class_numbers(network: Network, text: str) -> list[int]:
    """The chosen classes by number; all of a network that only knows one.

    Raises:
        BadUsage: an unknown class, or no choice among several.
    """
    names = dict(network.class_names)
    numbers = {name: number for number, name in names.items()}
    chosen = []
    for word in _listed(text):
        if word not in numbers and not word.isdecimal():
            raise BadUsage(f"the model has no class {word!r}; it has {', '.join(list(numbers)[:8]) or 'numbers only'}")
        chosen.append(numbers[word] if word in numbers else int(word))
    if len(names) > 1 and not chosen:
        listed = ", ".join(list(numbers)[:8])
        raise BadUsage(f"the model knows {len(names)} classes ({listed}, ...); say which are bolls with --classes")
    return chosen


def _table_prompts(table: Path, cameras: Sequence[Camera]) -> dict[str, Prompts]:
    """Prompts by the name of the image.

    Raises:
        BadInput: prompts of unknown images, or outside of theirs.
    """
    by_stem = {Path(camera.name).stem: camera for camera in cameras}
    prompts = {}
    for stem, rows in read_prompts(table).items():
        if stem not in by_stem:
            raise BadInput(
                f"{table.name} prompts {stem}, which is no image with a pose; use names such as {next(iter(by_stem))}"
            )
        camera = by_stem[stem]
        limits = np.tile([camera.width, camera.height], rows.shape[1] // 2)
        if ((rows < 0) | (rows > limits)).any():
            raise BadInput(
                f"{table.name} prompts {stem} outside of its {camera.width} x {camera.height} px; "
                "take them in the images of sfm/undistorted"
            )
        prompts[camera.name] = Prompts(points=rows) if rows.shape[1] == 2 else Prompts(boxes=rows)
    return prompts


def _weights_sha256(workspace: Workspace, options: MasksOptions) -> dict[str, str]:
    """Which weights made the masks."""
    sums: dict[str, str] = {}
    for text in filter(None, (options.weights, options.detector)):
        path = _found_file(workspace, text)
        files = [path] if path.is_file() else sorted([*path.glob("*.safetensors"), *path.glob("*.bin")])
        sums |= {f"{path.name}/{file.name}" if path.is_dir() else file.name: file_sha256(file) for file in files}
    return sums


def _disk_bytes(_: Workspace, options: MasksOptions) -> float:
    return options.views * MASK_BYTES


def _cost(work: Work) -> Cost:
    """Views vote on what is lint, whether they get masks or not."""
    width, height = work.size
    image_mp, voting = width * height / 1e6, min(max(work.views, VOTING_VIEWS), work.images)
    return Cost((0.16 + 0.05 * image_mp) * voting + 0.36 * image_mp * work.views)


STAGE = Stage("masks", version=10, inputs=inputs, run=run, cost=_cost, disk_bytes=_disk_bytes, named_files=named_files)
