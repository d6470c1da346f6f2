"""The picture of a study: accuracy against time of all settings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..io.tradeoff_plot import Dot, Panel, write_tradeoff
from .tables import MEASURES, Row, clock_of, comparable_rows, front, machine_was_busy


def write_plot(path: Path, rows: Sequence[Row]) -> None:
    """Save a panel for the PSNR of the plant and one for the error of its traits."""
    clock = clock_of(rows)
    against = "error" if any(row["reference"] == "truth" for row in rows) else "change"
    titles = {
        "full_psnr_db": "PSNR of the plant at full size, dB",
        "trait_error_pct": f"mean {against} of count, volume, height, canopy, %",
    }
    panels = []
    for measure in MEASURES:
        shown, best = comparable_rows(rows, measure), front(rows, measure)
        dots = [
            Dot(row["sweep"], row["setting"], row[clock], row[measure], (row["sweep"], row["setting"]) in best)
            for row in shown
        ]
        panels.append(Panel(titles[measure], dots))
    axis = "CPU-seconds / cores" if machine_was_busy(rows) else "seconds from video to table"
    write_tradeoff(path, panels, f"{axis} (log)")
