# SPDX-License-Identifier: Apache-2.0
"""Four pictures of one view of a finished plant: photo, model, masks, and the model coloured by boll.

python examples/picture.py plant_dir picture.jpg
"""

import json
import sys
from pathlib import Path

import numpy as np

from cotton3dg.gaussians.rasterizer import render
from cotton3dg.io.colmap import read_cameras
from cotton3dg.io.images import read_ids, read_image, write_image
from cotton3dg.io.ply import read_gaussians
from cotton3dg.report.figures import outline_masks
from cotton3dg.workspace import Workspace


def eight_bit(image: np.ndarray) -> np.ndarray:
    return np.rint(np.clip(image, 0, 1) * 255).astype(np.uint8)


def picture(plant_dir: Path) -> np.ndarray:
    """(2 H, 2 W, 3) from the first image that has masks."""
    workspace = Workspace(plant_dir)
    name = next(iter(json.loads(workspace.masks_json.read_text())["images"]))["name"]
    camera = next(c for c in read_cameras(workspace.undistorted / "sparse") if c.name == name)
    photo = read_image(workspace.undistorted_image(name))
    model = eight_bit(render(read_gaussians(workspace.gaussians_ply), camera).image)
    ids = read_ids(workspace.mask_png(name))
    masks = outline_masks(photo, ids, {boll: boll for boll in np.unique(ids)})
    bolls = eight_bit(render(read_gaussians(workspace.bolls_ply), camera).image)
    return np.vstack([np.hstack([photo, model]), np.hstack([masks, bolls])])


if __name__ == "__main__":
    write_image(Path(sys.argv[2]), picture(Path(sys.argv[1])))
