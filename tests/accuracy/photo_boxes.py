# SPDX-License-Identifier: Apache-2.0
"""Instances found in photos of cotton beside boxes that people drew around the bolls.

    python tests/accuracy/photo_boxes.py FOLDER [FOLDER ...] [--backend bolls|lint-colour] [--weights FILE] ...

A folder holds images/ and labels/, a YOLO text file an image: class, then cx cy w h or the corners of an outline, whose
box is used, in shares of the image's size. An image without a text file has no bolls. All classes count.

Prints precision, recall and F1 of the boxes around what is found, by the width of the boxes. In each image, found and
true boxes are matched one to one, the largest IoU first, as evaluate_masks matches masks. Of a range of widths, true
boxes outside it are neither missed nor, where one is hit, false; nor are found ones outside it that hit none within.

Of a folder without labels/, which should show no open boll, the share of images in which one is found. All px are those
of images whose longer side is --max-side, larger or smaller than the photo's.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from lint_by_colour import lint_score
from markdown_tables import markdown
from numpy.typing import NDArray

from cotton3dg.io.images import list_images, read_image, write_image

Find = Callable[[NDArray[np.uint8]], NDArray[np.uint16]]
"""(H, W, 3) RGB -> instance ids (H, W), 0 = background."""
Boxes = NDArray[np.float64]
"""(N, 4) left, top, right, bottom, px."""

THRESHOLDS = (0.3, 0.5)
"""IoU of a hit. A box drawn by hand takes in more or less of the bur, so that 0.75 would judge the drawing."""
LEAST_COLOUR_PX = 9
"""Fewest pixels of lint's colour that are an instance; what is smaller is mostly noise."""
YELLOW, GREEN, RED = (255, 220, 0), (0, 220, 0), (255, 0, 0)


def open_detector(backend: str, weights: Path | None) -> Find:
    """The function that finds bolls in an image. weights: of the network, None = its own; colour needs none."""
    if backend == "lint-colour":
        return find_lint_colour
    from cotton3dg.masks.bolls import open_bolls
    from cotton3dg.masks.single_image import find_bolls

    network = open_bolls(weights)
    return lambda image: find_bolls(image, network)[0]


def find_lint_colour(image: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Connected pixels of lint's colour: what can be had from one image without weights."""
    import cv2

    lint = (lint_score(image) > 0.5).astype(np.uint8)
    _, pieces, stats, _ = cv2.connectedComponentsWithStats(lint, connectivity=8)
    kept = stats[:, cv2.CC_STAT_AREA] >= LEAST_COLOUR_PX
    kept[0] = False  # the background
    return np.where(kept, np.cumsum(kept), 0)[pieces].astype(np.uint16)


def fit_image(image: NDArray[np.uint8], max_side: int) -> NDArray[np.uint8]:
    """The image (H, W, 3) with a longer side of `max_side` px."""
    import cv2

    factor = max_side / max(image.shape[:2])
    size = [max(round(factor * side), 1) for side in image.shape[1::-1]]
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC).astype(np.uint8)


def read_boxes(path: Path, height: int, width: int) -> Boxes:
    """True boxes of an image of this size, px, cut off at its border."""
    boxes = []
    for line in path.read_text(encoding="utf-8").split("\n") if path.is_file() else []:
        values = np.array(line.split()[1:], np.float64).reshape(-1, 2)
        if len(values) == 2:  # centre and size
            values = values[0] + np.array([[-0.5], [0.5]]) * values[1]
        if len(values):
            boxes.append(np.concatenate([values.min(axis=0), values.max(axis=0)]).clip(0, 1) * ((width, height) * 2))
    return np.array(boxes, np.float64).reshape(-1, 4)


def enclose(ids: NDArray[np.uint16]) -> Boxes:
    """Boxes around the instances of (H, W) ids."""
    from scipy.ndimage import find_objects

    places = [(x.start, y.start, x.stop, y.stop) for y, x in filter(None, find_objects(ids.astype(np.int32)))]
    return np.array(places, np.float64).reshape(-1, 4)


def match_boxes(found: Boxes, true: Boxes) -> list[tuple[float, int, int]]:
    """Pairs of overlapping boxes (N, 4), each box in one at most: IoU, index of the found one, of the true one."""
    sides = np.minimum(found[:, None, 2:], true[:, 2:]) - np.maximum(found[:, None, :2], true[:, :2])
    both = sides.clip(0).prod(axis=2)
    areas = [(boxes[:, 2:] - boxes[:, :2]).prod(axis=1) for boxes in (found, true)]
    ious = both / np.maximum(areas[0][:, None] + areas[1] - both, 1e-9)
    pairs = []
    while ious.size and ious.max() > 0:
        mine, theirs = (int(index) for index in np.unravel_index(ious.argmax(), ious.shape))
        pairs.append((float(ious[mine, theirs]), mine, theirs))
        ious[mine] = ious[:, theirs] = 0
    return pairs


def compare(found: Boxes, true: Boxes) -> NDArray[np.float64]:
    """A row a pair or a box without partner: IoU (0 without), width of the found and the true box, px (0 without)."""
    mine, theirs = found[:, 2] - found[:, 0], true[:, 2] - true[:, 0]
    rows = []
    for iou, i, j in match_boxes(found, true):
        rows.append((iou, mine[i], theirs[j]))
        mine[i] = theirs[j] = 0
    rows += [(0.0, width, 0.0) for width in mine[mine > 0]] + [(0.0, 0.0, width) for width in theirs[theirs > 0]]
    return np.array(rows, np.float64).reshape(-1, 3)


def score(rows: NDArray[np.float64], iou: float, low: float, high: float) -> dict[str, float]:
    """Precision, recall and F1 of boxes wider than `low` px, up to `high`; NaN where there are none."""
    ours, theirs = ((low < widths) & (widths <= high) for widths in rows[:, 1:].T)
    near = rows[:, 0] >= iou
    hits, n_true = int((near & theirs).sum()), int(theirs.sum())
    n_found = hits + int((~near & ours).sum())
    shares = {"precision": (hits, n_found), "recall": (hits, n_true), "F1": (2 * hits, n_found + n_true)}
    return {name: part / whole if whole else math.nan for name, (part, whole) in shares.items()}


def tabulate(judged: dict[str, list[NDArray[np.float64]]], min_width: float) -> pd.DataFrame:
    """A row a folder and range of widths; `judged`: the rows of `compare` of each image, by folder."""
    ranges = {"all": (0.0, math.inf), "<40": (0.0, 40.0), "40-80": (40.0, 80.0), ">80": (80.0, math.inf)}
    ranges[f">{min_width:g}"] = (min_width, math.inf)
    lines = []
    for folder, images in judged.items():
        rows = np.concatenate(images)
        for name, (low, high) in ranges.items():
            n_true = int(((low < rows[:, 2]) & (rows[:, 2] <= high)).sum())
            line: dict[str, object] = {"folder": folder, "images": len(images), "width, px": name, "boxes": n_true}
            for iou in THRESHOLDS:
                line |= {f"{what} at {iou}": value for what, value in score(rows, iou, low, high).items()}
            lines.append(line)
    return pd.DataFrame(lines)


def draw_boxes(image: NDArray[np.uint8], found: Boxes, true: Boxes) -> NDArray[np.uint8]:
    """The image with true boxes yellow, found ones green where they hit at the lowest threshold and red elsewhere."""
    import cv2

    drawn, hits = image.copy(), {i for iou, i, _ in match_boxes(found, true) if iou >= THRESHOLDS[0]}
    coloured = [(box, YELLOW) for box in true] + [(box, GREEN if i in hits else RED) for i, box in enumerate(found)]
    for box, colour in coloured:
        left, top, right, bottom = box.round().astype(int).tolist()
        cv2.rectangle(drawn, (left, top), (right - 1, bottom - 1), colour, 1)
    return drawn


def walk(folder: Path, find: Find, wanted: argparse.Namespace) -> Iterator[tuple[Boxes, NDArray[np.uint16]]]:
    """True boxes and found ids of each image, evenly chosen where there are more than --limit; draws the overlays."""
    paths = list_images(folder / "images")
    for chosen in np.linspace(0, len(paths) - 1, min(wanted.limit or len(paths), len(paths))).round().astype(int):
        stem, image = paths[chosen].stem, fit_image(read_image(paths[chosen]), wanted.max_side)
        true, ids = read_boxes(folder / "labels" / f"{stem}.txt", *image.shape[:2]), find(image)
        if wanted.overlays:
            (wanted.overlays / folder.name).mkdir(parents=True, exist_ok=True)
            write_image(wanted.overlays / folder.name / f"{stem}.jpg", draw_boxes(image, enclose(ids), true))
        yield true, ids


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
    parser.add_argument("--backend", choices=("bolls", "lint-colour"), default="bolls")
    parser.add_argument("--weights", type=Path, help="of --backend bolls; its own without")
    parser.add_argument("--max-side", type=int, default=960, help="longer side that images are scaled to, px")
    parser.add_argument("--min-width", type=float, default=80.0, help="also score boxes wider than this alone, px")
    parser.add_argument("--least-px", type=int, default=0, help="smallest false alarm where there are no labels")
    parser.add_argument("--limit", type=int, help="images a folder at most")
    parser.add_argument("--overlays", type=Path, metavar="DIR", help="put the images with their boxes there")
    wanted = parser.parse_args()
    if len({folder.name for folder in wanted.folders}) < len(wanted.folders):
        parser.error("the tables name folders by their last part; two are alike")
    find = open_detector(wanted.backend, wanted.weights)
    judged: dict[str, list[NDArray[np.float64]]] = {}
    alarms = []
    for folder in wanted.folders:
        if (folder / "labels").is_dir():
            judged[folder.name] = [compare(enclose(ids), true) for true, ids in walk(folder, find, wanted)]
        else:
            largest = [max(np.bincount(ids.ravel())[1:], default=0) for _, ids in walk(folder, find, wanted)]
            share = 100 * np.mean([px >= max(wanted.least_px, 1) for px in largest])
            alarms.append({"folder": folder.name, "images": len(largest), "images with an instance, %": share})
    if len(judged) > 1:
        judged["together"] = [rows for images in judged.values() for rows in images]
    for table, digits in ((tabulate(judged, wanted.min_width), 3), (pd.DataFrame(alarms), 1)):
        if len(table):
            print(markdown(table, digits))


if __name__ == "__main__":
    main()
