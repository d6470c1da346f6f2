# SPDX-License-Identifier: Apache-2.0
"""A folder for each plant from a phone's videos, named by the cards that the videos show.

The import remembers the codes of each video by the file's content, so that it continues after an interruption or after
a correction of the field book. It never guesses and never replaces a file: it reports a doubtful video and leaves it.
"""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from ..command_options import HOW
from ..core.columns import Column
from ..core.machine import usable_cores
from ..core.runs import Progress, silent
from ..errors import BadInput, BadUsage, Cotton3dgError, MissingInput, unknown
from ..identity.codes import LEAST_FRAMES, identify_plant, read_codes
from ..identity.names import folder_name, id_problem
from ..io import video
from ..io.fieldbook import FIELD_BOOK, FieldBook, read_fieldbook
from ..io.images import IMAGE_SUFFIXES, UNREAD_SUFFIXES, how_to_convert
from ..io.listing import files_below, require_utf8
from ..io.saving import (
    copy,
    explain_disk_errors,
    fingerprint,
    partial_name,
    printable,
    replacing,
    write_text_atomically,
)
from ..io.tables import csv_text, read_rows, refuse_other_table
from ..plants import has_results, keep_plant_id
from ..schemas.batch import ReadVideo, ReadVideos
from ..workspace import VIDEO_SUFFIXES, Workspace

TABLE: Final = "import.csv"
MEMORY: Final = ".import.json"
EVERY_S: Final = 0.25
MOST_FRAMES: Final = 160
SMALL_SIDE: Final = 1920
"""Longer side at which videos are read first; if that gives no code, they are read at full size."""
STILLS: Final = (".heic", ".heif", ".jpg", ".jpeg", ".dng")
LIVE_PHOTO_S: Final = 5.0
LEFTOVERS: Final = (".lrv",)
"""Small copies that action cameras write beside their videos."""

IMPORTED: Final = "imported"
THERE: Final = "there"
DOUBT: Final = "doubt"
LEFT_OUT: Final = "left out"

COLUMNS: Final = (
    Column("file", "", "the video"),
    Column("plant_id", "", "whose it is; blank when in doubt"),
    Column("state", "", "imported, there (it was before), doubt or left out"),
    Column("reason", "", "of a doubt, and what to do"),
    Column("folder", "", "the plant's folder"),
    Column("frames_read", "1", "frames that read the card"),
    Column("frames", "1", "frames that were looked at"),
)


@dataclass(frozen=True)
class Row:
    """The outcome for one video."""

    file: str
    plant_id: str = ""
    state: str = DOUBT
    reason: str = ""
    folder: str = ""
    frames_read: int | None = None
    frames: int | None = None


@dataclass(frozen=True)
class Import:
    """The request of an import."""

    into: Path
    fieldbook: Path | None = None
    id_column: str = ""
    names: Path | None = None
    """Table with the columns file and plant_id, for videos whose card cannot be read."""
    how: str = "copy"
    dry_run: bool = False


def import_videos(sources: Sequence[Path], asked: Import, progress: Progress = silent) -> list[Row]:
    """Make the plants' folders; return a row for each video, as `import.csv` has it.

    Raises:
        BadUsage: an unknown way to take the videos, or another field book than the field's own.
        BadInput: the field book or the table of names cannot be read.
        MissingInput: the sources hold no videos.
    """
    if asked.how not in HOW:
        raise unknown(f"--how {asked.how}", asked.how, HOW)
    if asked.into.is_dir() and has_results(Workspace(asked.into)):
        raise BadUsage(f"{asked.into} is a plant; give the folder of its field, or a new one, as --into")
    refuse_other_table(asked.into / TABLE, COLUMNS)
    videos = list(_videos(sources, asked.into))
    if not videos:
        raise MissingInput(
            f"no video ({', '.join(VIDEO_SUFFIXES)}) in {', '.join(map(str, sources))}; {_photos(sources)}"
        )
    book = _field_book(asked)
    named = _names(asked.names)
    rows = {path: Row(str(path), state=LEFT_OUT, reason=why) for path in videos if (why := _companion(path, videos))}
    rows |= {
        path: Row(printable(str(path)), reason=why) for path in videos if path not in rows and (why := _unusable(path))
    }
    wanted = [path for path in videos if path not in rows]
    prints = {path: fingerprint(path) for path in wanted}
    read = _read(wanted, prints, {path for path in wanted if _given(path, named)}, asked, progress)
    for path in wanted:
        rows[path] = _identify(path, read[prints[path]], book, _given(path, named))
    _find_doubles(rows, prints)
    if not asked.dry_run:
        _keep_book(asked)
    for path in wanted:
        rows[path] = _place(path, rows[path], asked)
        if not asked.dry_run:
            _save([rows[path] for path in videos], asked.into)
    return [rows[path] for path in videos]


def _videos(sources: Sequence[Path], into: Path) -> Iterator[Path]:
    """The named files, and the videos at any depth below the named folders, each once and in order of name.

    A folder that cannot be read is among them.
    """
    seen = set()
    for source in sources:
        if source.is_dir():
            refused: list[OSError] = []
            found = files_below(source, (*VIDEO_SUFFIXES, *LEFTOVERS), refused.append)
            found = sorted([*found, *(Path(error.filename) for error in refused)])
        elif source.is_file():
            found = [source]
        else:
            raise MissingInput(f"{source} is not there; give videos, or folders that hold them")
        for path in found:
            own = path.resolve()
            if own not in seen and not own.is_relative_to(into.resolve()):
                seen.add(own)
                yield path


def _photos(sources: Sequence[Path]) -> str:
    """The remedy if there are no videos, but perhaps photos."""
    photos = [photo for source in sources for photo in files_below(source, (*IMAGE_SUFFIXES, *UNREAD_SUFFIXES))]
    if not photos:
        return "give videos, or folders that hold them"
    remedy = f"{photos[0].name} is a photo: put each plant's photos into a folder PLANT/images"
    unread = next((photo for photo in photos if photo.suffix.lower() in UNREAD_SUFFIXES), None)
    return f"{remedy} and {how_to_convert(unread)}" if unread else remedy


def _unusable(path: Path) -> str:
    """Why the import cannot take a file or folder; empty if it can."""
    try:
        require_utf8(path).open("rb").close()
    except Cotton3dgError as error:
        return str(error)
    except OSError as error:
        return f"it cannot be read ({error.strerror}); change its permissions, or copy it again"
    return ""


def _companion(path: Path, videos: Sequence[Path]) -> str:
    """Why a file in a phone's folder is not a film of a plant; empty if it may be one."""
    if path.suffix.lower() in LEFTOVERS:
        return "a camera's small copy of another video"
    for still in (path.with_suffix(suffix) for low in STILLS for suffix in (low, low.upper())):
        if still.is_file():
            try:
                length_s = video.probe(path).duration_s
            except Cotton3dgError:
                return ""
            return f"the moving part of the photo {still.name}" if length_s < LIVE_PHOTO_S else ""
    # An iPhone saves an edited IMG_1234.MOV as IMG_E1234.MOV.
    original = path.with_name(path.name.replace("IMG_E", "IMG_", 1))
    return f"an edited version of {original.name}" if original != path and original in videos else ""


def _field_book(asked: Import) -> FieldBook | None:
    own = asked.into / FIELD_BOOK
    given = asked.fieldbook or (own if own.is_file() else None)
    book = read_fieldbook(given, asked.id_column) if given else None
    if asked.fieldbook and own.is_file() and book != read_fieldbook(own, asked.id_column):
        raise BadUsage(f"{own} is there and says something else than {asked.fieldbook.name}; move one of them away")
    return book


def _keep_book(asked: Import) -> None:
    """Save the field book in the field, as CSV that `batch` reads."""
    own = asked.into / FIELD_BOOK
    if asked.fieldbook and not own.exists():
        book = read_fieldbook(asked.fieldbook, asked.id_column)
        # The column of the ids keeps its name if `read_fieldbook` would find it again.
        columns = [Column(name, "", "") for name in (book.id_column, *book.columns)]
        with explain_disk_errors(asked.into):
            asked.into.mkdir(parents=True, exist_ok=True)
            rows = [{book.id_column: plant_id, **cells} for plant_id, cells in book.rows.items()]
            write_text_atomically(own, csv_text(columns, rows))


def _names(table: Path | None) -> dict[str, str]:
    """File name or path -> id that the user gives."""
    if table is None:
        return {}
    rows = read_rows(table)
    if not rows or not {"file", "plant_id"} <= rows[0].keys():
        raise BadInput(f"{table.name} needs the columns file and plant_id; {TABLE} of a field has both")
    given = [(row["file"].strip(), row["plant_id"].strip()) for row in rows if row["plant_id"].strip()]
    twice = [file for file, n in Counter(file for file, _ in given).items() if n > 1]
    if twice:
        raise BadInput(f"{table.name} names {twice[0]} twice; keep one row of it")
    return dict(given)


def _given(path: Path, named: dict[str, str]) -> str:
    return named.get(str(path)) or named.get(path.name, "")


def _read(
    videos: Sequence[Path], prints: dict[Path, str], named: set[Path], asked: Import, progress: Progress
) -> dict[str, ReadVideo]:
    """Codes in each video, by its fingerprint; no video is read twice."""
    memory = asked.into / MEMORY
    known = dict((ReadVideos.load_if_there(memory) or ReadVideos()).videos)
    due = {prints[path]: path for path in videos if prints[path] not in known and path not in named}
    with ThreadPoolExecutor(len(usable_cores())) as pool:
        results = zip(due, pool.map(read_video, due.values()), strict=True)
        for number, (own, found) in enumerate(results):
            known[own] = found
            progress(number + 1, len(due), "reading cards")
            if not asked.dry_run:
                with explain_disk_errors(asked.into):
                    asked.into.mkdir(parents=True, exist_ok=True)
                    ReadVideos(known).save(memory)
    return {own: known.get(own, ReadVideo()) for own in prints.values()}


def read_video(path: Path) -> ReadVideo:
    """The codes in a video: first in frames of `SMALL_SIDE` px and, if these give none, in frames of full size."""
    try:
        facts = video.probe(path)
        length_s = facts.duration_s if facts.duration_s > 0 else 60.0
        longer = max(facts.width, facts.height)
        for max_side in sorted({min(SMALL_SIDE, longer), longer}):
            codes: Counter[str] = Counter()
            n_frames = 0
            for frame in video.sample_frames(path, facts, max(EVERY_S, length_s / MOST_FRAMES), max_side):
                n_frames += 1
                codes.update(read_codes(frame))
            if max(codes.values(), default=0) >= LEAST_FRAMES:
                break
    except Cotton3dgError as error:
        return ReadVideo(problem=str(error))
    return ReadVideo(dict(codes), n_frames, "" if n_frames else "no frame can be decoded; copy it again from the phone")


def _identify(path: Path, read: ReadVideo, book: FieldBook | None, given: str) -> Row:
    """The plant of a video, or why it is not known."""
    if given:
        problem = id_problem(given)
        if not problem and book and given not in book.rows:
            problem = f"{given} was given for it, which is not in the field book"
        return Row(str(path), "" if problem else given, reason=problem)
    if read.problem:
        return Row(str(path), reason=read.problem, frames=read.frames)
    found = identify_plant(read.codes, book.rows if book else ())
    n_votes = max(found.votes.values(), default=0)
    remedy = f"; {_REMEDY}" if found.doubt else ""
    return Row(str(path), found.plant_id, reason=found.doubt + remedy, frames_read=n_votes, frames=read.frames)


_REMEDY: Final = f"write its plant_id into {TABLE} and give that with --names"


def _find_doubles(rows: dict[Path, Row], prints: dict[Path, str]) -> None:
    """Remove the id from videos that share it, or share its folder; of two copies of one video the first counts."""
    first: dict[str, Path] = {}
    for path, own in prints.items():
        if (other := first.setdefault(own, path)) is not path:
            rows[path] = Row(str(path), state=LEFT_OUT, reason=f"the same video as {other}")
    sharing: dict[str, list[Path]] = {}
    for path, row in rows.items():
        if row.plant_id:
            sharing.setdefault(folder_name(row.plant_id).casefold(), []).append(path)
    for paths in (paths for paths in sharing.values() if len(paths) > 1):
        ids = {path: rows[path].plant_id for path in paths}
        for path in paths:
            others = ", ".join(f"{other.name} ({ids[other]})" for other in paths if other != path)
            reason = f"reads {ids[path]}, which shares its folder with {others}; {_REMEDY}, or leave one video out"
            rows[path] = replace(rows[path], plant_id="", reason=reason)


def _place(path: Path, row: Row, asked: Import) -> Row:
    """Put a video of a known plant into the plant's folder."""
    if not row.plant_id:
        return row
    folder = asked.into / folder_name(row.plant_id)
    row = replace(row, folder=folder.name)
    taken = [other for other in asked.into.iterdir() if other.name.casefold() == folder.name.casefold()] if (
        asked.into.is_dir()
    ) else []  # fmt: skip
    if taken:
        return _compare_with(taken[0], path, row)
    if not asked.dry_run:
        with explain_disk_errors(asked.into):
            # The folder appears together with its video, or not at all.
            partial = asked.into / partial_name(folder.name)
            shutil.rmtree(partial, ignore_errors=True)
            partial.mkdir(parents=True)
            if folder.name != row.plant_id:
                keep_plant_id(Workspace(partial), row.plant_id)
            _take(path, partial / path.name, asked.how)
            partial.rename(folder)
            if asked.how == "move":
                path.unlink()
    return replace(row, state=IMPORTED)


def _compare_with(folder: Path, path: Path, row: Row) -> Row:
    """The row of a video whose folder already exists."""
    try:
        own = Workspace(folder).capture()
    except Cotton3dgError:
        own = None
    if own and own.is_file() and fingerprint(own) == fingerprint(path):
        return replace(row, state=THERE)
    reason = f"the folder {folder.name} is there with something else in it; films of another day belong into a field of"
    return replace(row, reason=f"{reason} their own")


def _take(path: Path, target: Path, how: str) -> None:
    """Copy with dates, or link; a move is a link, or a copy on another disk, and removes `path` at the end."""
    if how in ("link", "move"):
        try:
            os.link(path.resolve(), target)
            return
        except OSError as error:
            if how == "link":
                raise BadUsage(f"{path} cannot be linked ({error.strerror}); use --how copy") from error
    with replacing(target) as partial:
        copy(path, partial)


def _save(rows: Sequence[Row], into: Path) -> None:
    """Write `import.csv` with these rows and the rows of files from earlier imports."""
    table = into / TABLE
    own = {row.file for row in rows}
    before = []
    if table.is_file():
        before = [row for row in read_rows(table) if row.get("file") not in own]
    blank = dict.fromkeys((column.name for column in COLUMNS), "")
    with explain_disk_errors(into):
        into.mkdir(parents=True, exist_ok=True)
        write_text_atomically(table, csv_text(COLUMNS, [*(blank | row for row in before), *map(vars, rows)]))
