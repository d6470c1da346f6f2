# SPDX-License-Identifier: Apache-2.0
"""A sheet of markers to print. Not a stage of the pipeline: the user lays it on the table before filming."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from ..command_options import MarkersOptions
from ..core.card import DOTS_PER_CM, PAPER_CM
from ..errors import BadUsage
from ..io.sheet import write_sheet
from ..option_rules import as_dict
from ..outputs import made_of, saving
from ..scale.markers import MarkerKind, board_squares, draw_sheet

SHEET_CM: Final = PAPER_CM | {"a3": (29.7, 42.0)}


def print_markers(file: Path, options: MarkersOptions) -> str:
    """Write the sheet; return a text on how to use it.

    Raises:
        BadUsage: another suffix than .pdf and .png, or the paper is too small.
    """
    if file.suffix.lower() not in (".pdf", ".png"):
        raise BadUsage(f"{file.name} is neither .pdf nor .png; name the sheet so")
    kind = MarkerKind(options.dictionary, options.marker_cm, board_squares(options.board))
    try:
        sheet = draw_sheet(kind, *SHEET_CM[options.paper], DOTS_PER_CM, options.first)
    except ValueError as error:
        raise BadUsage(f"{error}; use a larger --paper or a smaller --marker-cm") from error
    made = made_of("markers", *(f"{name}={value}" for name, value in as_dict(options).items()))
    with saving(file.parent, made, instead="name") as folder:
        write_sheet(folder / file.name, sheet, DOTS_PER_CM, pdf=file.suffix.lower() == ".pdf")
    board = f" --set scale.board={options.board}" if options.board else ""
    return (
        f"saved as {file}\nPrint it at 100 %, measure its ruler of 10 cm, lay it flat beside the plant and film; then\n"
        f"  cotton3dg run PLANT_DIR --set scale.method=aruco --set scale.marker_cm={options.marker_cm:g}"
        f" --set scale.dictionary={options.dictionary}{board}"
    )
