"""A plant with exact truth: video.mp4, the pipeline's only input, and beside it what is true of it.

Not a stage of the pipeline: it makes the folder that a run starts from.

    video.mp4   truth.json (traits, bolls)   cameras.json   instances/frame_NNNN.png (16-bit lint ids), frames.json
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import ffmpeg
import numpy as np
from numpy.typing import NDArray

from ..core.progress import Progress, silent
from ..errors import BadUsage, StageFailed
from ..files.images import write_ids
from ..files.video import ffmpeg_binary
from ..options import SimulateOptions
from ..simulate.camera import orbit
from ..simulate.film import exposure_ev, filmed
from ..simulate.plant import grow_plant
from ..simulate.render import instance_ids, lit_scene
from ..simulate.room import build_room
from ..simulate.truth import MASKS_NOTE, camera_truth, plant_truth
from ..workspace import explained_disk_errors, json_text, write_text_atomically

FRAMES_PER_SECOND = 30
QUALITY = 12
"""x264's constant rate factor; a phone at 15 Mbit/s is about as good."""


def simulate(folder: Path, options: SimulateOptions, progress: Progress = silent) -> Path:
    """Film a simulated plant into `folder`.

    Returns:
        The folder.
    Raises:
        BadUsage: the folder holds something that simulate did not write, or the size cannot be encoded.
    """
    _check(folder, options)
    progress(0, options.frames, "growing")
    plant = grow_plant(options)
    path = orbit(options, plant.vertices)
    scene = lit_scene(plant, build_room(options, plant.stem_base))

    with explained_disk_errors(folder):
        instances = folder / "instances"
        shutil.rmtree(instances, ignore_errors=True)
        instances.mkdir(parents=True)
        masks: dict[int, NDArray[np.uint16]] = {}
        partial = folder / ".video.partial.mp4"
        with _encoder(partial, options) as write:
            for frame in range(options.frames):
                write(filmed(scene, path, frame, options))
                if frame % options.mask_interval == 0:
                    masks[frame] = instance_ids(scene, path.at(frame), k1=options.distortion)
                    write_ids(instances / f"frame_{frame:04d}.png", masks[frame])
                progress(frame + 1, options.frames, "filming")
        frames = {f"frame_{frame:04d}.png": frame for frame in masks}
        write_text_atomically(instances / "frames.json", json_text({"note": MASKS_NOTE, "frames": frames}))
        exposures = [exposure_ev(frame, options) for frame in range(options.frames)]
        write_text_atomically(folder / "cameras.json", json_text(camera_truth(path, options, exposures)))
        write_text_atomically(folder / "truth.json", json_text(plant_truth(plant, options, masks)))
        partial.replace(folder / "video.mp4")
    return folder


def _check(folder: Path, options: SimulateOptions) -> None:
    if options.width % 2 or options.height % 2:
        raise BadUsage(f"{options.width}x{options.height} cannot be encoded; choose even numbers")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        try:
            ours = json.loads((folder / "truth.json").read_text(encoding="utf-8"))["preset"] == "simulate"
        except (OSError, ValueError, KeyError, TypeError):
            ours = False
        if not ours:
            raise BadUsage(f"{folder} is not empty and was not made by simulate; give a new folder")


@contextmanager
def _encoder(path: Path, options: SimulateOptions) -> Iterator:
    """A function that appends an (H, W, 3) RGB image to an H.264 video at `path`."""
    stream = ffmpeg.input(
        "pipe:",
        format="rawvideo",
        pix_fmt="rgb24",
        s=f"{options.width}x{options.height}",
        framerate=FRAMES_PER_SECOND,
    )
    stream = ffmpeg.output(stream, str(path), vcodec="libx264", crf=QUALITY, pix_fmt="yuv420p", movflags="+faststart")
    arguments = stream.global_args("-hide_banner", "-loglevel", "error").overwrite_output().compile(ffmpeg_binary())
    process = subprocess.Popen(arguments, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdin and process.stderr
    try:
        yield lambda image: process.stdin.write(np.ascontiguousarray(image).data)
        process.stdin.close()
        message = process.stderr.read().decode(errors="replace").strip()
        if process.wait():
            raise StageFailed(f"ffmpeg could not encode the video ({message}); check that it has libx264")
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
        process.stderr.close()
