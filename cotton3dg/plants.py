# SPDX-License-Identifier: Apache-2.0
"""Which folders are plants, for commands and for batches. Nothing is written before a film is found."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from .errors import BadInput, BadUsage, Cotton3dgError, MissingInput
from .io.listing import folders_in, is_litter, is_there
from .io.saving import explain_disk_errors, fingerprint, link, write_text_atomically
from .options import STAGE_OPTIONS
from .workspace import OWN_FOLDERS, OWN_NAMES, OWNER_MARK, VIDEO_SUFFIXES, Workspace

LEVELS_BELOW: Final = 2
"""Depth of the search for plants below other folders: a field may have a folder for each row. Not all of a home."""


def plant_at(given: Path, *, make: bool = False) -> Workspace:
    """The plant that the user names by its folder or its film.

    The plant of a film is the folder of the film, if that has results, or else a folder with its name beside it.

    Args:
        make: make a folder for a film, which shares the film, if there is none yet.
    Raises:
        BadUsage: the folder holds plants.
        MissingInput: the folder does not exist or has no film or photos, or no stage has run for a film.
        BadInput: the file is not a video, or the folder with its name has another one.
    """
    workspace = _plant_of_film(given, make) if given.is_file() else Workspace(given)
    if is_plant(workspace):
        return workspace
    if below := list(_plants_below(workspace.root, LEVELS_BELOW)):
        plants = "a plant" if len(below) == 1 else f"{len(below)} plants"
        raise BadUsage(
            f"this folder holds {plants} and is none itself; measure all with"
            f" `cotton3dg batch {shlex.quote(str(given))}`, or give one, e.g. {shlex.quote(str(below[0]))}"
        )
    workspace.capture()  # explains what is missing
    return workspace


def is_plant(workspace: Workspace) -> bool:
    """Whether a folder has a film, photos, or results of one that is gone."""
    try:
        workspace.capture()
    except MissingInput:
        return has_results(workspace)
    except Cotton3dgError:
        pass  # its run will explain
    return True


def keep_plant_id(workspace: Workspace, plant_id: str) -> None:
    """Write an id that no folder can have as its name into the plant's options; options that are there stay."""
    if not workspace.options_file.exists():
        name = json.dumps(plant_id, ensure_ascii=False)
        write_text_atomically(workspace.options_file, f"[traits]\nplant_id = {name}\n")


def has_results(workspace: Workspace) -> bool:
    """Whether a stage has run in a folder."""
    return any(
        workspace.record_file(stage).is_file() or (workspace.folder(stage) / OWNER_MARK).exists()
        for stage in STAGE_OPTIONS
    )


def may_be_plant(folder: Path) -> bool:
    """As `is_plant`, but also true for an unusable folder, whose run will explain the problem."""
    try:
        return is_plant(Workspace(folder))
    except Cotton3dgError:
        return True


def refuse_plant(folder: Path) -> None:
    """Raise BadUsage if the command needs a field and the user gives the folder of one plant."""
    if is_plant(Workspace(folder)) and not any(_plants_below(folder, LEVELS_BELOW)):
        raise BadUsage(f"this folder is one plant and no field; use `cotton3dg run {shlex.quote(str(folder))}`")


def plants_in(folder: Path) -> list[Path]:
    """Folders of plants below `folder`, in order of name: those with a capture, and leaves that lack one."""
    return _plants_in(folder, {folder.resolve()})


def _plants_in(folder: Path, seen: set[Path]) -> list[Path]:
    """Plants in folders that are not in `seen`, which holds paths without links: links may lead in circles."""
    found: list[Path] = []
    for child in _folders(folder):
        if (own := child.resolve()) not in seen:
            seen.add(own)
            found += [child] if may_be_plant(child) else _plants_in(child, seen) or [child]
    return found


def same_films(field: Path, names: Sequence[str]) -> dict[str, str]:
    """Plant of a field -> the first other plant with the same video; only plants that share one."""
    by_size: dict[int, list[tuple[str, Path]]] = {}
    for name in names:
        videos: list[Path] = []
        with suppress(Cotton3dgError):  # an unusable folder; its run will explain
            videos = Workspace(field / name).videos()
        if len(videos) == 1 and (size := videos[0].stat().st_size):
            by_size.setdefault(size, []).append((name, videos[0]))
    found: dict[str, str] = {}
    for alike in (alike for alike in by_size.values() if len(alike) > 1):
        first: dict[str, str] = {}
        for name, video in alike:
            other = first.setdefault(fingerprint(video), name)
            if other != name:
                found[name] = other
                found.setdefault(other, name)
    return found


def is_empty(folder: Path) -> bool:
    """Whether a folder holds nothing but what this tool or the system left there."""
    return all(path.name in OWN_NAMES or is_litter(path.name) for path in folder.iterdir())


def _plants_below(folder: Path, levels: int) -> Iterator[Path]:
    for child in _folders(folder):
        if may_be_plant(child):
            yield child
        elif levels > 1:
            yield from _plants_below(child, levels - 1)


def _folders(folder: Path) -> list[Path]:
    """Folders that may be plants or hold some: neither hidden nor made by this tool."""
    return [
        path
        for path in folders_in(folder)
        if not is_there(path / OWNER_MARK)
        # A plot may have the name `check`; a folder with such a name inside a plant's folder has no video.
        and (path.name not in OWN_FOLDERS or Workspace(path).videos())
    ]


def _plant_of_film(film: Path, make: bool) -> Workspace:
    if film.suffix.lower() not in VIDEO_SUFFIXES:
        raise BadInput(f"{film.name} is not a video ({', '.join(VIDEO_SUFFIXES)}); give a video or a plant's folder")
    if has_results(Workspace(film.parent)):
        return Workspace(film.parent)
    folder = film.parent / film.stem
    if not folder.is_dir() and not make:
        begin = f"begin with `cotton3dg run {shlex.quote(str(film))}`"
        raise MissingInput(f"nothing was run of this film yet; {begin}, or give the folder of its plant")
    with explain_disk_errors(film.parent):
        if folder.exists() and not folder.is_dir():
            raise BadInput(f"{folder.name} is a file where {film.name} gets its folder; move it elsewhere")
        own = Workspace(folder).videos() if folder.is_dir() else []
        if any(video.name != film.name or fingerprint(video) != fingerprint(film) for video in own):
            raise BadInput(f"{folder.name}/ has another video than {film.name}; move one of them elsewhere")
        if make and not own:
            folder.mkdir(exist_ok=True)
            link(film, folder / film.name)
    return Workspace(folder)
