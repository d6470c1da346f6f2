# SPDX-License-Identifier: Apache-2.0
"""Computes the scale again after a person moved corners of the table: a table of known size is fitted to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..core.measurements import Scale
from ..core.runs import StageOutcome
from ..core.scene import Camera, Float64
from ..geometry.triangulation import point_of_picks
from ..options import ScaleOptions
from ..schemas.scale import ScaleInfo
from .estimate_scale import PICTURES, TABLE_SOURCES, FoundScale, Plant, facts_of, summary_of, table_of, warnings_of
from .rectangle import Rectangle
from .references import LEAST_ERROR, Reference, reconcile, scale_on
from .table import outline_table
from .two_points import MAX_ERROR

SOURCE: Final = "corners"
ALONG_X: Final = (1, 0, 3, 2)
ALONG_Y: Final = (3, 2, 1, 0)
"""Corner -> the one at the other end of its long edge, which has the same y, and of its short edge, of the same x."""
OFF_TABLE: Final = 0.05
"""Largest distance of a picked corner from the table top or from a rectangle, in widths of the table. Picks farther off
are not corners of the table."""

Moves = Sequence[Mapping[str, NDArray[np.float64]]]
"""For each moved corner, image -> (2,) px."""


@dataclass(frozen=True)
class MovedTable:
    """The table through the corners that a person moved."""

    reference: Reference | None
    """None when no move applies."""
    rectangle: Rectangle | None
    refused: tuple[str, ...]
    """Reasons why moves do not apply."""


def move_corners(
    found: FoundScale, plant: Plant, moves: Moves, options: ScaleOptions, refused: Sequence[str] = ()
) -> FoundScale:
    """Compute the scale again, from the table through the moved corners and from the references besides the table.

    Args:
        found: the scale without the moves; kept as `ScaleInfo.found`.
        refused: reasons why further moves do not apply.
    """
    scale, cameras = found.info.scale, {camera.name: camera for camera in plant.cameras}
    references = [
        Reference(item["source"], item["cm_per_su"], item["relative_error"]) for item in found.info.references or ()
    ]
    moved = MovedTable(None, None, ())
    if scale is None or not TABLE_SOURCES & {reference.source for reference in references}:
        refused = (*refused, *("the scale does not come from the table" for _ in moves))
    elif moves:
        moved = fit_table_to_corners(scale, cameras, moves, *options.table_cm)
        refused = (*refused, *moved.refused)
    if moved.reference and moved.rectangle:
        by_corners = replace(moved.reference, assumed=options.table_is_assumed)
        references = [by_corners, *(item for item in references if item.source not in TABLE_SOURCES)]
        together = reconcile(references)
        source = "+".join(together.agreeing)
        now = scale_on(moved.rectangle, together.cm_per_su, together.relative_error, source)
        evidence = moved.reference.evidence
        info = replace(
            ScaleInfo.of_scale(
                now,
                evidence=evidence,
                references=facts_of(references),
                refused=found.info.refused,
                **table_of(together, options),
            ),
            found=found.info,
        )
        summary = summary_of(info, evidence)
        shown = list(dict.fromkeys(image for picks in moves for image in picks))[:PICTURES]
        pictures = found.pictures | {
            f"{SOURCE}_{number}.jpg": outline_table(plant.photo(image), cameras[image], moved.rectangle)
            for number, image in enumerate(shown)
        }
        found = FoundScale(info, StageOutcome(summary, *warnings_of(together, unclear_edge=False)), pictures)
    return refuse_moves(found, refused)


def refuse_moves(found: FoundScale, reasons: Sequence[str]) -> FoundScale:
    """The same scale with a warning that moves of corners do not apply, for each of `reasons`."""
    if not reasons:
        return found
    outcome = replace(
        found.outcome,
        flags=(*found.outcome.flags, "corrections_not_applied"),
        warnings=(*found.outcome.warnings, *(f"correction not applied: corner: {why}" for why in reasons)),
    )
    return replace(found, outcome=outcome)


def fit_table_to_corners(
    scale: Scale, cameras: Mapping[str, Camera], moves: Moves, length_cm: float, width_cm: float
) -> MovedTable:
    """The table of known size that fits the moved corners best, in the plane of the table as it was found.

    A move belongs to the corner nearest to the point where its picks meet; the last move of a corner counts. A moved
    corner takes its two edges with it, unless the corner at their other end was moved, too. Position, turn and size of
    the table are fitted to the four corners by least squares.
    """
    axes, origin = scale.table_frame, scale.corners.mean(axis=0)
    width_su = width_cm / scale.cm_per_su
    found = _complex((scale.corners - origin) @ axes.T)
    moved: dict[int, tuple[complex, float]] = {}
    refused: list[str] = []
    for picks in moves:
        picked = point_of_picks([cameras[image] for image in picks], np.array(list(picks.values())))
        if picked is None:
            refused.append("the picks do not meet in space")
            continue
        place = (picked.point - origin) @ axes.T
        height = float(scale.height_cm(picked.point[None])[0])
        if abs(height) > OFF_TABLE * width_cm:
            refused.append(f"the picks meet {height:+.1f} cm above the table top")
            continue
        at = complex(place[0], place[1])
        moved[int(np.abs(found - at).argmin())] = (at, picked.error_su)
    if not moved:
        return MovedTable(None, None, tuple(refused))
    at_corner = [moved.get(corner, (complex(found[corner]), 0.0))[0] for corner in range(4)]
    there = np.array(
        [
            at_corner[k] if k in moved else complex(at_corner[ALONG_Y[k]].real, at_corner[ALONG_X[k]].imag)
            for k in range(4)
        ]
    )
    errors = np.full(4, scale.relative_error * width_su)
    errors[list(moved)] = [error_su for _, error_su in moved.values()]
    known = _complex(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [length_cm / 2, width_cm / 2])
    spread = float((np.abs(known) ** 2).sum())
    factor = complex((known.conj() * (there - there.mean())).sum() / spread)
    residuals = np.abs(there - there.mean() - factor * known)
    if residuals.max() > OFF_TABLE * width_su:
        refused.append(f"the corners are not those of a table of {length_cm:g} x {width_cm:g} cm")
        return MovedTable(None, None, tuple(refused))
    left = float((residuals**2).sum()) / 4
    error = float(np.sqrt((errors**2 * np.abs(known) ** 2).sum() / spread**2 + left / spread)) / abs(factor)
    if error > MAX_ERROR:
        refused.append(f"the picks give the table's size to {error:.0%} only; pick it in photos from other sides")
        return MovedTable(None, None, tuple(refused))
    x = (factor / abs(factor)).real * axes[0] + (factor / abs(factor)).imag * axes[1]
    middle = there.mean()
    half = np.array([length_cm, width_cm]) / 2 * abs(factor)
    rectangle = Rectangle(
        np.stack([x, np.cross(scale.up, x), scale.up]),
        origin + middle.real * axes[0] + middle.imag * axes[1],
        np.array([-half[0], half[0], -half[1], half[1]]),
    )
    reference = Reference(
        SOURCE, 1 / abs(factor), max(error, LEAST_ERROR), {"moved_corners": sorted(k + 1 for k in moved)}
    )
    return MovedTable(reference, rectangle, tuple(refused))


def _complex(places: Float64) -> NDArray[np.complex128]:
    """Places on the table as complex numbers; turning and scaling them is then a multiplication."""
    return np.asarray(places[:, 0] + 1j * places[:, 1])
