# SPDX-License-Identifier: Apache-2.0
"""Facts of a study that only the lab knows, from `study.toml` in the field's folder; keys are MIAPPE's code names."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from ..errors import BadInput, unknown
from ..text import read_text

STUDY_FILE: Final = "study.toml"
SECTIONS: Final = ("Investigation", "Study", "Person")


@dataclass(frozen=True)
class Study:
    """Facts of a study; empty if the lab gives none."""

    sections: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Section -> code name -> text."""

    def get(self, section: str, name: str, default: str = "") -> str:
        return self.sections.get(section, {}).get(name, default)


def read_study(folder: Path) -> Study:
    """Read `study.toml`; a missing file counts as an empty one.

    Raises:
        BadInput: it is not TOML. BadUsage: it has an unknown table.
    """
    path = folder / STUDY_FILE
    if not path.is_file():
        return Study()
    try:
        tables = tomllib.loads(read_text(path))
    except (tomllib.TOMLDecodeError, OSError) as error:
        raise BadInput(f"{STUDY_FILE}: {error}; mend it") from error
    for name, table in tables.items():
        if name not in SECTIONS or not isinstance(table, dict):
            raise unknown(f"{STUDY_FILE}: [{name}]", name, SECTIONS)
    return Study({name: {key: str(value) for key, value in table.items()} for name, table in tables.items()})
