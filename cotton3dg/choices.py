# SPDX-License-Identifier: Apache-2.0
"""Where the options of a plant come from, and which choices are kept.

Order of precedence: command line > plant's `cotton3dg.toml` > those of the folders above, nearest first > options of
the plant's last run > preset > default. `--preset`, `--reset` and `--time-budget` begin anew: they ignore the last
run.
"""

from __future__ import annotations

import os
import stat
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from .errors import BadInput, BadUsage, MissingInput, unknown
from .option_rules import Place, counting, differences
from .options import (
    PRESET_VALUES,
    STAGE_OPTIONS,
    STANDARD,
    check_preset,
    origins,
    resolve,
)
from .plants import plant_at
from .recorded_options import is_former_default, recorded
from .schemas.record import Choices
from .stage import STAGES
from .staleness import changed_options
from .text import read_text
from .workspace import Workspace

Values = Mapping[str, Mapping[str, Any]]
"""Stage -> option -> value."""

OPTIONS_FILE: Final = "cotton3dg.toml"
COMMAND_LINE: Final = "command line"
LAST_RUN: Final = "last run"
BUDGET: Final = "--time-budget"


@dataclass(frozen=True)
class Asked:
    """The options that a command line gives, or a call from Python."""

    preset: str | None = None
    reset: bool = False
    values: Values = field(default_factory=dict)
    budgeted: Values = field(default_factory=dict)
    """Values that a time budget chooses; files and `values` win."""
    by: str = COMMAND_LINE
    """Who asks."""

    @property
    def anew(self) -> str:
        """The option that makes a command ignore the last run; empty if it does not."""
        return f"--preset {self.preset}" if self.preset else BUDGET if self.budgeted else "--reset" * self.reset

    @property
    def arguments(self) -> list[str]:
        """Arguments of `cotton3dg run` that ask for the same preset and values."""
        given = [f"{name}={value}" for stage, own in self.values.items() for name, value in _named(stage, own)]
        words = [word for each in given for word in ("--set", each)]
        return [*words, *(["--preset", self.preset] if self.preset else []), *["--reset"] * self.reset]


@dataclass(frozen=True)
class Layer:
    """Values from one origin."""

    name: str
    values: Values
    preset: str = ""
    """The preset that a file names."""

    def of(self, stage: str) -> Mapping[str, Any]:
        return self.values.get(stage, {})


@dataclass(frozen=True)
class Base:
    """The preset on which the last run's choices build, and the files that win over them."""

    plant: Workspace | None
    files: tuple[Layer, ...]
    """Layers of the files, the nearest last."""
    preset: str
    preset_from: str = LAST_RUN

    @property
    def usual(self) -> tuple[Layer, ...]:
        """The layers that hold without any further values. A renamed folder makes the tables stale."""
        named = {"traits": {"plant_id": self.plant.plant_id}} if self.plant else {}
        return Layer("the folder's name", named), Layer("", PRESET_VALUES[self.preset])

    @cached_property
    def options(self) -> dict[str, Any]:
        return _resolved((*self.usual, *self.files))

    def choices(self, made: Mapping[str, Any]) -> Choices:
        """The choices to keep so that `made`, options of stages, result again."""
        of_file = self.preset_from in (layer.name for layer in self.files)
        values = {stage: differences(options, self.options[stage]) for stage, options in made.items()}
        named = "" if of_file or self.preset == STANDARD else self.preset
        return Choices(named, {stage: own for stage, own in values.items() if own})


@dataclass(frozen=True)
class Chosen:
    """The options of a plant's stages, and where each comes from."""

    base: Base
    upper: tuple[Layer, ...]
    """Layers that win over the preset; that of the command line is the last."""
    options: dict[str, Any]
    """Options of every stage."""
    anew: str = ""
    """As `Asked.anew`."""

    def to_keep(self, stages: Iterable[str]) -> Choices:
        """The choices that a run of `stages` keeps for the next one. Other stages keep theirs if they have ever run."""
        plant = self.base.plant
        others = _made(plant, set(STAGES) - set(stages)) if plant and self.anew else {}
        return self.base.choices(self.options | others)

    def summary(self) -> str:
        """The preset and each option that differs from it, with their origins; empty if everything is usual."""
        found = [] if self.base.preset == STANDARD else [f"preset {self.base.preset} ({self.base.preset_from})"]
        for stage, place, value in self._differing(self.base):
            found.append(f"{stage}.{place.name} {_shown(value)} ({self._origin(stage, place)})")
        return ", ".join(found)

    def changes(self, stages: Iterable[str]) -> str:
        """Each option that differs from the one behind the results of `stages`, and what changes it; may be empty."""
        found: dict[str, list[str]] = {}
        for stage in stages:
            record = self.base.plant.read_record(stage) if self.base.plant else None
            if not record:
                continue
            changed = changed_options(record, self.options[stage])
            for place in counting(self.options[stage]):
                before, now = changed.get(place.name, (None, None))
                left = is_former_default(stage, record.stage_version, place.name, before) and not now
                if place.name in changed and not left:
                    before, now = _shown(before), _shown(now)
                    cause = self._origin(stage, place) or self.anew or self._usual_origin()
                    found.setdefault(cause, []).append(f"{stage}.{place.name} {before} -> {now}")
        return ", ".join(f"{', '.join(changed)} ({cause})" for cause, changed in found.items())

    def by_stage(self) -> dict[str, dict[str, Any]]:
        """Stage -> option that is not its default -> value."""
        found: dict[str, dict[str, Any]] = {stage: {} for stage in STAGES}
        for stage, place, value in self._differing(replace(self.base, preset=STANDARD)):
            found[stage][place.name] = value
        return found

    def _differing(self, base: Base) -> Iterator[tuple[str, Place, Any]]:
        """Options in effect that differ from their values without files and choices."""
        usual = _resolved(base.usual)
        for stage, options in self.options.items():
            differs = differences(options, usual[stage])
            yield from ((stage, place, differs[place.path]) for place in counting(options) if place.path in differs)

    def _origin(self, stage: str, place: Place) -> str:
        """The origin of a value; empty if it is the preset's or a default."""
        layers = (*self.base.usual, *self.upper)
        number = origins(stage, *(layer.of(stage) for layer in layers)).get(place.path)
        return "" if number is None else layers[number].name

    def _usual_origin(self) -> str:
        return "default" if self.base.preset == STANDARD else f"preset {self.base.preset}, {self.base.preset_from}"


def choose(plant: Workspace | None, asked: Asked | None = None, folder: Path | None = None) -> Chosen:
    """Options of a plant or, without one, of the plants in a folder that set none themselves.

    Raises:
        BadUsage: an option or a preset does not exist, or an option does not accept a value.
    """
    asked = asked or Asked()
    folder = plant.root if plant else folder
    files = _read_files(folder) if folder else ()
    last = last_choices(plant, files) if plant and not asked.anew else Choices()
    named = [(asked.preset, asked.by), *_presets(files), (last.preset, LAST_RUN)]
    preset, preset_from = next(((preset, by) for preset, by in named if preset), (STANDARD, "default"))
    check_preset(preset)
    base = Base(plant, files, preset, preset_from)
    lower, typed = (
        (Layer(LAST_RUN, last.values), Layer(BUDGET, asked.budgeted), *files),
        Layer(asked.by, asked.values),
    )
    return Chosen(base, (*lower, typed), _resolved((*base.usual, *lower), typed), asked.anew)


def plant_and_options(given: Path, asked: Asked | None = None, *, make: bool = False) -> tuple[Workspace, Chosen]:
    """The plant at a folder or film, and its options; these are refused before a film gets a folder.

    Args:
        make: make a folder for a film that has none yet.
    Raises:
        Cotton3dgError: there is no plant (`plant_at`), or an option is refused (`choose`).
    """
    try:
        workspace = plant_at(given)
    except MissingInput:
        choose(None, asked, given.with_suffix("") if given.is_file() else given)
        if not (make and given.is_file()):
            raise
        workspace = plant_at(given, make=True)
    return workspace, choose(workspace, asked)


def last_choices(plant: Workspace, files: tuple[Layer, ...]) -> Choices:
    """The choices of the plant's last run that files do not give."""
    kept = _kept(plant)
    if kept is None:  # by an earlier version
        kept = _recognised(_made(plant, STAGES), plant, files)
    return Choices(kept.preset, {stage: own for stage, own in kept.values.items() if _is_known(stage, own)})


def choices_of(plant: Workspace, options: Mapping[str, Any], stages: Iterable[str]) -> Choices:
    """The choices that a program that runs `stages` with these options keeps for the next run."""
    bare = choose(plant)
    if all(options[stage] == bare.options[stage] for stage in stages):
        return bare.to_keep(stages)
    made = bare.options | dict(options) | _made(plant, set(STAGES) - set(stages))
    return _recognised(made, plant, _read_files(plant.root))


def option_files(folder: Path) -> list[Path]:
    """The files with options for a folder: in it and in the folders above, the farthest first.

    The search ends at the user's home, and below folders like /tmp, where anybody may leave a file.
    """
    own, home = _absolute(folder), Path(os.path.expanduser("~"))  # noqa: PTH111 - fails where there is no home
    found: list[Path] = []
    for place in (own, *own.parents):
        if place != own and _is_everybodys(place):
            break
        found.insert(0, place / OPTIONS_FILE)
        if place == home:
            break
    return found


def _named(prefix: str, values: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Each value with its name as `--set` has it: those of a method stand in a table of their own."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _named(f"{prefix}.{name}", value)
        else:
            yield f"{prefix}.{name}", value


def _absolute(folder: Path) -> Path:
    return Path(os.path.abspath(folder))  # noqa: PTH100 - a link to a plant lies where it is, as its user sees it


def _is_everybodys(folder: Path) -> bool:
    try:
        return bool(folder.stat().st_mode & stat.S_ISVTX)
    except OSError:
        return False


def _read_files(folder: Path) -> tuple[Layer, ...]:
    own = _absolute(folder)
    layers = []
    for path in option_files(folder):
        above = path.parent.name or path.parent.as_posix()
        try:
            found = read_toml(path)
        except BadUsage as error:
            raise (error if path.parent == own else BadUsage(f"{above}/{error}")) from error
        name = OPTIONS_FILE if path.parent == own else f"{OPTIONS_FILE} of {above}"
        layers.append(Layer(name, {stage: found.get(stage, {}) for stage in STAGES}, found.get("preset", "")))
    return tuple(layer for layer in layers if layer.preset or any(layer.values.values()))


def read_toml(path: Path) -> dict[str, Any]:
    """Read `cotton3dg.toml`: one table per stage, and perhaps a `preset`. A missing file counts as an empty one.

    Raises:
        BadUsage: the file cannot be parsed or does not consist of tables.
    """
    if not path.exists():
        return {}
    try:
        tables = tomllib.loads(read_text(path, BadUsage))
    except (tomllib.TOMLDecodeError, OSError) as error:
        raise BadUsage(f"{path.name}: {error}; fix or remove the file") from error
    check_preset(tables.get("preset", STANDARD))
    for name, table in tables.items():
        if name == "preset":
            continue
        if name not in STAGE_OPTIONS:
            raise unknown(f"{path.name}: stage [{name}]", name, STAGE_OPTIONS)
        if not isinstance(table, dict):
            raise BadUsage(f"{path.name}: {name} is not a table; write its options below [{name}]")
    return tables


def _presets(files: Iterable[Layer]) -> list[tuple[str, str]]:
    """The presets that files name, and the files; the nearest first."""
    return [(layer.preset, layer.name) for layer in files if layer.preset][::-1]


def _resolved(layers: Iterable[Layer], asked: Layer | None = None) -> dict[str, Any]:
    """Options of every stage; a refusal names the file whose values it refuses."""
    layers, last = tuple(layers), asked or Layer(COMMAND_LINE, {})
    try:
        return {stage: resolve(stage, *(layer.of(stage) for layer in layers), asked=last.of(stage)) for stage in STAGES}
    except BadUsage as error:
        below, top = (layers, last) if asked else (layers[:-1], layers[-1])
        try:
            _resolved(below)
        except BadUsage as found:
            if str(found).endswith(str(error)):
                raise found from error
        if top.name.startswith(OPTIONS_FILE):
            raise BadUsage(f"{top.name}: {error}") from error
        raise


def _kept(plant: Workspace) -> Choices | None:
    """The choices that the last run kept; None if the file is missing or damaged."""
    try:
        kept = Choices.load(plant.choices_json)
        check_preset(kept.preset or STANDARD)
    except (BadInput, BadUsage):
        return None
    return kept


def _made(plant: Workspace, stages: Iterable[str]) -> dict[str, Any]:
    """The options of each stage's last run, for stages that have run."""
    kept = _kept(plant) or Choices()
    # The name in the record may be that of the folder, which may have been renamed since.
    named = {"plant_id": kept.values.get("traits", {}).get("plant_id", plant.plant_id)}
    found: dict[str, Any] = {}
    for stage in stages:
        record = plant.read_record(stage)
        try:
            if record and record.options:
                values = record.options | (named if stage == "traits" else {})
                found[stage] = recorded(stage, values, record.stage_version)
        except BadUsage:
            continue  # the record is from another version
    return found


def _recognised(made: Mapping[str, Any], plant: Workspace, files: tuple[Layer, ...]) -> Choices:
    """`made`, options of stages, as a preset and the values that differ from it.

    The preset is that of a file or else, among the presets with all their values in `made`, the one that sets most.
    """
    if named := _presets(files):
        return Base(plant, files, *named[0]).choices(made)
    best, most_set = Base(plant, files, STANDARD), 0
    usual = best.options
    for preset, values in PRESET_VALUES.items():
        base = Base(plant, files, preset)
        preset_values = {stage: differences(base.options[stage], usual[stage]).keys() for stage in values}
        holds = values.keys() <= made.keys() and all(
            own.isdisjoint(differences(made[stage], base.options[stage])) for stage, own in preset_values.items()
        )
        if holds and sum(map(len, preset_values.values())) > most_set:
            best, most_set = base, sum(map(len, preset_values.values()))
    return best.choices(made)


def _is_known(stage: str, values: Mapping[str, Any]) -> bool:
    """Whether this version accepts values that another version may have kept."""
    try:
        return stage in STAGES and bool(resolve(stage, values))
    except BadUsage:
        return False


def _shown(value: Any) -> str:
    """A value as a user writes it: 120 for 120.0, true, and `none` for an empty text."""
    return str(value).lower() if isinstance(value, bool) else str(value).removesuffix(".0") or "none"
