# SPDX-License-Identifier: Apache-2.0
"""The definition of a stage: all that the rest of the program knows of it, declared in its room's `stage.py` as STAGE.

`stage.py` loads the inputs, calls the pure functions of the room, and saves the outputs through `workspace.writing`.
Stages meet in files only. `pipeline.py` runs them; `staleness.py` decides which results are stale.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, cast

from . import __version__
from .core.runs import Progress, StageOutcome
from .errors import BadInput, MissingInput
from .io.images import fit_size
from .option_rules import as_dict, places
from .options import STAGE_OPTIONS
from .schemas.record import Record
from .workspace import Workspace

STAGES: Final = tuple(STAGE_OPTIONS)
"""Names, in the order in which they run."""
FILE: Final = "file"
FOLDER: Final = "folder"
EITHER: Final = "file or folder"


@dataclass(frozen=True)
class Footage:
    """The frames of a capture, before any stage reads them."""

    frames: int
    width: int
    height: int
    is_video: bool = True


@dataclass(frozen=True)
class Work:
    """The work of a run, as far as it is known in advance."""

    options: Mapping[str, Any]
    """Options of all stages."""
    source: Footage

    @property
    def images(self) -> int:
        """Number of images taken from the capture."""
        asked: int = self.options["frames"].count
        return min(asked, self.source.frames)

    @property
    def views(self) -> int:
        """Number of images that get masks."""
        asked: int = self.options["masks"].views
        return min(asked, self.images)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the images, px."""
        return fit_size(self.source.width, self.source.height, self.options["frames"].max_side)

    def megapixels(self, max_side: int) -> float:
        """Megapixels of an image whose longer side is at most `max_side` px."""
        width, height = fit_size(*self.size, max_side)
        return width * height / 1e6

    @property
    def million_gaussians(self) -> float:
        most: int = self.options["train"].max_gaussians
        return most / 1e6


@dataclass(frozen=True)
class Cost:
    """Seconds of one core: for work that all cores share, and for work that one core does alone."""

    shared_s: float
    alone_s: float = 0.0

    @property
    def cpu_s(self) -> float:
        return self.shared_s + self.alone_s

    def seconds(self, cores: float) -> float:
        """Seconds on the clock of an idle machine."""
        return self.alone_s + self.shared_s / cores

    def times(self, factor: float) -> Cost:
        return Cost(self.shared_s * factor, self.alone_s * factor)


@dataclass(frozen=True)
class Stage:
    """One stage."""

    name: str
    """Also the name of its room, its command and its folder, and the key of its options in `options.STAGE_OPTIONS`."""
    version: int
    """Raised when the code gives another result for the same inputs."""
    inputs: Callable[[Workspace], list[Path]]
    """Files and folders of the plant that the result depends on."""
    run: Callable[[Workspace, Any, Progress], StageOutcome]
    """Workspace, options of the stage and progress."""
    cost: Callable[[Work], Cost]
    """Cost on the machine on which the constants of `planning.cost` were measured."""
    begin: Callable[[Workspace, Any, Progress], None] | None = None
    """Does the part that shows how good the capture is, and keeps it for `run`; None if there is no such part."""
    splats: bool = False
    """Whether its time scales with that of the splatting core instead of with that of images."""
    disk_bytes: Callable[[Workspace, Any], float] = lambda workspace, options: 0.0
    """Generous estimate of the bytes that it writes, from its options and the size of its inputs."""
    names: Mapping[str, str] = field(default_factory=dict)
    """Option that names a file or folder of the user, as `--set` writes it -> FILE, FOLDER or EITHER."""
    also_reads: Callable[[Workspace, Any], list[Path]] = lambda workspace, options: []
    """Further files, in any place, that it reads with these options."""
    parts: Callable[[Workspace, Any], dict[str, str]] = lambda workspace, options: {}
    """SHA-256 of the parts that it reads of files that hold more, by the file's name, # and the part's name."""
    droppable: Callable[[Workspace], list[Path]] = lambda workspace: []
    """Files that `clean` drops: they can be made again and are not results."""

    def named_files(self, workspace: Workspace, options: Any) -> list[Path]:
        """The files that its options name, in any place: a new file under the same name gives another result."""
        return [path for _, path in self._named(workspace, options)]

    def reads(self, workspace: Workspace, options: Any) -> list[Path]:
        """All files on which the result depends, besides the options."""
        return [
            *self.inputs(workspace),
            *self.named_files(workspace, options),
            *self.also_reads(workspace, options),
        ]

    def require_named(self, workspace: Workspace, options: Any) -> None:
        """Look for the files and folders that its options name.

        Raises:
            MissingInput: one is missing. BadInput: one is a folder instead of a file, or a file instead of a folder.
        """
        for place, path in self._named(workspace, options):
            option, kind = f"{self.name}.{place} = {str(path)!r}", self.names[place]
            if not path.exists():
                raise MissingInput(f"{option} is not there, neither in the plant's folder nor here; mend the path")
            if path.is_dir() == (kind == FILE) and kind != EITHER:
                raise BadInput(f"{option} is a {FOLDER if path.is_dir() else FILE}; give a {kind}")

    def require_results(self, workspace: Workspace, made: Collection[str] = ()) -> None:
        """Look for the results of the stages that it follows.

        Args:
            made: stages that run before it.
        Raises:
            MissingInput: one of them has no result.
        """
        for path in self.inputs(workspace):
            maker = path.relative_to(workspace.root).parts[0] if path.is_relative_to(workspace.root) else ""
            if maker in STAGES and maker not in made and not workspace.folder(maker).is_dir():
                workspace.require(path, maker)

    def _named(self, workspace: Workspace, options: Any) -> Iterator[tuple[str, Path]]:
        """The options in effect that name a file or folder, and its path."""
        known = list(places(options))
        method = known[0].value_in(options)
        for place in known:
            if place.path in self.names and place.counts_with(method) and (text := place.value_in(options)):
                yield place.path, workspace.named_file(text)

    def input_hashes(self, workspace: Workspace, options: Any) -> dict[str, str]:
        """SHA-256 of all that it reads, by name."""
        return workspace.hashes(*self.reads(workspace, options)) | self.parts(workspace, options)

    def follows(self, workspace: Workspace, options: Any, stages: Collection[str]) -> bool:
        """Whether it reads the result or the record of one of these stages."""
        paths = (
            path.relative_to(workspace.root)
            for path in self.reads(workspace, options)
            if path.is_relative_to(workspace.root)
        )
        makers = {path.stem if path.parts[0] == "records" else path.parts[0] for path in paths if path.parts}
        makers |= {name.split("/")[0] for name in self.parts(workspace, options)}
        return not makers.isdisjoint(stages)

    def record(self, options: Any, reason: str) -> Record:
        """The record of a run that begins."""
        return Record(
            self.name,
            stage_version=self.version,
            cotton3dg_version=__version__,
            options=as_dict(options),
            reason=reason,
        )


def twice_the_model(workspace: Workspace, _: Any) -> float:
    """Bytes on the disk of a stage that writes data for each Gaussian."""
    return 2 * workspace.gaussians_ply.stat().st_size if workspace.gaussians_ply.exists() else 0


def stage_of(name: str) -> Stage:
    """A stage by its name; its room is imported when needed, because some rooms import large libraries."""
    return cast("Stage", importlib.import_module(f"cotton3dg.{name}.stage").STAGE)
