# SPDX-License-Identifier: Apache-2.0
"""The folder of one plant. Sole owner of paths, atomic saves, records and the lock.

A stage writes into a private folder that replaces the stage's folder in one rename once everything is on disk; its
record is written last. A process killed at any moment therefore leaves either the old result or the new one, and a
result without a record is simply made again.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Final

from .errors import BadInput, MissingInput
from .io.listing import files_in, is_there, require_utf8
from .io.lock import is_held, locked
from .io.saving import (
    FULL_BELOW_BYTES,
    explain_disk_errors,
    file_sha256,
    fsync,
    full_disk,
    link,
    partial_name,
)
from .schemas.corrections import Pick
from .schemas.document import Document
from .schemas.record import DroppedFiles, Record

VIDEO_SUFFIXES: Final = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm")
OWNER_MARK: Final = ".cotton3dg"
"""Empty file in every folder that this tool wrote, so that it never replaces any other folder."""
PACKAGE: Final = Path(__file__).resolve().parent


class _Below:
    """A path in the plant's folder."""

    def __init__(self, path: str):
        self.path = path

    def __get__(self, workspace: Workspace, _: type) -> Path:
        return workspace.root / self.path


class Workspace:
    """Paths of one plant's folder and safe ways to write below it."""

    # ------------------------------------------------- what the user gives
    options_file = _Below("cotton3dg.toml")
    images_input = _Below("images")
    masks_input = _Below("own_masks")
    """Boll masks that the user made, for the import back end."""
    scale_points = _Below("scale_points.csv")
    """Two points of known distance that the user picked in images, for scale --method distance."""
    corrections_json = _Below("corrections.json")
    """Corrections of single bolls by a person."""
    truth_json = _Below("truth.json")
    """The truth of a simulated plant; no stage reads it."""

    # --------------------------------------------- what stages write, by stage
    frames_json = _Below("frames/frames.json")
    sfm_model = _Below("sfm")
    """COLMAP model of the images as filmed."""
    sfm_json = _Below("sfm/sfm.json")
    sfm_begun = _Below("records/sfm.begun")
    """Keyframes that `check` placed, until sfm goes on from them."""
    undistorted = _Below("sfm/undistorted")
    """Folder with `images/` and the pinhole COLMAP model `sparse/` of them."""
    gaussians_ply = _Below("train/gaussians.ply")
    metrics_json = _Below("train/metrics.json")
    effects_json = _Below("train/effects.json")
    """Which effects of the camera the training allows for, and the evidence for and against each."""
    masks_json = _Below("masks/masks.json")
    lint_share_npz = _Below("segment/lint_share.npz")
    """How much each Gaussian is lint, by the network's maps."""
    selections_npz = _Below("segment/selections.npz")
    segment_json = _Below("segment/segment.json")
    """How the segmentation ran, and how its maps agree with the masks."""
    probabilities_npy = _Below("segment/probabilities.npy")
    """(N,) float32: how likely each Gaussian is lint."""
    lint_ply = _Below("segment/lint.ply")
    """The Gaussians whose probability is above the threshold."""
    features_npy = _Below("segment/features.npy")
    """(N, C) float32: smoothed affinity features, similar within a boll; zero for a Gaussian without one."""
    bolls_json = _Below("cluster/bolls.json")
    labels_npy = _Below("cluster/labels.npy")
    bolls_ply = _Below("cluster/bolls.ply")
    """The model with each boll in a colour of its own and the rest in grey, for viewers."""
    boll_images = _Below("cluster/images")
    """Bolls drawn into the images, where all images together found them."""
    views_jpg = _Below("cluster/views.jpg")
    """Bolls as one view shows them, beside all views together."""
    scale_json = _Below("scale/scale.json")
    patches_json = _Below("scale/patches.json")
    """The grey patches of the plant's card, if the stage sought and saw it."""
    traits_csv = _Below("traits/traits.csv")
    bolls_csv = _Below("traits/bolls.csv")
    columns_csv = _Below("traits/columns.csv")
    """The meaning of each column of the two tables."""
    branches_csv = _Below("traits/branches.csv")
    skeleton_json = _Below("traits/skeleton.json")
    """The plant's map: stem, branches, and where each boll sits."""
    skeleton_ply = _Below("traits/skeleton.ply")
    """The same as points and edges, for Blender and CloudCompare."""
    plant_map_svg = _Below("traits/plant_map.svg")
    """The same as a drawing to print."""
    repeats = _Below("repeats")
    """Further runs of the same capture, to see how far they agree."""
    render = _Below("render")
    """Films of the model."""
    corrected_bolls_json = _Below("traits/bolls.json")
    corrected_labels_npy = _Below("traits/labels.npy")
    """The measured bolls after corrections, in the form of those of `cluster`."""
    plant_npy = _Below("traits/plant.npy")
    """(N,) bool: which Gaussians are the plant."""

    # ---------------------------------------------- what else is written here
    report_html = _Below("report.html")
    """The plant's page: everything to look at in one file."""
    check_json = _Below("check/check.json")
    """The findings of a first look at the film."""
    check_html = _Below("check/check.html")
    annotations_json = _Below("annotations/bolls.json")
    """The masks as COCO, for annotation tools; the images they belong to are beside it."""
    study_csv = _Below("study/study.csv")
    """Accuracy and time of the settings that were tried."""
    study_md = _Below("study/study.md")
    study_plot = _Below("study/study.png")
    train_checkpoint = _Below("records/train.checkpoint.npz")
    """A training that was interrupted."""
    train_rejected = _Below("records/train.rejected.npz")
    """The first training step that had no finite loss: its Gaussians, view and optimiser, for diagnosis."""
    choices_json = _Below("records/options.json")
    """The chosen options of the last run."""
    dropped_json = _Below("records/dropped.json")
    """Names of the files that `clean` dropped."""
    log_file = _Below("run.log")

    def __init__(self, root: Path | str):
        self.root = Path(root)
        require_utf8(self.root.resolve())
        if not is_there(self.root):
            raise MissingInput(f"{self.root} does not exist; look at its spelling and at the folder that you are in")
        if not self.root.is_dir():
            raise MissingInput(f"{self.root} is not a folder; give the folder that holds the plant's video")

    def __repr__(self) -> str:
        return f"Workspace({str(self.root)!r})"

    @property
    def plant_id(self) -> str:
        return self.root.resolve().name

    def capture(self) -> Path:
        """The user's video, or the `images` folder.

        Raises:
            MissingInput: there is neither.
            BadInput: there are several videos, or a name that is not UTF-8.
            EnvironmentUnusable: the folder cannot be read.
        """
        videos = self.videos()
        if len(videos) > 1:
            names = ", ".join(path.name for path in videos)
            raise BadInput(f"several videos ({names}); keep one video in each plant's folder")
        if videos:
            return videos[0]
        if self.images_input.is_dir():
            return self.images_input
        raise MissingInput(
            f"no video ({', '.join(VIDEO_SUFFIXES)}) and no images folder; copy the plant's video here, or photos of it"
            " into a folder named images in here"
        )

    def videos(self) -> list[Path]:
        """The videos in the plant's folder itself."""
        return files_in(self.root, VIDEO_SUFFIXES)

    def folder(self, stage: str) -> Path:
        return self.root / stage

    def frame_images(self) -> list[Path]:
        """The images of the frames stage in order of time."""
        return sorted((self.root / "frames").glob("*.jpg"))

    def undistorted_image(self, name: str) -> Path:
        return self.undistorted / "images" / name

    def has_images(self, picks: Iterable[Pick]) -> bool:
        """Whether the undistorted images of the picks are there, or were dropped by `clean`, and are unchanged."""
        for pick in picks:
            found = list(self.hashes(self.undistorted_image(pick.image)).values())
            if not found or pick.sha256 not in ("", *found):
                return False
        return True

    def named_file(self, text: str) -> Path:
        """A path that an option names, from the plant's folder or, if nothing is there, from the working folder."""
        beside = self.root / text
        return beside if beside.exists() else Path(text)

    def mask_png(self, image_name: str) -> Path:
        """Instance ids of an undistorted image."""
        return self.root / "masks" / f"{Path(image_name).stem}.png"

    def maps_npz(self, image_name: str) -> Path:
        """The bolls' network's maps of an undistorted image."""
        return self.root / "masks" / f"{Path(image_name).stem}.npz"

    def boll_ids_png(self, image_name: str) -> Path:
        """Ids in an undistorted image that bolls name as their masks: drawn by all images together, or its masks."""
        drawn = self.boll_images / self.mask_png(image_name).name
        return drawn if drawn.is_file() else self.mask_png(image_name)

    def segment_picture(self, kind: str, image_name: str) -> Path:
        """A view with rendered `probability`, grey, white = 1 (.png), this over the `training`, or `lint`.ply alone."""
        suffix = "png" if kind == "probability" else "jpg"
        return self.root / "segment" / f"{kind}_{Path(image_name).stem}.{suffix}"

    def boll_ply(self, boll_id: int) -> Path:
        """The Gaussians of one boll."""
        return self.root / "cluster" / f"boll_{boll_id:03d}.ply"

    def study_setting(self, sweep: str, value: str) -> Workspace:
        """A folder like this plant's for another setting; made if needed."""
        return self._like_this(self.root / "study", sweep, value)

    def repeat_run(self, number: int) -> Workspace:
        """A folder like this plant's for another run of the same capture; made if needed."""
        return self._like_this(self.repeats, str(number))

    def _like_this(self, ours: Path, *names: str) -> Workspace:
        self._check_ours(ours)
        folder = ours.joinpath(*names)
        with explain_disk_errors(self.root):
            folder.mkdir(parents=True, exist_ok=True)
            (ours / OWNER_MARK).touch()
        return Workspace(folder)

    def share_inputs(self, other: Workspace) -> None:
        """Give `other` the user's files without a second copy on the disk: the capture, own masks, picked points."""
        for source in (self.capture(), self.masks_input, self.scale_points):
            target = other.root / source.name
            if source.exists() and not target.exists():
                link(source, target)

    def share_result(self, stage: str, other: Workspace) -> None:
        """Give `other` a finished stage without a second copy on the disk: no stage changes files in place."""
        with other.writing(stage) as folder:
            link(self.folder(stage), folder)
        record = self.read_record(stage)
        if record:
            other.write_record(record)

    def final_bolls(self) -> tuple[Path, Path]:
        """bolls.json and labels.npy of the bolls that `traits` measured: the corrected ones if there are any."""
        if self.corrected_bolls_json.is_file():
            return self.corrected_bolls_json, self.corrected_labels_npy
        return self.bolls_json, self.labels_npy

    def require(self, path: Path, stage: str) -> Path:
        """`path`, or MissingInput naming the stage that makes it."""
        if not path.exists():
            raise MissingInput(f"{path.relative_to(self.root)} is missing; run `cotton3dg {stage}` first")
        return path

    # ------------------------------------------------------------ safe saves
    @contextmanager
    def writing(self, stage: str) -> Iterator[Path]:
        """A private folder for a stage's output that becomes `folder(stage)` when the block ends without an error.

        `stage` may be two levels deep, e.g. `render/turntable`.
        """
        final = self.folder(stage)
        self._check_ours(final)
        partial = final.with_name(partial_name(final.name))
        with explain_disk_errors(self.root):
            final.parent.mkdir(exist_ok=True)
            shutil.rmtree(partial, ignore_errors=True)
            partial.mkdir()
        try:
            with explain_disk_errors(self.root):
                yield partial
                (partial / OWNER_MARK).touch()
                for path in sorted(partial.rglob("*")):
                    if path.is_file():
                        fsync(path)
                self.record_file(stage).unlink(missing_ok=True)
                old = final.with_name(f".{final.name}.old")
                shutil.rmtree(old, ignore_errors=True)
                if final.exists():
                    final.rename(old)
                partial.rename(final)
                fsync(final.parent)
                shutil.rmtree(old, ignore_errors=True)
        except (RuntimeError, ValueError) as error:
            # On a full disk, libraries raise all kinds of errors.
            if shutil.disk_usage(self.root).free >= FULL_BELOW_BYTES:
                raise
            raise full_disk(self.root) from error
        finally:
            shutil.rmtree(partial, ignore_errors=True)

    def drop_unfinished(self, stages: Iterable[str]) -> None:
        """Remove the remains of runs that were killed during a save; only for the holder of the lock."""
        for stage in stages:
            for left in ("partial", "old"):
                shutil.rmtree(self.root / f".{stage}.{left}", ignore_errors=True)

    def _check_ours(self, final: Path) -> None:
        if final.parent.exists() and not final.parent.is_dir():
            raise BadInput(f"{final.parent.name} is a file where cotton3dg makes a folder; move it elsewhere")
        if final.is_symlink() or (final.exists() and not (final / OWNER_MARK).exists()):
            raise BadInput(
                f"{final.name} stands where cotton3dg writes its output but was not made by it; move it elsewhere"
            )

    # --------------------------------------------------------------- records
    def record_file(self, stage: str) -> Path:
        return self.root / "records" / f"{stage}.json"

    def read_record(self, stage: str) -> Record | None:
        """The record of the last run of `stage`; None when there is none that can be read."""
        try:
            return Record.load(self.record_file(stage))
        except BadInput:
            return None

    def write_record(self, record: Record) -> None:
        """Save the record of its stage."""
        self.keep(record, record.stage)

    def keep(self, document: Document, name: str) -> None:
        """Save a document of this plant under a name beside the records of the stages."""
        with explain_disk_errors(self.root):
            document.save(self.record_file(name))

    def hashes(self, *paths: Path) -> dict[str, str]:
        """SHA-256 of files, and of all files below folders, by path: relative to the plant's folder, relative to
        cotton3dg for files that come with the program, wherever that is installed, or else absolute.

        Files that `clean` dropped count as if they still existed.
        """
        files: list[Path] = []
        for path in paths:
            if path.is_dir():
                files += [p for p in path.rglob("*") if p.is_file() and p.name != OWNER_MARK]
            elif path.exists():
                files.append(path)
        found = {self._name(path): file_sha256(path) for path in sorted(files)}
        dropped = self.dropped()
        return found | {name: dropped[name] for name in dropped if self._is_below(name, paths)}

    def _name(self, path: Path) -> str:
        if path.is_relative_to(self.root):
            return path.relative_to(self.root).as_posix()
        path = path.resolve()
        return (path.relative_to(PACKAGE.parent) if path.is_relative_to(PACKAGE) else path).as_posix()

    def dropped(self, *paths: Path) -> dict[str, str]:
        """Hashes of the files, below `paths` if given, that `clean` dropped and no stage has made again since."""
        try:
            names = DroppedFiles.load(self.dropped_json).names
        except BadInput:
            return {}
        # A stage that wrote its folder again removed its old record, and with it the files that it no longer makes.
        outputs: dict[str, str] = {}
        for stage in {name.split("/")[0] for name in names}:
            record = self.read_record(stage)
            outputs |= record.outputs if record else {}
        hashes = {name: outputs.get(name) for name in names}
        return {
            name: sha256
            for name, sha256 in hashes.items()
            if sha256 and not (self.root / name).exists() and (not paths or self._is_below(name, paths))
        }

    def _is_below(self, name: str, paths: tuple[Path, ...]) -> bool:
        return any((self.root / name).is_relative_to(path) for path in paths)

    # ------------------------------------------------------------------ lock
    def locked(self, *, wait: bool = False) -> AbstractContextManager[None]:
        """Hold the plant's folder for this process, as `io.lock.locked` explains."""
        return locked(self.root / ".lock", wait=wait)

    @property
    def is_locked(self) -> bool:
        """Whether a process holds the folder; the lock is only looked at."""
        return is_held(self.root / ".lock")


OWN_NAMES: Final = frozenset(item.path.split("/")[0] for item in vars(Workspace).values() if isinstance(item, _Below))
"""Names of everything that a plant's folder holds besides the video."""
OWN_FOLDERS: Final = frozenset(name for name in OWN_NAMES if not Path(name).suffix)
"""The names of folders among them: a folder with such a name is only a plant if it has a video."""
