"""Structure from motion: COLMAP run on a folder of images."""

from __future__ import annotations

import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.machine import usable_cores
from ..core.progress import Progress, silent
from .images import read_image, write_image

PEAK_THRESHOLD = 0.002
"""A third of COLMAP's: a dark room's low contrast then still gives features (2110 instead of 19 in a frame with a tenth
of the light), and where light is plenty `max_features` is the limit anyway."""
CAMERA_MODEL = "SIMPLE_RADIAL"
"""One focal length and one radial term: phones correct their lenses, and more parameters can bend a closed orbit."""
NEEDLESS_RISE_PCT = 0.1
"""A lens distortion without which the mean reprojection error rises by less is left out."""


@dataclass(frozen=True)
class ReconstructionSettings:
    """What structure from motion may spend, and what is known beforehand."""

    max_features: int
    max_side: int
    """Features are looked for at this size, px."""
    seed: int
    focal_length_px: float | None = None
    """A prior, e.g. from EXIF; without one 1.2 times the longer side."""


def reconstruct(
    image_folder: Path,
    names: list[str],
    pairs: list[tuple[int, int]],
    work_folder: Path,
    settings: ReconstructionSettings,
    progress: Progress = silent,
) -> list[Any]:
    """Find the cameras of images and a sparse cloud of points; the same bits each time on one machine.

    Args:
        names: images in `image_folder`, all of one camera and one size.
        pairs: indices into `names` of the images to match with each other.
        work_folder: empty; receives the feature database.
    Returns:
        pycolmap.Reconstructions, the one with the most images (then points) first; images without a finite pose are
        taken out. Empty when no two images fit together.
    """
    import pycolmap

    pycolmap.logging.minloglevel = int(pycolmap.logging.Level.FATAL)
    pycolmap.set_random_seed(settings.seed)
    database = work_folder / "features.db"
    progress(0, 2 * len(names), "finding features")
    _find_features(image_folder, names, database, settings)
    progress(len(names) // 2, 2 * len(names), f"matching {len(pairs)} pairs of images")
    pairs_file = work_folder / "pairs.txt"
    pairs_file.write_text("".join(f"{names[i]} {names[j]}\n" for i, j in pairs))
    _match(database, pairs_file, settings)

    n_placed = 0

    def placed() -> None:
        nonlocal n_placed
        n_placed += 1
        progress(min(len(names) + n_placed, 2 * len(names)), 2 * len(names), "placing cameras")

    models = pycolmap.incremental_mapping(
        database, image_folder, work_folder, _mapping_options(settings), next_image_callback=placed
    )
    kept = [_drop_lost_images(model) for model in models.values()]
    return sorted(kept, key=lambda model: (-model.num_reg_images(), -model.num_points3D()))


def _find_features(image_folder: Path, names: list[str], database: Path, settings: ReconstructionSettings) -> None:
    import pycolmap

    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = len(usable_cores())
    options.max_image_size = settings.max_side
    options.sift.max_num_features = settings.max_features
    # Octave -1 would double the image first: four times the work for the finest, least repeatable features.
    options.sift.first_octave = 0
    options.sift.peak_threshold = PEAK_THRESHOLD
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = CAMERA_MODEL
    # Entered in order first: the threads of the extraction would number the images as they finish.
    pycolmap.Database.open(database).close()
    pycolmap.import_images(database, image_folder, pycolmap.CameraMode.SINGLE, names, reader)
    pycolmap.extract_features(
        database,
        image_folder,
        names,
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=reader,
        extraction_options=options,
        device=pycolmap.Device.cpu,
    )
    if settings.focal_length_px:
        with pycolmap.Database.open(database) as opened:
            for camera in opened.read_all_cameras():
                camera.focal_length = settings.focal_length_px
                camera.has_prior_focal_length = True
                opened.update_camera(camera)


def _match(database: Path, pairs_file: Path, settings: ReconstructionSettings) -> None:
    import pycolmap

    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = pairs_file
    matching = pycolmap.FeatureMatchingOptions()
    # Two matchers at once find other neighbours in one run of twenty. One spreads its search over all cores itself and
    # takes a sixth longer.
    matching.num_threads = 1
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = settings.seed
    pycolmap.match_image_pairs(
        database,
        matching_options=matching,
        pairing_options=pairing,
        verification_options=verification,
        device=pycolmap.Device.cpu,
    )


def _mapping_options(settings: ReconstructionSettings) -> Any:
    """COLMAP's defaults, but less patience in between; the last adjustment sets all straight.

    Neighbours are adjusted once for a new image instead of up to twice, all cameras each time the model has grown by
    80 % instead of 10 %, and adjustments stop when the cost falls by less than 1e-5 (1e-4 among neighbours).
    """
    import pycolmap

    options = pycolmap.IncrementalPipelineOptions()
    # The order of sums in bundle adjustment depends on threads; one is hardly slower and gives the same bits each time.
    options.num_threads = 1
    options.random_seed = settings.seed
    options.ba_global_frames_ratio = options.ba_global_points_ratio = 1.8
    options.ba_global_max_refinements = 2
    options.ba_global_function_tolerance = 1e-5
    options.ba_local_max_refinements = 1
    options.ba_local_function_tolerance = 1e-4
    return options


def _drop_lost_images(model: Any) -> Any:
    """The model after taking out images whose pose is not finite."""
    for image_id in list(model.reg_image_ids()):
        image = model.image(image_id)
        if not np.isfinite(image.cam_from_world().matrix()).all():
            model.deregister_frame(image.frame_id)
    return model


@dataclass(frozen=True)
class LensEvidence:
    """Whether a reconstruction needs its lens distortion."""

    rise_pct: float
    """By how much the mean reprojection error rises without."""
    corner_px: float
    """How far the distortion moves the corners of the image."""

    @property
    def on(self) -> bool:
        return not self.rise_pct < NEEDLESS_RISE_PCT


def straighten(model: Any) -> tuple[Any, LensEvidence]:
    """The reconstruction adjusted without lens distortion, and what tells whether that is allowed.

    Focal length and distortion can stand in for each other on a closed orbit: a lens without distortion is given up to
    2 % of both. The error tells: adjusted without distortion it rises by less than 0.05 % where there is none.
    """
    import pycolmap

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
    import pycolmap

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


def _through(source: Any, target: Any, places_px: NDArray) -> NDArray:
    """Places (n, 2) px of one camera in another that looks the same way."""
    rays = source.cam_from_img(places_px)
    return target.img_from_cam(np.column_stack([rays, np.ones(len(rays))]))


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

    with ThreadPoolExecutor(len(usable_cores())) as threads:
        list(threads.map(undistort_one, names))
