# SPDX-License-Identifier: Apache-2.0
"""What each thing that the bolls' network says is worth: masks of `bolls` without it, on plants whose bolls are known.

    python tests/accuracy/ablation.py PLANT ... [--views 36] [--without offsets sizes]

A PLANT is a folder where `cotton3dg train` is through, with `truth.json`, `cameras.json` and `instances/` in it or in
the folder given after a colon (RUN:TRUTH). Prints a table: bolls that were counted, F1 of the masks at IoU 0.5 and
mIoU, for each plant; nothing in the plants' folders changes.

classes     lint is what has its colour and brightness (`lint_by_colour.py`)
offsets     each pixel votes for the place where it is itself
sizes       each boll is as wide as the usual one of its image
lengths     parts are joined by whether their votes meet in one place alone, however wide they are together
things      white things that stand out from the plant's bolls stay
space       each image is taken alone
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from unittest import mock

import cv2
import numpy as np
import pandas as pd
from lint_by_colour import lint_score
from markdown_tables import markdown
from numpy.typing import NDArray
from true_scene import TruePlant, true_masks, true_plant

from cotton3dg.cluster import locate_bolls as locate_bolls_module
from cotton3dg.cluster import separate_bolls
from cotton3dg.cluster.locate_bolls import locate_bolls
from cotton3dg.cluster.same_boll import read_score
from cotton3dg.core.network_maps import Maps, middles_of_pixels
from cotton3dg.evaluation.masks import score_masks
from cotton3dg.gaussians.rasterizer import Window
from cotton3dg.geometry.camera_orbit import azimuths, evenly_spaced, find_up, fit_orbit, within_orbit
from cotton3dg.geometry.point_sets import weighted_median
from cotton3dg.io.colmap import read_cameras
from cotton3dg.io.images import read_image
from cotton3dg.io.ply import read_gaussians
from cotton3dg.masks.bolls import BollNetwork, open_bolls
from cotton3dg.masks.single_image import find_bolls
from cotton3dg.schemas.scale import read_scale
from cotton3dg.segment.lint_share import gather_lint

PARTS = ("classes", "offsets", "sizes", "lengths", "things", "space")


def take_away(part: str, maps: Maps, image: NDArray[np.uint8]) -> Maps:
    """Maps of an image without what the network says of one thing."""
    if part == "classes":
        small = cv2.resize(image, maps.lint.shape[::-1], interpolation=cv2.INTER_AREA).astype(np.uint8)
        score = lint_score(small).astype(np.float32)
        probabilities = np.zeros_like(maps.probabilities)
        probabilities[0], probabilities[1] = 1 - score, score
        return replace(maps, probabilities=probabilities)
    if part == "offsets":
        return replace(maps, votes=middles_of_pixels(maps.lint.shape, maps.scale))
    if part == "sizes":
        usual = weighted_median(maps.diameters.ravel(), maps.lint.ravel())
        return replace(maps, diameters=np.full_like(maps.diameters, usual))
    return maps


class Lessened:
    """A network that has said all that it will of some images, but for one thing."""

    def __init__(self, network: BollNetwork, part: str):
        self._network, self._part = network, part
        self._known: dict[int, tuple[NDArray[np.uint8], Maps]] = {}
        """With each image, so that no other gets its number."""

    def without(self, part: str) -> Lessened:
        other = Lessened(self._network, part)
        other._known = self._known
        return other

    def maps(self, image: NDArray[np.uint8], look: float = 1.0, window: Window | None = None) -> Maps:
        if look != 1:
            return take_away(self._part, self._network.maps(image, look, window), image)
        if id(image) not in self._known:
            self._known[id(image)] = image, self._network.maps(image, window=window)
        return take_away(self._part, self._known[id(image)][1], image)


def join_by_votes_alone() -> AbstractContextManager[object]:
    """Nothing else has a say."""
    terms = tuple(term for term in read_score().terms if term.name == "two_middles")
    return mock.patch.object(separate_bolls, "read_score", lambda: replace(read_score(), terms=terms))


def keep_white_things() -> AbstractContextManager[object]:
    """Nothing that was found is dropped for what it looks like."""
    return mock.patch.object(locate_bolls_module, "find_white_things", lambda sums, _: np.zeros(len(sums), bool))


def measure(plant: TruePlant, n_views: int, parts: Sequence[str]) -> Iterator[dict[str, object]]:
    """A row for each part that is left out, and first one with all."""
    cameras = read_cameras(plant.run.undistorted / "sparse")
    orbit = fit_orbit(cameras)
    views = [cameras[i] for i in evenly_spaced(azimuths(cameras, orbit), n_views)]
    images = [read_image(plant.run.undistorted_image(camera.name)) for camera in views]
    true = true_masks(plant, views)
    gaussians = read_gaussians(plant.run.gaussians_ply)
    allowed = within_orbit(gaussians.means, cameras, orbit)
    network = Lessened(open_bolls(), "")
    scale = read_scale(plant.run.scale_json) if plant.run.scale_json.is_file() else None
    cm_per_su = scale.cm_per_su if scale else None
    changes = {"lengths": join_by_votes_alone, "things": keep_white_things}
    for part in ("", *parts):
        lessened = network.without(part)
        if part == "space":
            shown = zip(images, views, strict=True)
            found = {view.name: find_bolls(image, lessened)[0] for image, view in shown if view.name in true}
            bolls = float("nan")
        else:
            maps = [lessened.maps(image) for image in images]
            shares = gather_lint(maps, views, gaussians, allowed)
            with changes.get(part, nullcontext)():
                located = locate_bolls(maps, views, gaussians, shares, find_up(views), cm_per_su)
            found, bolls = located.images, float(len(located.bolls))
        scores, miou = score_masks((found[name], true[name]) for name in true)
        yield {
            "plant": plant.run.plant_id,
            "without": part or "nothing",
            "bolls": bolls,
            "F1": next(score.f1 for score in scores if score.iou == 0.5),
            "mIoU": miou,
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plants", type=true_plant, nargs="+", metavar="PLANT")
    parser.add_argument("--views", type=int, default=36)
    parser.add_argument("--without", nargs="*", choices=PARTS, default=PARTS)
    wanted = parser.parse_args()
    rows = []
    for plant in wanted.plants:
        for row in measure(plant, wanted.views, wanted.without):
            rows.append(row)
            print(row, flush=True)
    print(markdown(pd.DataFrame(rows), digits=3))


if __name__ == "__main__":
    main()
