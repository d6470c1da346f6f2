# SPDX-License-Identifier: Apache-2.0
"""Criteria for a film and for a row, once for all pages: `check` before the training, the report and the index after.

Green is good as it is. Yellow means that `run` sets a flag, or that a value of the row is missing or less sure than
usual. Red has no result. The limits are the ones at which the stages set their flags.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from decimal import ROUND_HALF_UP, Decimal
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ..frames.frame_quality import BLURRED, quality_flags
from ..io.tables import flags_of, parse_number
from ..schemas.check import GREEN, RED, YELLOW, Finding
from ..schemas.frames import FrameInfo, VideoInfo
from ..schemas.scale import ScaleInfo
from ..sfm.registration_quality import FEW_REGISTERED_PCT, MAX_GAP_DEG
from ..traits.error_model import blurs_bolls

SMALL_BOLL_PX: Final = 10.0
"""Width in the training images below which bolls can be lost."""
SCALE_ERROR: Final = 0.01
FEW_SECONDS: Final = 15.0
USUAL_PCT: Final = {
    "boll_count": 10.0,
    "boll_volume_cm3": 10.0,
    "boll_volume_mean_cm3": 10.0,
    "plant_height_cm": 1.0,
    "canopy_size_cm": 2.0,
}
"""Column -> half-width of its 95 % interval, up to which it is as sure as usual; films in good light are surer
(docs/notes/stated_errors.md)."""
SURENESS: Final = {
    GREEN: "as sure as usual",
    YELLOW: "less sure than usual",
    RED: "so wide that it says little",
}
WIDE: Final = 3.0
"""Half-width of an interval, in usual ones, beyond which a trait says little."""


def of_walk(coverage_deg: float, gap_deg: float, remedy: str = "walk a full turn and end where you began") -> Finding:
    """How far around the plant the camera went, and the widest part that it left out."""
    if gap_deg <= MAX_GAP_DEG:
        return Finding(GREEN, "Walk", f"{coverage_deg:.0f} degrees around the plant")
    return Finding(YELLOW, "Walk", f"no view of the plant for {gap_deg:.0f} degrees", remedy)


def of_placed(n_placed: int, n_frames: int, where: str = "") -> Finding:
    """How many frames have a camera.

    Args:
        where: the others are in the film, as ` from 3 to 8 s of the film`.
    """
    text = f"{n_placed} of {n_frames} frames placed"
    if 100 * n_placed >= FEW_REGISTERED_PCT * n_frames:
        return Finding(GREEN, "Placed frames", text)
    remedy = f"walk more slowly{where}, with more light and more texture in view"
    return Finding(YELLOW, "Placed frames", text, remedy)


def of_sharpness(images: Sequence[FrameInfo], blur_px: float, boll_widths_px: ArrayLike) -> Finding:
    """Whether most images are sharp, and sharp enough for the bolls.

    Args:
        images: at least one.
        blur_px: motion blur of the images that bolls are measured in; boll_widths_px: of bolls there.
    """
    remedy = "walk more slowly, or film with more light"
    blurred = [image for image in images if image.blur > BLURRED]
    share = len(blurred) / len(images)
    if np.median([image.blur for image in images]) > BLURRED:
        return Finding(YELLOW, "Sharpness", f"{share:.0%} of the frames are blurred", remedy)
    if blurs_bolls(blur_px, 1.0, np.asarray(boll_widths_px, np.float64)):
        text = f"motion blurs the images by {blur_px:.0f} px, much of a boll's width"
        return Finding(YELLOW, "Sharpness", text, remedy)
    others = f", the others{span}" if (span := span_of(blurred)) else ""
    return Finding(GREEN, "Sharpness", f"{1 - share:.0%} of the frames sharp{others}")


def span_of(images: Sequence[FrameInfo]) -> str:
    """` from 3 to 8 s of the film`, where the images lie; empty if that is not known."""
    times = [image.timestamp_s for image in images if image.timestamp_s is not None]
    return f" from {min(times):.0f} to {max(times):.0f} s of the film" if times else ""


def of_length(video: VideoInfo | None) -> Finding | None:
    """How long the film is; None for photos, or where the file does not say."""
    if not video or not video.duration_s > 0:
        return None
    remark = "" if video.duration_s >= FEW_SECONDS else "; 20 to 60 s let you choose sharp frames from more"
    return Finding(GREEN, "Length", f"the video is {video.duration_s:.0f} s long{remark}")


def of_light(images: Sequence[FrameInfo]) -> list[Finding]:
    """What is wrong with the light of most images; empty if it is good."""
    highlight = float(np.median([image.highlight for image in images]))
    white = float(np.median([image.white_share for image in images]))
    concerns = (concern.partition("; ") for concern in quality_flags(0.0, highlight, white).values())
    return [Finding(YELLOW, "Light", text, remedy) for text, _, remedy in concerns]


WELL_LIT: Final = Finding(GREEN, "Light", "well lit")


def of_framing(n_lost: int, n_placed: int) -> Finding | None:
    """Frames whose middle is not the plant; None if there are none."""
    if not n_lost:
        return None
    text = f"the plant has left the frame in {n_lost} of {n_placed} frames"
    return Finding(YELLOW, "Plant", text, "keep it in the middle")


def of_distance(width_px: float, text: str) -> Finding:
    """Whether bolls are large enough in the images where they are measured; `text` is the remark if so."""
    if width_px < SMALL_BOLL_PX:
        problem = f"bolls are {width_px:.0f} px wide, below {SMALL_BOLL_PX:.0f} they can be lost"
        return Finding(YELLOW, "Bolls", problem, "film closer, or raise train.max_side")
    return Finding(GREEN, "Bolls", text)


def of_scale(info: ScaleInfo, warnings: Sequence[str]) -> list[Finding]:
    """How well lengths are known.

    Args:
        info: has a scale. warnings: of the stage.
    """
    error = info.relative_error or 0.0
    if error > SCALE_ERROR:
        remedy = "film so that all of the table top is in view, with its edges clear, or lay a printed marker on it"
        return [Finding(YELLOW, "Scale", f"the scale is known to {100 * error:.1f} % only", remedy)]
    doubts = [Finding(YELLOW, "Scale", *_parted(warning)) for warning in warnings]
    table = f", {info.table_words}" if info.table_words else ""
    return doubts or [Finding(GREEN, "Scale", f"scale to {100 * error:.1f} %{table}")]


def _parted(warning: str) -> tuple[str, str]:
    text, _, remedy = warning.partition("; ")
    return text, remedy


FEW_FLAGS: Final = 3
"""Number of quality flags that a verdict names."""


def of_row(flags: Collection[str], n_doubtful_bolls: int, traits: Mapping[str, object]) -> tuple[str, str]:
    """The verdict on a plant's row, and why.

    Args:
        flags: its quality flags; n_doubtful_bolls: bolls with flags of their own; traits: its cells.
    """
    if {"no_masks", "no_bolls"} & set(flags):
        return YELLOW, "No bolls were found"
    if "no_scale" in flags:
        return YELLOW, "Counted only: no scale, so no centimetres"
    if flags:
        names = ", ".join(flag.replace("_", " ") for flag in flags)
        return YELLOW, f"Look before you use it: {names if len(flags) <= FEW_FLAGS else f'{len(flags)} quality flags'}"
    if n := n_doubtful_bolls:
        return YELLOW, f"Good, but look at {n} doubtful {'boll' if n == 1 else 'bolls'}"
    if unsure := find_unsure(traits):
        return YELLOW, f"Less sure than usual: {', '.join(unsure)}"
    return GREEN, "All checks passed"


def find_unsure(traits: Mapping[str, object]) -> list[str]:
    """Traits, in words, whose intervals are wider than usual."""
    found = []
    for column in USUAL_PCT:
        value, low, high = interval_of(traits, column)
        if sureness_of(traits, column) in (YELLOW, RED):
            name = column.partition("_cm")[0].replace("_", " ")
            found.append(f"{name} ± {100 * (high - low) / 2 / value:.0f} %")
    return found


def sureness_of(traits: Mapping[str, object], column: str) -> str | None:
    """How sure a trait of `USUAL_PCT` is, by its interval: green as usual, yellow wider, red more than `WIDE` times as
    wide; None where it is blank. A count that is sure to one boll is green; what rests on an assumed table is not."""
    value, low, high = interval_of(traits, column)
    half = (high - low) / 2
    if not (value > 0 and np.isfinite(half)):
        return None
    if half <= USUAL_PCT[column] / 100 * value or (column == "boll_count" and half <= 1):
        return YELLOW if is_assumed(traits, column) else GREEN
    return YELLOW if half <= WIDE * USUAL_PCT[column] / 100 * value else RED


def sureness_words(traits: Mapping[str, object], column: str) -> str:
    """How sure a trait is, in words, with the half-width where it is less sure than usual; empty where it is blank."""
    sure = sureness_of(traits, column)
    if sure in (None, GREEN):
        return SURENESS.get(sure or "", "")
    if is_assumed(traits, column):
        return f"{SURENESS[sure]}: table assumed"
    value, low, high = interval_of(traits, column)
    return f"{SURENESS[sure]}: ± {50 * (high - low) / value:.0f} %"


def is_assumed(traits: Mapping[str, object], column: str) -> bool:
    """Whether the program assumed the size of the table that a trait in cm depends on; the interval leaves this out."""
    return "_cm" in column and "table_size_assumed" in flags_of(traits)


def interval_of(traits: Mapping[str, object], column: str) -> tuple[float, float, float]:
    """A trait and the ends of its interval; NaN for a blank cell."""
    name, unit, power = column.partition("_cm")
    low, high = (parse_number(traits.get(f"{name}_{end}{unit}{power}")) for end in ("low", "high"))
    return parse_number(traits.get(column)), low, high


def rounded(value: float, digits: int) -> str:
    """A finite number as pages show it, with halves away from zero: 37.15 becomes 37.2.

    People round the decimals of a table as they are written; the binary 37.15 is a little less and would become 37.1.
    """
    return str(Decimal(repr(float(value))).quantize(Decimal(1).scaleb(-digits), ROUND_HALF_UP))
