# SPDX-License-Identifier: Apache-2.0
"""The declaration of an option and its consequences: its flag, its bounds, and the methods with which it counts.

A stage with several methods has a table of options for each method that needs some. The stage's first option chooses
the method.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, is_dataclass, replace
from functools import cache
from typing import Any, Final, get_type_hints

from .errors import BadUsage, unknown

_KINDS: Final = {int: "a whole number", float: "a number", bool: "true or false", str: "text"}


@dataclass(frozen=True)
class Retired:
    """A method that is gone."""

    successor: str
    """The method that replaces it."""
    options: tuple[str, ...] = ()
    """The names of the flags that only it had."""


def option(
    default: Any,
    help: str,
    *,
    unit: str = "",
    paper: str = "",
    at_least: float | None = None,
    at_most: float | None = None,
    choices: tuple[str, ...] = (),
    idle_with: tuple[str, ...] = (),
    retired: Mapping[str, Retired] | None = None,
    permits: bool = False,
) -> Any:
    """A dataclass field with what `--help` says about it and what values it accepts.

    Args:
        idle_with: methods of the stage with which it has no effect.
        retired: former choices, with what replaces each; the error for one that is still given says it.
        permits: it permits what could do harm and changes no result, so that only the person at the keyboard gives it:
            no file does, no record keeps it.
    """
    return field(
        default=default,
        metadata={
            "help": help,
            "unit": unit,
            "paper": paper,
            "at_least": at_least,
            "at_most": at_most,
            "choices": choices,
            "idle_with": idle_with,
            "retired": retired or {},
            "permits": permits,
        },
    )


def options_of(kind: type, *methods: str) -> Any:
    """A dataclass field for the options of a method, or of several.

    Args:
        methods: the first is the name of the table.
    """
    return field(default=kind(), metadata={"methods": methods})


@dataclass(frozen=True)
class Place:
    """The place of an option in the options of a stage or command."""

    item: Field[Any]
    kind: type
    table: str = ""
    """The field of the stage's options that holds it; empty for an option of the stage itself."""
    methods: tuple[str, ...] = ()
    """Methods with which the table counts."""

    @property
    def name(self) -> str:
        """The name of its flag."""
        return self.item.name

    @property
    def path(self) -> str:
        """The path that `--set` and TOML write behind the stage."""
        return f"{self.methods[0]}.{self.name}" if self.table else self.name

    @property
    def permits(self) -> bool:
        """Whether it permits something and changes no result."""
        return bool(self.item.metadata["permits"])

    def counts_with(self, method: Any) -> bool:
        return method in self.methods if self.table else method not in self.item.metadata["idle_with"]

    def value_in(self, options: Any) -> Any:
        return getattr(getattr(options, self.table) if self.table else options, self.name)


def places(options: Any) -> tuple[Place, ...]:
    """Every option of a stage or command, of its class or of an instance; the one that chooses the method is first."""
    return _places_of(options if isinstance(options, type) else type(options))


@cache
def _places_of(kind: type) -> tuple[Place, ...]:
    found: list[Place] = []
    kinds = get_type_hints(kind)
    for item in fields(kind):
        own, methods = kinds[item.name], item.metadata.get("methods", ())
        if is_dataclass(own):
            inner = get_type_hints(own)
            found += [Place(each, inner[each.name], item.name, methods) for each in fields(own)]
        else:
            found.append(Place(item, own))
    return tuple(found)


def counting(options: Any) -> list[Place]:
    """The options that have an effect on the result with the chosen method."""
    known = places(options)
    return [place for place in known if place.counts_with(known[0].value_in(options)) and not place.permits]


def as_dict(options: Any) -> dict[str, Any]:
    """Plain values for a record, by the names of their flags; only those that have an effect with the chosen method."""
    return {place.name: place.value_in(options) for place in counting(options)}


def differences(options: Any, base: Any) -> dict[str, Any]:
    """Values of `options` that differ from those of `base`, as TOML writes them behind the stage."""
    return {
        place.path: place.value_in(options)
        for place in places(options)
        if place.value_in(options) != place.value_in(base) and not place.permits
    }


def effective(options: Any, values: Mapping[str, Any]) -> dict[str, Any]:
    """The entries of `values`, by the names of their flags, that have an effect with the method that they name."""
    known = places(options)
    method = values.get(known[0].name, known[0].value_in(options))
    names = (place.name for place in known if place.counts_with(method) and not place.permits)
    return {name: values[name] for name in names if name in values}


def permissions(options: Any, values: Mapping[str, Any]) -> list[str]:
    """The names of the options in `values`, as TOML has them, that permit something."""
    known = places(options)
    named = [name for name, _ in _paths(values, {place.methods[0] for place in known if place.table})]
    return [name for name in named if any(place.permits and name in (place.name, place.path) for place in known)]


@dataclass(frozen=True)
class Given:
    """The value of an option that a layer gives."""

    place: Place
    value: Any
    layer: int
    """The last layer that gives it."""


def resolved(stage: str, options: Any, layers: Sequence[Mapping[str, Any]], asked: Mapping[str, Any]) -> Any:
    """`options` after the `layers` of values and, at last, the values of `asked`, as `options.resolve` explains."""
    values: dict[str, dict[str, Any]] = {}
    for given in given_values(stage, options, layers, asked):
        values.setdefault(given.place.table, {})[given.place.name] = given.value
    own = values.pop("", {})
    tables = {table: replace(getattr(options, table), **chosen) for table, chosen in values.items()}
    return checked(stage, replace(options, **own, **tables))


def given_values(
    stage: str, options: Any, layers: Sequence[Mapping[str, Any]], asked: Mapping[str, Any]
) -> list[Given]:
    """The last value of each option of a stage that the layers give; `asked` is the last layer."""
    every_layer = (*layers, asked)
    known = places(options)
    chooser = known[0]
    method = next(
        (layer[chooser.name] for layer in reversed(every_layer) if chooser.name in layer), chooser.item.default
    )
    _check_value(f"{stage}.{chooser.name}", _converted(f"{stage}.{chooser.name}", method, chooser.kind), chooser)
    given: dict[str, Given] = {}
    for number, layer in enumerate(every_layer):
        for name, value in _paths(layer, {place.methods[0] for place in known if place.table}):
            found = [place for place in known if name in (place.name, place.path)]
            if not found:
                raise _no_option(stage, name, known)
            active = [place for place in found if place.counts_with(method)]
            if not active and (layer is asked or name != found[0].path):
                raise _no_effect(stage, name, chooser.name, method, found)
            for place in active or found:
                given[place.path] = Given(place, _converted(f"{stage}.{name}", value, place.kind), number)
    return list(given.values())


def _paths(layer: Mapping[str, Any], tables: set[str]) -> Iterator[tuple[str, Any]]:
    """Each value with its name in `--set`."""
    for name, value in layer.items():
        if name in tables and isinstance(value, dict):
            yield from ((f"{name}.{inner}", each) for inner, each in value.items())
        else:
            yield name, value


def _no_option(stage: str, name: str, known: Sequence[Place]) -> BadUsage:
    """The error for an option that does not exist, or went with its method."""
    chooser = known[0]
    for method, gone in chooser.item.metadata["retired"].items():
        if name.partition(".")[0] in (method, *gone.options):
            went = f"option {stage}.{name} is gone with {chooser.name} = {method}"
            return BadUsage(f"{went}; use {chooser.name} = {gone.successor}")
    names = dict.fromkeys(place.name for place in known)
    return unknown(f"option {stage}.{name}", name.rpartition(".")[2], names)


def _no_effect(stage: str, name: str, chooser: str, method: Any, found: list[Place]) -> BadUsage:
    """The error for an option that the user gave and that has no effect."""
    problem = f"{stage}.{name} has no effect with {chooser} = {method}; "
    others = " or ".join(dict.fromkeys(other for place in found for other in place.methods))
    if not others:
        return BadUsage(f"{problem}leave it out")
    table = f"[{stage}.{found[0].methods[0]}]"
    return BadUsage(f"{problem}choose {chooser} = {others}, leave it out, or keep it below {table} in cotton3dg.toml")


def checked(stage: str, options: Any) -> Any:
    """The same `options`.

    Raises:
        BadUsage: an option is out of bounds.
    """
    for place in places(options):
        _check_value(f"{stage}.{place.path}", place.value_in(options), place)
    return options


def _check_value(where: str, value: Any, place: Place) -> None:
    rules = place.item.metadata
    if value == place.item.default:  # 0 may stand for an option that nobody gave
        return
    low, high, choices = rules["at_least"], rules["at_most"], rules["choices"]
    if isinstance(value, float) and not math.isfinite(value):
        raise BadUsage(f"{where} = {value} is not finite; give a number")
    if low is not None and not value >= low:
        raise BadUsage(f"{where} = {value} is too small; use at least {low}")
    if high is not None and not value <= high:
        raise BadUsage(f"{where} = {value} is too large; use at most {high}")
    if choices and value not in choices:
        if gone := rules["retired"].get(value):
            raise BadUsage(f"{where} = {value!r} is gone; use {gone.successor}")
        raise unknown(f"{where} = {value!r}", str(value), choices)


def _converted(where: str, value: Any, kind: type) -> Any:
    """`value` as `kind`; strings (from --set) are parsed, other types must fit exactly."""
    try:
        if isinstance(value, str) and kind is not str:
            if kind is bool:
                return {"true": True, "false": False}[value.lower()]
            return kind(value)
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            return float(value)
    except (ValueError, KeyError) as error:
        raise BadUsage(f"{where} = {value!r} cannot be used; give {_KINDS[kind]}") from error
    if type(value) is not kind:
        raise BadUsage(f"{where} = {value!r} cannot be used; give {_KINDS[kind]}")
    return value


def flags(options: type) -> dict[str, tuple[Place, str]]:
    """Flag -> an option that it sets, and what `--help` shows; options of methods with the same name share one."""
    alike: dict[str, list[Place]] = {}
    for place in places(options):
        alike.setdefault(place.name, []).append(place)
    return {name: (found[0], _united_help(found)) for name, found in alike.items()}


def retired_flags(options: type) -> list[str]:
    """Flags of methods that are gone. They are still parsed, so that an error can say what replaces one."""
    return [name for gone in places(options)[0].item.metadata["retired"].values() for name in gone.options]


def _united_help(found: list[Place]) -> str:
    """The help of one flag, with the methods that use it."""
    methods_of: dict[str, list[str]] = {}
    for place in found:
        methods_of.setdefault(help_text(place.item), []).extend(place.methods[:1])
    return "; ".join(f"{', '.join(methods)}: {text}" if methods else text for text, methods in methods_of.items())


def _default_text(default: Any) -> str:
    if isinstance(default, bool):
        return "on" if default else ""
    return f"{default:g}" if isinstance(default, float) else str(default)


def help_text(item: Field[Any]) -> str:
    """Purpose, unit, choices, the paper's value and the default of an option; an empty or false default goes unsaid."""
    unit, paper = item.metadata["unit"], item.metadata["paper"]
    choices = item.metadata["choices"]
    notes = [unit] if unit else []
    notes += [" | ".join(choices)] if choices else []
    notes += [f"paper: {paper}"] if paper else []
    notes += [f"default: {default}"] if (default := _default_text(item.default)) else []
    text: str = item.metadata["help"]
    return text + (f" ({'; '.join(notes)})" if notes else "")
