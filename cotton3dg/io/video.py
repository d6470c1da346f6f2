# SPDX-License-Identifier: Apache-2.0
"""Reads videos through ffmpeg: their facts, the time stamp of every frame, and single frames.

The module does not trust ffmpeg's exit code, frame count and duration: ffmpeg exits with 0 on a truncated file. Only
the decoded frames count, and ffmpeg's messages about them.

Only local files are opened, only of container kinds that phones write, and never through a shell.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import BadInput, EnvironmentUnusable, MissingInput
from .ffmpeg_text import VideoFacts, parse_description, parse_log, seconds_of, sizes_of_frames
from .images import MAX_PIXELS, fit_size
from .tonemap import tone_map
from .yuv import Coding, YuvFrame

DEMUXERS: Final = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi"
PIPE_BYTES: Final = 2**20
"""The largest pipe that Linux grants to any user; a frame then passes in a few steps."""
FRAME_RATE_OUT: Final = 25
"""Any constant: see `_in_step`."""
RIVAL: Final = 0.5
"""A video stream at least this long, as a share of the longest, may be the film; a shorter one is a preview."""

T = TypeVar("T")


@dataclass(frozen=True)
class Scan(Generic[T]):
    """The result of decoding every frame."""

    timestamps_s: NDArray[np.float64]
    """(n,) strictly increasing."""
    intact: NDArray[np.bool_]
    """(n,) false from a decoding error to the next key frame, with a margin for the decoder's delay."""
    n_damaged: int
    """Frames from the errors to the next key frames, without the margin: the least that must be damaged."""
    measures: list[T]
    """The measures of every `every`-th frame."""
    every: int
    errors: tuple[str, ...]
    """The decoder's error messages."""


def ffmpeg_binary() -> str:
    """The ffmpeg on the PATH, else the one of imageio-ffmpeg.

    Raises:
        EnvironmentUnusable: neither exists.
    """
    if on_path := shutil.which("ffmpeg"):
        return on_path
    import imageio_ffmpeg

    try:
        bundled: str = imageio_ffmpeg.get_ffmpeg_exe()
        return bundled
    except RuntimeError as error:
        raise EnvironmentUnusable("ffmpeg is missing; install ffmpeg or `pip install imageio-ffmpeg`") from error


def probe(path: Path) -> VideoFacts:
    """Read a video's header, through ffmpeg's own description because not every installation has ffprobe.

    The longest of several video streams is the film. Among streams of about that length, it is the one that players
    show, or the largest.

    Raises:
        BadInput: the file is not a video that ffmpeg can read, or is too large.
        MissingInput: no such file.
    """
    if not path.is_file():
        raise MissingInput(f"{path.name} is not there; copy the plant's video into its folder")
    found = parse_description(_run_ffmpeg(path))
    if not found:
        why = "is empty (0 bytes)" if path.stat().st_size == 0 else "is not a video that can be read"
        raise BadInput(f"{path.name} {why}; copy it again from the phone or export it as mp4")
    facts = found[0]
    if len(found) > 1:
        lengths_s = [_length_s(path, one.stream) for one in found]
        films = [one for one, length_s in zip(found, lengths_s, strict=True) if length_s >= RIVAL * max(lengths_s)]
        facts = replace(films[0], rivals=len(films) - 1)
    if facts.width * facts.height > MAX_PIXELS:
        raise BadInput(f"{path.name} claims frames of {facts.width} x {facts.height} px; export it smaller")
    return facts


def _run_ffmpeg(path: Path, *arguments: str) -> str:
    """ffmpeg's output about a file and about what it makes of the file."""
    command = [ffmpeg_binary(), "-nostdin", "-hide_banner", *_input_arguments(), "-i", _url(path), *arguments]
    done = subprocess.run(command, capture_output=True, check=False, stdin=subprocess.DEVNULL)
    return done.stderr.decode("utf-8", "replace")


def _length_s(path: Path, stream: int) -> float:
    """Length of one stream, read to its end without decoding."""
    log = _run_ffmpeg(path, "-map", f"0:{stream}", "-c", "copy", "-f", "null", "-")
    times = re.findall(r"\btime=(\d+):(\d+):([\d.]+)", log)
    return seconds_of(*times[-1]) if times else 0.0


def scan(path: Path, facts: VideoFacts, max_side: int, measure: Callable[[YuvFrame], T], every: int = 1) -> Scan[T]:
    """Decode the whole video once, one frame in memory at a time.

    Args:
        max_side: longer side of the frames that are measured, px.
        measure: called with every `every`-th frame, from the first on; it has to copy what it keeps of a frame.
    Raises:
        BadInput: the size of the pictures changes.
    """
    coding = coding_of(facts, max_side)
    measures: list[T] = []
    frame = YuvFrame(coding, np.empty(coding.size, coding.kind))
    stream = _stream(path, facts).filter("showinfo", checksum=0)
    if every > 1:
        stream = stream.filter("select", f"not(mod(n,{every}))")
    stream = stream.filter("scale", coding.width, coding.height, flags="area").filter("format", coding.pixel_format)
    with _decoding(_in_step(stream), coding.pixel_format, frame.numbers) as (frames, log):
        measures.extend(measure(frame) for _ in frames)
        text = log()
    if len(sizes := sizes_of_frames(text)) > 1:
        raise BadInput(
            f"{path.name} changes its size from {sizes[0]} to {sizes[1]} px; cut out the part with the whole turn, or"
            " film again without switching lenses or joining clips"
        )
    timestamps_s, intact, n_damaged, errors = parse_log(text)
    n = min(len(timestamps_s), len(measures) * every)
    timestamps_s, intact = timestamps_s[:n], intact[:n]
    # A file whose parts were joined, or whose clock jumps back, repeats times; those frames have no place in the order.
    latest = np.maximum.accumulate(np.concatenate([[-np.inf], timestamps_s[:-1]])) if n else timestamps_s
    intact = intact & (timestamps_s > latest)
    return Scan(timestamps_s, intact, min(n_damaged, n), measures[: -(-n // every)], every, errors)


def coding_of(facts: VideoFacts, max_side: int) -> Coding:
    """The coding of the frames that `scan` receives: their own, unless they are larger or finer than anybody sees."""
    width, height = fit_size(facts.width, facts.height, max_side)
    if facts.is_hdr:
        return Coding(width, height, 10, facts.full_range, facts.matrix, facts.transfer)
    return Coding(width, height, 8, facts.full_range, facts.matrix)


def read_frames(path: Path, facts: VideoFacts, indices: list[int], max_side: int) -> Iterator[NDArray[np.uint8]]:
    """Decode the frames of the given numbers (ascending, as counted by `scan`), at most `max_side` px long.

    Yields:
        (H, W, 3) RGB, upright, sRGB; HDR is tone-mapped.
    Raises:
        BadInput: ffmpeg decodes fewer frames than are wanted.
    """
    width, height = fit_size(facts.width, facts.height, max_side)
    pixel_format, kind = ("rgb48le", "<u2") if facts.is_hdr else ("rgb24", "u1")
    stream = (
        _stream(path, facts)
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
        _stream(path, facts)
        .filter("select", f"isnan(prev_selected_t)+gte(t-prev_selected_t,{every_s:.3f})")
        .filter("scale", width, height, flags="area")
        .filter("format", "gray")
    )
    numbers = np.empty((height, width), np.uint8)
    with _decoding(_in_step(stream), "gray", numbers) as (frames, _):
        for _frame in frames:
            yield numbers.copy()


def _balanced_sum(terms: list[str]) -> str:
    """Terms added up in pairs of pairs, because ffmpeg refuses expressions nested more than a hundred deep."""
    while len(terms) > 1:
        terms = [f"({'+'.join(terms[i : i + 2])})" for i in range(0, len(terms), 2)]
    return terms[0]


def _url(path: Path) -> str:
    """ffmpeg takes `a:b.mp4` for a protocol and `-x.mp4` for an option; `file:` and a full path prevent both."""
    return f"file:{path.resolve()}"


def _input_arguments() -> list[str]:
    """Let ffmpeg open local files of known containers only, so that a playlist named .mp4 cannot point elsewhere."""
    return ["-protocol_whitelist", "file", "-format_whitelist", DEMUXERS]


def _stream(path: Path, facts: VideoFacts) -> Any:
    """The film as an ffmpeg-python node."""
    import ffmpeg

    return ffmpeg.input(_url(path), protocol_whitelist="file", format_whitelist=DEMUXERS)[str(facts.stream)]


def _in_step(stream: Any, n_frames: int | None = None) -> tuple[Any, dict[str, Any]]:
    """Output exactly the frames that come in.

    ffmpeg repeats and drops frames to keep a constant rate, and the option against that has another name in every
    second version; frames that already are at a constant rate pass unchanged in all of them.
    """
    limit = {} if n_frames is None else {"frames:v": n_frames}
    return stream.filter("setpts", f"N/({FRAME_RATE_OUT}*TB)"), {"r": FRAME_RATE_OUT, **limit}


@contextmanager
def _decoding(
    stream_and_settings: tuple[Any, dict[str, Any]], pixel_format: str, numbers: NDArray[Any]
) -> Iterator[tuple[Iterator[None], Callable[[], str]]]:
    """Run ffmpeg: an iterator that fills `numbers` with the next raw frame, and a function for the whole log."""
    stream, settings = stream_and_settings
    output = stream.output("pipe:1", format="rawvideo", pix_fmt=pixel_format, **settings)
    command = output.global_args("-nostdin", "-hide_banner", "-nostats", "-loglevel", "level+info").compile(
        cmd=ffmpeg_binary()
    )
    process = subprocess.Popen(
        command,
        bufsize=0,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        pipesize=PIPE_BYTES,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    stdout = process.stdout

    def frames() -> Iterator[None]:
        content = memoryview(numbers.data).cast("B")
        while _fill(stdout, content):
            yield
        process.wait()

    with stdout, reading(process.stderr) as log:
        try:
            yield frames(), log
        finally:
            process.kill()
            process.wait()


@contextmanager
def reading(pipe: IO[bytes]) -> Iterator[Callable[[], str]]:
    """A function that returns all that a pipe delivers; a thread reads the pipe so that it does not fill up."""
    parts: list[bytes] = []
    reader = threading.Thread(target=lambda: parts.extend(iter(pipe.readline, b"")), daemon=True)
    reader.start()

    def text() -> str:
        reader.join()
        return b"".join(parts).decode("utf-8", "replace")

    try:
        yield text
    finally:
        reader.join()
        pipe.close()


def _fill(source: IO[bytes], content: memoryview) -> bool:
    """Read until `content` is full; false if the source ends before."""
    filled = 0
    while filled < len(content):
        n = source.readinto(content[filled:])  # type: ignore[attr-defined]
        if not n:
            return False
        filled += n
    return True
