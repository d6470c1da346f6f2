"""Corrections of a plant's bolls: taken from the report's page or the command line, kept, and replayed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .. import pipeline
from ..documents.bolls import read_bolls
from ..documents.corrections import Correction, Corrections, Pick, Place
from ..documents.scale import read_scale
from ..errors import BadInput, BadUsage, MissingInput
from ..files.colmap import read_cameras
from ..files.saving import explain_disk_errors
from ..files.tables import parse_number, read_rows
from ..geometry.triangulation import triangulate
from ..options import recorded
from ..stages.stage import STAGES
from ..workspace import Workspace

PICK_PX = 6.0
"""Farther from the place that the others agree on, a pick is a slip."""


@dataclass(frozen=True)
class Asked:
    """What is to be done with a plant's corrections."""

    file: Path | None = None
    """Saved by the report's page."""
    merge: Sequence[str] = ()
    """Numbers of bolls by comma."""
    split: Sequence[int] = ()
    delete: Sequence[int] = ()
    branch: Sequence[int] = ()
    add: Sequence[str] = ()
    """`IMAGE:X,Y IMAGE:X,Y`, px in undistorted images."""
    undo: bool = False


@dataclass(frozen=True)
class Outcome:
    """What came of it."""

    kept: Corrections
    refused: tuple[str, ...]
    """Those that do not apply."""
    before: float
    after: float
    """Count of bolls."""


def correct(workspace: Workspace, asked: Asked, watcher: pipeline.Watcher | None = None) -> Outcome:
    """Keep further corrections, or take the last back, and measure the bolls again with all that are kept.

    Raises:
        BadUsage: a correction that makes no sense, or a boll that is not there.
        BadInput: the file cannot be read.
        MissingInput: the plant has no result yet.
    """
    records = {stage: workspace.read_record(stage) for stage in STAGES}
    if not all(record and record.is_ok for record in records.values()):
        raise MissingInput("the plant has no finished result to correct; run `cotton3dg run` first")
    kept = Corrections.load_if_there(workspace.corrections_json) or Corrections()
    own = kept.corrections[:-1] if asked.undo else kept.corrections
    if asked.undo and not kept.corrections:
        raise BadUsage("there is no correction to take back")
    known = _Known(workspace)
    for new in (*_from_file(asked.file), *_from_words(asked)):
        if problem := new.problem():
            raise BadUsage(f"a correction makes no sense: {problem}")
        placed = known.placed(new)
        own = own if placed in own else (*own, placed)
    before = _count(workspace)
    kept = Corrections(own)
    with explain_disk_errors(workspace.root):
        if own:
            kept.save(workspace.corrections_json)
        else:
            workspace.corrections_json.unlink(missing_ok=True)
    options = {stage: recorded(stage, record.options) for stage, record in records.items() if record}
    pipeline.run(workspace, options, ("traits",), watcher=watcher, report=True)
    record = workspace.read_record("traits")
    refused = tuple(warning for warning in record.warnings if "correction not applied" in warning) if record else ()
    return Outcome(kept, refused, before, _count(workspace))


class _Known:
    """The plant's bolls as its tables and its report show them."""

    def __init__(self, workspace: Workspace):
        self.workspace = workspace
        bolls, self.model = read_bolls(*workspace.final_bolls())
        self.bolls = {boll.boll_id: boll for boll in bolls}
        rows = read_rows(workspace.bolls_csv)
        self.cm = {int(row["boll_id"]): tuple(parse_number(row[f"{axis}_cm"]) for axis in "xyz") for row in rows}

    def placed(self, correction: Correction) -> Correction:
        """The same with the places of its bolls."""
        if correction.kind == "add":
            places = correction.bolls or (self._picked(correction.picks),)
        else:
            places = tuple(self._of(place) for place in correction.bolls)
        return replace(correction, bolls=places, model=self.model)

    def _of(self, place: Place) -> Place:
        if place.centre_cm is not None or place.centre_su is not None:
            return place
        if place.boll_id not in self.bolls:
            raise BadUsage(f"there is no boll {place.boll_id}; its bolls are {', '.join(map(str, self.bolls))}")
        centre = tuple(float(x) for x in self.bolls[place.boll_id].centre)
        cm = self.cm.get(place.boll_id)
        return Place(place.boll_id, cm if cm and np.isfinite(cm).all() else None, centre)

    def _picked(self, picks: Sequence[Pick]) -> Place:
        """The place that picks in several images show."""
        sparse = self.workspace.undistorted / "sparse"
        cameras = {camera.name: camera for camera in read_cameras(self.workspace.require(sparse, "sfm"))}
        if missing := [pick.image for pick in picks if pick.image not in cameras]:
            raise BadUsage(f"{missing[0]} is no placed image; look into sfm/undistorted/images")
        pixels = np.array([(pick.x_px, pick.y_px) for pick in picks])
        views = [cameras[pick.image] for pick in picks]
        sighting = triangulate(views, pixels, tolerance_px=PICK_PX)
        if sighting is None:
            raise BadUsage("the picks do not meet in space; pick the boll's middle in two images from other sides")
        return Place(0, self._cm_of(sighting.point), tuple(float(x) for x in sighting.point))

    def _cm_of(self, point: np.ndarray) -> tuple[float, ...] | None:
        """A scene point in the plant's frame, as the other bolls tell it."""
        scale = read_scale(self.workspace.scale_json)
        known = [boll_id for boll_id, cm in self.cm.items() if boll_id in self.bolls and np.isfinite(cm).all()]
        if scale is None or not known:
            return None
        centre, cm = self.bolls[known[0]].centre, np.array(self.cm[known[0]])
        return tuple(float(x) for x in cm + (point - centre) @ scale.table_frame.T * scale.cm_per_su)


def _from_file(file: Path | None) -> tuple[Correction, ...]:
    if file is None:
        return ()
    try:
        return Corrections.parsed(json.loads(file.read_text(encoding="utf-8"))).corrections
    except (OSError, ValueError) as error:
        raise BadInput(f"{file.name} holds no corrections ({error}); save it again from the plant's report") from error


def _from_words(asked: Asked) -> list[Correction]:
    """What the command line asks for."""
    found = []
    for text in asked.merge:
        numbers = [number.strip() for number in text.split(",")]
        if not all(number.isdecimal() for number in numbers):
            raise BadUsage(f"--merge {text}: write numbers of bolls, e.g. 3,5")
        found.append(Correction("merge", tuple(Place(int(number)) for number in numbers)))
    for kind in ("split", "delete", "branch"):
        found += [Correction(kind, (Place(number),)) for number in getattr(asked, kind)]
    for text in asked.add:
        try:
            picks = []
            for word in text.split():
                image, _, place = word.rpartition(":")
                x, y = place.split(",")
                picks.append(Pick(image, float(x), float(y)))
        except ValueError:
            example = "'000000.jpg:412,530 000012.jpg:388,541'"
            raise BadUsage(f"--add {text!r}: write IMAGE:X,Y twice, e.g. {example}") from None
        found.append(Correction("add", picks=tuple(picks)))
    return found


def _count(workspace: Workspace) -> float:
    return parse_number(read_rows(workspace.traits_csv)[0]["boll_count"])
