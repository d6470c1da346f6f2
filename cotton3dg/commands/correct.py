# SPDX-License-Identifier: Apache-2.0
"""Corrections of a plant's bolls and table: taken from the report's page or the command line, kept, and replayed."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from .. import pipeline
from ..choices import choose
from ..core.measurements import PlantFrame
from ..core.scene import Float64
from ..errors import BadInput, BadUsage, MissingInput
from ..geometry.triangulation import PickedPoint, point_of_picks
from ..io.colmap import read_cameras
from ..io.saving import explain_disk_errors
from ..io.tables import parse_number, read_rows
from ..recorded_options import recorded
from ..schemas.bolls import read_bolls
from ..schemas.corrections import CORNER, ENDS, RULER, Correction, Corrections, Pick, Place
from ..schemas.record import Choices
from ..schemas.scale import ScaleInfo
from ..schemas.train import TrainMetrics
from ..stage import STAGES
from ..text import read_text
from ..workspace import Workspace

EXAMPLE: Final = "000000.jpg:412,530 000012.jpg:388,541"


@dataclass(frozen=True)
class Asked:
    """The changes to a plant's corrections that a command asks for."""

    file: Path | None = None
    """The file that the report's page saved."""
    merge: Sequence[str] = ()
    """Numbers of bolls, separated by commas."""
    split: Sequence[int] = ()
    delete: Sequence[int] = ()
    branch: Sequence[int] = ()
    add: Sequence[str] = ()
    """`IMAGE:X,Y IMAGE:X,Y`, px in undistorted images."""
    corner: Sequence[str] = ()
    """In the same form: where a corner of the table is."""
    ruler: Sequence[str] = ()
    """In the same form: both ends, with a slash between them."""
    undo: bool = False


@dataclass(frozen=True)
class Length:
    """The length that a ruler measures."""

    length_cm: float
    error_cm: float
    """Standard error, from picks and scale."""

    def __str__(self) -> str:
        return f"{self.length_cm:.2f} ± {self.error_cm:.2f} cm"


@dataclass(frozen=True)
class Outcome:
    """The result of the corrections."""

    kept: Corrections
    refused: tuple[str, ...]
    """Corrections that do not apply."""
    lengths: tuple[Length | None, ...]
    """Lengths of the rulers that are kept; None if the ends are no longer known or the plant has no scale."""
    before: float
    after: float
    """Count of bolls after the corrections."""
    volume_before_cm3: float = math.nan
    volume_after_cm3: float = math.nan

    @property
    def change(self) -> str:
        """By what the corrections change the count and the volume."""
        bolls = f"bolls: {self.before:g} → {self.after:g}"
        if not math.isfinite(self.volume_before_cm3 + self.volume_after_cm3):
            return bolls
        volume = f"volume: {self.volume_before_cm3:.0f} → {self.volume_after_cm3:.0f} cm³"
        merged = self.after < self.before and self.kept.corrections[-1:] and self.kept.corrections[-1].kind == "merge"
        gap = " (a merged boll has one hull, with the gap between its parts)"
        return f"{bolls}, {volume}{gap if merged and self.volume_after_cm3 > self.volume_before_cm3 else ''}"

    @property
    def texts(self) -> list[str]:
        """The kept corrections in words, rulers with their lengths."""
        return _texts(self.kept, self.lengths)


def correct(workspace: Workspace, asked: Asked, watcher: pipeline.Watcher | None = None) -> Outcome:
    """Add corrections, or take back the last one, and measure the bolls again with all that are kept.

    Raises:
        BadUsage: a correction that makes no sense, a boll that is not there, or a plant of an earlier version that used
            a method which is gone.
        BadInput: the file cannot be read.
        MissingInput: the plant has no result yet.
        EnvironmentUnusable: a run of the plant is going on; nothing has changed.
    """
    records = {stage: workspace.read_record(stage) for stage in STAGES}
    if not all(record and record.is_ok for record in records.values()):
        raise MissingInput("the plant has no finished result to correct; run `cotton3dg run` first")
    options = {
        stage: recorded(stage, record.options, record.stage_version) for stage, record in records.items() if record
    }
    with workspace.locked():
        before, volume_before_cm3 = _totals(workspace)
        former, kept = _take_up(workspace, asked)
    table_moves = former.of(CORNER) != kept.of(CORNER)
    choices = choose(workspace).to_keep(STAGES)
    if table_moves:
        _scale_again(workspace, options, choices, watcher)
    # What is kept has to be measured, also if another run has begun meanwhile.
    pipeline.run(workspace, options, ("traits",), wait=True, watcher=watcher, report=True, choices=choices)
    done = [record for record in map(workspace.read_record, ("scale", "traits")) if record]
    refused = tuple(warning for record in done for warning in record.warnings if "correction not applied" in warning)
    after, volume_after_cm3 = _totals(workspace)
    return Outcome(kept, refused, _lengths(workspace, kept), before, after, volume_before_cm3, volume_after_cm3)


def kept_texts(workspace: Workspace) -> list[str]:
    """The corrections that a plant keeps in words, rulers with their lengths."""
    kept = Corrections.load_if_there(workspace.corrections_json) or Corrections()
    return _texts(kept, _lengths(workspace, kept))


def _texts(kept: Corrections, lengths: Sequence[Length | None]) -> list[str]:
    found = iter(lengths)
    return [
        f"{item.summary} {next(found) or '(its ends or the scale are not known)'}"
        if item.kind == RULER
        else item.summary
        for item in kept.corrections
    ]


def _lengths(workspace: Workspace, kept: Corrections) -> tuple[Length | None, ...]:
    """The present length of each kept ruler; None for one that is not known any more."""
    if not kept.of(RULER):
        return ()
    known = _Known(workspace)
    return tuple(known.length(ruler) for ruler in kept.of(RULER))


def _take_up(workspace: Workspace, asked: Asked) -> tuple[Corrections, Corrections]:
    """Save the plant's corrections with the changes that are asked for; return the former ones and the new ones."""
    kept = Corrections.load_if_there(workspace.corrections_json) or Corrections()
    if asked.undo and not kept.corrections:
        raise BadUsage("there is no correction to take back")
    known = _Known(workspace)
    own: tuple[Correction, ...] = ()
    # Kept corrections already have their places, unless somebody copied the page's file here.
    earlier = kept.corrections[:-1] if asked.undo else kept.corrections
    for correction in (*earlier, *_from_file(asked.file), *_from_words(asked)):
        if problem := correction.problem():
            raise BadUsage(f"a correction makes no sense: {problem}")
        if correction.model not in ("", known.model) and correction not in kept.corrections:
            raise BadUsage(f"{asked.file} is of another plant or model; give the file that this plant's report saved")
        placed = known.placed(correction)
        own = own if placed in own else (*own, placed)
    with explain_disk_errors(workspace.root):
        if own:
            Corrections(own).save(workspace.corrections_json)
        else:
            workspace.corrections_json.unlink(missing_ok=True)
    return kept, Corrections(own)


def _scale_again(
    workspace: Workspace, options: dict[str, Any], choices: Choices, watcher: pipeline.Watcher | None
) -> None:
    """Compute the scale with the kept corners; the plant's row still gives the seconds of the plant's run."""
    before = workspace.read_record("scale")
    pipeline.run(workspace, options, ("scale",), wait=True, watcher=watcher, choices=choices)
    after = workspace.read_record("scale")
    if before and after:
        workspace.write_record(replace(after, seconds=before.seconds))


class _Known:
    """The plant that its tables and its report show."""

    def __init__(self, workspace: Workspace):
        self.workspace = workspace
        bolls, self.model = read_bolls(*workspace.final_bolls())
        self.bolls = {boll.boll_id: boll for boll in bolls}
        rows = read_rows(workspace.bolls_csv)
        self.cm = {int(row["boll_id"]): tuple(parse_number(row[f"{axis}_cm"]) for axis in "xyz") for row in rows}
        sparse = workspace.require(workspace.undistorted / "sparse", "sfm")
        self.cameras = {camera.name: camera for camera in read_cameras(sparse)}
        self.scale_info = ScaleInfo.load(workspace.scale_json)

    def placed(self, correction: Correction) -> Correction:
        """The correction with the places of its bolls and the images of its picks; one that has them stays as it is.

        Raises:
            BadUsage: a boll or an image does not exist, or the picks do not meet.
        """
        if correction.model:
            return correction
        picks = tuple(self._seen(pick) for pick in correction.picks)
        places = tuple(self._of(place) for place in correction.bolls)
        if correction.kind == CORNER:
            self._meet(picks)
        elif correction.kind == RULER and not places:
            places = tuple(self._at(self._meet(replace(correction, picks=picks).of_end(end)).point) for end in ENDS)
        elif correction.kind == "add" and not places:
            places = (self._at(self._meet(picks).point),)
        return replace(correction, bolls=places, picks=picks, model=self.model)

    def length(self, ruler: Correction) -> Length | None:
        """The length that a ruler measures with the present scale."""
        scale = self.scale_info.scale
        if scale is None:
            return None
        pixel_su = TrainMetrics.load(self.workspace.metrics_json).pixel_su
        ends: list[PickedPoint | None] = []
        for number, end in enumerate(ENDS):
            picks = ruler.of_end(end)
            if picks and {pick.image for pick in picks} <= self.cameras.keys() and self.workspace.has_images(picks):
                pixels = np.array([(pick.x_px, pick.y_px) for pick in picks])
                ends.append(point_of_picks([self.cameras[pick.image] for pick in picks], pixels))
            else:
                place = ruler.bolls[number]
                known = place.centre_su if ruler.model == self.model else None
                ends.append(PickedPoint(np.array(known), pixel_su) if known else None)
        first, second = ends
        if first is None or second is None:
            return None
        length_cm = float(np.linalg.norm(first.point - second.point)) * scale.cm_per_su
        picked_cm = float(np.hypot(first.error_su, second.error_su)) * scale.cm_per_su
        return Length(length_cm, float(np.hypot(picked_cm, length_cm * scale.relative_error)))

    def _of(self, place: Place) -> Place:
        """A boll, or a place in the coordinates of the tables, in the scene and in the plant's frame."""
        if place.centre_cm is not None:
            return self._at(self._scene(place.centre_cm), place.boll_id)
        if place.boll_id not in self.bolls:
            raise BadUsage(f"there is no boll {place.boll_id}; its bolls are {', '.join(map(str, self.bolls))}")
        return self._at(self.bolls[place.boll_id].centre, place.boll_id)

    def _seen(self, pick: Pick) -> Pick:
        """The pick with its image's hash."""
        if pick.image not in self.cameras:
            raise BadUsage(f"{pick.image} is not a placed image; look into sfm/undistorted/images")
        if not self.workspace.has_images((pick,)):
            raise BadUsage(f"{pick.image} is another image now; open the plant's report anew and point again")
        (sha256,) = self.workspace.hashes(self.workspace.undistorted_image(pick.image)).values()
        return replace(pick, sha256=sha256)

    def _meet(self, picks: Sequence[Pick]) -> PickedPoint:
        """The point that picks in several images show."""
        pixels = np.array([(pick.x_px, pick.y_px) for pick in picks])
        picked = point_of_picks([self.cameras[pick.image] for pick in picks], pixels)
        if picked is None:
            raise BadUsage("the picks do not meet in space; pick the same point in two images from other sides")
        return picked

    def _at(self, point: Float64, boll_id: int = 0) -> Place:
        """A scene point, also in the plant's frame if there is one, with the scale that the stage found."""
        found = (self.scale_info.found or self.scale_info).scale
        foot, cm = self._foot(), None
        if found is not None and foot is not None:
            cm = tuple(float(x) for x in PlantFrame(found, foot).cm(point))
        return Place(boll_id, cm, tuple(float(x) for x in point))

    def _scene(self, centre_cm: Sequence[float]) -> Float64:
        """The scene point of a place that the tables give in the plant's frame."""
        scale, foot = self.scale_info.scale, self._foot()
        if scale is None or foot is None:
            raise BadUsage("the plant's frame is not known any more; open its report anew and say it again")
        return PlantFrame(scale, foot).scene(centre_cm)

    def _foot(self) -> Float64 | None:
        """(3,) su, where the stem meets the table according to the tables; None if no boll has a place."""
        scale = self.scale_info.scale
        known = [boll_id for boll_id, cm in self.cm.items() if boll_id in self.bolls and np.isfinite(cm).all()]
        if scale is None or not known:
            return None
        cm = np.array(self.cm[known[0]]) / scale.cm_per_su
        return np.asarray(self.bolls[known[0]].centre - cm @ scale.table_frame)


def _from_file(file: Path | None) -> tuple[Correction, ...]:
    if file is None:
        return ()
    if not file.is_file():
        raise MissingInput(f"{file} is not there; give the corrections.json that the plant's report saved")
    try:
        return Corrections.parsed(json.loads(read_text(file))).corrections
    except (OSError, ValueError) as error:
        raise BadInput(f"{file.name} holds no corrections ({error}); save it again from the plant's report") from error


def _from_words(asked: Asked) -> list[Correction]:
    """The corrections that the command line asks for."""
    found = []
    for text in asked.merge:
        numbers = [number.strip() for number in text.split(",")]
        if not all(number.isdecimal() for number in numbers):
            raise BadUsage(f"--merge {text}: write numbers of bolls, e.g. 3,5")
        found.append(Correction("merge", tuple(Place(int(number)) for number in numbers)))
    for kind in ("split", "delete", "branch"):
        found += [Correction(kind, (Place(number),)) for number in getattr(asked, kind)]
    for kind, texts in (("add", asked.add), (CORNER, asked.corner)):
        found += [Correction(kind, picks=_picks(f"--{kind} {text!r}", text)) for text in texts]
    for text in asked.ruler:
        ends = text.split("/")
        if len(ends) != len(ENDS):
            raise BadUsage(f"--ruler {text!r}: write both ends with a slash between them, e.g. '{EXAMPLE} / {EXAMPLE}'")
        of_ends = [_picks(f"--ruler {text!r}", word, end) for word, end in zip(ends, ENDS, strict=True)]
        found.append(Correction(RULER, picks=(*of_ends[0], *of_ends[1])))
    return found


def _picks(option: str, text: str, end: str = "") -> tuple[Pick, ...]:
    picks = []
    for word in text.split():
        image, _, place = word.rpartition(":")
        try:
            x, y = map(float, place.split(","))
        except ValueError:
            raise BadUsage(f"{option}: write IMAGE:X,Y twice, e.g. '{EXAMPLE}'") from None
        picks.append(Pick(image, x, y, end))
    return tuple(picks)


def _totals(workspace: Workspace) -> tuple[float, float]:
    """Count and volume, cm³, of the plant's bolls; NaN for what is not known."""
    (row,) = read_rows(workspace.traits_csv)
    return parse_number(row["boll_count"]), parse_number(row["boll_volume_cm3"])
