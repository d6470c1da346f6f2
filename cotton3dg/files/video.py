"""Videos read through ffmpeg: what they are, every frame's time stamp, and the frames that are wanted.

ffmpeg's exit code, frame count and duration are not believed: it ends with 0 on a truncated file. What counts are the
frames that come out, and what it says about them while they do.

Only local files are opened, only of container kinds that phones write, and never through a shell.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import BadInput, EnvironmentUnusable, MissingInput
from .images import MAX_PIXELS, fit_size
from .tonemap import HLG, PQ, tone_map
from .yuv import Coding, YuvFrame

DEMUXERS: Final = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi"
DECODER_DELAY_FRAMES: Final = 32
"""A threaded decoder reports a damaged frame up to this many frames before it comes out."""
PIPE_BYTES: Final = 2**20
"""The most that Linux gives without asking: a frame then passes in a few steps."""
FRAME_RATE_OUT: Final = 25
"""Any constant: see `_in_step`."""

T = TypeVar("T")


@dataclass(frozen=True)
class VideoFacts:
    """What a video's header says."""

    codec: str
    width: int
    """Of the picture as shown: rotation and pixel aspect applied, px."""
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

    @property
    def is_hdr(self) -> bool:
        return self.transfer in (PQ, HLG)


@dataclass(frozen=True)
class Scan(Generic[T]):
    """What decoding every frame showed."""

    timestamps_s: NDArray[np.float64]
    """(n,) strictly increasing."""
    intact: NDArray[np.bool_]
    """(n,) false from a decoding error to the next key frame, with a margin for the decoder's delay."""
    n_damaged: int
    """Frames from the errors to the next key frames, without the margin: the least that must be damaged."""
    measures: list[T]
    """Of every `every`-th frame."""
    every: int
    errors: tuple[str, ...]
    """The decoder's complaints."""


def ffmpeg_binary() -> str:
    """The ffmpeg on the PATH, else the one of imageio-ffmpeg.

    Raises:
        EnvironmentUnusable: neither is there.
    """
    if on_path := shutil.which("ffmpeg"):
        return on_path
    import imageio_ffmpeg

    try:
        return imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError as error:
        raise EnvironmentUnusable("ffmpeg is missing; install ffmpeg or `pip install imageio-ffmpeg`") from error


def probe(path: Path) -> VideoFacts:
    """Read a video's header, through ffmpeg's own description because not every installation has ffprobe.

    Raises:
        BadInput: no video that ffmpeg can read, or one too large.
        MissingInput: no such file.
    """
    if not path.is_file():
        raise MissingInput(f"{path.name} is not there; copy the plant's video into its folder")
    command = [ffmpeg_binary(), "-nostdin", "-hide_banner", *_input_arguments(), "-i", _url(path)]
    told = subprocess.run(command, capture_output=True, check=False, stdin=subprocess.DEVNULL).stderr
    facts = parse_description(told.decode("utf-8", "replace"))
    if facts is None:
        raise BadInput(f"{path.name} is no video that can be read; copy it again from the phone or export it as mp4")
    if facts.width * facts.height > MAX_PIXELS:
        raise BadInput(f"{path.name} claims frames of {facts.width} x {facts.height} px; export it smaller")
    return facts


def parse_description(text: str) -> VideoFacts | None:
    """Facts from what `ffmpeg -i` prints; None when it names no video stream with a size."""
    streams = [
        part for part in re.split(r"(?m)^  Stream #", text) if ": Video: " in part and "(attached pic)" not in part
    ]
    if not streams:
        return None
    line = streams[0].split("\n", 1)[0]
    size = re.search(r", (\d+)x(\d+)", line)
    codec = re.search(r": Video: (\w+)", line)
    if size is None or codec is None or int(size[1]) * int(size[2]) == 0:
        return None
    width, height = int(size[1]), int(size[2])
    aspect = re.search(r"SAR (\d+):(\d+)", line)
    if aspect and int(aspect[1]) and int(aspect[2]):
        width = max(1, round(width * int(aspect[1]) / int(aspect[2])))
    turn = re.search(r"rotation of (-?[\d.]+) degrees", streams[0])
    rotation = round(-float(turn[1]) / 90) * 90 % 360 if turn else 0
    if rotation in (90, 270):
        width, height = height, width
    # E.g. `yuv420p10le(tv, bt2020nc/bt2020/arib-std-b67, progressive)`: matrix, primaries and transfer function, which
    # are one name where all are alike.
    told = line.split(", ", 1)[1].split(f", {size[1]}x{size[2]}")[0]
    colours = re.search(r"([\w-]+)/[\w-]+/([\w-]+)", told) or re.search(r"\b((bt709))\b", told)
    pixel_format = re.search(r", (\w+)", line)
    rate = re.search(r"([\d.]+)(k?) fps", line)
    length = re.search(r"Duration: (\d+):(\d+):([\d.]+)", text)
    return VideoFacts(
        codec=codec[1],
        width=width,
        height=height,
        rotation_deg=rotation,
        pixel_format=pixel_format[1] if pixel_format else "",
        transfer=colours[2] if colours and colours[2] != "unknown" else "",
        matrix=colours[1] if colours and colours[1] != "unknown" else "",
        full_range="(pc" in told or (pixel_format is not None and pixel_format[1].startswith("yuvj")),
        fps=float(rate[1]) * (1000 if rate[2] else 1) if rate else float("nan"),
        duration_s=int(length[1]) * 3600 + int(length[2]) * 60 + float(length[3]) if length else float("nan"),
    )


def scan(path: Path, facts: VideoFacts, max_side: int, measure: Callable[[YuvFrame], T], every: int = 1) -> Scan[T]:
    """Decode the whole video once, one frame in memory at a time.

    Args:
        max_side: longer side of the frames that are measured, px.
        measure: called with every `every`-th frame, from the first on; what it keeps of a frame it has to copy.
    """
    coding = coding_of(facts, max_side)
    measures: list[T] = []
    frame = YuvFrame(coding, np.empty(coding.size, coding.kind))
    stream = _stream(path).filter("showinfo", checksum=0)
    if every > 1:
        stream = stream.filter("select", f"not(mod(n,{every}))")
    stream = stream.filter("scale", coding.width, coding.height, flags="area").filter("format", coding.pixel_format)
    with _decoding(_in_step(stream), coding.pixel_format, frame.numbers) as (frames, log):
        measures.extend(measure(frame) for _ in frames)
        log.seek(0)
        text = log.read().decode("utf-8", "replace")
    timestamps_s, intact, n_damaged, errors = parse_log(text)
    n = min(len(timestamps_s), len(measures) * every)
    timestamps_s, intact = timestamps_s[:n], intact[:n]
    # A file whose parts were joined, or whose clock jumps back, repeats times; those frames have no place in the order.
    latest = np.maximum.accumulate(np.concatenate([[-np.inf], timestamps_s[:-1]])) if n else timestamps_s
    intact = intact & (timestamps_s > latest)
    return Scan(timestamps_s, intact, min(n_damaged, n), measures[: -(-n // every)], every, errors)


def coding_of(facts: VideoFacts, max_side: int) -> Coding:
    """How `scan` has frames handed over: as they are, but for what is larger or finer than anybody sees."""
    width, height = fit_size(facts.width, facts.height, max_side)
    if facts.is_hdr:
        return Coding(width, height, 10, facts.full_range, facts.matrix, facts.transfer)
    return Coding(width, height, 8, facts.full_range, facts.matrix)


def read_frames(path: Path, facts: VideoFacts, indices: list[int], max_side: int) -> Iterator[NDArray[np.uint8]]:
    """Decode the frames of the given numbers (ascending, as counted by `scan`), at most `max_side` px long.

    Yields:
        (H, W, 3) RGB, upright, sRGB; HDR is tone-mapped.
    Raises:
        BadInput: fewer frames came out than are wanted.
    """
    width, height = fit_size(facts.width, facts.height, max_side)
    pixel_format, kind = ("rgb48le", "<u2") if facts.is_hdr else ("rgb24", "u1")
    stream = (
        _stream(path)
        .filter("select", _balanced_sum([f"eq(n,{index})" for index in indices]))
        .filter("scale", width, height, flags="area+accurate_rnd+full_chroma_int+full_chroma_inp")
        .filter("format", pixel_format)
    )
    n_read = 0
    numbers = np.empty((height, width, 3), kind)
    with _decoding(_in_step(stream, len(indices)), pixel_format, numbers) as (frames, _):
        for _frame in frames:
            n_read += 1
            yield tone_map(numbers, facts.transfer) if facts.is_hdr else numbers.copy()
    if n_read != len(indices):
        raise BadInput(f"{path.name}: {n_read} of {len(indices)} frames came out on second reading; copy it again")


def sample_frames(path: Path, facts: VideoFacts, every_s: float, max_side: int) -> Iterator[NDArray[np.uint8]]:
    """Decode a frame every so many seconds, at most `max_side` px long, one in memory at a time.

    Yields:
        (H, W) grey, upright. A damaged video ends early.
    """
    width, height = fit_size(facts.width, facts.height, max_side)
    stream = (
        _stream(path)
        .filter("select", f"isnan(prev_selected_t)+gte(t-prev_selected_t,{every_s:.3f})")
        .filter("scale", width, height, flags="area")
        .filter("format", "gray")
    )
    numbers = np.empty((height, width), np.uint8)
    with _decoding(_in_step(stream), "gray", numbers) as (frames, _):
        for _frame in frames:
            yield numbers.copy()


def parse_log(text: str) -> tuple[NDArray[np.float64], NDArray[np.bool_], int, tuple[str, ...]]:
    """Time stamps, intact flags, number of surely damaged frames and errors, as in `Scan`, from the log of a decoding
    run with `showinfo` at `level+info`.
    """
    timestamps: list[float] = []
    key_frames: list[int] = []
    damaged_at: list[int] = []
    errors: list[str] = []
    for line in text.splitlines():
        shown = re.search(r"\bn: *\d+ pts: *\S+ +pts_time:(\S+)", line)
        if shown:
            if re.search(r"\b(?:iskey|key):1\b", line) or "type:I" in line:
                key_frames.append(len(timestamps))
            timestamps.append(_number(shown[1]))
        elif "[error]" in line or "[fatal]" in line or "corrupt decoded frame" in line:
            damaged_at.append(len(timestamps))
            errors.append(line.strip())
    intact = np.isfinite(np.array(timestamps, np.float64))
    damaged = ~intact
    for start in damaged_at:
        for flags, value, delay in ((damaged, True, 0), (intact, False, DECODER_DELAY_FRAMES)):
            clean = [key for key in key_frames if key >= start + delay]
            flags[max(0, start - 1) : clean[0] if clean else None] = value
    return np.nan_to_num(np.array(timestamps, np.float64), nan=-np.inf), intact, int(damaged.sum()), tuple(errors)


def _balanced_sum(terms: list[str]) -> str:
    """Terms added up in pairs of pairs, because ffmpeg refuses expressions nested more than a hundred deep."""
    while len(terms) > 1:
        terms = [f"({'+'.join(terms[i : i + 2])})" for i in range(0, len(terms), 2)]
    return terms[0]


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def _url(path: Path) -> str:
    """ffmpeg takes `a:b.mp4` for a protocol and `-x.mp4` for an option; `file:` and a full path prevent both."""
    return f"file:{path.resolve()}"


def _input_arguments() -> list[str]:
    """Let ffmpeg open local files of known containers only, so that a playlist named .mp4 cannot point elsewhere."""
    return ["-protocol_whitelist", "file", "-format_whitelist", DEMUXERS]


def _stream(path: Path):  # type: ignore[no-untyped-def]
    """The video stream (capital V: not a cover picture) as an ffmpeg-python node."""
    import ffmpeg

    return ffmpeg.input(_url(path), protocol_whitelist="file", format_whitelist=DEMUXERS)["V"]


def _in_step(stream, n_frames: int | None = None):  # type: ignore[no-untyped-def]
    """Output exactly the frames that come in.

    ffmpeg repeats and drops frames to keep a constant rate, and the option against that has another name in every
    second version; frames that already are at a constant rate pass unchanged in all of them.
    """
    limit = {} if n_frames is None else {"frames:v": n_frames}
    return stream.filter("setpts", f"N/({FRAME_RATE_OUT}*TB)"), {"r": FRAME_RATE_OUT, **limit}


@contextmanager
def _decoding(
    stream_and_settings: tuple, pixel_format: str, numbers: NDArray
) -> Iterator[tuple[Iterator[None], IO[bytes]]]:
    """Run ffmpeg: an iterator that fills `numbers` with the next raw frame, and the log, complete once all are read."""
    stream, settings = stream_and_settings
    output = stream.output("pipe:1", format="rawvideo", pix_fmt=pixel_format, **settings)
    command = output.global_args("-nostdin", "-hide_banner", "-nostats", "-loglevel", "level+info").compile(
        cmd=ffmpeg_binary()
    )
    # The log goes to a file: two pipes would need a thread to keep the unread one from filling up.
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(
            command, bufsize=0, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=log, pipesize=PIPE_BYTES
        )
        assert process.stdout is not None
        stdout = process.stdout

        def frames() -> Iterator[None]:
            content = memoryview(numbers.data).cast("B")
            while _fill(stdout, content):
                yield
            process.wait()

        try:
            yield frames(), log
        finally:
            stdout.close()
            process.kill()
            process.wait()


def _fill(source: IO[bytes], content: memoryview) -> bool:
    """Read until `content` is full; false where the source ends before."""
    filled = 0
    while filled < len(content):
        n = source.readinto(content[filled:])  # type: ignore[attr-defined]
        if not n:
            return False
        filled += n
    return True
