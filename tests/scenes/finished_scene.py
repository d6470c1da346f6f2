# SPDX-License-Identifier: Apache-2.0
"""A plant's folder as a whole run leaves it, made by code in seconds: all stages done, with records."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from cotton3dg.cluster import stage as cluster
from cotton3dg.core.runs import StageOutcome
from cotton3dg.gaussians.metrics import to_uint8
from cotton3dg.gaussians.rasterizer import render, render_values
from cotton3dg.io.images import write_ids, write_image
from cotton3dg.io.ply import write_gaussians
from cotton3dg.options import resolve
from cotton3dg.pipeline import stage_options
from cotton3dg.segment import stage as segment
from cotton3dg.stage import stage_of
from cotton3dg.traits import stage as traits
from cotton3dg.workspace import Workspace
from scenes.boll_scene import write_model
from scenes.documents import effects, frame_info, frames_info, sfm_info, table_scale, train_metrics
from scenes.table_scene import POSE, orbit, plant_scene

N_VIEWS, N_BOLLS = 16, 4
UNPLACED = f"{N_VIEWS:06d}.jpg"


def record(workspace: Workspace, stage: str, flags: tuple[str, ...] = (), warnings: tuple[str, ...] = ()) -> None:
    """As the pipeline writes it for a stage that is done."""
    options = stage_options(workspace)[stage]
    found = replace(
        stage_of(stage).record(options, ""), seconds=1.25, cpu_seconds=2.5, peak_memory_mib=321.0,
        inputs=stage_of(stage).input_hashes(workspace, options),
    )  # fmt: skip
    outcome = StageOutcome({"n": 3}, flags, warnings)
    workspace.write_record(found.done(outcome, workspace.hashes(workspace.folder(stage))))


def finished_workspace(folder: Path) -> Workspace:
    """Four bolls, one frame that could not be placed, a table; flags orbit_gap and few_frames_registered."""
    folder.mkdir(parents=True)
    (folder / "walk.mp4").write_text("no stage is run that reads it")
    workspace = Workspace(folder)
    gaussians, labels = plant_scene()
    gaussians.sh[:, 0] = np.where(labels[:, None] > 0, 1.5, np.sin(POSE.cm(gaussians.means) / [25, 15, 30]))
    views = orbit(N_VIEWS, 320, 240)
    photos = [to_uint8(render(gaussians, view).image) for view in views]

    names = [*(view.name for view in views), UNPLACED]
    with workspace.writing("frames") as made:
        for name, photo in zip(names, [*photos, photos[0]], strict=True):
            write_image(made / name, photo)
        entries = [frame_info(name, blur=0.2 + 0.015 * k, timestamp_s=0.5 * k) for k, name in enumerate(names)]
        frames_info(entries).save(made / "frames.json")
    record(workspace, "frames")

    with workspace.writing("sfm") as made:
        write_model(made / "undistorted" / "sparse", views)
        (made / "undistorted" / "images").mkdir()
        for view, photo in zip(views, photos, strict=True):
            write_image(made / "undistorted" / "images" / view.name, photo)
        info = sfm_info(names, (UNPLACED,), orbit_coverage_deg=330.0, orbit_largest_gap_deg=45.0)
        info.save(made / "sfm.json")
    record(workspace, "sfm", ("few_frames_registered", "orbit_gap"), ("16 of 17 frames registered; walk more slowly",))

    with workspace.writing("train") as made:
        write_gaussians(made / "gaussians.ply", gaussians)
        train_metrics(held_out=tuple(names[::4])).save(made / "metrics.json")
        effects().save(made / "effects.json")
    record(workspace, "train")

    with workspace.writing("scale") as made:
        table_scale(evidence={"edge_support": [0.9, 0.8, 0.9, 0.7]}).save(made / "scale.json")
        write_image(made / "table_0.jpg", photos[0])
    record(workspace, "scale")

    shares = np.eye(1 + N_BOLLS, dtype=np.float32)[labels]
    with workspace.writing("masks") as made:
        for view in views:
            image = render_values(gaussians, view, shares).image
            ids = np.where(image[..., 1:].sum(axis=2) > 0.5, image[..., 1:].argmax(axis=2) + 1, 0).astype(np.uint16)
            write_ids(made / f"{Path(view.name).stem}.png", ids)
    record(workspace, "masks")
    for module in (segment, cluster):
        stage = module.STAGE.name
        module.run(workspace, resolve(stage))
        record(workspace, stage)
    traits.run(workspace, resolve("traits"))
    record(workspace, "traits")
    return workspace
