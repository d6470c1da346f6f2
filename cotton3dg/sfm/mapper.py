# SPDX-License-Identifier: Apache-2.0
"""COLMAP's mapper: cameras and points from features and matches, by one thread, the same bits each time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..core.libraries import import_pycolmap
from ..io.images import read_image
from .features import Features
from .matching import MIN_MATCHES, PairMatches

CAMERA_MODEL: Final = "SIMPLE_RADIAL"
"""One focal length and one radial term: phones correct their lenses, and more parameters can bend a closed orbit."""
UNKNOWN_FOCAL: Final = 1.2
"""Focal length to begin with, in longer sides of the image, as COLMAP has it."""
FINAL_TOLERANCE: Final = 1e-6
"""Relative change of the cost at which the last adjustments stop. (One of them leaves cameras 1.5 mm off, two 0.8.)"""
OUTLIER: Final = 3.0
"""Error of an observation, relative to the median error of the points, above which it is left out in the end. The
mapper keeps all within 4 px, though their mean error is a tenth of that; without the far ones cameras are a third
nearer to the truth."""


def write_database(
    path: Path,
    image_folder: Path,
    names: list[str],
    features: dict[int, Features],
    matches: dict[tuple[int, int], PairMatches],
    focal_length_px: float | None,
) -> None:
    """Write COLMAP's database of all images; for those without features it holds the name only."""
    pycolmap = import_pycolmap()

    pycolmap.logging.minloglevel = int(pycolmap.logging.Level.FATAL)
    # COLMAP's own import decodes each image to learn its size; all have that of the first.
    height, width = read_image(image_folder / names[0]).shape[:2]
    focal = focal_length_px or UNKNOWN_FOCAL * max(width, height)
    camera = pycolmap.Camera(
        model=CAMERA_MODEL,
        width=width,
        height=height,
        params=[focal, width / 2, height / 2, 0.0],
        has_prior_focal_length=focal_length_px is not None,
    )
    with pycolmap.Database.open(path) as database:
        camera.camera_id = database.write_camera(camera)
        rig = pycolmap.Rig()
        rig.add_ref_sensor(camera.sensor_id)
        rig.rig_id = database.write_rig(rig)
        ids = [_write_image(database, name, camera, rig) for name in names]
        for number, found in features.items():
            database.write_keypoints(ids[number], found.places_px)
        for (i, j), pair in matches.items():
            geometry = pycolmap.TwoViewGeometry()
            geometry.config = pycolmap.TwoViewGeometryConfiguration.UNCALIBRATED
            geometry.F = pair.fundamental
            geometry.inlier_matches = pair.rows
            database.write_two_view_geometry(ids[i], ids[j], geometry)


def _write_image(database: Any, name: str, camera: Any, rig: Any) -> int:
    """An image in a frame of its own, as COLMAP has it since there are rigs; its number."""
    pycolmap = import_pycolmap()

    image = pycolmap.Image(name=name, camera_id=camera.camera_id)
    image.image_id = database.write_image(image)
    frame = pycolmap.Frame()
    frame.rig_id = rig.rig_id
    frame.add_data_id(image.data_id)
    database.write_frame(frame)
    return int(image.image_id)


def map_images(
    database: Path,
    image_folder: Path,
    work_folder: Path,
    names: Sequence[str],
    seed: int,
    placed: Callable[[], None],
) -> list[Any]:
    """The models of some images, placed one after the other; the one with the most images first."""
    pycolmap = import_pycolmap()

    pycolmap.set_random_seed(seed)
    options = _mapping_options(seed)
    options.image_names = list(names)
    found = pycolmap.incremental_mapping(database, image_folder, work_folder, options, next_image_callback=placed)
    return sorted(found.values(), key=lambda model: -model.num_reg_images())


def map_globally(database: Path, image_folder: Path, work_folder: Path, seed: int) -> list[Any]:
    """The models that the global mapper finds, the one with the most images first; the focal length has to be known."""
    pycolmap = import_pycolmap()

    pycolmap.set_random_seed(seed)
    options = pycolmap.GlobalPipelineOptions()
    options.num_threads = options.mapper.num_threads = 1
    options.random_seed = options.mapper.random_seed = seed
    options.min_num_matches = MIN_MATCHES
    found = pycolmap.global_mapping(database, image_folder, work_folder, options)
    return sorted(found.values(), key=lambda model: -model.num_reg_images())


def place_others(model: Any, database: Path, seed: int, placed: Callable[[], None]) -> Any:
    """The model of the keyframes, joined by the other images, all adjusted together."""
    pycolmap = import_pycolmap()

    options = _mapping_options(seed)
    of_cache = pycolmap.DatabaseCacheOptions()
    of_cache.min_num_matches = MIN_MATCHES
    with pycolmap.Database.open(database) as opened:
        cache = pycolmap.DatabaseCache.create(opened, of_cache)
    mapper, triangulation = options.get_mapper(), options.get_triangulation()
    # The keyframes know the lens better than one image does.
    mapper.abs_pose_refine_focal_length = mapper.abs_pose_refine_extra_params = False
    adjustment = options.get_global_bundle_adjustment()
    adjustment.ceres.solver_options.function_tolerance = FINAL_TOLERANCE
    work = pycolmap.IncrementalMapper(cache)
    work.begin_reconstruction(model)
    for image_id in sorted(cache.images):
        if not model.image(image_id).has_pose and work.register_next_image(mapper, image_id):
            work.triangulate_image(triangulation, image_id)
            placed()
    work.iterative_global_refinement(
        options.ba_global_max_refinements, options.ba_global_max_refinement_change, mapper, adjustment, triangulation
    )
    work.end_reconstruction(False)
    return model


def bundle_adjust(model: Any) -> None:
    """Adjust all cameras and points of a pycolmap.Reconstruction once more, without observations that are far off."""
    pycolmap = import_pycolmap()

    if model.num_points3D() == 0:
        return
    model.update_point_3d_errors()
    limit_px = OUTLIER * float(np.median([point.error for point in model.points3D.values()]))
    least_angle_deg = pycolmap.IncrementalMapperOptions().filter_min_tri_angle
    pycolmap.ObservationManager(model).filter_all_points3D(limit_px, least_angle_deg)
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.reg_image_ids():
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.function_tolerance = FINAL_TOLERANCE
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()
    model.update_point_3d_errors()


def _mapping_options(seed: int) -> Any:
    """COLMAP's defaults, but with shorter adjustments in between, as the last one corrects everything.

    Neighbours are adjusted once for a new image instead of up to twice, all cameras each time the model has grown by
    80 % instead of 10 %, and adjustments stop when the cost falls by less than 1e-5 (1e-4 among neighbours).
    """
    pycolmap = import_pycolmap()

    options = pycolmap.IncrementalPipelineOptions()
    # The order of sums in bundle adjustment depends on threads; one is hardly slower and gives the same bits each time.
    options.num_threads = 1
    options.random_seed = seed
    options.extract_colors = False  # `colours` colours all points in the end
    options.ba_global_frames_ratio = options.ba_global_points_ratio = 1.8
    options.ba_global_max_refinements = 2
    options.ba_global_function_tolerance = 1e-5
    options.ba_local_max_refinements = 1
    options.ba_local_function_tolerance = 1e-4
    return options


def drop_lost_images(model: Any) -> Any:
    """The model after taking out images whose pose is not finite."""
    for image_id in list(model.reg_image_ids()):
        image = model.image(image_id)
        if not np.isfinite(image.cam_from_world().matrix()).all():
            model.deregister_frame(image.frame_id)
    return model
