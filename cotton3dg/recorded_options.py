# SPDX-License-Identifier: Apache-2.0
"""Options as records of earlier runs have them, also of earlier versions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from .errors import BadUsage
from .option_rules import effective
from .options import COMMAND_OPTIONS, USUAL_TABLE_CM, resolve

FORMER_DEFAULTS: Final[dict[str, tuple[int, dict[str, Any]]]] = {
    "scale": (11, {"table_length_cm": USUAL_TABLE_CM[0], "table_width_cm": USUAL_TABLE_CM[1]}),
    "segment": (6, {"method": "lift"}),
    "cluster": (12, {"method": "consensus"}),
}
"""Stage -> its version since which these are not defaults any more."""


def recorded(stage: str, values: Mapping[str, Any], version: int | None = None) -> Any:
    """Options as a record has them. An old one also has those of methods that were not chosen; they had no effect.

    Args:
        version: of the stage that wrote the record. Nobody chose a value that was the default of an older version.
    Raises:
        BadUsage: an earlier version had an option or a method that this one does not have.
    """
    if version is not None:
        values = {name: value for name, value in values.items() if not is_former_default(stage, version, name, value)}
    try:
        return resolve(stage, effective(COMMAND_OPTIONS[stage](), values))
    except BadUsage as error:
        problem = f"{stage} was made by an earlier version: {error}"
        raise BadUsage(f"{problem}; run `cotton3dg {stage}` again") from error


def is_former_default(stage: str, version: int, name: str, value: Any) -> bool:
    """Whether an option in a record of a stage's `version` is what was the default then."""
    since, former = FORMER_DEFAULTS.get(stage, (0, {}))
    return version < since and name in former and former[name] == value
