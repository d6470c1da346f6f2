# SPDX-License-Identifier: Apache-2.0
"""cotton3dg: cotton plant traits from a smartphone video.

The names below are the public API (docs/python.md); each is imported when it is first used, so that `import cotton3dg`
and the command line start at once. `measure` and `measure_many` do what the commands `run` and `batch` do; the others
are the pure functions of each stage, on arrays and on the types of `core`, and readers and writers of the files.
"""

from __future__ import annotations

import importlib
from typing import Any, Final

__version__ = "0.1.0"

_HOMES: Final = {
    "cluster.consensus": ("merge_views",),
    "cluster.dbscan": ("cluster_objects",),
    "cluster.locate_bolls": ("locate_bolls",),
    "core.bolls": ("BollInstance", "LiftedMasks", "MaskSet"),
    "core.measurements": ("BollTraits", "PlantTraits", "Scale"),
    "core.scene": ("Camera", "Gaussians"),
    "errors": ("Cotton3dgError",),
    "evaluation.masks": ("score_masks",),
    "evaluation.plant": ("compare_bolls",),
    "frames.frame_quality": ("blur", "sharpness"),
    "frames.keyframe_buffer": ("select_keyframes",),
    "gaussians.metrics": ("psnr_db",),
    "gaussians.rasterizer": ("accumulate_weights", "render", "render_values"),
    "gaussians.views": ("View",),
    "geometry.camera_orbit": ("azimuths", "evenly_spaced", "fit_orbit", "within_orbit"),
    "io.annotations": ("read_masks",),
    "io.colmap": ("read_cameras", "read_points"),
    "io.images": ("read_ids", "read_image", "write_ids", "write_image"),
    "io.ply": ("recolour", "read_gaussians", "write_gaussians"),
    "masks.bolls": ("open_bolls",),
    "measurement": ("Measurement", "measure", "measure_many"),
    "options": ("resolve",),
    "pipeline": ("plan", "run", "stage_options", "status"),
    "scale.table": ("TableFit", "find_table", "scale_from_table"),
    "schemas.bolls": ("boll_labels", "read_bolls", "read_lifted"),
    "schemas.scale": ("read_scale",),
    "segment.lint_share": ("gather_lint",),
    "segment.lift": ("ViewWeights", "lift", "rim_width_px", "mark_rim"),
    "sfm.image_pairs": ("choose_pairs",),
    "sfm.lens": ("undistort",),
    "sfm.reconstruction": ("ReconstructionSettings", "reconstruct"),
    "train.initialise": ("start_gaussians",),
    "train.trainer": ("fit",),
    "traits.boll_volume": ("measure_bolls",),
    "traits.measure": ("summarise_plant",),
    "traits.plant_segmentation": ("isolate_plant",),
    "traits.plant_size": ("measure_silhouette",),
    "traits.surface": ("dilate_gaussians",),
    "workspace": ("Workspace",),
}
"""Module -> public names; __init__.pyi tells type checkers the same."""

_HOME_OF: Final = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value = getattr(importlib.import_module(f".{_HOME_OF[name]}", __name__), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME_OF})
