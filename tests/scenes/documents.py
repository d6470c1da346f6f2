# SPDX-License-Identifier: Apache-2.0
"""Documents as stages write them, of which a test gives what it is about."""

from typing import Any

import numpy as np

from cotton3dg.core.measurements import Scale
from cotton3dg.schemas.frames import FrameInfo, FramesInfo, VideoInfo
from cotton3dg.schemas.scale import ScaleInfo
from cotton3dg.schemas.sfm import LensDecision, SfmInfo
from cotton3dg.schemas.train import Effects, ExposureDecision, HeldOut, TrainMetrics
from scenes.table_scene import POSE, Pose


def frame_info(name: str, **known: Any) -> FrameInfo:
    usual = {"source_index": 0, "sharpness": 1.0, "blur": 0.2, "mean_luminance": 0.4, "highlight": 0.8}
    return FrameInfo(name, **{**usual, "black_share": 0.0, "white_share": 0.0, **known})


def frames_info(images: list[FrameInfo], ordered: bool = True, fps: float = 30.0) -> FramesInfo:
    """Of a video of 8.5 s, or of photos where there is no order."""
    facts = VideoInfo("h264", 320, 240, 0, "yuv420p", "", "", False, fps, 8.5, len(images), len(images), (), ())
    file, video = ("walk.mp4", facts) if ordered else (None, None)
    return FramesInfo("video" if ordered else "images", ordered, "as filmed", tuple(images), file=file, video=video)


def sfm_info(names: list[str], unregistered: tuple[str, ...] = (), **known: Any) -> SfmInfo:
    registered = tuple(name for name in names if name not in unregistered)
    usual: dict[str, Any] = {
        "n_frames": len(names), "registered": registered, "registered_pct": 100 * len(registered) / len(names),
        "unregistered": unregistered, "n_models": 1, "n_points": 1000, "mean_reprojection_error_px": 0.5,
        "mean_track_length": 6.0, "mean_observations": 60.0, "camera_model": "SIMPLE_RADIAL",
        "camera_params": (250.0, 160.0, 120.0, 0.0), "focal_length_px": 250.0, "orbit_coverage_deg": 360.0,
        "orbit_largest_gap_deg": 5.0, "orbit_radius_su": 1.0, "orbit_axis": (0.0, 0.0, 1.0),
        "orbit_target": (0.0, 0.0, 0.0), "distortion": LensDecision("on", on=True), "plant_out_of_view": (),
    }  # fmt: skip
    return SfmInfo(**usual | known)


def train_metrics(pixel_su: float = 1e-4, psnr_db: float = 31.0, held_out: tuple[str, ...] = ()) -> TrainMetrics:
    return TrainMetrics(
        psnr_db, 0.95, 30.5, 0.94, "all", n_gaussians=1000, steps=100, seconds=2.0, cpu_seconds=3.0, n_pruned=0,
        n_split=0, culled={}, rejected_steps=(), history=(), pixel_su=pixel_su,
        held_out=tuple(HeldOut(name, psnr_db, 0.95, 30.5, 0.94, 0.3) for name in held_out),
    )  # fmt: skip


def effects(**known: Any) -> Effects:
    return Effects(**{"exposure": ExposureDecision("off", on=False), **known})


def table_scale(pose: Pose = POSE, **evidence: Any) -> ScaleInfo:
    """Of a table of 120 x 60 cm."""
    corners = pose.scene(np.array([[-60, -30, 0], [60, -30, 0], [60, 30, 0], [-60, 30, 0.0]]))
    up = pose.rotation[:, 2]
    plane = np.append(up, -up @ corners[0])
    return ScaleInfo.of_scale(Scale(pose.cm_per_su, 0.002, "table", up, plane, corners), **evidence)
