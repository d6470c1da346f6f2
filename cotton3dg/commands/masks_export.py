# SPDX-License-Identifier: Apache-2.0
"""The masks of a plant as COCO, for annotation tools. Not a stage of the pipeline: no stage reads it.

    annotations/  bolls.json (polygons)   images/ (undistorted, as the masks)

Correct them in the tool, export COCO, Labelme or YOLO labels, and hand that to `masks --backend import --source` or to
`masks-train --annotations`.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from ..errors import MissingInput
from ..io.coco import coco_document
from ..io.colmap import read_cameras
from ..io.images import read_ids
from ..io.saving import json_text
from ..outputs import made_of, note_all, refuse_changed
from ..schemas.masks import MasksInfo
from ..staleness import id_image
from ..workspace import Workspace


def export(workspace: Workspace) -> Path:
    """Write annotations/.

    Returns:
        The COCO file.
    Raises:
        MissingInput: there are no masks.
        BadUsage: somebody has changed the masks of an earlier export.
    """
    masks = MasksInfo.load(workspace.require(workspace.masks_json, "masks"))
    cameras = {camera.name for camera in read_cameras(workspace.require(workspace.undistorted / "sparse", "sfm"))}
    names = [image.name for image in masks.images]
    if missing := sorted(set(names) - cameras):
        raise MissingInput(f"the image {missing[0]} of the masks is gone; run `cotton3dg masks` again")
    final = workspace.annotations_json
    refuse_changed(final.parent)
    with workspace.writing("annotations") as folder:
        (folder / "images").mkdir()
        for name in names:
            shutil.copyfile(workspace.undistorted_image(name), folder / "images" / Path(name).name)
        png_of = id_image(workspace)
        coco = coco_document({name: read_ids(png_of(name)) for name in names})
        (folder / final.name).write_text(json_text(coco), encoding="utf-8")
        note_all(folder, made_of("masks-export", workspace.root))
    return final
