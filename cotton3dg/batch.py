# SPDX-License-Identifier: Apache-2.0
"""Many plants: each in a process of its own, so that a fault costs one plant, and one table of all of them.

The table is saved again after every plant. A batch that dies leaves its running plants to finish by themselves; the
next one waits for them, skips what is up to date and goes on.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Final

from .core.machine import confine, usable_cores
from .core.runs import State
from .errors import (
    HUNG_UP,
    INTERRUPTED,
    TERMINATED,
    BadUsage,
    Cotton3dgError,
    MissingInput,
    OutOfResources,
    StageFailed,
)
from .field.columns import book_cells, table_columns
from .field.genotypes import FIT_COLUMNS, MEANS_COLUMNS, Fit, Mean, Trial, compare_genotypes
from .field.tables import BATCH_COLUMNS, BOLL_TABLE, FITS_TABLE, KNOWN, MEANS_TABLE, TABLE
from .identity.names import folder_name
from .io.fieldbook import FIELD_BOOK, FieldBook, read_fieldbook
from .io.saving import printable, write_text_atomically
from .io.tables import BOLLS, TRAITS, csv_text, flags_of, joined, read_rows, refuse_other_table, value_of
from .plants import is_empty, may_be_plant, plants_in, refuse_plant, same_films
from .resource_checks import OUT_OF_MEMORY
from .stage import STAGES, stage_of
from .staleness import recorded_states
from .workspace import Workspace

RUN: Final = (sys.executable, "-m", "cotton3dg.cli", "run")

INDEX: Final = "index.html"
SAME_FILM: Final = "same_film"

MEMORY_OF_A_RUN_GIB: Final = 3.0
"""Memory of one plant with room to spare; it decides how many run side by side unless --jobs does."""

WORTH_RETRYING: Final = (StageFailed.exit_code, OutOfResources.exit_code)
"""A second try may help here, and after a signal that ended the process. A bad video stays a bad video."""

INTERRUPTING: Final = frozenset({INTERRUPTED, TERMINATED, HUNG_UP, -signal.SIGINT, -signal.SIGTERM, -signal.SIGHUP})
"""Exit codes of a run that ended from outside and not by a fault; negative: before it could clean up."""

STATES: Final = (State.FAILED, State.STALE, State.MISSING, State.WAITING, State.DONE)
"""States in the order of the tables: plants that need attention come first."""


@dataclass(frozen=True)
class Result:
    """The outcome for one plant."""

    folder: str
    state: State = State.WAITING
    exit_code: int | None = None
    reason: str = ""

    @property
    def worth_retrying(self) -> bool:
        return self.exit_code is not None and (self.exit_code < 0 or self.exit_code in WORTH_RETRYING)


def find_plants(folder: Path) -> list[Path]:
    """Folders of plants below `folder`, in order of name: those with a capture, and leaves that lack one.

    A leaf without video or images is a plant whose video was forgotten; leaving it out would hide that.

    Raises:
        MissingInput: `folder` is not a folder, or none below it has a capture or is an empty one that waits for it.
        BadUsage: `folder` is a plant itself.
    """
    if not folder.is_dir():
        raise MissingInput(f"{folder} is not a folder; give the folder that holds a folder a plant")
    plants = plants_in(folder)
    if any(map(may_be_plant, plants)):
        return plants
    refuse_plant(folder)
    if not plants:
        raise MissingInput(f"{folder} holds no folders; put each plant's video into a folder of its own below it")
    if not all(map(is_empty, plants)):
        raise MissingInput(f"no folder below {folder} has a video or images; put each plant's into a folder of its own")
    return plants


def require_named(plants: Sequence[Path], options: Mapping[str, Any]) -> None:
    """Refuse a batch that would fail on every plant alike, before it replaces tables.

    Args:
        options: of every stage, as all plants share them.
    Raises:
        MissingInput, BadInput: an option names a file that does not exist, not even beside a plant.
    """
    for stage in STAGES:
        found: list[Cotton3dgError] = []
        for plant in plants:
            try:
                stage_of(stage).require_named(Workspace(plant), options[stage])
                break
            except Cotton3dgError as error:
                found.append(error)
        else:
            raise found[0]


def default_jobs() -> int:
    """Plants to run side by side: one per core, as far as memory allows."""
    memory_gib = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return max(1, min(len(usable_cores()), int(memory_gib / MEMORY_OF_A_RUN_GIB)))


@dataclass
class Batch:
    """A batch at work; `results` and the tables are right at any time."""

    folder: Path
    arguments: Sequence[str] = ()
    """Further arguments of `cotton3dg run`."""
    jobs: int = 1
    retries: int = 0
    tell: Callable[[str], None] = print
    command: Sequence[str] = RUN
    index: bool = True
    """Whether to write the page of all plants beside the table."""
    results: dict[str, Result] = field(default_factory=dict)
    _tried: int = 0
    _tables: dict[tuple[str, str], list[dict[str, Any]]] = field(default_factory=dict)
    """Rows of finished plants, cached because the batch saves its tables again after each plant."""
    _processes: set[subprocess.Popen[str]] = field(default_factory=set)
    _same_film: dict[str, str] = field(default_factory=dict)
    """Folder of a plant -> another folder with the same film."""
    _saving: threading.Lock = field(default_factory=threading.Lock)
    _draining: threading.Event = field(default_factory=threading.Event)

    def run(self, plants: Sequence[Path]) -> list[Result]:
        """Run all plants; returns every result the batch knows, failures first.

        The first Ctrl-C lets the running plants finish and starts no others; the second interrupts them. A signal that
        ends the batch interrupts them at once.
        """
        if self.jobs < 1:
            raise BadUsage(f"--jobs {self.jobs}: at least 1")
        names = [plant.relative_to(self.folder).as_posix() for plant in plants]
        self.jobs = min(self.jobs, max(1, len(names)))  # each gets its share of cores and memory
        self.results |= {name: Result(name) for name in names}
        self.check_plants()
        self.save()
        slots: SimpleQueue[list[int]] = SimpleQueue()
        for slot in range(self.jobs):
            slots.put(usable_cores()[slot :: self.jobs] or usable_cores())
        began = time.monotonic()
        with ThreadPoolExecutor(self.jobs) as pool:
            futures = [pool.submit(self._one, name, slots, began, len(names)) for name in names]
            for interruption in (
                "no further plant is started, the running ones finish; Ctrl-C again interrupts them",
                "the running plants are interrupted; the same command continues",
            ):
                try:
                    wait(futures)
                    break
                except KeyboardInterrupt:
                    self.tell(interruption)
                    if self._draining.is_set():
                        self._interrupt(signal.SIGINT)
                    self._draining.set()
                except SystemExit:  # another signal, which comes only once
                    self._draining.set()
                    self._interrupt(signal.SIGTERM)
                    raise
            else:
                wait(futures)
        for future in futures:
            future.result()
        return self.ordered()

    def check_plants(self) -> None:
        """Look at the plants before anything is written: report which share a film, and flag these in the table.

        Raises:
            BadInput: a file of the user's has the name of one of the tables.
        """
        for name, columns in KNOWN.items():
            refuse_other_table(self.folder / name, columns)
        self._same_film = same_films(self.folder, sorted(self.results))
        for name, other in self._same_film.items():
            if other < name:
                self.tell(f"{name} has the same film as {other}; put each plant's own film into its folder")

    def ordered(self) -> list[Result]:
        """Results with failures first, then waiting plants, then finished ones; by folder."""
        return sorted(self.results.values(), key=lambda result: (STATES.index(result.state), result.folder))

    def _one(self, name: str, slots: SimpleQueue[list[int]], began: float, total: int) -> None:
        if self._draining.is_set():
            return
        slot = slots.get()
        try:
            for attempt in range(self.retries + 1):
                result = self._attempt(name, slot)
                if not result.worth_retrying or attempt == self.retries or self._draining.is_set():
                    break
                self.tell(f"{name}: {result.reason}; tried again")
        finally:
            slots.put(slot)
        with self._saving:
            self.results[name] = result
            self.save()
            self._tried += 1
            left_s = (time.monotonic() - began) / self._tried * (total - self._tried)
            self.tell(f"[{self._tried}/{total}] {name}: {self._outcome(result)}; about {_duration(left_s)} left")

    def _attempt(self, name: str, slot: list[int]) -> Result:
        # A session of its own keeps the terminal's Ctrl-C away from the process: this code decides whether it ends.
        process = subprocess.Popen(
            [*self.command, str((self.folder / name).absolute()), "--wait", *self.arguments],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,
        )
        self._processes.add(process)
        confine(process.pid, slot, self.jobs)
        try:
            _, output = process.communicate()
        finally:
            self._processes.discard(process)
        return result_of(name, process.returncode, output)

    def _interrupt(self, number: int) -> None:
        for process in list(self._processes):
            process.send_signal(number)

    def _outcome(self, result: Result) -> str:
        if result.state != State.DONE:
            return f"{result.state}: {result.reason}"
        row = self._rows(result, "traits_csv")[0]
        bolls = f"{row['boll_count'] or 'no'} bolls in {_duration(float(row['seconds']))}"
        return ", ".join([bolls, *flags_of(row)])

    @cached_property
    def book(self) -> FieldBook | None:
        """The field's book; None without one.

        Raises:
            BadInput: it cannot be read.
        """
        path = self.folder / FIELD_BOOK
        return read_fieldbook(path) if path.is_file() else None

    @cached_property
    def _id_of_folder(self) -> dict[str, str]:
        """Name of a folder -> id in the field book, for plants without a table."""
        return {folder_name(plant_id): plant_id for plant_id in self.book.rows} if self.book else {}

    def save(self) -> None:
        """Write the tables and the page of all plants; once all are done, genotypes compared."""
        ordered = self.ordered()
        blank = dict.fromkeys((column.name for column in TRAITS), "")
        added = table_columns(self.book, [column.name for column in BATCH_COLUMNS])
        rows = []
        for result in ordered:
            row = vars(result) | (self._rows(result, "traits_csv") or [blank])[0]
            if result.folder in self._same_film:
                row["qc_flags"] = joined([*flags_of(row), SAME_FILM])
            plant_id = row["plant_id"] or self._id_of_folder.get(Path(result.folder).name, "")
            rows.append(row | book_cells(self.book, plant_id, added))
        bolls_added = table_columns(self.book, [column.name for column in BOLLS])
        bolls = [
            row | book_cells(self.book, row["plant_id"] or "", bolls_added)
            for result in ordered
            for row in self._rows(result, "bolls_csv")
        ]
        write_text_atomically(self.folder / TABLE, csv_text([*BATCH_COLUMNS, *added.values()], rows))
        write_text_atomically(self.folder / BOLL_TABLE, csv_text([*BOLLS, *bolls_added.values()], bolls))
        means: list[Mean] = []
        fits: list[Fit] = []
        if self.book and all(result.state != State.WAITING for result in ordered):
            means, fits = compare_genotypes(rows, [column.name for column in added.values()])
            for name, columns, found in ((MEANS_TABLE, MEANS_COLUMNS, means), (FITS_TABLE, FIT_COLUMNS, fits)):
                if found:
                    write_text_atomically(self.folder / name, csv_text(columns, map(vars, found)))
        if self.index:
            there = {row["plant_id"] for row in rows} | {
                self._id_of_folder.get(Path(name).name) for name in self.results
            }
            unfilmed = {k: cells for k, cells in self.book.rows.items() if k not in there} if self.book else {}
            self._save_index(rows, Trial(tuple(column.name for column in added.values()), means, fits, unfilmed))

    def _save_index(self, rows: list[dict[str, Any]], trial: Trial) -> None:
        """Save the page of all plants; an error there is only reported, because the tables do not need the page."""
        try:
            from .report.index import index_page
            from .report.page import write_page

            text = index_page(self.folder.resolve().name, self.folder, rows, trial)
            write_page(self.folder / INDEX, text)
        except Exception as error:
            self.tell(f"{INDEX} could not be made ({type(error).__name__}: {error}); the tables are not affected")

    def _rows(self, result: Result, table: str) -> list[dict[str, Any]]:
        """Rows of a plant's table; none unless it is done: older rows belong to another video or other options."""
        if result.state != State.DONE:
            return []
        key = result.folder, table
        if key not in self._tables:
            path: Path = getattr(Workspace(self.folder / result.folder), table)
            columns = TRAITS if table == "traits_csv" else BOLLS
            self._tables[key] = [
                {column.name: value_of(row.get(column.name, ""), column) for column in columns}
                for row in (read_rows(path) if path.is_file() else [])
            ]
        return self._tables[key]


def save_tables(folder: Path) -> None:
    """Save the tables and the page of a field as its plants are now, without a run. A plant without a result keeps the
    failure that the last batch recorded."""
    work, saved = Batch(folder), saved_results(folder) if (folder / TABLE).is_file() else {}
    for plant in plants_in(folder):
        name = plant.relative_to(folder).as_posix()
        try:
            due = next((item for item in recorded_states(Workspace(plant)) if not item.done), None)
        except Cotton3dgError as error:
            work.results[name] = Result(name, State.FAILED, error.exit_code, str(error))
            continue
        if due is None:
            work.results[name] = Result(name, State.DONE, 0)
        elif due.state == State.FAILED:
            work.results[name] = Result(name, State.FAILED, due.record.exit_code if due.record else None, due.reason)
        elif name not in saved or saved[name].state == State.DONE:
            work.results[name] = Result(name, State.WAITING, None, f"{due.stage}: {due.reason}")
        else:
            work.results[name] = saved[name]
    work.check_plants()
    work.save()


def saved_results(folder: Path) -> dict[str, Result]:
    """The result of each folder in the saved table.

    Raises:
        MissingInput: the table does not exist.
    """
    if not (folder / TABLE).is_file():
        raise MissingInput(f"{TABLE} is missing; run the whole batch first")
    results = [
        Result(row["folder"], State(row["state"]), int(row["exit_code"]) if row["exit_code"] else None, row["reason"])
        for row in read_rows(folder / TABLE)
    ]
    return {result.folder: result for result in results if (folder / result.folder).is_dir()}


def result_of(name: str, code: int, output: str) -> Result:
    """The result of a plant whose run has ended.

    Args:
        name: the plant's folder, relative to the batch's.
        code: exit code; negative: the signal that ended the run.
        output: the run's output.
    """
    if code == 0:
        return Result(name, State.DONE, 0)
    if code in INTERRUPTING:
        return Result(name, State.WAITING, None, "interrupted")
    return Result(name, State.FAILED, code, _reason(Path(name).name, code, output))


def _reason(name: str, code: int, output: str) -> str:
    """The last line that a failed run printed, without its plant's name; or the signal that ended it."""
    if OUT_OF_MEMORY.search(output):  # also if a library ended the process by itself
        return "ran out of memory; use fewer --jobs, --preset draft or a machine with more memory"
    if code < 0:
        cause = " (out of memory?); use fewer --jobs" if code == -signal.SIGKILL else ""
        return f"ended by signal {-code}{cause}"
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    printed = " ".join(printable(name).split())  # on one line, for any name of the folder
    return lines[-1].removeprefix(f"{printed}: ") if lines else "no reason was given; see its run.log"


def _duration(seconds: float) -> str:
    minutes = round(seconds / 60)
    return f"{seconds:.0f} s" if minutes < 2 else f"{minutes} min" if minutes < 120 else f"{minutes / 60:.1f} h"
