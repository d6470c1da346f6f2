# SPDX-License-Identifier: Apache-2.0
"""Structure from motion: features found and matched by OpenCV and the core, cameras placed by COLMAP's mapper."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

from ..core.runs import Progress, Stopwatch, silent
from ..schemas.sfm import RescueStep
from .colours import colour_points
from .epipolar_consistency import contradicted_pct
from .features import Features, FeatureSettings, features_of_images
from .keyframes import (
    MODEL,
    Keyframes,
    first_keyframes,
    has_enough_images,
    images_between,
    keyframe_spacing,
    pairs_of_keyframes,
)
from .mapper import bundle_adjust, drop_lost_images, map_images, place_others, write_database
from .matching import PairMatches, find_similar_pairs, match_pairs
from .registration_recovery import Attempt, Task, recover_registration
from .stationary_camera import pairs_far_apart, require_walk


@dataclass(frozen=True)
class ReconstructionSettings:
    """The limits of structure from motion, and its prior knowledge."""

    max_features: int
    max_side: int
    """Features are looked for at this size, px."""
    seed: int
    focal_length_px: float | None = None
    """A prior, e.g. from EXIF; without one 1.2 times the longer side."""
    overlap: int = 8
    """Neighbours in time that each image of a film is matched with."""
    partners: int | None = None
    """Number of other images that each image is matched with, the most similar of `pairs`; None = all of `pairs`, as
    for a film."""

    @property
    def features(self) -> FeatureSettings:
        return FeatureSettings(self.max_features, self.max_side, far_apart=self.partners is not None)


@dataclass(frozen=True)
class Reconstructed:
    """The cameras of images and a sparse cloud of points."""

    models: list[Any]
    """pycolmap.Reconstructions, the one with the most images (then points) first, its points in colour; images without
    a finite pose are taken out. Empty when no two images fit together."""
    rescue: tuple[RescueStep, ...] = ()
    """The steps that were tried because too few images were placed at first."""
    contradicted_pct: float | None = None
    """Of the first model, as `epipolar_consistency` has it."""


def reconstruct(
    image_folder: Path,
    names: list[str],
    pairs: list[tuple[int, int]],
    work_folder: Path,
    settings: ReconstructionSettings,
    progress: Progress = silent,
    watch: Stopwatch | None = None,
    keyframes: Keyframes | None = None,
) -> Reconstructed:
    """Find the cameras of images and a sparse cloud of points; the same bits each time on one machine.

    Args:
        names: images in `image_folder`, all of one camera and one size.
        pairs: indices into `names` of the images to match with each other.
        work_folder: empty; receives the database of matches.
        keyframes: the result of `place_keyframes` with the same arguments; None = keyframes are placed here, if that is
            worth it.
    Raises:
        CaptureFailed: the camera stood still.
    """
    watch = watch or Stopwatch()
    with ThreadPoolExecutor(1) as beside:  # the mapper takes one core
        mapping = None
        if keyframes is None and has_keyframes(len(names), settings):
            folder = work_folder / "keyframes"
            keyframes = _match_keyframes(image_folder, names, pairs, folder, settings, progress, watch)
            mapping = beside.submit(_map_keyframes, keyframes, image_folder, names, settings)
        features, matches = (keyframes.features, keyframes.matches) if keyframes else ({}, {})
        others = [i for i in range(len(names)) if i not in features]
        features = features | features_of_images(image_folder, names, others, settings.features, progress)
        watch.lap("features")
        if settings.partners is not None:
            pairs = find_similar_pairs([features[i] for i in range(len(names))], pairs, settings.partners)
            watch.lap("choosing pairs")
        seen = set(keyframes.images if keyframes else ())
        pairs = [pair for pair in pairs if not seen.issuperset(pair)]
        progress(len(names) // 2, 2 * len(names), f"matching {len(pairs)} pairs of images")
        matches = dict(sorted((matches | _match(features, pairs, len(names))).items()))
        watch.lap("matching")
        if mapping:
            mapping.result()
    database = work_folder / "matches.db"
    write_database(database, image_folder, names, features, matches, settings.focal_length_px)
    models = _place_cameras(database, image_folder, names, work_folder, settings, keyframes, progress)
    watch.lap("mapping")
    overlap = settings.overlap if settings.partners is None else None
    task = Task(
        image_folder, names, work_folder, settings.features, overlap, settings.seed, settings.focal_length_px, progress
    )
    best, steps = recover_registration(task, Attempt(features, matches, models))
    if steps:
        watch.lap("rescue")
    kept = [drop_lost_images(model) for model in best.models]
    for model in kept:
        bundle_adjust(model)
    watch.lap("mapping")
    kept.sort(key=lambda model: (-model.num_reg_images(), -model.num_points3D()))
    if kept:
        colour_points(kept[0], image_folder)
        watch.lap("colours")
    contradicted = contradicted_pct(kept[0], names, best.features, best.matches) if kept else None
    return Reconstructed(kept, steps, contradicted)


def has_keyframes(images: int, settings: ReconstructionSettings) -> bool:
    """Whether some of the images are placed before the others, as in a film that has more than enough images."""
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
    Raises:
        CaptureFailed: the camera stood still.
    """
    watch = watch or Stopwatch()
    keyframes = _match_keyframes(image_folder, names, pairs, folder, settings, progress, watch)
    _map_keyframes(keyframes, image_folder, names, settings, progress)
    watch.lap("mapping")
    return keyframes


def _match_keyframes(
    image_folder: Path,
    names: list[str],
    pairs: list[tuple[int, int]],
    folder: Path,
    settings: ReconstructionSettings,
    progress: Progress,
    watch: Stopwatch,
) -> Keyframes:
    """Choose the keyframes and find their features and matches; their model follows later."""
    chosen: list[int] = []
    features: dict[int, Features] = {}
    matches: dict[tuple[int, int], PairMatches] = {}
    more = first_keyframes(len(names))
    while more:
        features |= features_of_images(image_folder, names, more, settings.features, progress)
        watch.lap("features")
        chosen = sorted([*chosen, *more])
        matches |= _match(features, pairs_of_keyframes(chosen, more, pairs), len(names))
        watch.lap("matching")
        more = images_between(chosen, matches)
    return Keyframes(tuple(chosen), features, dict(sorted(matches.items())), folder)


def _map_keyframes(
    keyframes: Keyframes,
    image_folder: Path,
    names: list[str],
    settings: ReconstructionSettings,
    progress: Progress = silent,
) -> None:
    """Write their model into their folder, if any two fit together."""
    folder, chosen = keyframes.folder, [names[i] for i in keyframes.images]
    folder.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as work:
        database = Path(work) / "matches.db"
        write_database(database, image_folder, names, keyframes.features, keyframes.matches, settings.focal_length_px)
        placed = _counted(len(names), len(names), progress)
        models = map_images(database, image_folder, Path(work), chosen, settings.seed, placed)
    if models:
        (folder / MODEL).mkdir()
        drop_lost_images(models[0]).write_binary(folder / MODEL)


def _match(
    features: dict[int, Features], pairs: list[tuple[int, int]], images: int
) -> dict[tuple[int, int], PairMatches]:
    """The pairs that fit together, in their order; matching stops if a few of them show that the camera stood still."""
    looked_at = pairs_far_apart(pairs, images)
    first = match_pairs(features, looked_at)
    require_walk(features, first)
    found = first | match_pairs(features, sorted(set(pairs) - set(looked_at)))
    return {pair: found[pair] for pair in pairs if pair in found}


def _place_cameras(
    database: Path,
    image_folder: Path,
    names: list[str],
    work_folder: Path,
    settings: ReconstructionSettings,
    keyframes: Keyframes | None,
    progress: Progress,
) -> list[Any]:
    """The models of the images, from keyframes where these suffice."""
    model = keyframes.read_model() if keyframes else None
    if keyframes and has_enough_images(model, len(keyframes.images)):
        placed = _counted(len(names) + len(keyframes.images), len(names), progress)
        whole = place_others(model, database, settings.seed, placed)
        if has_enough_images(whole, len(names)):
            return [whole]
    placed = _counted(len(names), len(names), progress)
    return map_images(database, image_folder, work_folder, names, settings.seed, placed)


def _counted(done: int, images: int, progress: Progress) -> Callable[[], None]:
    """A function to call for each placed camera, after `done` of two units of progress an image."""
    numbers = count(done + 1)
    return lambda: progress(min(next(numbers), 2 * images), 2 * images, "placing cameras")
