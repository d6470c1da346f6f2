"""Structure from motion: features found and matched by OpenCV and the core, cameras placed by COLMAP's mapper."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..core.machine import one_thread_each, usable_cores
from ..core.progress import Progress, silent
from ..core.stopwatch import Stopwatch
from ..files.images import read_image
from .features import Features, find_features
from .keyframes import MODEL, Keyframes, keyframe_spacing, will_do
from .matching import MIN_MATCHES, PairMatches, find_alike, match

CAMERA_MODEL = "SIMPLE_RADIAL"
"""One focal length and one radial term: phones correct their lenses, and more parameters can bend a closed orbit."""
FINAL_TOLERANCE = 1e-6
"""Relative change of the cost at which the last adjustments stop. (One of them leaves cameras 1.5 mm off, two 0.8.)"""
OUTLIER = 3.0
"""Times the median error of the points: observations farther off are left out in the end. The mapper keeps all within
4 px, though their mean error is a tenth of that; without the far ones cameras are a third nearer to the truth."""


@dataclass(frozen=True)
class ReconstructionSettings:
    """What structure from motion may spend, and what is known beforehand."""

    max_features: int
    max_side: int
    """Features are looked for at this size, px."""
    seed: int
    focal_length_px: float | None = None
    """A prior, e.g. from EXIF; without one 1.2 times the longer side."""
    partners: int | None = None
    """Other images that each is matched with, the most alike of `pairs`; None = all of `pairs`, as for a film."""


def reconstruct(
    image_folder: Path,
    names: list[str],
    pairs: list[tuple[int, int]],
    work_folder: Path,
    settings: ReconstructionSettings,
    progress: Progress = silent,
    watch: Stopwatch | None = None,
    keyframes: Keyframes | None = None,
) -> list[Any]:
    """Find the cameras of images and a sparse cloud of points; the same bits each time on one machine.

    Args:
        names: images in `image_folder`, all of one camera and one size.
        pairs: indices into `names` of the images to match with each other.
        work_folder: empty; receives the database of matches.
        keyframes: what `place_keyframes` found with the same arguments; None = it is done here, if it is worth it.
    Returns:
        pycolmap.Reconstructions, the one with the most images (then points) first; images without a finite pose are
        taken out. Empty when no two images fit together.
    """
    watch = watch or Stopwatch()
    if keyframes is None and has_keyframes(len(names), settings):
        keyframes = place_keyframes(image_folder, names, pairs, work_folder / "keyframes", settings, progress, watch)
    features, matches = (keyframes.features, keyframes.matches) if keyframes else ({}, {})
    others = [i for i in range(len(names)) if i not in features]
    features = features | _find_features(image_folder, names, others, settings, progress)
    watch.lap("features")
    if settings.partners is not None:
        pairs = find_alike([features[i] for i in range(len(names))], pairs, settings.partners)
        watch.lap("choosing pairs")
    seen = set(keyframes.images if keyframes else ())
    pairs = [pair for pair in pairs if not seen.issuperset(pair)]
    progress(len(names) // 2, 2 * len(names), f"matching {len(pairs)} pairs of images")
    matches = matches | _match_pairs(features, pairs)
    watch.lap("matching")
    database = work_folder / "matches.db"
    _write_database(database, image_folder, names, features, dict(sorted(matches.items())), settings)
    models = _place_cameras(database, image_folder, names, work_folder, settings, keyframes, progress)
    kept = [_drop_lost_images(model) for model in models]
    for model in kept:
        settle(model)
    watch.lap("mapping")
    return sorted(kept, key=lambda model: (-model.num_reg_images(), -model.num_points3D()))


def has_keyframes(images: int, settings: ReconstructionSettings) -> bool:
    """Whether some of the images are placed before the others: those of a film that has more than enough."""
    return settings.partners is None and keyframe_spacing(images) > 1


def place_keyframes(
    image_folder: Path,
    names: list[str],
    pairs: list[tuple[int, int]],
    folder: Path,
    settings: ReconstructionSettings,
    progress: Progress = silent,
    watch: Stopwatch | None = None,
) -> Keyframes:
    """Find the cameras of every few images of a film; all arguments are those of `reconstruct`.

    Args:
        folder: receives the model; made if needed.
    """
    watch = watch or Stopwatch()
    chosen = range(0, len(names), keyframe_spacing(len(names)))
    features = _find_features(image_folder, names, chosen, settings, progress)
    watch.lap("features")
    both = [pair for pair in pairs if pair[0] in chosen and pair[1] in chosen]
    matches = _match_pairs(features, both)
    watch.lap("matching")
    folder.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as work:
        database = Path(work) / "matches.db"
        _write_database(database, image_folder, names, features, matches, settings)
        placed = _counted(len(names), len(names), progress)
        models = _map(database, image_folder, Path(work), [names[i] for i in chosen], settings, placed)
    if models:
        (folder / MODEL).mkdir()
        _drop_lost_images(models[0]).write_binary(folder / MODEL)
    watch.lap("mapping")
    return Keyframes(tuple(chosen), features, matches, folder)


def _find_features(
    image_folder: Path, names: list[str], chosen: Sequence[int], settings: ReconstructionSettings, progress: Progress
) -> dict[int, Features]:
    """Those of the chosen images."""

    def found(number: int) -> Features:
        grey = cv2.cvtColor(read_image(image_folder / names[number]), cv2.COLOR_RGB2GRAY)
        return find_features(grey, settings.max_features, settings.max_side, far_apart=settings.partners is not None)

    features = {}
    with one_thread_each(), ThreadPoolExecutor(len(usable_cores())) as threads:
        for done, (number, of_image) in enumerate(zip(chosen, threads.map(found, chosen), strict=True)):
            progress(done // 2, 2 * len(names), "finding features")
            features[number] = of_image
    return features


def _match_pairs(features: dict[int, Features], pairs: Sequence[tuple[int, int]]) -> dict[tuple[int, int], PairMatches]:
    """The pairs of images that fit together, with their matches."""
    with one_thread_each(), ThreadPoolExecutor(len(usable_cores())) as threads:
        found = threads.map(lambda pair: match(features[pair[0]], features[pair[1]]), pairs)
        return {pair: matches for pair, matches in zip(pairs, found, strict=True) if matches is not None}


def _write_database(
    path: Path,
    image_folder: Path,
    names: list[str],
    features: dict[int, Features],
    matches: dict[tuple[int, int], PairMatches],
    settings: ReconstructionSettings,
) -> None:
    """COLMAP's database of all images; of those without features it knows the name only."""
    import pycolmap

    pycolmap.logging.minloglevel = int(pycolmap.logging.Level.FATAL)
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = CAMERA_MODEL
    pycolmap.Database.open(path).close()
    pycolmap.import_images(path, image_folder, pycolmap.CameraMode.SINGLE, names, reader)
    with pycolmap.Database.open(path) as database:
        for camera in database.read_all_cameras() if settings.focal_length_px else ():
            camera.focal_length = settings.focal_length_px
            camera.has_prior_focal_length = True
            database.update_camera(camera)
        ids = [database.read_image_with_name(name).image_id for name in names]
        for number, found in features.items():
            database.write_keypoints(ids[number], found.places_px)
        for (i, j), pair in matches.items():
            geometry = pycolmap.TwoViewGeometry()
            geometry.config = pycolmap.TwoViewGeometryConfiguration.UNCALIBRATED
            geometry.F = pair.fundamental
            geometry.inlier_matches = pair.rows
            database.write_two_view_geometry(ids[i], ids[j], geometry)


def _place_cameras(
    database: Path,
    image_folder: Path,
    names: list[str],
    work_folder: Path,
    settings: ReconstructionSettings,
    keyframes: Keyframes | None,
    progress: Progress,
) -> list[Any]:
    """The models that there are, from keyframes where these will do."""
    model = keyframes.read_model() if keyframes else None
    if keyframes and will_do(model, len(keyframes.images)):
        placed = _counted(len(names) + len(keyframes.images), len(names), progress)
        whole = _place_others(model, database, settings, placed)
        if will_do(whole, len(names)):
            return [whole]
    placed = _counted(len(names), len(names), progress)
    return _map(database, image_folder, work_folder, names, settings, placed)


def _counted(done: int, images: int, progress: Progress) -> Callable[[], None]:
    """A function to call for each camera that is placed, once `done` of two units an image are."""
    numbers = count(done + 1)
    return lambda: progress(min(next(numbers), 2 * images), 2 * images, "placing cameras")


def _map(
    database: Path,
    image_folder: Path,
    work_folder: Path,
    names: Sequence[str],
    settings: ReconstructionSettings,
    placed: Callable[[], None],
) -> list[Any]:
    """The models of some images, placed one after the other; the one with the most images first."""
    import pycolmap

    pycolmap.set_random_seed(settings.seed)
    options = _mapping_options(settings)
    options.image_names = list(names)
    found = pycolmap.incremental_mapping(database, image_folder, work_folder, options, next_image_callback=placed)
    return sorted(found.values(), key=lambda model: -model.num_reg_images())


def _place_others(model: Any, database: Path, settings: ReconstructionSettings, placed: Callable[[], None]) -> Any:
    """The model of the keyframes, joined by the other images, all adjusted together."""
    import pycolmap

    options = _mapping_options(settings)
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


def settle(model: Any) -> None:
    """Adjust all cameras and points of a pycolmap.Reconstruction once more, without observations that are far off."""
    import pycolmap

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
