# SPDX-License-Identifier: Apache-2.0
"""ffmpeg's output: about the streams in a file, and about the frames while it decodes them."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .tonemap import HLG, PQ

DECODER_DELAY_FRAMES: Final = 32
"""A threaded decoder reports a damaged frame up to this many frames before it comes out."""
MESSAGE: Final = re.compile(r"(?:\[[^\]]+ @ \w+\] )*\[(\w+)\] (.*)")
"""A line of ffmpeg's log at `level+info`: the part of ffmpeg that prints it, the level, and the message."""
HARMLESS: Final = re.compile(
    "co located POCs unavailable|mmco: unref short failure|non monotonically increasing dts", re.IGNORECASE
)
"""Errors that cost no picture: in the first frames after a cut without encoding, and in clocks, which `scan` judges."""


@dataclass(frozen=True)
class VideoFacts:
    """The facts in a video's header."""

    codec: str
    width: int
    """Size of the picture as shown: rotation and pixel aspect applied, px."""
    height: int
    rotation_deg: int
    """Rotation tag, clockwise 0, 90, 180 or 270. ffmpeg applies it, so that frames come out upright."""
    pixel_format: str
    transfer: str
    """Transfer function, empty when not tagged."""
    matrix: str
    """From brightness and colour differences to red, green, blue; empty when not tagged."""
    full_range: bool
    """Whether black is 0."""
    fps: float
    """Average frame rate, NaN when unknown; informative only."""
    duration_s: float
    """NaN when unknown."""
    stream: int = field(default=0, kw_only=True)
    """Number of the film's stream in the file."""
    rivals: int = field(default=0, kw_only=True)
    """Number of further films in the file."""

    @property
    def is_hdr(self) -> bool:
        return self.transfer in (PQ, HLG)


def parse_description(text: str) -> list[VideoFacts]:
    """Facts of each video stream, from the output of `ffmpeg -i`; first those that players show, the largest ahead.

    Cover pictures and streams without a size are left out.
    """
    length = re.search(r"Duration: (\d+):(\d+):([\d.]+)", text)
    duration_s = seconds_of(*length.groups()) if length else float("nan")
    found = []
    for part in re.split(r"(?m)^  Stream #", text)[1:]:
        facts = _facts_of_stream(part, duration_s)
        if facts and "(attached pic)" not in part:
            is_default = "(default)" in part.split("\n", 1)[0]
            found.append((not is_default, -facts.width * facts.height, facts.stream, facts))
    return [facts for *_, facts in sorted(found, key=lambda entry: entry[:3])]


def _facts_of_stream(text: str, duration_s: float) -> VideoFacts | None:
    """Facts from a description such as `0:1[0x2](und): Video: h264 ...`; None for other streams or without a size."""
    line = text.split("\n", 1)[0]
    size = re.search(r", (\d+)x(\d+)", line)
    codec = re.match(r"0:(\d+)[^ ]*: Video: (\w+)", line)
    if size is None or codec is None or int(size[1]) * int(size[2]) == 0:
        return None
    width, height = int(size[1]), int(size[2])
    aspect = re.search(r"SAR (\d+):(\d+)", line)
    if aspect and int(aspect[1]) and int(aspect[2]):
        width = max(1, round(width * int(aspect[1]) / int(aspect[2])))
    turn = re.search(r"rotation of (-?[\d.]+) degrees", text)
    rotation = round(-float(turn[1]) / 90) * 90 % 360 if turn else 0
    if rotation in (90, 270):
        width, height = height, width
    # E.g. `yuv420p10le(tv, bt2020nc/bt2020/arib-std-b67, progressive)`: matrix, primaries and transfer function, which
    # are one name if all three are alike.
    coding = line.split(", ", 1)[1].split(f", {size[1]}x{size[2]}")[0]
    colours = re.search(r"([\w-]+)/[\w-]+/([\w-]+)", coding) or re.search(r"\b((bt709))\b", coding)
    pixel_format = re.search(r", (\w+)", line)
    rate = re.search(r"([\d.]+)(k?) fps", line)
    return VideoFacts(
        codec=codec[2],
        width=width,
        height=height,
        rotation_deg=rotation,
        pixel_format=pixel_format[1] if pixel_format else "",
        transfer=colours[2] if colours and colours[2] != "unknown" else "",
        matrix=colours[1] if colours and colours[1] != "unknown" else "",
        full_range="(pc" in coding or (pixel_format is not None and pixel_format[1].startswith("yuvj")),
        fps=float(rate[1]) * (1000 if rate[2] else 1) if rate else float("nan"),
        duration_s=duration_s,
        stream=int(codec[1]),
    )


def seconds_of(hours: str, minutes: str, seconds: str) -> float:
    """Seconds of a time that ffmpeg prints as 00:01:02.50."""
    return int(hours) * 3600 + int(minutes) * 60 + float(seconds)


def parse_log(text: str) -> tuple[NDArray[np.float64], NDArray[np.bool_], int, tuple[str, ...]]:
    """Time stamps, intact flags, number of surely damaged frames and errors, as in `Scan`, from the log of a decoding
    run with `showinfo` at `level+info`.
    """
    timestamps: list[float] = []
    key_frames: list[int] = []
    damaged_at: list[int] = []
    errors: list[str] = []
    # The lines before are about the container, its other streams, and a first look that decoding repeats.
    opening, _, decoding = text.partition("] Stream mapping:\n")
    for line in (decoding or opening).splitlines():
        shown = re.search(r"\bn: *\d+ pts: *\S+ +pts_time:(\S+)", line)
        if shown:
            if re.search(r"\b(?:iskey|key):1\b", line) or "type:I" in line:
                key_frames.append(len(timestamps))
            timestamps.append(_number(shown[1]))
        elif _tells_damage(line):
            damaged_at.append(len(timestamps))
            errors.append(line.strip())
    intact = np.isfinite(np.array(timestamps, np.float64))
    damaged = ~intact
    for start in damaged_at:
        for flags, value, delay in ((damaged, True, 0), (intact, False, DECODER_DELAY_FRAMES)):
            clean = [key for key in key_frames if key >= start + delay]
            flags[max(0, start - 1) : clean[0] if clean else None] = value
    return np.nan_to_num(np.array(timestamps, np.float64), nan=-np.inf), intact, int(damaged.sum()), tuple(errors)


def sizes_of_frames(text: str) -> list[str]:
    """Sizes of the frames in the log of a decoding run, as `1920x1080`, each once, in the order they come in."""
    return list(dict.fromkeys(re.findall(r"\bn: *\d+ pts: .*? s:(\d+x\d+) ", text)))


def _tells_damage(line: str) -> bool:
    message = MESSAGE.match(line)
    if message is None:
        return False
    level, what = message.groups()
    if level == "warning":
        return "corrupt decoded frame" in what
    return level in ("error", "fatal") and not HARMLESS.search(what)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")
