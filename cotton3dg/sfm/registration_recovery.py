# SPDX-License-Identifier: Apache-2.0
"""The steps that follow when structure from motion places too few of the images: the cheapest first, each when needed.

1. `following`: where images of a walk are lost, e.g. blurred ones, a tracker follows the features of their neighbours
   into them, and COLMAP's mapper goes on from there.
2. `markers`: where printed markers lie in view, their corners join the matches, and all images are placed again.
3. `more features`: with more features of a larger image and wider pairs, all images are matched and placed again.
4. `all at once`: COLMAP's global mapper (Pan et al. 2024, "Global structure-from-motion revisited"), once the partial
   model, or EXIF, gives the focal length.

A step counts when it places more images than those before it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..core.libraries import import_pycolmap
from ..core.runs import Progress
from ..schemas.sfm import RescueStep
from .features import Features, FeatureSettings, features_of_images, read_grey
from .image_pairs import choose_pairs
from .keyframes import has_enough_images
from .mapper import bundle_adjust, map_globally, map_images, place_others, write_database
from .marker_corners import match_marker_corners, squares_of_images
from .matching import PairMatches, match_pairs, verify
from .tracking import follow

FEW: Final = 0.8
"""Share of placed images below which the costlier steps follow."""
MORE_FEATURES: Final = 4
LARGER: Final = 2
WIDER: Final = 2
"""Factors of the number of features, of the side of the images, and of the pairs."""
FOLLOWED_OVER: Final = 2
"""Largest distance, in images, of the neighbours from which features are followed into a lost image."""
LEAST_POINTS: Final = 30
"""Least number of the model's points that a rescued image shows. The pose of an image with fewer may be far off, so it
is left out."""
MOST_FOLLOWED: Final = 2048
"""Largest number of an image's features that are followed, the best ones."""

Pairs = dict[tuple[int, int], PairMatches]


@dataclass(frozen=True)
class Task:
    """The input of structure from motion."""

    image_folder: Path
    names: list[str]
    work_folder: Path
    features: FeatureSettings
    overlap: int | None
    """Neighbours in time that images are matched with; None = they have no order."""
    seed: int
    focal_length_px: float | None = None
    progress: Progress = lambda *_: None


@dataclass(frozen=True)
class Attempt:
    """Matches, and the models made from them, the one with the most images first."""

    features: dict[int, Features]
    matches: Pairs
    models: list[Any]

    @property
    def placed(self) -> int:
        """Images of the first model."""
        return self.models[0].num_reg_images() if self.models else 0

    def lost(self, names: list[str]) -> list[int]:
        """Numbers of the images that the first model lacks."""
        kept = {self.models[0].image(i).name for i in self.models[0].reg_image_ids()} if self.models else set()
        return [number for number, name in enumerate(names) if name not in kept]


def recover_registration(task: Task, first: Attempt) -> tuple[Attempt, tuple[RescueStep, ...]]:
    """The best attempt, and the steps that were tried; none where the first attempt suffices."""
    best, steps = first, []
    for name, tried in _ladder(task):
        share = best.placed / len(task.names)
        if has_enough_images(best.models[0] if best.models else None, len(task.names)):
            break
        if name != FOLLOWING and share >= FEW:
            continue
        attempt = tried(best)
        if attempt is None:
            continue
        steps.append(RescueStep(name, best.placed, attempt.placed))
        if attempt.placed > best.placed:
            best = attempt
    return best, tuple(steps)


FOLLOWING: Final = "following"


def _ladder(task: Task) -> Iterator[tuple[str, Callable[[Attempt], Attempt | None]]]:
    yield FOLLOWING, lambda best: follow_into_lost(task, best)
    yield "markers", lambda best: place_by_markers(task, best)
    yield "more features", lambda best: retry_with_more_features(task)
    yield FOLLOWING, lambda best: follow_into_lost(task, best)
    yield "all at once", lambda best: place_globally(task, best)


def follow_into_lost(task: Task, best: Attempt) -> Attempt | None:
    """The model with the images into which features of their neighbours could be followed; None if there are none."""
    lost, n = best.lost(task.names), len(task.names)
    if task.overlap is None or not lost or len(lost) == n:
        return None
    features, matches = dict(best.features), dict(best.matches)
    grey: dict[int, Any] = {}
    for number in _outwards(lost, n):
        for step in range(-FOLLOWED_OVER, FOLLOWED_OVER + 1):
            other = (number + step) % n
            pair = (min(number, other), max(number, other))
            if step == 0 or pair in matches or not len(features[other].places_px):
                continue
            for image in pair:
                grey.setdefault(image, read_grey(task.image_folder / task.names[image]))
            rows, places = follow(grey[other], grey[number], features[other].places_px[:MOST_FOLLOWED])
            added = features[number].joined(places)
            new = np.arange(len(features[number].places_px), len(added.places_px))
            both = np.column_stack([rows, new] if other < number else [new, rows]).astype(np.uint32)
            first, second = (added if image == number else features[image] for image in pair)
            found = verify(first.places_px, second.places_px, both)
            if found is not None:
                features[number], matches[pair] = added, found
    if len(matches) == len(best.matches):
        return None
    database = _fresh(task, "followed.db")
    write_database(database, task.image_folder, task.names, features, dict(sorted(matches.items())), _focal(task, best))
    model = place_others(_copied(best.models[0], task), database, task.seed, lambda: None)
    bundle_adjust(model)
    names = {task.names[number] for number in lost}
    for image in [model.image(i) for i in model.reg_image_ids()]:
        if image.name in names and image.num_points3D < LEAST_POINTS:
            model.deregister_frame(image.frame_id)
    return Attempt(features, matches, [model, *best.models[1:]])


def _copied(model: Any, task: Task) -> Any:
    """A copy of the model with its placed images only, so that their features may differ from the others'. It goes by
    way of the disk, which drops the rest and orders the points."""
    pycolmap = import_pycolmap()

    with tempfile.TemporaryDirectory(dir=task.work_folder) as folder:
        model.write_binary(folder)
        return pycolmap.Reconstruction(folder)


def place_by_markers(task: Task, best: Attempt) -> Attempt | None:
    """Place all again, with the corners of printed markers as matches; None where they do not tie more images."""
    squares = squares_of_images(lambda number: read_grey(task.image_folder / task.names[number]), len(task.names))
    features, matches = match_marker_corners(best.features, best.matches, squares)
    if all(pair in best.matches and len(found.rows) <= len(best.matches[pair].rows) for pair, found in matches.items()):
        return None
    database = _fresh(task, "markers.db")
    write_database(database, task.image_folder, task.names, features, matches, _focal(task, best))
    models = map_images(database, task.image_folder, task.work_folder, task.names, task.seed, lambda: None)
    return Attempt(features, matches, models)


def retry_with_more_features(task: Task) -> Attempt:
    """Match and place all again with more features, of larger images, in more pairs."""
    settings = replace(task.features, most=MORE_FEATURES * task.features.most, max_side=LARGER * task.features.max_side)
    n = len(task.names)
    features = features_of_images(task.image_folder, task.names, range(n), settings, task.progress)
    overlap = WIDER * task.overlap if task.overlap is not None else n
    pairs = choose_pairs(n, overlap, task.overlap is not None)
    matches = match_pairs(features, pairs)
    database = _fresh(task, "harder.db")
    write_database(database, task.image_folder, task.names, features, matches, task.focal_length_px)
    models = map_images(database, task.image_folder, task.work_folder, task.names, task.seed, lambda: None)
    return Attempt(features, matches, models)


def place_globally(task: Task, best: Attempt) -> Attempt | None:
    """Place all cameras by the global mapper; None where no focal length is known."""
    focal_length_px = _focal(task, best)
    if focal_length_px is None:
        return None
    database = _fresh(task, "at_once.db")
    write_database(database, task.image_folder, task.names, best.features, best.matches, focal_length_px)
    models = map_globally(database, task.image_folder, task.work_folder, task.seed)
    return Attempt(best.features, best.matches, models)


def _focal(task: Task, best: Attempt) -> float | None:
    """Focal length of the partial model, or from EXIF."""
    if not best.models:
        return task.focal_length_px
    return float(next(iter(best.models[0].cameras.values())).mean_focal_length())


def _fresh(task: Task, name: str) -> Path:
    path = task.work_folder / name
    path.unlink(missing_ok=True)
    return path


def _outwards(lost: list[int], n: int) -> list[int]:
    """Lost images on a ring of n, those beside placed ones first."""
    placed = sorted(set(range(n)) - set(lost))
    distances = {i: min(min(abs(i - k), n - abs(i - k)) for k in placed) for i in lost}
    return sorted(lost, key=lambda i: (distances[i], i))
