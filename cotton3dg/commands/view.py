# SPDX-License-Identifier: Apache-2.0
"""Pages of a plant or a field in the browser of this machine: corrections apply at once, films are added and measured.

Files stay the truth. A correction is what `correct` does with the file that the report saves from disk, and leaves the
same bytes. Checks and measurements are the commands `check` and `run`, one at a time, in processes of their own.
`io/local_server.py` says why the server is the standard library's, and who may ask it.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import sys
import tempfile
import threading
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from ..choices import choose
from ..errors import BadInput, BadUsage, Cotton3dgError, unknown
from ..field.tables import TABLE
from ..identity.names import folder_name, id_problem
from ..io.command_queue import DONE_WITH, CommandQueue
from ..io.local_server import HTML, Answer, LocalServer, Refused, Request, as_json
from ..io.saving import explain_disk_errors, full_disk, replacing
from ..io.tables import parse_number, read_rows
from ..options import PRESETS
from ..plants import has_results, is_plant, keep_plant_id, plants_in, refuse_plant
from ..report.live import describe, opened, view_page
from ..report.page import is_stale, make_report
from ..schemas.record import Choices
from ..workspace import VIDEO_SUFFIXES, Workspace
from .correct import Asked, correct, kept_texts
from .export import export

CSV: Final = "text/csv; charset=utf-8"
OF_PLANT: Final = {
    "report.html": HTML,
    "check/check.html": HTML,
    "traits/traits.csv": CSV,
    "traits/bolls.csv": CSV,
    "traits/branches.csv": CSV,
}
OF_FIELD: Final = {
    "index.html": HTML,
    TABLE: CSV,
    "batch_bolls.csv": CSV,
    "genotypes.csv": CSV,
    "heritability.csv": CSV,
}
"""The files that are shown, of a plant and of a field; there is no way to any other."""
CORRECTIONS: Final = "corrections"
UNDO: Final = "undo"
STOP: Final = "stop"
TABLES: Final = "tables"
WORKBOOK: Final = "workbook.xlsx"
XLSX: Final = "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet"
SIDES: Final = ("table_length_cm", "table_width_cm")
"""Options of `scale` that the page asks for."""
MOST_BYTES: Final = 2**20
MOST_FILM_BYTES: Final = 2**35
"""The largest content of a request, and the largest film."""


def view(
    folder: Path,
    save_tables: Callable[[Path], None],
    tell: Callable[[str], None],
    *,
    port: int = 0,
    browser: bool = True,
) -> None:
    """Serve the pages of a plant or a field until Ctrl-C; a save that has begun is finished first.

    Args:
        save_tables: saves the tables of a field anew. port: 0 = any that is free. browser: open it.
    Raises:
        MissingInput: the folder does not exist. BadUsage: the port cannot be had.
    """
    desk = Desk(folder, save_tables)
    with LocalServer(port, desk.answer, desk.most_bytes) as server:
        tell(f"{server.address}\nonly this computer reaches it, and only with this address; Ctrl-C ends it")
        if browser and not (_has_screen() and webbrowser.open(server.address)):
            tell("no browser opens here; open the address in one")
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            tell("ended; all changes are saved in the plants' folders")
        finally:
            desk.close()


def _has_screen() -> bool:
    """Whether a browser can have a window; without one Linux would open one in this terminal."""
    return sys.platform != "linux" or bool({"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys())


class Desk:
    """The answers for one folder: of a plant, or of a field with plants below it. An empty folder is a new field."""

    def __init__(self, given: Path, save_tables: Callable[[Path], None]):
        self.root = Workspace(given).root.resolve()
        self.is_field = not _is_plant(self.root)
        self._save_tables = save_tables
        self._messages: dict[Path, str] = {}
        """Folder of a plant -> the outcome of its last correction, until a page has shown it."""
        self._saving = threading.Lock()
        """One change at a time: the log of a run is the whole program's."""
        self._taking = threading.Lock()
        """One film at a time, so that two never get one name."""
        self._jobs = CommandQueue()

    def close(self) -> None:
        """End the work that goes on; a correction ends by itself."""
        self._jobs.close()
        with self._saving:
            pass

    def most_bytes(self, parts: tuple[str, ...]) -> int:
        return MOST_FILM_BYTES if _is_film(parts[-1:]) else MOST_BYTES

    def answer(self, request: Request) -> Answer:
        """The answer to a request.

        Raises:
            Refused: there is no such page. Cotton3dgError: what is asked for cannot be done.
        """
        return self._change(request) if request.posts else self._show(request.parts)

    # ------------------------------------------------------------------ to look at
    def plants(self) -> dict[str, Workspace]:
        """The plants by the names of their folders; one that a link leads out of the folder is left out."""
        if not self.is_field:
            return {self.root.name: Workspace(self.root)}
        found = {}
        for folder in plants_in(self.root):
            with suppress(Cotton3dgError):  # a name that no program can write; `batch` explains it
                if folder.resolve().is_relative_to(self.root):
                    found[folder.relative_to(self.root).as_posix()] = Workspace(folder)
        return found

    def _show(self, parts: tuple[str, ...]) -> Answer:
        name = "/".join(parts)
        if not parts:
            return _page(view_page(self.root.name, is_field=self.is_field, usual=self._usual()), 0)
        if name == "state":
            return as_json(self._state())
        if self.is_field and name in OF_FIELD:
            self._renew_tables()
            return self._file(self.root, name, OF_FIELD[name], len(parts))
        if self.is_field and name == WORKBOOK:
            return self._workbook()
        workspace, rest = self._find(parts)
        if rest == CORRECTIONS:
            return as_json({"kept": kept_texts(workspace), "message": self._messages.pop(workspace.root, "")})
        if rest == "report.html":
            self._renew(workspace)
        if rest in OF_PLANT:
            return self._file(workspace.root, rest, OF_PLANT[rest], len(parts))
        raise Refused(HTTPStatus.NOT_FOUND, "there is no such page")

    def _find(self, parts: tuple[str, ...]) -> tuple[Workspace, str]:
        """The plant that a path begins with, and the rest of the path."""
        plants = self.plants()
        for n in range(1, len(parts)):
            if workspace := plants.get("/".join(parts[:n])):
                return workspace, "/".join(parts[n:])
        raise Refused(HTTPStatus.NOT_FOUND, "there is no such page")

    def _file(self, folder: Path, name: str, kind: str, depth: int) -> Answer:
        path = folder / name
        if not path.resolve().is_relative_to(self.root):
            raise Refused(HTTPStatus.FORBIDDEN, f"{name} is a link that leads out of the folder")
        try:
            content = path.read_bytes()
        except OSError as error:
            raise Refused(HTTPStatus.NOT_FOUND, f"{name} cannot be read ({error.strerror})") from error
        if kind == HTML:
            return _page(content, depth)
        label = path.name if folder == self.root and self.is_field else f"{folder_name(folder.name)}_{path.name}"
        return _download(content, kind, label)

    def _workbook(self) -> Answer:
        """The tables of the field as an Excel file."""
        with tempfile.TemporaryDirectory() as folder:
            export(self.root, "xlsx", Path(folder) / "export")
            (file,) = Path(folder).glob("export/*.xlsx")
            return _download(file.read_bytes(), XLSX, file.name)

    def _state(self) -> dict[str, Any]:
        plants = []
        for name, workspace in self.plants().items():
            pages = [page for page in OF_PLANT if (workspace.root / page).is_file()]
            job = {"busy": name in self._jobs.asked, "job": self._jobs.text(name)}
            shown = "/".join([*name.split("/")[:-1], _id_of(workspace)])
            plants.append({"plant": name, "shown": shown, "pages": pages} | job | describe(workspace))
        return {"plants": plants, "pages": [page for page in OF_FIELD if (self.root / page).is_file()]}

    def _renew_tables(self) -> None:
        """Save the tables of the field anew if a plant was measured or corrected since."""
        table = self.root / TABLE
        if not table.is_file() or table.is_symlink():
            return
        rows = [plant.traits_csv for plant in self.plants().values() if plant.traits_csv.is_file()]
        if any(row.stat().st_mtime_ns > table.stat().st_mtime_ns for row in rows):
            with self._saving, suppress(Cotton3dgError):
                self._save_tables(self.root)

    def _usual(self) -> dict[str, str]:
        """What the page's form would say of the plant that was measured or checked last; empty if there is none."""
        if not self.is_field:
            return {}
        written = {
            workspace.choices_json.stat().st_mtime_ns: workspace
            for workspace in self.plants().values()
            if workspace.choices_json.is_file()
        }
        if not written:
            return {}
        with suppress(Cotton3dgError):
            kept = Choices.load(written[max(written)].choices_json)
            sides = kept.values.get("scale", {})
            return {"preset": kept.preset} | {side: f"{sides[side]:g}" for side in SIDES if side in sides}
        return {}

    def _renew(self, workspace: Workspace) -> None:
        """Make the report anew if it lacks something; while a run goes on, or where it cannot be, it stays as it is."""
        with self._saving, suppress(Cotton3dgError), workspace.locked():
            if has_results(workspace) and is_stale(workspace):
                make_report(workspace)

    # ------------------------------------------------------------------ to change
    def _change(self, request: Request) -> Answer:
        if len(request.parts) == 2 and _is_film(request.parts):
            return as_json({"plant": self._take_film(request)})
        if self.is_field and request.parts == (TABLES,):
            with self._saving:
                self._save_tables(self.root)
            return as_json({})
        workspace, what = self._find(request.parts)
        plant = "/".join(request.parts[:-1])
        if what in DONE_WITH:
            form = _read_form(request.read())
            if not workspace.choices_json.is_file():  # a new plant is measured as the one before it
                usual = self._usual()
                form = {name: value or usual.get(name, "") for name, value in form.items()}
            self._jobs.add(plant, [what, str(workspace.root), *_arguments(form)])
            return as_json({})
        if what == STOP:
            self._jobs.stop(plant)
            return as_json({})
        if what == CORRECTIONS:
            with _as_file(request.read()) as file:
                return self._correct(workspace, Asked(file=file))
        if what == UNDO:
            return self._correct(workspace, Asked(undo=True))
        raise Refused(HTTPStatus.NOT_FOUND, "there is no such page")

    def _correct(self, workspace: Workspace, asked: Asked) -> Answer:
        with self._saving:
            try:
                outcome = correct(workspace, asked)
            except Cotton3dgError as error:
                self._messages[workspace.root] = f"Not done: {error}"
                raise
            self._messages[workspace.root] = "; ".join([outcome.change.capitalize(), *outcome.refused])
            return as_json({"message": self._messages[workspace.root]})

    def _take_film(self, request: Request) -> str:
        """Save a film in a new plant's folder, whose name it returns.

        Raises:
            BadUsage: the name cannot be one, or the plant has a film. OutOfResources: the disk is too small.
        """
        plant, file = request.parts
        if not self.is_field:
            raise BadUsage("this folder is one plant; open the folder above it to add others")
        if problem := id_problem(plant):
            raise BadUsage(f"{problem}; give the plant another name")
        folder = self.root / folder_name(plant)
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            raise BadInput(f"{folder.name} is not a folder of this field; give the plant another name")
        with self._taking:
            if folder.exists() and is_plant(Workspace(folder)):
                raise BadUsage(f"{folder.name} has a film already; give the plant another name")
            with explain_disk_errors(self.root):
                if shutil.disk_usage(self.root).free < request.left:
                    raise full_disk(self.root)
                folder.mkdir(exist_ok=True)
                if folder.name != plant:
                    keep_plant_id(Workspace(folder), plant)
                film = Path(file)
                with replacing(folder / f"{folder_name(film.stem)}{film.suffix}") as partial, partial.open("wb") as out:
                    for chunk in request.chunks():
                        out.write(chunk)
        return folder.name


def _id_of(workspace: Workspace) -> str:
    """The plant's id: as its row has it, or as the next run will name it."""
    with suppress(Cotton3dgError, LookupError):
        return read_rows(workspace.traits_csv)[0]["plant_id"]
    with suppress(Cotton3dgError):
        return str(choose(workspace).options["traits"].plant_id) or workspace.plant_id
    return workspace.plant_id


def _page(content: bytes, depth: int) -> Answer:
    page, policy = opened(content, depth)
    return Answer(page, HTML, headers={"Content-Security-Policy": policy})


def _download(content: bytes, kind: str, name: str) -> Answer:
    return Answer(content, kind, headers={"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name)}"})


def _read_form(said: bytes) -> dict[str, str]:
    """What the page's form says of preset and table; blank = as before.

    Raises:
        BadUsage: the content is not that of this version's form.
    """
    try:
        form = json.loads(said)
        return {name: str(form.get(name, "")) for name in ("preset", *SIDES)}
    except (ValueError, AttributeError) as error:
        raise BadUsage("this is not what the page's form says; load the page again") from error


def _arguments(form: Mapping[str, str]) -> list[str]:
    """Arguments of a command for what the page's form says; what it leaves blank stays as the plant has it.

    Raises:
        BadUsage: the form has an unknown preset, or a length that is not a positive number.
    """
    words = []
    if preset := form["preset"]:
        if preset not in PRESETS:
            raise unknown(f"preset {preset!r}", preset, PRESETS)
        words += ["--preset", preset]
    for side in SIDES:
        if value := form[side]:
            length_cm = parse_number(value.replace(",", "."))
            if not 0 < length_cm < math.inf:
                raise BadUsage(f"{value!r} is not a length of a table; write its centimetres as a number, like 120")
            words += ["--set", f"scale.{side}={length_cm:g}"]
    return words


@contextmanager
def _as_file(content: bytes) -> Iterator[Path]:
    """A file with the corrections that a page sends, as the same page saves it from disk."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "corrections.json"
        file.write_bytes(content)
        yield file


def _is_film(parts: tuple[str, ...]) -> bool:
    """Whether a path ends in the name of a film."""
    return bool(parts) and Path(parts[-1]).suffix.lower() in VIDEO_SUFFIXES


def _is_plant(folder: Path) -> bool:
    try:
        refuse_plant(folder)
    except BadUsage:
        return True
    return False
