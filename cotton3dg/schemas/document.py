# SPDX-License-Identifier: Apache-2.0
"""What all JSON documents share: a frozen dataclass is written as it stands, and read back field by field."""

from __future__ import annotations

import json
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Any, ClassVar, Self, Union, get_args, get_origin, get_type_hints

from ..errors import BadInput
from ..io.saving import json_text, write_text_atomically
from ..text import read_text


class Document:
    """A JSON file. Subclasses are frozen dataclasses; only they parse and write the file.

    A field that is None is not in the file. NaN is null there, and null is NaN again.
    """

    REMEDY: ClassVar[str]
    """What to do about a file that cannot be read."""

    def save(self, path: Path) -> None:
        """Write the file, all at once."""
        write_text_atomically(path, json_text(to_plain(self)))

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read the file. Further keys are ignored, because a later version may write more.

        Raises:
            BadInput: the file does not exist, is damaged, or lacks fields because an older version wrote it.
        """
        try:
            return cls.parsed(json.loads(read_text(path)))
        except OSError as error:
            raise BadInput(f"{path.name} cannot be read ({error.strerror}); {cls.REMEDY}") from error
        except (ValueError, BadInput) as error:
            raise BadInput(f"{path.name} is damaged or of another version ({error}); {cls.REMEDY}") from error

    @classmethod
    def load_if_there(cls, path: Path) -> Self | None:
        """As `load`; None without a file.

        Raises:
            BadInput: the file cannot be read.
        """
        return cls.load(path) if path.is_file() else None

    @classmethod
    def parsed(cls, value: Any) -> Self:
        """The document that a parsed file holds.

        Raises:
            ValueError: what is wrong with it.
        """
        document: Self = _convert(cls, value, "")
        return document


class WholeDocument(Document):
    """A JSON file that is one list, or one table of similar things: the only field of the dataclass is the whole
    file."""

    def save(self, path: Path) -> None:
        (content,) = to_plain(self).values()
        write_text_atomically(path, json_text(content))

    @classmethod
    def parsed(cls, value: Any) -> Self:
        ((name, kind),) = _kinds(cls).items()  # type: ignore[arg-type]
        return cls(**{name: _convert(kind, value, "it")})


def to_plain(value: Any) -> Any:
    """A document as dictionaries, lists and numbers."""
    if is_dataclass(value):
        items = ((item.name, getattr(value, item.name)) for item in fields(value))
        return {name: to_plain(item) for name, item in items if item is not None}
    if isinstance(value, dict):
        return {key: to_plain(item) for key, item in value.items()}
    return [to_plain(item) for item in value] if isinstance(value, (list, tuple)) else value


@cache
def _kinds(kind: type) -> dict[str, Any]:
    return {name: hint for name, hint in get_type_hints(kind).items() if get_origin(hint) is not ClassVar}


def _convert(kind: Any, value: Any, where: str) -> Any:
    """`value`, which json parsed, as the type `kind` of a field `where`."""
    origin, parts = get_origin(kind), get_args(kind)
    if is_dataclass(kind):
        return _instance(kind, value, where)
    if origin in (Union, UnionType):
        (kind,) = (part for part in parts if part is not type(None))
        return None if value is None else _convert(kind, value, where)
    if origin is tuple and isinstance(value, list):
        return tuple(_convert(parts[0], item, f"{where}[{i}]") for i, item in enumerate(value))
    if origin is dict and isinstance(value, dict):
        return {key: _convert(parts[1], item, f"{where}[{key!r}]") for key, item in value.items()}
    if kind is float and (value is None or _is_a(float, value) or _is_a(int, value)):
        return float("nan" if value is None else value)
    if kind is Any or (origin is None and _is_a(kind, value)):
        return value
    raise ValueError(f"{where} is not {'a table' if origin is dict else 'a list' if origin else kind.__name__}")


def _is_a(kind: type, value: Any) -> bool:
    """Whether a value is of a type; true and false are not numbers."""
    return isinstance(value, kind) and isinstance(value, bool) == (kind is bool)


def _instance(kind: Any, value: Any, where: str) -> Any:
    if not isinstance(value, dict):
        raise ValueError(f"{where or 'it'} is not a table")
    kinds = _kinds(kind)
    needed = [item.name for item in fields(kind) if item.default is MISSING and item.default_factory is MISSING]
    if missing := [name for name in needed if name not in value]:
        raise ValueError(f"{where + ' ' if where else ''}has no {', '.join(missing)}")
    prefix = f"{where}." if where else ""
    return kind(**{name: _convert(kinds[name], value[name], prefix + name) for name in kinds if name in value})
