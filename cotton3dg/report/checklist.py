# SPDX-License-Identifier: Apache-2.0
"""Plants of a batch to film, again or for the first time, with the reasons and what to do better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from ..core.runs import State
from ..errors import BadInput, CaptureFailed, MissingInput, NoScale
from ..field.columns import find_roles
from ..field.genotypes import Trial
from ..schemas.check import RED, CheckInfo, Finding, film_of
from ..workspace import Workspace
from .advice import meaning

FILM_AGAIN: Final = {
    "video_damaged": "the whole turn again; part of the video cannot be read",
    "few_frames": "one slow full turn of 20 to 60 s",
    "blurred": "walk more slowly, in more light",
    "underexposed": "in more light",
    "overexposed": "with less exposure, or out of the bright sun",
    "few_frames_registered": "walk slowly and evenly, without a jerk or a turn of the phone",
    "cameras_contradicted": "with the plant and everything around it at rest",
    "orbit_gap": "a full turn that ends where it began",
    "plant_out_of_view": "keep the plant in the middle of the picture",
    "plant_cut": "step back, or hold the phone upright, until the whole plant is in view",
    "no_scale": "with all four corners of the table, or the card, in view",
    "table_edge_unclear": "with all four edges of the table in view and cleared, or with the card on it",
    "no_plant": "with the plant on the table, both in view",
}
"""Flag that another film may clear -> what to film."""
FILM_AGAIN_CODES: Final = (CaptureFailed.exit_code, NoScale.exit_code)
USUAL: Final = "one slow full turn with the whole plant and the table in view"


def to_film(folder: Path, plants: Sequence[Mapping[str, Any]], trial: Trial) -> list[dict[str, Any]]:
    """A row for each plant: its name, where it stands, why, and what to film.

    A plant is on the list when its run failed for its film, when `check` found the film red, when it has flags that
    another film may clear, or when the field book has it and nobody filmed it.

    Args:
        folder: of the batch. plants: its rows, with `flags` as a list.
    """
    found = []
    for plant in plants:
        reasons = _reasons(folder / str(plant["folder"]), plant)
        if reasons:
            what = list(dict.fromkeys(text for _, text in reasons if text)) or [USUAL]
            why = list(dict.fromkeys(text for text, _ in reasons))
            place = _where(plant, trial.columns)
            found.append(
                {"plant": plant["folder"], "link": plant.get("link", ""), "where": place, "why": why, "what": what}
            )
    return found + [
        {"plant": plant_id, "link": "", "where": _where(cells, list(cells)), "why": ["not filmed yet"], "what": [USUAL]}
        for plant_id, cells in trial.unfilmed.items()
    ]


def _reasons(root: Path, plant: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Why a plant needs another film, each with what to film."""
    reasons = []
    if plant["state"] == State.FAILED and plant.get("exit_code") in FILM_AGAIN_CODES:
        why, _, what = str(plant["reason"] or "the run failed").partition("; ")
        reasons.append((why, what))
    reasons += [(meaning(flag).title, FILM_AGAIN[flag]) for flag in plant["flags"] if flag in FILM_AGAIN]
    reasons += [(finding.text, finding.remedy) for finding in _red(root)]
    return reasons


def _red(root: Path) -> list[Finding]:
    """The red findings of `check` for the present film."""
    try:
        workspace = Workspace(root)
        info = CheckInfo.load_if_there(workspace.check_json)
    except (BadInput, MissingInput):
        return []
    if info is None or info.film != film_of(workspace.read_record("frames")):
        return []
    return [finding for finding in info.findings if finding.verdict == RED]


def _where(cells: Mapping[str, Any], columns: Sequence[str]) -> str:
    """The cells that help to find a plant in the field."""
    roles = find_roles(columns)
    named = [f"{role} {cells[roles[role]]}" for role in ("site", "block", "row", "column", "plot") if role in roles]
    return ", ".join(text for text in named if not text.endswith(" "))
