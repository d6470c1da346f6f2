"""A plant's folder as a whole run leaves it, made by code in seconds: all stages done, with records."""

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from cotton3dg.core.measurements import Scale
from cotton3dg.files.images import write_ids, write_image
from cotton3dg.files.ply import write_gaussians
from cotton3dg.files.saving import json_text
from cotton3dg.files.scale import scale_facts
from cotton3dg.options import STAGE_OPTIONS, as_dict, resolve
from cotton3dg.pipeline import stage_inputs, stage_options
from cotton3dg.splat.metrics import to_uint8
from cotton3dg.splat.rasterizer import render, render_values
from cotton3dg.stages import cluster, frames, masks, scale, segment, sfm, train, traits
from cotton3dg.workspace import Workspace
from scenes.boll_scene import write_model
from scenes.table_scene import POSE, orbit, plant_scene

MODULES: dict[str, ModuleType] = {
    "frames": frames, "sfm": sfm, "train": train, "masks": masks,
    "segment": segment, "cluster": cluster, "scale": scale, "traits": traits,
}  # fmt: skip
N_VIEWS, N_BOLLS = 16, 4
UNPLACED = f"{N_VIEWS:06d}.jpg"


def record(workspace: Workspace, stage: str, flags: tuple[str, ...] = (), warnings: tuple[str, ...] = ()) -> None:
    """As the pipeline writes it for a stage that is done."""
    options = stage_options(workspace)[stage]
    found: dict[str, Any] = {
        "stage": stage, "status": "ok", "stage_version": MODULES[stage].VERSION,
        "options": as_dict(options),
        "seconds": 1.25, "cpu_seconds": 2.5, "peak_memory_mib": 321.0,
        "inputs": workspace.hashes(*stage_inputs(workspace, stage, options)),
        "outputs": workspace.hashes(workspace.folder(stage)),
        "summary": {"n": 3}, "flags": flags, "warnings": warnings,
    }  # fmt: skip
    workspace.write_record(stage, found)


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
        entries = [
            {"name": name, "blur": 0.2 + 0.015 * k, "mean_luminance": 0.4, "timestamp_s": 0.5 * k, "white_share": 0.0}
            for k, name in enumerate(names)
        ]
        facts = {"source": "video", "file": "walk.mp4", "ordered": True, "images": entries,
                 "video": {"duration_s": 8.5, "width": 320, "height": 240}}  # fmt: skip
        (made / "frames.json").write_text(json_text(facts))
    record(workspace, "frames")

    with workspace.writing("sfm") as made:
        write_model(made / "undistorted" / "sparse", views)
        (made / "undistorted" / "images").mkdir()
        for view, photo in zip(views, photos, strict=True):
            write_image(made / "undistorted" / "images" / view.name, photo)
        facts = {"n_frames": len(names), "registered": names[:-1], "unregistered": [UNPLACED],
                 "orbit_coverage_deg": 330.0, "orbit_largest_gap_deg": 45.0, "plant_out_of_view": []}  # fmt: skip
        (made / "sfm.json").write_text(json_text(facts))
    record(workspace, "sfm", ("few_frames_registered", "orbit_gap"), ("16 of 17 frames registered; walk more slowly",))

    with workspace.writing("train") as made:
        write_gaussians(made / "gaussians.ply", gaussians)
        held_out = [{"image": name, "plant_psnr_db": 30.5} for name in names[::4]]
        (made / "metrics.json").write_text(json_text({"psnr_db": 31.0, "pixel_su": 1e-4, "held_out": held_out}))
    record(workspace, "train")

    shares = np.eye(1 + N_BOLLS, dtype=np.float32)[labels]
    with workspace.writing("masks") as made:
        for view in views:
            image = render_values(gaussians, view, shares).image
            ids = np.where(image[..., 1:].sum(axis=2) > 0.5, image[..., 1:].argmax(axis=2) + 1, 0).astype(np.uint16)
            write_ids(made / f"{Path(view.name).stem}.png", ids)
    record(workspace, "masks")
    for module in (segment, cluster):
        stage = module.__name__.rpartition(".")[2]
        module.run(workspace, resolve(stage))
        record(workspace, stage)

    corners = POSE.scene(np.array([[-60, -30, 0], [60, -30, 0], [60, 30, 0], [-60, 30, 0.0]]))
    up = POSE.rotation[:, 2]
    facts = scale_facts(Scale(37.0, 0.002, "table", up, np.append(up, -up @ corners[0]), corners))
    with workspace.writing("scale") as made:
        (made / "scale.json").write_text(json_text(facts | {"evidence": {"edge_support": [0.9, 0.8, 0.9, 0.7]}}))
        write_image(made / "table_0.jpg", photos[0])
    record(workspace, "scale")
    traits.run(workspace, resolve("traits"))
    record(workspace, "traits")
    assert list(MODULES) == list(STAGE_OPTIONS)
    return workspace
