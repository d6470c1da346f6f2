# SPDX-License-Identifier: Apache-2.0
"""From the results of a first look to a verdict: what is good, what to film again.

Red is for films that `run` refuses, yellow for findings that it would flag or that would leave gaps in the row, green
for the rest. Findings that the report also judges use the same functions, so that the verdict agrees with it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..frames.frame_quality import BLURRED
from ..geometry.camera_orbit import find_out_of_view
from ..report.verdicts import (
    FEW_SECONDS,
    WELL_LIT,
    of_distance,
    of_framing,
    of_length,
    of_light,
    of_placed,
    of_scale,
    of_sharpness,
    of_walk,
    span_of,
)
from ..schemas.check import GREEN, RED, VERDICTS, YELLOW, CheckInfo, Finding
from .first_count import find_sure
from .framing import corners_in_view, find_cut_plants, find_cut_sides, find_gaps
from .preview import Look

NOTED_GAP_DEG: Final = 20.0
OFTEN_CUT: Final = 0.25
"""Share of images whose frame cuts the plant from which on it matters."""
ALWAYS_CUT: Final = 0.8
"""Share from which on perhaps no image shows the plant whole, and its height is unknown."""
BURNT_LINT: Final = 0.25
"""Share of the lint without shades from which on bolls lose their shape."""
DARK_SIDE: Final = 2.5
"""Ratio of the lint's brightness on the bright and on the dark side from which on the dark side is lost in noise."""
RARELY_SEEN: Final = 0.1
"""Share of the images that show a corner of the table, below which its place is a guess."""


def judge(look: Look, train_side_px: int, seconds: float) -> CheckInfo:
    """The verdict on a film whose cameras could be placed.

    Args:
        train_side_px: longer side of the images that bolls will be measured in.
    """
    found = [
        _walk(look),
        _placed(look),
        _sharp(look, train_side_px),
        _light(look),
        _plant(look),
        _bolls(look, train_side_px),
    ]
    found.append(_scale(look))
    findings = [finding for part, _ in found for finding in part]
    figures = {name: value for _, part in found for name, value in part.items()}
    return conclude(findings, figures, seconds)


def conclude(findings: Sequence[Finding], figures: dict[str, Any], seconds: float) -> CheckInfo:
    """The findings in order, the worst first, and the verdict."""
    ordered = sorted(findings, key=lambda finding: -VERDICTS.index(finding.verdict))
    verdict = ordered[0].verdict
    doubts = [finding for finding in ordered if finding.verdict != GREEN]
    if not doubts:
        line = ", ".join(finding.text for finding in ordered)
    else:
        more = f" (and {len(doubts) - 1} more)" if len(doubts) > 1 else ""
        line = f"{doubts[0]}{more}"
    return CheckInfo(verdict, line, tuple(ordered), figures, round(seconds, 1))


def refuse(reason: str, seconds: float) -> CheckInfo:
    """The verdict on a film that a stage refused, `what is wrong; what to do`."""
    text, _, remedy = reason.partition("; ")
    return conclude([Finding(RED, "Film", text, remedy)], {}, seconds)


_Part = tuple[list[Finding], dict[str, Any]]


def _walk(look: Look) -> _Part:
    orbit = look.orbit
    figures: dict[str, Any] = {
        "orbit_coverage_deg": round(orbit.coverage_deg, 1),
        "largest_gap_deg": round(orbit.largest_gap_deg, 1),
    }
    gaps = find_gaps(look.cameras, orbit, NOTED_GAP_DEG)
    figures["gaps_deg"] = [[round(start), round(end)] for start, end in gaps]
    if not gaps:
        return [of_walk(orbit.coverage_deg, 0.0)], figures
    start, end = gaps[0]
    if end >= 360:
        remedy = (
            f"you stopped {end - start:.0f} degrees before the turn was full: film on until you are where you began"
        )
    else:
        remedy = f"film again from {start:.0f} to {end:.0f} degrees of your walk, counted from where you began"
    return [of_walk(orbit.coverage_deg, orbit.largest_gap_deg, remedy)], figures


def _placed(look: Look) -> _Part:
    n, of = len(look.cameras), len(look.names)
    figures = {"placed": n, "looked_at": of}
    missing = set(look.names) - {camera.name for camera in look.cameras}
    where = span_of([image for image in look.frames.images if image.name in missing])
    return [of_placed(n, of, where)], figures


def _sharp(look: Look, train_side_px: int) -> _Part:
    images = look.frames.images
    blurs = np.array([image.blur for image in images])
    figures = {
        "blur": round(float(np.median(blurs)), 3),
        "blurred_share": round(float((blurs > BLURRED).mean()), 3),
        "motion_blur_px": look.blur_px,
    }
    found = [of_sharpness(images, look.blur_px, _boll_widths_px(look, train_side_px))]
    video = look.frames.video
    if video and video.duration_s < FEW_SECONDS and (length := of_length(video)):
        found.append(length)
    return found, figures


def _light(look: Look) -> _Part:
    images = look.frames.images
    luminance, highlight, white = (
        float(np.median([getattr(i, key) for i in images])) for key in ("mean_luminance", "highlight", "white_share")
    )
    figures = {"luminance": round(luminance, 3), "highlight": round(highlight, 3), "white_share": round(white, 3)}
    findings = of_light(images)
    lint = np.array([sight.lint_luminance for sight in look.sights])
    burnt = np.array([sight.burnt_share for sight in look.sights])
    if np.isfinite(lint).any():
        bright, dark = float(np.nanmax(lint)), float(np.nanmin(lint))
        share = float(np.nanmean(burnt))
        figures |= {"lint_luminance": round(float(np.nanmean(lint)), 3), "lint_burnt_share": round(share, 3)}
        figures["lint_bright_to_dark"] = round(bright / max(dark, 1e-3), 2)
        if share > BURNT_LINT:
            text = f"{share:.0%} of the lint is burnt out white"
            findings.append(Finding(YELLOW, "Light", text, "lower the exposure, or take the plant out of the glare"))
        if bright > DARK_SIDE * dark:
            text = f"the lint is {bright / max(dark, 1e-3):.1f} times brighter on one side"
            findings.append(Finding(YELLOW, "Light", text, "light the plant from both sides, or turn off the lamp"))
    return findings or [WELL_LIT], figures


def _plant(look: Look) -> _Part:
    """Findings about whether the frame cuts the plant."""
    by_bolls = find_cut_sides(look.bolls, look.cameras)
    by_looks = find_cut_plants(look.bolls, look.sights)
    lost = find_out_of_view(look.orbit.centre, look.cameras)
    share = len(by_bolls) / len(look.cameras)
    always = len(by_looks) / max(len(look.sights), 1)
    figures = {"plant_cut_share": round(max(share, always), 3), "plant_out_of_view": len(lost)}
    sides = Counter(side for cut in (by_looks if always > share else by_bolls).values() for side in cut)
    side = sides.most_common(1)[0][0] if sides else ""
    remedy = "step back, or hold the phone upright, until the whole plant and the table around it are in view"
    if always >= ALWAYS_CUT:
        text = f"the plant is cut by the {side} of the frame nearly everywhere, so its size cannot be measured"
        return [Finding(RED, "Plant", text, remedy)], figures
    if max(share, always) > OFTEN_CUT:
        text = f"the plant is cut by the {side} of the frame in {max(share, always):.0%} of the frames"
        return [Finding(YELLOW, "Plant", text, remedy)], figures
    framing = of_framing(len(lost), len(look.cameras))
    return [framing or Finding(GREEN, "Plant", "plant whole in view")], figures


def _bolls(look: Look, train_side_px: int) -> _Part:
    count = len(find_sure(look.bolls, len(look.sights)))
    figures: dict[str, Any] = {"bolls": count, "bolls_less_sure": len(look.bolls) - count}
    if not count:
        remedy = "if it has open bolls, film closer and with the lint lit"
        return [Finding(YELLOW, "Bolls", "no boll was found", remedy)], figures
    width = float(np.median(_boll_widths_px(look, train_side_px)))
    figures["boll_px"] = round(width, 1)
    return [of_distance(width, f"about {count} bolls")], figures


def _boll_widths_px(look: Look, train_side_px: int) -> NDArray[np.float64]:
    """Widths of all bolls in all sights, px of the images on which `run` trains."""
    shown = min(1.0, train_side_px / max(look.cameras[0].width, look.cameras[0].height))
    return shown * np.concatenate([np.zeros(0), *(sight.diameters_px for sight in look.sights)])


def _scale(look: Look) -> _Part:
    scale, outcome = look.scale.info.scale, look.scale.outcome
    if scale is None:
        text, _, remedy = next(iter(outcome.warnings), "no scale was asked for").partition("; ")
        again = "`run` looks again with the plant's model, which hides what is behind it"
        return [Finding(YELLOW, "Scale", f"{text} at a first look", f"{remedy}; {again}" if remedy else again)], {}
    error = scale.relative_error
    corners = corners_in_view(scale.corners, look.cameras)
    figures = {"scale": scale.source, "scale_error_pct": round(100 * error, 2)}
    figures["corners_in_view"] = np.round(corners, 2).tolist()
    findings = of_scale(look.scale.info, outcome.warnings)
    if "table" in scale.source and corners.min() < RARELY_SEEN:
        text = f"a corner of the table is in view in {corners.min():.0%} of the frames only"
        findings.append(Finding(YELLOW, "Table", text, "step back, so that all of the table is in view"))
    return findings, figures
