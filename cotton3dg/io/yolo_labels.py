# SPDX-License-Identifier: Apache-2.0
"""YOLO segmentation labels: one text file per image, one line per instance: class, then x y of its corners in shares of
the image's width and height (https://docs.ultralytics.com/datasets/segment). An empty file is an image without any.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..errors import BadInput
from ..text import read_text
from .instances import AnnotatedImage, Instance, check_size, fill_polygons, trace_outlines
from .listing import files_below

BOX_COLUMNS: Final = 5
TOLERANCE_PX: Final = 0.5
CLASS_NAMES: Final = "classes.txt"
"""File beside YOLO labels that names one class per line."""
DATA_SET: Final = "data.yaml"
"""File of an export; its `names` are the names of the classes."""
_NUMBERS: Final = re.compile(r"[\s\d.eE+-]*", re.ASCII)
_QUOTED: Final = r'"(?:[^"\\]|\\.)*"|' + r"'(?:[^']|'')*'"
_YAML_ITEM: Final = (
    r"{lead}\s*(?:-\s+|['\"]?(\d+)['\"]?\s*:\s*)?"
    rf"({_QUOTED}|[^\s{{lead}}#'\"-][^{{lead}}\n]*?)"
    r"\s*(?:#|(?={lead})|$)"
)
"""A name of a list or table behind a comma or a line's end: its number where it has one, and the name."""


def find_labels(source: Path, stems: Collection[str]) -> list[Path]:
    """The label files of an export: all below its `labels` folders if it has any, without other text files.

    Args:
        stems: of the images that labels may belong to.
    """
    texts = files_below(source, (".txt",))
    labels = [path for path in texts if "labels" in path.relative_to(source).parts[:-1]] or texts
    return [path for path in labels if path.name != CLASS_NAMES and (path.stem in stems or _is_label(path))]


def _is_label(path: Path) -> bool:
    """Whether a text is made of numbers; the notes, lists of images and names of an export are not."""
    try:
        return all(_NUMBERS.fullmatch(line) for line in read_text(path).split("\n"))
    except BadInput:
        return False


def read_class_names(folder: Path) -> dict[int, str]:
    """Number -> name of the classes, from `classes.txt` or `data.yaml`; empty if there is neither.

    Raises:
        BadInput: the encoding of the file is not known.
    """
    if (folder / CLASS_NAMES).is_file():
        lines = [line.strip() for line in read_text(folder / CLASS_NAMES).split("\n")]
        return {number: line for number, line in enumerate(lines) if line}
    if (folder / DATA_SET).is_file():
        return _yaml_names(read_text(folder / DATA_SET))
    return {}


def _yaml_names(text: str) -> dict[int, str]:
    """The `names` of a YAML document: a list or a table by number, in brackets or a line each."""
    begin = re.search(r"^names[ \t]*:[ \t]*(#.*)?", text, re.MULTILINE)
    if not begin:
        return {}
    rest = text[begin.end() :]
    # In brackets, or lines up to the next key at the left edge.
    inline = re.match(r"[\[{](.*?)[\]}]", rest, re.DOTALL)
    lead, body = (",", inline[1]) if inline else ("\n", re.split(r"\n(?=[^\s#-])", rest, maxsplit=1)[0])
    items = re.finditer(_YAML_ITEM.replace("{lead}", lead), lead + body)
    return {int(item[1] or place): _unquoted(item[2]) for place, item in enumerate(items)}


def _unquoted(text: str) -> str:
    if text.startswith('"'):
        with suppress(SyntaxError, ValueError):
            return str(ast.literal_eval(text))
        return text[1:-1]
    return text[1:-1].replace("''", "'") if text.startswith("'") else text.strip()


def read_yolo_labels(path: Path, height: int, width: int, names: Mapping[int, str]) -> AnnotatedImage:
    """The instances of one image.

    Args:
        height, width: of the image. names: of the classes, by their number; without one, the number is the name.
    Raises:
        BadInput: a line is not an outline.
    """
    check_size(height, width)
    instances = []
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        words = line.split()
        if not words:
            continue
        where = f"{path.name}, line {number}"
        if len(words) == BOX_COLUMNS:
            raise BadInput(f"{where} is a box, not an outline; export segmentation labels")
        try:
            values, label = np.array([float(word) for word in words[1:]]), int(words[0])
            # A last, odd number is the confidence of a prediction.
            score = float(values[-1]) if len(values) % 2 else 1.0
            corners = values[: len(values) // 2 * 2].reshape(-1, 2)
            if label < 0 or not np.isfinite(values).all() or (np.abs(corners - 0.5) > 1).any():
                raise ValueError(line[:40])
        except ValueError as error:
            raise BadInput(
                f"{where} is not a class and x y in shares of the image's size; export the labels again"
            ) from error
        try:
            pixels = fill_polygons([corners * (width, height)], height, width)
        except BadInput as error:
            raise BadInput(f"{where}: {error}") from error
        instances.append(Instance(names.get(label, str(label)), pixels, min(max(score, 0.0), 1.0)))
    return AnnotatedImage(height, width, instances)


def write_yolo_labels(path: Path, ids: NDArray[np.uint16]) -> None:
    """Save instance ids (H, W) as class 0; a seam joins the outlines of an instance in several pieces.

    As a line holds one outline, the pieces follow one another and each returns to where the first began.
    """
    height, width = ids.shape
    lines = []
    for value in np.unique(ids[ids > 0]).tolist():
        polygons = trace_outlines(ids == value, TOLERANCE_PX)
        if polygons:
            start = polygons[0][:1]
            chain = [np.concatenate([corners, corners[:1], start]) for corners in polygons]
            shares = np.concatenate(chain if len(chain) > 1 else polygons) / (width, height)
            lines.append("0 " + " ".join(f"{share:.6f}" for share in shares.ravel()))
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
