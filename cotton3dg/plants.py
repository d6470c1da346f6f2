"""Which folders are plants: what a command is given, and what a batch finds. Nothing is made before a film is found."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from .errors import BadInput, BadUsage, Cotton3dgError, MissingInput
from .files.listing import folders_in, is_litter
from .files.saving import explain_disk_errors, fingerprint, link
from .options import STAGE_OPTIONS
from .workspace import OWN_FOLDERS, OWN_NAMES, OWNER_MARK, VIDEO_SUFFIXES, Workspace

LEVELS_BELOW: Final = 2
"""How deep plants are sought below a folder that is none: a field may have a folder for each row. Not all of a home."""


def plant_at(given: Path, *, make: bool = False) -> Workspace:
    """The plant that a command is given: its folder, or its film.

    The plant of a film is the folder that it lies in, once there are results, or else one of its name beside it.

    Args:
        make: a film's folder, which shares the film, where there is none yet.
    Raises:
        BadUsage: a folder of plants.
        MissingInput: there is no such folder, no film or photos in it, or nothing was run of a film.
        BadInput: no video, or the folder of its name has another one.
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
        return _has_results(workspace)
    except Cotton3dgError:
        pass  # its run will explain
    return True


def refuse_plant(folder: Path) -> None:
    """Raise BadUsage where a field is asked for and the folder of one plant was given."""
    if is_plant(Workspace(folder)):
        raise BadUsage(f"this folder is one plant and no field; use `cotton3dg run {shlex.quote(str(folder))}`")


def plants_in(folder: Path) -> list[Path]:
    """Folders of plants below `folder`, in order of name: those with a capture, and leaves that lack one."""
    return [plant for child in _folders(folder) for plant in _plants_at(child)]


def _plants_at(folder: Path) -> list[Path]:
    return [folder] if is_plant(Workspace(folder)) else plants_in(folder) or [folder]


def is_empty(folder: Path) -> bool:
    """Whether a folder holds nothing but what this tool or the system left there."""
    return all(path.name in OWN_NAMES or is_litter(path.name) for path in folder.iterdir())


def _plants_below(folder: Path, levels: int) -> Iterator[Path]:
    for child in _folders(folder):
        if is_plant(Workspace(child)):
            yield child
        elif levels > 1:
            yield from _plants_below(child, levels - 1)


def _folders(folder: Path) -> list[Path]:
    """Those that may be plants or hold some: neither hidden nor made by this tool."""
    return [
        path
        for path in folders_in(folder)
        if not (path / OWNER_MARK).exists()
        # A plot may be called `check`; what a plant's folder holds under such a name has no video.
        and (path.name not in OWN_FOLDERS or Workspace(path).videos())
    ]


def _has_results(workspace: Workspace) -> bool:
    return any(
        workspace.record_file(stage).is_file() or (workspace.folder(stage) / OWNER_MARK).exists()
        for stage in STAGE_OPTIONS
    )


def _plant_of_film(film: Path, make: bool) -> Workspace:
    if film.suffix.lower() not in VIDEO_SUFFIXES:
        raise BadInput(f"{film.name} is no video ({', '.join(VIDEO_SUFFIXES)}); give a video or a plant's folder")
    if _has_results(Workspace(film.parent)):
        return Workspace(film.parent)
    folder = film.parent / film.stem
    if not folder.is_dir() and not make:
        raise MissingInput(f"nothing was run of this film yet; begin with `cotton3dg run {shlex.quote(str(film))}`")
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
