"""What a stage is: everything that the rest of the program knows of it, declared in its room's `stage.py` as STAGE.

`stage.py` loads the inputs, calls the pure functions of the room, and saves the outputs through `workspace.writing`.
Stages meet in files only. `pipeline.py` runs them; `staleness.py` decides what is to be made again.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, cast

from . import __version__
from .core.outcome import StageOutcome
from .core.progress import Progress
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
    """What there is to be read."""

    frames: int
    width: int
    height: int
    is_video: bool = True


@dataclass(frozen=True)
class Work:
    """What a run has to do, as far as it is known before."""

    options: Mapping[str, Any]
    """Of all stages."""
    source: Footage

    @property
    def images(self) -> int:
        """Taken from the capture."""
        return min(self.options["frames"].count, self.source.frames)

    @property
    def views(self) -> int:
        """Images that get masks."""
        return min(self.options["masks"].views, self.images)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the images, px."""
        return fit_size(self.source.width, self.source.height, self.options["frames"].max_side)

    def megapixels(self, max_side: int) -> float:
        """Of an image whose longer side is at most `max_side` px."""
        width, height = fit_size(*self.size, max_side)
        return width * height / 1e6

    @property
    def million_gaussians(self) -> float:
        return self.options["train"].max_gaussians / 1e6


@dataclass(frozen=True)
class Cost:
    """Seconds of one core, of work that all cores share and of work that one must do alone."""

    shared_s: float
    alone_s: float = 0.0

    @property
    def cpu_s(self) -> float:
        return self.shared_s + self.alone_s

    def seconds(self, cores: float) -> float:
        """On the clock of an idle machine."""
        return self.alone_s + self.shared_s / cores

    def times(self, factor: float) -> Cost:
        return Cost(self.shared_s * factor, self.alone_s * factor)


@dataclass(frozen=True)
class Stage:
    """One stage."""

    name: str
    """Also of its room, its command and its folder; its options stand under it in `options.STAGE_OPTIONS`."""
    version: int
    """Raised when the same inputs give another result."""
    inputs: Callable[[Workspace], list[Path]]
    """Files and folders of the plant that the result depends on."""
    run: Callable[[Workspace, Any, Progress], StageOutcome]
    """Workspace, options of the stage and progress."""
    cost: Callable[[Work], Cost]
    """On the machine that the constants of `planning.cost` were measured on."""
    begin: Callable[[Workspace, Any, Progress], None] | None = None
    """Does what tells how good the capture is, and keeps it for `run`; None where nothing can be done beforehand."""
    splats: bool = False
    """Whether its time goes with that of the splatting core instead of with that of images."""
    disk_bytes: Callable[[Workspace, Any], float] = lambda workspace, options: 0.0
    """About what it writes, by its options and by the size of what it reads; generous."""
    names: Mapping[str, str] = field(default_factory=dict)
    """Option that names something of the user's, as `--set` writes it -> FILE, FOLDER or EITHER."""
    also_reads: Callable[[Workspace, Any], list[Path]] = lambda workspace, options: []
    """Files anywhere that it reads with these options, besides those."""
    parts: Callable[[Workspace, Any], dict[str, str]] = lambda workspace, options: {}
    """SHA-256 of what it reads of files that hold more than what is for it, by the name of the file, # and what."""
    droppable: Callable[[Workspace], list[Path]] = lambda workspace: []
    """What `clean` drops, as it can be made again and no result is."""

    def named_files(self, workspace: Workspace, options: Any) -> list[Path]:
        """What its options name, wherever that is: a file made anew under the same name gives another result."""
        return [path for _, path in self._named(workspace, options)]

    def reads(self, workspace: Workspace, options: Any) -> list[Path]:
        """All that the result depends on besides the options."""
        return [
            *self.inputs(workspace),
            *self.named_files(workspace, options),
            *self.also_reads(workspace, options),
        ]

    def require_named(self, workspace: Workspace, options: Any) -> None:
        """Look for what its options name.

        Raises:
            MissingInput: it is not there. BadInput: a folder where a file is due, or the other way round.
        """
        for place, path in self._named(workspace, options):
            said, kind = f"{self.name}.{place} = {str(path)!r}", self.names[place]
            if not path.exists():
                raise MissingInput(f"{said} is not there, neither in the plant's folder nor here; mend the path")
            if path.is_dir() == (kind == FILE) and kind != EITHER:
                raise BadInput(f"{said} is a {FOLDER if path.is_dir() else FILE}; give a {kind}")

    def require_results(self, workspace: Workspace, made: Collection[str] = ()) -> None:
        """Look for the results of the stages that it follows.

        Args:
            made: stages that run before it.
        Raises:
            MissingInput: one has none.
        """
        for path in self.inputs(workspace):
            maker = path.relative_to(workspace.root).parts[0] if path.is_relative_to(workspace.root) else ""
            if maker in STAGES and maker not in made and not workspace.folder(maker).is_dir():
                workspace.require(path, maker)

    def _named(self, workspace: Workspace, options: Any) -> Iterator[tuple[str, Path]]:
        """Options that name something and count, and what they name."""
        known = list(places(options))
        method = known[0].value_in(options)
        for place in known:
            if place.path in self.names and place.counts_with(method) and (text := place.value_in(options)):
                yield place.path, workspace.named_file(text)

    def input_hashes(self, workspace: Workspace, options: Any) -> dict[str, str]:
        """SHA-256 of the same, by names."""
        return workspace.hashes(*self.reads(workspace, options)) | self.parts(workspace, options)

    def follows(self, workspace: Workspace, options: Any, stages: Collection[str]) -> bool:
        """Whether it reads what one of these stages makes, or its record."""
        paths = (
            path.relative_to(workspace.root)
            for path in self.reads(workspace, options)
            if path.is_relative_to(workspace.root)
        )
        makers = {path.stem if path.parts[0] == "records" else path.parts[0] for path in paths if path.parts}
        makers |= {name.split("/")[0] for name in self.parts(workspace, options)}
        return not makers.isdisjoint(stages)

    def record(self, options: Any, reason: str) -> Record:
        """Of a run that begins."""
        return Record(
            self.name,
            stage_version=self.version,
            cotton3dg_version=__version__,
            options=as_dict(options),
            reason=reason,
        )


def twice_the_model(workspace: Workspace, _: Any) -> float:
    """Disk of a stage that writes something for each Gaussian."""
    return 2 * workspace.gaussians_ply.stat().st_size if workspace.gaussians_ply.exists() else 0


def stage_of(name: str) -> Stage:
    """A stage by its name; its room is opened when needed, because some pull in large libraries."""
    return cast("Stage", importlib.import_module(f"cotton3dg.{name}.stage").STAGE)
