# SPDX-License-Identifier: Apache-2.0
"""The tables of a study, and its picture: study.csv, Markdown in the layout of the papers with seconds, study.png."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from ..core.columns import Column
from ..core.runs import State
from ..io.tables import TRAITS
from ..io.tradeoff_plot import Dot, Panel, write_tradeoff
from ..planning.tradeoff import format_duration, pareto_front

Row = Mapping[str, Any]

ERRORS: Final = ("boll_count", "boll_volume_cm3", "plant_height_cm", "canopy_size_cm")
"""Traits that are compared; each has a column <trait>_error_pct."""

PUBLISHED: Final = ("boll_volume_published_cm3", "plant_height_published_cm", "canopy_size_published_cm")
"""The same traits as Cotton3DGaussians defines them; they stand beside those and do not enter `trait_error_pct`."""

COLUMNS: Final = (
    Column("sweep", "", "what is varied; base: the setting that all others differ from in one thing"),
    Column("setting", "", "its value"),
    Column("state", "", "done, failed or skipped"),
    Column("reason", "", "why it failed or was skipped"),
    Column("psnr_db", "dB", "likeness of rendered and held-out images", 2),
    Column("ssim", "1", "structural similarity of rendered and held-out images", 4),
    Column(
        "plant_psnr_db",
        "dB",
        "psnr_db over the pixels that the bolls' network takes for the plant",
        2,
    ),
    Column("plant_ssim", "1", "ssim over the plant's pixels", 4),
    Column("full_psnr_db", "dB", "plant_psnr_db of the same model at full size, at most 960 px: the same for all", 2),
    Column("fps", "1/s", "images of the training's size rendered in a second, on the clock with all cores", 1),
    Column("n_gaussians", "1", "Gaussians of the model"),
    Column("n_frames", "1", "images taken from the video"),
    *(column for column in TRAITS if column.name in ERRORS),
    *(Column(f"{trait}_error_pct", "%", f"{trait} relative to the reference", 2) for trait in ERRORS),
    Column("trait_error_pct", "%", "mean of the four absolute errors", 2),
    Column("reference", "", "what errors are relative to: the truth, or the finest setting of the sweep"),
    Column("seconds", "s", "all stages from video to table", 1),
    Column("cpu_seconds", "s", "the same, summed over cores", 1),
    Column("idle_seconds", "s", "cpu_seconds shared evenly among the cores: as on an idle machine", 1),
    Column("peak_memory_mib", "MiB", "largest of all stages", 0),
    Column("lpips", "1", "LPIPS of the held-out images, 0 = alike; blank without a network (--lpips)", 4),
    *(column for column in TRAITS if column.name in PUBLISHED),
    *(Column(f"{trait}_error_pct", "%", f"{trait} relative to the reference", 2) for trait in PUBLISHED),
)

TITLES: Final = {
    "resolution": ("Table 1: image resolution", "longer side"),
    "steps": ("Table 2: optimisation steps, models that one training passes through", "steps"),
    "schedule": ("Optimisation steps, a training of its own for each", "steps"),
    "images": ("Table 3: number of images", "images"),
    "style": ("Table 4: capture style", "in the frame"),
    "sh": ("Degree of the view-dependent colour", "degree"),
    "gaussians": ("Budget of Gaussians", "budget"),
    "views": ("Images with masks", "images"),
    "method": ("Segmentation method", "method"),
    "preset": ("Presets", "preset"),
}
"""Sweep -> title and heading of its first column."""

FIGURES: Final = (
    ("PSNR dB", "psnr_db", ".2f"),
    ("SSIM", "ssim", ".3f"),
    ("plant PSNR", "plant_psnr_db", ".2f"),
    ("plant SSIM", "plant_ssim", ".3f"),
    ("full-size", "full_psnr_db", ".2f"),
    ("LPIPS", "lpips", ".3f"),
    ("FPS", "fps", ".0f"),
    ("bolls", "boll_count", ".0f"),
    ("count %", "boll_count_error_pct", "+.1f"),
    ("volume %", "boll_volume_cm3_error_pct", "+.1f"),
    ("height %", "plant_height_cm_error_pct", "+.1f"),
    ("canopy %", "canopy_size_cm_error_pct", "+.1f"),
    ("published volume %", "boll_volume_published_cm3_error_pct", "+.1f"),
    ("height %", "plant_height_published_cm_error_pct", "+.1f"),
    ("canopy %", "canopy_size_published_cm_error_pct", "+.1f"),
    ("s", "seconds", ".0f"),
    ("idle s", "idle_seconds", ".0f"),
    ("CPU s", "cpu_seconds", ".0f"),
    ("MiB", "peak_memory_mib", ".0f"),
)

MEASURES: Final = {"full_psnr_db": -1.0, "trait_error_pct": 1.0}
"""Measures of accuracy that have a front, and the sign that makes a smaller value better."""

BUSY: Final = 1.5
"""Ratio of clock time to CPU-seconds shared among the cores above which other programs were computing, too."""


def with_errors(rows: Sequence[Row], truth: Mapping[str, float]) -> list[dict[str, Any]]:
    """Rows with their errors in percent of the truth or, if a trait's truth is unknown, of the finest setting.

    Args:
        rows: those of one sweep, coarse to fine.
    """
    done = [row for row in rows if row["state"] == State.DONE]
    finest = done[-1] if done else {}
    completed = []
    for row in rows:
        errors = {
            f"{trait}_error_pct": _error_pct(row.get(trait), truth.get(trait) if truth else finest.get(trait))
            for trait in (*ERRORS, *PUBLISHED)
        }
        judged_errors = [errors[f"{trait}_error_pct"] for trait in ERRORS]
        finite = [abs(error) for error in judged_errors if math.isfinite(error)]
        reference = "truth" if truth else f"{finest['sweep']} {finest['setting']}" if finest else ""
        # The finest setting's change against itself does not show its accuracy.
        known = len(finite) == len(ERRORS) and (bool(truth) or row is not finest)
        completed.append({**row, **errors, "trait_error_pct": sum(finite) / len(finite) if known else math.nan})
        completed[-1]["reference"] = reference
    return completed


def _error_pct(value: float | None, reference: float | None) -> float:
    if value is None or not reference:
        return math.nan
    return 100.0 * (value - reference) / reference


def machine_was_busy(rows: Sequence[Row]) -> bool:
    """Whether the seconds on the clock include the work of other programs."""
    done = [row for row in rows if row["state"] == State.DONE]
    busy: bool = sum(row["seconds"] for row in done) > BUSY * sum(row["idle_seconds"] for row in done)
    return busy


def markdown(rows: Sequence[Row]) -> str:
    """One table per sweep; a star marks the settings on a front of accuracy against time over all sweeps."""
    best = pareto_settings(rows)
    parts = [_table(sweep, [row for row in rows if row["sweep"] == sweep], best) for sweep in TITLES]
    parts = [part for part in parts if part]
    notes = [
        "Errors are relative to the truth." if _has_truth(rows) else "Errors are changes against the finest setting."
    ]
    notes.append("`idle s` are the CPU-seconds shared evenly among the cores.")
    if machine_was_busy(rows):
        notes.append("Other programs ran meanwhile, so that the seconds on the clock (`s`) are too long.")
    notes.append("`full-size` is the PSNR of the plant at the images' full size (at most 960 px), whatever a model was")
    notes[-1] += " trained on."
    notes.append("NeRF, not measured here: 6.91 dB less than 3D Gaussian splatting (Cotton3DGaussians, abstract).")
    notes.append("* on the front: nothing measured here is as quick and as good.")
    return "\n\n".join([*parts, " ".join(notes)]) + "\n"


def clock_of(rows: Sequence[Row]) -> str:
    """The column to use for time: on a busy machine the clock has no meaning."""
    return "idle_seconds" if machine_was_busy(rows) else "seconds"


def comparable_rows(rows: Sequence[Row], measure: str) -> list[Row]:
    """The rows whose `measure` can be compared, each setting once."""
    base = next((row for row in rows if row["sweep"] == "base"), None)
    shown: list[Row] = []
    for row in rows:
        if row["state"] != State.DONE or not math.isfinite(row[measure]):
            continue
        # A nearer camera has other images, and a setting that leaves the model alone shows nothing about it.
        alike = base is not None and row[measure] == base[measure]
        if measure == "full_psnr_db" and row is not base and (alike or row["sweep"] == "style"):
            continue
        if all(any(row[key] != other[key] for key in (*MEASURES, "seconds")) for other in shown):
            shown.append(row)
    return shown


def front(rows: Sequence[Row], measure: str) -> set[tuple[str, str]]:
    """Sweep and setting of the rows that no other row beats in time and `measure`."""
    shown, clock, sign = comparable_rows(rows, measure), clock_of(rows), MEASURES[measure]
    best = pareto_front([row[clock] for row in shown], [sign * row[measure] for row in shown])
    return {(shown[i]["sweep"], shown[i]["setting"]) for i in best}


def pareto_settings(rows: Sequence[Row]) -> set[tuple[str, str]]:
    """Sweep and setting of the rows on the front of any measure, under all names of a setting."""
    best = set().union(*(front(rows, measure) for measure in MEASURES))
    if any(sweep == "base" for sweep, _ in best):
        base = next(row for row in rows if row["sweep"] == "base")
        best |= {
            (row["sweep"], row["setting"])
            for row in rows
            if all(row[key] == base[key] for key in (*MEASURES, "seconds", "state"))
        }
    return best


def _has_truth(rows: Sequence[Row]) -> bool:
    return any(row.get("reference") == "truth" for row in rows)


def _table(sweep: str, rows: Sequence[Row], best: set[tuple[str, str]]) -> str:
    if not rows:
        return ""
    title, heading = TITLES[sweep]
    lines = [
        f"**{title}**",
        "",
        "| " + " | ".join([heading, *(name for name, _, _ in FIGURES)]) + " |",
        "|" + "---|" * (1 + len(FIGURES)),
    ]
    left_out = []
    for row in rows:
        if row["state"] != State.DONE:
            left_out.append(f"{row['setting']}: {row['state']}, {row['reason']}.")
            continue
        star = " *" if (sweep, row["setting"]) in best else ""
        cells = [_figure(row.get(key), form) for _, key, form in FIGURES]
        lines.append("| " + " | ".join([row["setting"] + star, *cells]) + " |")
    return "\n".join([*lines, *([""] if left_out else []), *left_out])


def _figure(value: float | None, form: str) -> str:
    return "" if value is None or not math.isfinite(value) else f"{value:{form}}"


def summary(rows: Sequence[Row]) -> str:
    """One line per setting, for the terminal."""
    best = pareto_settings(rows)
    lines = [f"{'sweep':<12}{'setting':<14}{'PSNR dB':>9}{'traits %':>9}{'time':>10}{'CPU':>10}"]
    for row in rows:
        start = f"{row['sweep']:<12}{row['setting']:<14}"
        if row["state"] != State.DONE:
            lines.append(f"{start} {row['state']}: {row['reason']}")
            continue
        figures = [_figure(row["full_psnr_db"], ".2f"), _figure(row["trait_error_pct"], ".1f")]
        times = [format_duration(row["seconds"]), format_duration(row["cpu_seconds"])]
        star = " *" if (row["sweep"], row["setting"]) in best else ""
        lines.append(f"{start}{figures[0]:>9}{figures[1]:>9}{times[0]:>10}{times[1]:>10}{star}")
    return "\n".join(lines)


def write_plot(path: Path, rows: Sequence[Row]) -> None:
    """Save accuracy against time of all settings: a panel for the PSNR of the plant, one for the error of traits."""
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
