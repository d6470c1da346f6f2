"""The folder of one plant. Sole owner of paths, atomic saves, records and the lock.

A stage writes into a private folder that replaces the stage's folder in one rename once everything is on disk; its
record is written last. A process killed at any moment therefore leaves either the old result or the new one, and a
result without a record is simply made again.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from .documents.document import Document
from .documents.record import Record
from .errors import BadInput, EnvironmentUnusable, MissingInput
from .files.saving import (
    FULL_BELOW_BYTES,
    explain_disk_errors,
    file_sha256,
    fsync,
    full_disk,
    link,
)

VIDEO_SUFFIXES = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm")
OWNER_MARK = ".cotton3dg"
"""Empty file in every folder that this tool wrote, so that nobody else's folder is ever replaced."""


class Workspace:
    """Paths of one plant's folder and safe ways to write below it."""

    def __init__(self, root: Path | str):
        self.root = Path(root)
        if not self.root.is_dir():
            raise MissingInput(f"{self.root} is not a folder; give the folder that holds the plant's video")

    @property
    def plant_id(self) -> str:
        return self.root.resolve().name

    # ---------------------------------------------------------------- inputs
    @property
    def options_file(self) -> Path:
        return self.root / "cotton3dg.toml"

    @property
    def images_input(self) -> Path:
        return self.root / "images"

    @property
    def masks_input(self) -> Path:
        """Boll masks that the user made, for the import back end."""
        return self.root / "own_masks"

    @property
    def scale_points(self) -> Path:
        """Two points of known distance that the user picked in images, for scale --method distance."""
        return self.root / "scale_points.csv"

    def capture(self) -> Path:
        """The user's video, or the `images` folder.

        Raises:
            MissingInput: there is neither.
            BadInput: there are several videos.
        """
        videos = sorted(
            path
            for path in self.root.iterdir()
            if path.suffix.lower() in VIDEO_SUFFIXES and path.is_file() and not path.name.startswith(".")
        )
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

    @property
    def truth_json(self) -> Path:
        """What is known of a simulated plant; no stage reads it."""
        return self.root / "truth.json"

    # --------------------------------------------------------------- outputs
    def folder(self, stage: str) -> Path:
        return self.root / stage

    @property
    def frames_json(self) -> Path:
        return self.root / "frames" / "frames.json"

    def frame_images(self) -> list[Path]:
        """The images of the frames stage in order of time."""
        return sorted((self.root / "frames").glob("*.jpg"))

    @property
    def sfm_model(self) -> Path:
        """COLMAP model of the images as filmed."""
        return self.root / "sfm"

    @property
    def sfm_json(self) -> Path:
        return self.root / "sfm" / "sfm.json"

    @property
    def undistorted(self) -> Path:
        """Folder with `images/` and the pinhole COLMAP model `sparse/` of them."""
        return self.root / "sfm" / "undistorted"

    def undistorted_image(self, name: str) -> Path:
        return self.undistorted / "images" / name

    @property
    def gaussians_ply(self) -> Path:
        return self.root / "train" / "gaussians.ply"

    @property
    def train_checkpoint(self) -> Path:
        """A training that was interrupted."""
        return self.root / "records" / "train.checkpoint.npz"

    @property
    def train_rejected(self) -> Path:
        """The first training step that had no finite loss: its Gaussians, view and optimiser, for diagnosis."""
        return self.root / "records" / "train.rejected.npz"

    @property
    def metrics_json(self) -> Path:
        return self.root / "train" / "metrics.json"

    @property
    def effects_json(self) -> Path:
        """Which effects of the camera the training allows for, and the evidence for and against each."""
        return self.root / "train" / "effects.json"

    @property
    def masks_json(self) -> Path:
        return self.root / "masks" / "masks.json"

    def mask_png(self, image_name: str) -> Path:
        """Instance ids of an undistorted image."""
        return self.root / "masks" / f"{Path(image_name).stem}.png"

    @property
    def annotations_json(self) -> Path:
        """The masks as COCO, for annotation tools; the images they belong to are beside it."""
        return self.root / "annotations" / "bolls.json"

    @property
    def selections_npz(self) -> Path:
        return self.root / "segment" / "selections.npz"

    @property
    def segment_json(self) -> Path:
        """What the segmentation took, and how its maps agree with the masks."""
        return self.root / "segment" / "segment.json"

    @property
    def probabilities_npy(self) -> Path:
        """(N,) float32: how likely each Gaussian is lint."""
        return self.root / "segment" / "probabilities.npy"

    @property
    def features_npy(self) -> Path:
        """(N, C) float32: smoothed affinity features, zero where there is none; alike within a boll."""
        return self.root / "segment" / "features.npy"

    def probability_png(self, image_name: str) -> Path:
        """Rendered probabilities of a view, grey; white = 1."""
        return self.root / "segment" / f"probability_{Path(image_name).stem}.png"

    @property
    def bolls_json(self) -> Path:
        return self.root / "cluster" / "bolls.json"

    @property
    def labels_npy(self) -> Path:
        return self.root / "cluster" / "labels.npy"

    @property
    def bolls_ply(self) -> Path:
        """The model with each boll in a colour of its own and the rest in grey, for viewers."""
        return self.root / "cluster" / "bolls.ply"

    def boll_ply(self, boll_id: int) -> Path:
        """The Gaussians of one boll."""
        return self.root / "cluster" / f"boll_{boll_id:03d}.ply"

    @property
    def scale_json(self) -> Path:
        return self.root / "scale" / "scale.json"

    @property
    def traits_csv(self) -> Path:
        return self.root / "traits" / "traits.csv"

    @property
    def columns_csv(self) -> Path:
        """What each column of the two tables means."""
        return self.root / "traits" / "columns.csv"

    @property
    def plant_npy(self) -> Path:
        """(N,) bool: which Gaussians are the plant."""
        return self.root / "traits" / "plant.npy"

    @property
    def bolls_csv(self) -> Path:
        return self.root / "traits" / "bolls.csv"

    @property
    def report_html(self) -> Path:
        """The plant's page: everything to look at in one file."""
        return self.root / "report.html"

    @property
    def log_file(self) -> Path:
        return self.root / "run.log"

    @property
    def study_csv(self) -> Path:
        """Accuracy and time of the settings that were tried."""
        return self.root / "study" / "study.csv"

    @property
    def study_md(self) -> Path:
        return self.root / "study" / "study.md"

    @property
    def study_plot(self) -> Path:
        return self.root / "study" / "study.png"

    def study_setting(self, sweep: str, value: str) -> Workspace:
        """A folder like this one's for another setting; made if needed."""
        self._check_ours(self.root / "study")
        folder = self.root / "study" / sweep / value
        with explain_disk_errors(self.root):
            folder.mkdir(parents=True, exist_ok=True)
            (self.root / "study" / OWNER_MARK).touch()
        return Workspace(folder)

    def share_inputs(self, other: Workspace) -> None:
        """Give `other` what the user gave, without taking up space again: the capture, own masks, picked points."""
        for source in (self.capture(), self.masks_input, self.scale_points):
            target = other.root / source.name
            if source.exists() and not target.exists():
                link(source, target)

    def share_result(self, stage: str, other: Workspace) -> None:
        """Give `other` a finished stage without taking up space again; files are replaced, never changed in place."""
        with other.writing(stage) as folder:
            link(self.folder(stage), folder)
        record = self.read_record(stage)
        if record:
            other.write_record(record)

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
        partial = final.with_name(f".{final.name}.partial")
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
            # What libraries say on a full disk can be anything.
            if shutil.disk_usage(self.root).free >= FULL_BELOW_BYTES:
                raise
            raise full_disk(self.root) from error
        finally:
            shutil.rmtree(partial, ignore_errors=True)

    def drop_unfinished(self, stages: Iterable[str]) -> None:
        """Remove what runs left that were killed while they saved; for whoever holds the lock."""
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
    @property
    def dropped_json(self) -> Path:
        """Names of the files that `clean` dropped."""
        return self.root / "records" / "dropped.json"

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
        """Save what is to be remembered of this plant under a name beside the records of the stages."""
        with explain_disk_errors(self.root):
            document.save(self.record_file(name))

    def hashes(self, *paths: Path) -> dict[str, str]:
        """SHA-256 of files, and of all files below folders, by path: from the plant's folder, or absolute if outside.

        What `clean` dropped counts as if it were still there.
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
        return (path.relative_to(self.root) if path.is_relative_to(self.root) else path.resolve()).as_posix()

    def dropped(self, *paths: Path) -> dict[str, str]:
        """Hashes of the files, below `paths` if given, that `clean` dropped and nothing has made again since."""
        try:
            names = json.loads(self.dropped_json.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            return {}
        # A stage that wrote anew took its old record away, and with it the word for files that it no longer makes.
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
    @contextmanager
    def locked(self, *, wait: bool = False) -> Iterator[None]:
        """Hold the plant's folder for this process; the lock ends with the process, however it dies.

        Args:
            wait: until whoever holds it ends, instead of failing.
        """
        with explain_disk_errors(self.root):
            handle = os.open(self.root / ".lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
            except OSError as error:
                if error.errno not in (errno.EAGAIN, errno.EACCES):
                    raise
                raise EnvironmentUnusable(
                    "another cotton3dg is working in this folder; wait for it or stop it"
                ) from error
            yield
        finally:
            os.close(handle)


def user_cache(name: str) -> Path:
    """A file of this user for all plants, below $XDG_CACHE_HOME or ~/.cache; its folder is made if needed."""
    root = os.environ.get("XDG_CACHE_HOME", "")
    folder = (Path(root) if Path(root).is_absolute() else Path.home() / ".cache") / "cotton3dg"
    with explain_disk_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return folder / name
