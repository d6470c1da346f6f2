# SPDX-License-Identifier: Apache-2.0
"""A plant with exact truth: video.mp4, the pipeline's only input, and beside it the true values.

Not a stage of the pipeline: it makes the folder that a run starts from.

    video.mp4   truth.json (traits, bolls)   cameras.json   instances/frame_NNNN.png (16-bit lint ids), frames.json
    cotton3dg.toml (the size of the table)
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..command_options import SimulateOptions
from ..core.card import PAPER_CM, printed_reflectance
from ..core.runs import Progress, silent
from ..core.scene import Float32
from ..core.srgb import to_srgb
from ..errors import BadInput, BadUsage
from ..identity.codes import code_picture
from ..identity.draw_card import draw_card
from ..identity.names import card_text, id_problem
from ..io.encode import video_encoder
from ..io.images import write_ids
from ..io.saving import explain_disk_errors, json_text, write_text_atomically
from ..plants import has_results
from ..schemas.truth import TrueMasks, TruthOrigin
from ..simulate.camera import Orbit, orbit
from ..simulate.camera_effects import exposure_ev, film, film_ids
from ..simulate.plant import PlantMeshes, grow_plant
from ..simulate.render import RenderScene, light_scene, on_turntable, render
from ..simulate.room import build_room
from ..simulate.truth import MASKS_NOTE, camera_truth, plant_truth
from ..workspace import Workspace

FRAMES_PER_SECOND: Final = 30
CARD_DOTS: Final = 60
"""Dots per cm of a simulated card: as fine as a film from half a metre shows it."""
QUALITY: Final = 12
"""x264's constant rate factor; a phone at 15 Mbit/s is about as good."""

TABLE_REMARK: Final = "# The table of this film, as simulate made it."

STANDARD_PLANT: Final = {"seed": 1, "bolls": 12, "frames": 120}
"""The plant that `study --standard` films if the folder has none."""


def simulate(folder: Path, options: SimulateOptions, progress: Progress = silent) -> Path:
    """Film a simulated plant into `folder`.

    Returns:
        The folder.
    Raises:
        BadUsage: the folder holds something that simulate did not write, or the size cannot be encoded.
    """
    _check(folder, options)
    with explain_disk_errors(folder):  # an error about the folder comes before the work
        folder.mkdir(parents=True, exist_ok=True)
    progress(0, options.frames, "growing")
    plant = grow_plant(options)
    path = orbit(options, plant.vertices)
    scene, behind = _stage(plant, path, options)

    with explain_disk_errors(folder):
        instances = folder / "instances"
        shutil.rmtree(instances, ignore_errors=True)
        instances.mkdir(parents=True)
        masks: dict[int, NDArray[np.uint16]] = {}
        partial = folder / ".video.partial.mp4"
        with video_encoder(partial, options.width, options.height, FRAMES_PER_SECOND, QUALITY) as append:
            for frame in range(options.frames):
                append(film(scene, path, frame, options, behind))
                if frame % options.mask_interval == 0:
                    masks[frame] = film_ids(scene, path, frame, options)
                    write_ids(instances / f"frame_{frame:04d}.png", masks[frame])
                progress(frame + 1, options.frames, "filming")
        frames = {f"frame_{frame:04d}.png": frame for frame in masks}
        TrueMasks(MASKS_NOTE, frames).save(instances / "frames.json")
        exposures = [exposure_ev(frame, options) for frame in range(options.frames)]
        write_text_atomically(folder / "cameras.json", json_text(camera_truth(path, options, exposures)))
        write_text_atomically(folder / "truth.json", json_text(plant_truth(plant, options, masks)))
        _print_table(Workspace(folder).options_file, options)
        partial.replace(folder / "video.mp4")
    return folder


def _stage(plant: PlantMeshes, path: Orbit, options: SimulateOptions) -> tuple[RenderScene, Float32 | None]:
    """The scene that the camera circles and, for a plant on a turntable, the fixed background: (H, W, 3) light."""
    room = build_room(options, plant.stem_base, _printed_card(options.card) if options.card else None)
    if not options.turntable:
        return light_scene(plant, room), None
    turning, standing = on_turntable(light_scene(plant, room), plant, room)
    return turning, render(standing, path.at(0), k1=options.distortion)


def _printed_card(plant_id: str) -> Float32:
    """(H, W, 3) sRGB in 0..1 of a card on A4, as printed with black ink on white paper."""
    if problem := id_problem(plant_id):
        raise BadUsage(f"--card {plant_id!r} is not an id: {problem}")
    sheet = draw_card(code_picture(card_text(plant_id)), plant_id, (), PAPER_CM["a4"], CARD_DOTS)
    return np.repeat(to_srgb(printed_reflectance(sheet))[..., None], 3, axis=2)


def _print_table(options_file: Path, options: SimulateOptions) -> None:
    """Write what a person would measure; keep a file that somebody changed."""
    ours = not options_file.exists() or options_file.read_text(encoding="utf-8").startswith(TABLE_REMARK)
    if options.table and ours:
        sides = f"table_length_cm = {options.table_length_cm:g}\ntable_width_cm = {options.table_width_cm:g}\n"
        write_text_atomically(options_file, f"{TABLE_REMARK}\n[scale]\n{sides}")


def film_once(folder: Path, options: SimulateOptions, progress: Progress = silent) -> None:
    """Film a simulated plant into `folder`, unless it has one."""
    if not (folder.is_dir() and Workspace(folder).truth_json.is_file()):
        simulate(folder, options, progress)


def _check(folder: Path, options: SimulateOptions) -> None:
    if options.width % 2 or options.height % 2:
        raise BadUsage(f"{options.width}x{options.height} cannot be encoded; choose even numbers")
    if folder.is_dir() and has_results(Workspace(folder)):
        raise BadUsage(f"{folder} holds results of its film; give a new folder")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        try:
            ours = TruthOrigin.load(folder / "truth.json").preset == "simulate"
        except BadInput:
            ours = False
        if not ours:
            raise BadUsage(f"{folder} is not empty and was not made by simulate; give a new folder")
