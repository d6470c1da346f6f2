"""cotton3dg: cotton plant traits from a smartphone video.

The names below are the public API (docs/python.md); each is imported when it is first used, so that `import cotton3dg`
and the command line start at once. `Workspace` and `run` work on a plant's folder as the command line does; the others
are the pure functions of each stage, on arrays and on the types of `core`, and readers and writers of the files.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

_HOMES = {
    "core.bolls": ("BollInstance", "LiftedMasks", "MaskSet"),
    "core.measurements": ("BollTraits", "PlantTraits", "Scale"),
    "core.scene": ("Camera", "Gaussians"),
    "errors": ("Cotton3dgError",),
    "evaluate": ("compare_bolls",),
    "evaluate_masks": ("score_masks",),
    "files.annotations": ("read_masks",),
    "files.bolls": ("boll_labels", "read_bolls", "read_lifted"),
    "files.colmap": ("read_cameras", "read_points"),
    "files.images": ("read_ids", "read_image", "write_ids", "write_image"),
    "files.ply": ("coloured", "read_gaussians", "write_gaussians"),
    "files.reconstruction": ("ReconstructionSettings", "reconstruct", "undistort"),
    "files.scale": ("read_scale",),
    "options": ("resolve",),
    "pipeline": ("plan", "run", "stage_options", "status"),
    "plant.capture": ("blur", "sharpness", "spread_frames"),
    "plant.dbscan": ("cluster_objects",),
    "plant.detect_lint": ("detect_lint",),
    "plant.isolate": ("isolate_plant",),
    "plant.lift": ("ViewWeights", "lift", "rim_width_px", "with_rim", "within_orbit"),
    "plant.measure": ("measure_bolls", "measure_silhouette", "summarise_plant"),
    "plant.merge": ("merge_views",),
    "plant.orbit": ("image_pairs",),
    "plant.surface": ("as_drawn",),
    "plant.table": ("TableFit", "find_table", "scale_from_table"),
    "plant.views": ("azimuths", "evenly_spaced", "fit_orbit"),
    "splat.fit": ("fit",),
    "splat.initialise": ("starting_gaussians",),
    "splat.metrics": ("focus", "psnr_db"),
    "splat.ops": ("accumulate_weights", "render", "render_values"),
    "splat.views": ("View",),
    "workspace": ("Workspace",),
}
"""Module -> public names; __init__.pyi tells type checkers the same."""

_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value = getattr(importlib.import_module(f".{_HOME_OF[name]}", __name__), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME_OF})
