# SPDX-License-Identifier: Apache-2.0
"""Real captures of all kinds through the program: what is placed, how like the model is, what scale comes out.

    python tests/accuracy/real_captures.py FOLDER [--only pineapple,romi] [--preset draft]

FOLDER holds the sets that there are, under these names (where to find them: docs/notes/real_captures.md); a missing one
is left out:

- `pineapple/images/`: photos of a fruit on a board of ArUco markers; half of the markers give the scale, the other half
  judges it, and the distances from marker to marker do.
- `banana/`: photos of a thing without any reference.
- `fox/images/`: frames of a phone's walk, a third of a turn around a stuffed fox.
- `romi/images/`, `romi/metadata/images/`: photos of a thin plant by an arm whose positions are known in mm.
- `cotton_1/frames/`, `cotton_1/depth/`, also `cotton_2`: frames of a film with the depth in mm that a sensor measured.
- `clips/`: phone clips with rotation tags, edit lists, HDR colours; only decoded.

A set is run to `train` in FOLDER/runs/NAME (it goes on where it ended). Writes real_captures.csv and prints a table.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pycolmap
from markdown_tables import markdown

from cotton3dg import pipeline
from cotton3dg.core.scene import Camera, Float64
from cotton3dg.errors import Cotton3dgError
from cotton3dg.io.colmap import read_cameras, read_points
from cotton3dg.io.images import list_images, read_image
from cotton3dg.io.video import probe
from cotton3dg.scale.markers import Corner, MarkerKind, find_markers, scale_from_markers
from cotton3dg.scale.references import NoReference
from cotton3dg.schemas.frames import FramesInfo
from cotton3dg.schemas.sfm import SfmInfo
from cotton3dg.schemas.train import TrainMetrics
from cotton3dg.workspace import Workspace

BOARD = MarkerKind("7x7_1000", 3.3)
BOARD_COLUMNS, BOARD_PITCH_CM = 5, 4.0
"""Of the pineapple's board: markers in a row, and from the corner of one to that of the next."""
MOST_FRAMES = 120
"""Of a long film so many, evenly spaced."""
DEPTH_CM = 0.1
"""Of one count of a depth image."""


def measured(workspace: Workspace, preset: str) -> dict[str, Any]:
    """Run to `train`; figures that every set has, or why there are none."""
    images = len(list_images(workspace.images_input))
    options = pipeline.stage_options(workspace, preset, {"frames": {"count": max(images, 8)}})
    row: dict[str, Any] = {"refused": ""}
    for stage in ("frames", "sfm", "train"):
        try:
            pipeline.run(workspace, options, (stage,))
        except Cotton3dgError as error:
            return row | {"refused": f"{stage}: {error}"}
        record = workspace.read_record(stage)
        row[f"{stage}_s"] = round(record.seconds, 1)
        if stage == "sfm":
            sfm = SfmInfo.load(workspace.sfm_json)
            row |= {"placed": f"{len(sfm.registered)}/{sfm.n_frames}", "error_px": sfm.mean_reprojection_error_px}
    metrics = TrainMetrics.load(workspace.metrics_json)
    trained = [step for step in metrics.history if step.loss is not None]
    return row | {
        "psnr_db": metrics.psnr_db,
        "plant_psnr_db": metrics.plant_psnr_db,
        "gaussians": metrics.n_gaussians,
        "loss": trained[-1].loss if trained else float("nan"),
    }


def cameras_of(workspace: Workspace) -> list[Camera]:
    return read_cameras(workspace.undistorted / "sparse")


def pineapple(workspace: Workspace, _: Path) -> dict[str, Any]:
    """Scale from the markers of even number, judged by those of odd number."""
    cameras = cameras_of(workspace)
    found = [find_markers(read_image(workspace.undistorted_image(camera.name)), BOARD) for camera in cameras]

    def half(odd: int) -> list[dict[Corner, Float64]]:
        return [{corner: place for corner, place in one.items() if corner[1] % 2 == odd} for one in found]

    fits = [scale_from_markers(cameras, half(odd), BOARD) for odd in (0, 1)]
    for fit in fits:
        if isinstance(fit, NoReference):
            return {"truth": fit.reason}
    given, judge = (fit for fit in fits if not isinstance(fit, NoReference))
    scale = given.reference.cm_per_su
    corners = list(judge.sightings)
    places = scale * np.array([judge.sightings[corner].point for corner in corners])
    true = np.array([board_cm(corner) for corner in corners])
    i, j = np.triu_indices(len(corners), 1)
    ratio = np.linalg.norm(places[i] - places[j], axis=1) / np.linalg.norm(true[i] - true[j], axis=1)
    sides = np.linalg.norm(true[i] - true[j], axis=1) <= BOARD.side_cm * 1.5
    return {
        "scale_pct": 100 * float(np.median(ratio) - 1),
        "truth": f"{len(corners)} hidden corners, {len(ratio)} distances, 95 % of them within"
        f" {100 * np.quantile(np.abs(ratio[~sides] - 1), 0.95):.2f} %",
    }


def board_cm(corner: Corner) -> Float64:
    """(2,) place of a corner on the board, whose markers are numbered row by row."""
    row, column = divmod(corner[1], BOARD_COLUMNS)
    return BOARD_PITCH_CM * np.array([column, row], float) + BOARD.corner_cm(corner)


def fit_to_arm(workspace: Workspace, source: Path) -> tuple[pycolmap.Sim3d | None, Float64, Float64]:
    """The similarity from the scene to the arm's positions in cm, the cameras' centres (N, 3) and these positions."""
    files = {image.name: image.file for image in FramesInfo.load(workspace.frames_json).images}
    centres, arm = [], []
    for camera in cameras_of(workspace):
        pose = source / "metadata" / "images" / f"{Path(files[camera.name] or '').stem}.json"
        arm.append(json.loads(pose.read_text())["approximate_pose"][:3])
        centres.append(camera.centre)
    arm_cm = 0.1 * np.array(arm, np.float64)
    return pycolmap.estimate_sim3d(np.array(centres), arm_cm), np.array(centres), arm_cm


def romi(workspace: Workspace, source: Path) -> dict[str, Any]:
    """Camera centres against the arm's positions, all but a similarity."""
    fitted, centres, arm_cm = fit_to_arm(workspace, source)
    if fitted is None:
        return {"truth": "the cameras do not fit the arm's positions"}
    off = np.linalg.norm(fitted.matrix() @ np.vstack([centres.T, np.ones(len(centres))]) - arm_cm.T, axis=0)
    return {"truth": f"{fitted.scale:.4g} cm/su; camera centres {10 * np.median(off):.1f} mm off the arm's (median)"}


def cotton(workspace: Workspace, source: Path) -> dict[str, Any]:
    """Points against the sensor's depth, all but one scale."""
    files = {image.name: image.file for image in FramesInfo.load(workspace.frames_json).images}
    points, *_ = read_points(workspace.undistorted / "sparse")
    ratios, scales = [], []
    for camera in cameras_of(workspace):
        depth = DEPTH_CM * np.load(source / "depth" / f"{Path(files[camera.name] or '').stem}.npy")
        pixels, z = camera.project(points)
        u, v = (pixels * (depth.shape[1] / camera.width, depth.shape[0] / camera.height)).astype(int).T
        seen = (z > 0) & (u >= 0) & (u < depth.shape[1]) & (v >= 0) & (v < depth.shape[0])
        sensed = depth[v[seen], u[seen]]
        # Whatever stands before a point hides it; a robust ratio an image leaves such out.
        ratio = (sensed / z[seen])[sensed > 0]
        if len(ratio) >= 20:
            scales.append(float(np.median(ratio)))
            ratios.append(ratio)
    scale = float(np.median(scales))
    off = np.abs(np.concatenate(ratios) / scale - 1)
    spread = np.ptp(np.quantile(scales, [0.05, 0.95])) / scale
    return {
        "truth": f"depth {100 * np.median(off):.1f} % off (median) after one scale; the images' own scales differ by"
        f" {100 * spread:.1f} % (5 to 95 %)"
    }


TRUTHS: dict[str, Callable[[Workspace, Path], dict[str, Any]]] = {
    "pineapple": pineapple,
    "banana": lambda *_: {},
    "fox": lambda *_: {},
    "romi": romi,
    "cotton_1": cotton,
    "cotton_2": cotton,
}


def photos_of(source: Path) -> list[Path]:
    """The images of a set, evenly thinned."""
    folder = next((source / name for name in ("images", "frames") if (source / name).is_dir()), source)
    images = list_images(folder)
    return images[:: max(1, round(len(images) / MOST_FRAMES))]


def run_set(name: str, source: Path, runs: Path, preset: str) -> dict[str, Any]:
    """One row of the table."""
    (runs / name).mkdir(parents=True, exist_ok=True)
    workspace = Workspace(runs / name)
    if not workspace.images_input.is_dir():
        workspace.images_input.mkdir()
        for image in photos_of(source):
            shutil.copyfile(image, workspace.images_input / image.name)
    row = {"set": name, **measured(workspace, preset)}
    return row if row["refused"] else row | TRUTHS[name](workspace, source)


def run_clip(clip: Path, runs: Path) -> dict[str, Any]:
    """What `frames` makes of a clip: orientation, times and colours."""
    (runs / f"clip_{clip.stem}").mkdir(parents=True, exist_ok=True)
    workspace = Workspace(runs / f"clip_{clip.stem}")
    shutil.copyfile(clip, workspace.root / clip.name)
    row: dict[str, Any] = {"clip": clip.name, "refused": ""}
    try:
        facts = probe(clip)
        row |= {"shown": f"{facts.width}x{facts.height}", "rotation_deg": facts.rotation_deg, "fps": facts.fps}
        pipeline.run(workspace, pipeline.stage_options(workspace, "draft"), ("frames",))
    except Cotton3dgError as error:
        return row | {"refused": str(error)}
    info = FramesInfo.load(workspace.frames_json)
    height, width = read_image(workspace.frame_images()[0]).shape[:2]
    times = np.array([image.timestamp_s for image in info.images], float)
    return row | {
        "taken": f"{len(info.images)} of {width}x{height}",
        "seconds": f"{times[0]:.2f} to {times[-1]:.2f}",
        "ascending": bool((np.diff(times) > 0).all()),
        "colour": info.colour,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default=",".join([*TRUTHS, "clips"]))
    parser.add_argument("--preset", default="draft")
    arguments = parser.parse_args()
    asked, runs = arguments.only.split(","), arguments.folder / "runs"
    rows = []
    for name in (name for name in TRUTHS if name in asked and (arguments.folder / name).is_dir()):
        rows.append(run_set(name, arguments.folder / name, runs, arguments.preset))
        print(rows[-1], flush=True)
    if rows:
        pd.DataFrame(rows).to_csv(arguments.folder / "real_captures.csv", index=False)
        print(markdown(pd.DataFrame(rows)))
    clips = sorted((arguments.folder / "clips").glob("*")) if "clips" in asked else []
    if clips:
        decoded = pd.DataFrame([run_clip(clip, runs) for clip in clips])
        decoded.to_csv(arguments.folder / "clips.csv", index=False)
        print(markdown(decoded))


if __name__ == "__main__":
    main()
