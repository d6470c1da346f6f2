# SPDX-License-Identifier: Apache-2.0
"""Videos written through ffmpeg, frame by frame as they are made."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..errors import Cotton3dgError, EnvironmentUnusable, OutOfResources, StageFailed
from .video import ffmpeg_binary, reading

COLOURS: Final = {"colorspace": "smpte170m", "color_primaries": "bt709", "color_trc": "bt709"}
"""Tags that describe ffmpeg's default conversion of RGB; without them players guess from the size."""
CROPPED_QUALITY: Final = 12
"""x264's constant rate factor; the loss is far below the one that the phone's encoder caused before."""
LOWEST_PRIORITY: Final = 19


@contextmanager
def video_encoder(
    path: Path, width: int, height: int, fps: float, quality: int
) -> Iterator[Callable[[NDArray[np.uint8]], None]]:
    """A function that appends an (H, W, 3) RGB image to an H.264 video at `path`.

    Args:
        width, height: even, px.
        quality: x264's constant rate factor, 0 = without loss, 51 = worst.
    Raises:
        OutOfResources: the disk is full. EnvironmentUnusable: this ffmpeg cannot encode H.264.
        StageFailed: ffmpeg failed otherwise.
    """
    import ffmpeg

    stream = ffmpeg.input("pipe:0", format="rawvideo", pix_fmt="rgb24", s=f"{width}x{height}", framerate=fps)
    output = stream.output(
        f"file:{path.resolve()}", vcodec="libx264", crf=quality, pix_fmt="yuv420p", movflags="+faststart", **COLOURS
    )
    command = output.global_args("-hide_banner", "-nostats", "-loglevel", "error").overwrite_output()
    process = subprocess.Popen(
        command.compile(cmd=ffmpeg_binary()),
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    assert process.stdin is not None
    assert process.stderr is not None
    stdin = process.stdin
    # Encoding runs while the next frames are made and should not slow them down.
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, process.pid, LOWEST_PRIORITY)

    def append(image: NDArray[np.uint8]) -> None:
        if image.shape != (height, width, 3) or image.dtype != np.uint8:
            raise ValueError(f"frames must be uint8 {(height, width, 3)}, got {image.dtype} {image.shape}")
        try:
            stdin.write(np.ascontiguousarray(image).data)
        except BrokenPipeError:
            raise _failure(log().strip()) from None

    with reading(process.stderr) as log:
        try:
            yield append
            with suppress(BrokenPipeError):
                stdin.close()
            if process.wait():
                raise _failure(log().strip())
        finally:
            process.kill()
            process.wait()
            with suppress(BrokenPipeError):
                stdin.close()


def crop_video(source: Path, target: Path, share: float) -> None:
    """Save the middle of a video, `share` of its width and height, as H.264 at nearly the same quality.

    Raises:
        OutOfResources: the disk is full. EnvironmentUnusable: this ffmpeg cannot encode H.264.
        StageFailed: ffmpeg failed otherwise.
    """
    import ffmpeg

    def even(side: str) -> str:
        return f"2*floor({share}*{side}/2)"

    cropped = ffmpeg.input(f"file:{source.resolve()}").video.filter("crop", even("iw"), even("ih"))
    output = cropped.output(
        f"file:{target.resolve()}", vcodec="libx264", crf=CROPPED_QUALITY, pix_fmt="yuv420p", f="mp4"
    )
    command = output.global_args("-hide_banner", "-nostats", "-nostdin", "-loglevel", "error").overwrite_output()
    done = subprocess.run(
        command.compile(cmd=ffmpeg_binary()), check=False, capture_output=True, text=True, errors="replace"
    )
    if done.returncode:
        target.unlink(missing_ok=True)
        raise _failure(done.stderr.strip())


def _failure(message: str) -> Cotton3dgError:
    if "No space left on device" in message:
        return OutOfResources("the disk is full; free some space and run again")
    if "Unknown encoder" in message:
        return EnvironmentUnusable("this ffmpeg has no H.264 encoder; install one with libx264")
    last = message.splitlines()[-1] if message else "no message"
    return StageFailed(f"ffmpeg could not encode the video ({last}); save images instead or install another ffmpeg")
