# SPDX-License-Identifier: Apache-2.0
"""A reconstruction's lens distortion: whether it is needed, and images without it."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.libraries import import_pycolmap
from ..core.machine import on_all_cores
from ..io.images import read_image, write_image

NEEDLESS_RISE_PCT: Final = 0.1
"""Rise of the mean reprojection error without lens distortion, in per cent, below which the distortion is left out."""


@dataclass(frozen=True)
class LensEvidence:
    """Whether a reconstruction needs its lens distortion."""

    rise_pct: float
    """By how much the mean reprojection error rises without the distortion."""
    corner_px: float
    """How far the distortion moves the corners of the image."""

    @property
    def on(self) -> bool:
        return not self.rise_pct < NEEDLESS_RISE_PCT


def adjust_without_distortion(model: Any) -> tuple[Any, LensEvidence]:
    """The reconstruction adjusted without lens distortion, and the evidence on whether that is allowed.

    Focal length and distortion can compensate each other on a closed orbit: a lens without distortion may get up to
    2 % of both. The error decides: adjusted without distortion, it rises by less than 0.05 % where there is none.
    """
    pycolmap = import_pycolmap()

    (lens,) = model.cameras.values()
    without = pycolmap.Reconstruction(model)
    (straight,) = without.cameras.values()
    straight.params = [*lens.params[:3], 0.0]
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_extra_params = False
    options.print_summary = False
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.function_tolerance = 1e-6
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in without.reg_image_ids():
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    pycolmap.create_default_bundle_adjuster(options, config, without).solve()
    errors = []
    for each in (model, without):
        each.update_point_3d_errors()
        errors.append(each.compute_mean_reprojection_error())
    rise_pct = 100 * (errors[1] / errors[0] - 1) if errors[0] > 0 else 0.0
    corner = np.array([[lens.width, lens.height]], float)
    rays = np.column_stack([(corner - lens.params[1:3]) / lens.params[0], [1.0]])
    corner_px = float(np.linalg.norm(lens.img_from_cam(rays) - corner))
    return without, LensEvidence(rise_pct, corner_px)


def undistort(image_folder: Path, model_folder: Path, target_folder: Path) -> None:
    """Write `images/` without lens distortion and their pinhole model `sparse/` into `target_folder`.

    The pinhole shows no pixel that the lens did not see, so images may lose a little of their border. Those of a lens
    without distortion are copied, pixel for pixel.
    """
    pycolmap = import_pycolmap()

    model = pycolmap.Reconstruction(model_folder)
    ((camera_id, lens),) = model.cameras.items()
    registered = [model.image(image_id) for image_id in model.reg_image_ids()]
    images = target_folder / "images"
    images.mkdir(parents=True)
    if lens.params[3] == 0:
        focal, cx, cy, _ = lens.params
        pinhole = pycolmap.Camera(model="PINHOLE", width=lens.width, height=lens.height, params=[focal, focal, cx, cy])
        for image in registered:
            shutil.copyfile(image_folder / image.name, images / image.name)
    else:
        pinhole = pycolmap.undistort_camera(pycolmap.UndistortCameraOptions(), lens)
        _undistort_images(image_folder, [image.name for image in registered], images, lens, pinhole)
        for image in registered:
            seen_px = np.array([point.xy for point in image.points2D]).reshape(-1, 2)
            for point, place_px in zip(image.points2D, _through(lens, pinhole, seen_px), strict=True):
                point.xy = place_px
    model.cameras[camera_id] = pinhole
    (target_folder / "sparse").mkdir()
    model.write_binary(target_folder / "sparse")


def _through(source: Any, target: Any, places_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places (n, 2) px of one camera in another that looks the same way."""
    rays = source.cam_from_img(places_px)
    places: NDArray[np.float64] = target.img_from_cam(np.column_stack([rays, np.ones(len(rays))]))
    return places


def _undistort_images(source: Path, names: list[str], target: Path, lens: Any, pinhole: Any) -> None:
    """All images are of one camera, so one map moves the pixels of all: 100 take a sixth of COLMAP's time."""
    import cv2

    x, y = np.meshgrid(np.arange(pinhole.width) + 0.5, np.arange(pinhole.height) + 0.5)
    # COLMAP's (0, 0) is the corner of the first pixel, OpenCV's its middle.
    sources_px = _through(pinhole, lens, np.column_stack([x.ravel(), y.ravel()])) - 0.5
    maps = cv2.convertMaps(sources_px.reshape(*x.shape, 2).astype(np.float32), None, cv2.CV_16SC2)

    def undistort_one(name: str) -> None:
        picture = cv2.remap(read_image(source / name), *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        write_image(target / name, picture)

    on_all_cores(undistort_one, names)
