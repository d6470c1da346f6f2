"""Quality flags in words, and what this video says about how to film the next one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..capture.frame_quality import BLURRED, DARK_HIGHLIGHT
from ..documents.frames import FramesInfo
from ..documents.scale import ScaleInfo
from ..documents.sfm import LensDecision, SfmInfo
from ..documents.train import ExposureDecision, MotionBlurFound, RollingShutterFound
from ..files.tables import flags_of
from ..splat.exposure import ALIKE
from .facts import Facts

SMALL_BOLL_PX: Final = 10.0
"""Width in the training images below which bolls can be lost."""
EXPOSURE_RATIO: Final = 1.6
"""Brightest to darkest frame; two thirds of an aperture stop."""
WIDE_GAP_DEG: Final = 20.0
FEW_SECONDS: Final = 15.0
WEAK_EDGE: Final = 0.6
"""Share of a table edge that is found in the photos."""


@dataclass(frozen=True)
class Meaning:
    """A quality flag in words."""

    title: str
    meaning: str
    action: str


FLAGS: Final = {
    "video_damaged": Meaning(
        "Part of the video is damaged",
        "Some frames could not be decoded; the rest was used.",
        "Copy the video again from the phone.",
    ),
    "blank_frames": Meaning(
        "Empty frames left out",
        "Some frames are black, white or show nothing.",
        "Nothing, if there are few; keep fingers and cloth off the lens.",
    ),
    "repeated_frames": Meaning(
        "Repeated frames left out",
        "Some frames only repeat the one before, as screen recorders and slow phones do.",
        "Nothing, if there are few; else film with the phone's own camera app.",
    ),
    "few_frames": Meaning(
        "Fewer frames than wanted",
        "The video is too short for the number of frames that was asked for, so there are fewer views of each boll.",
        "Film longer: one slow full turn of 20 to 60 s.",
    ),
    "blurred": Meaning(
        "The images are blurred",
        "Edges of bolls and of the table are soft, which makes bolls swell and merge.",
        "Walk more slowly, or film with more light.",
    ),
    "underexposed": Meaning(
        "The images are dark", "Noise hides twigs and lint loses its white.", "Switch on more light."
    ),
    "overexposed": Meaning(
        "The images are burnt out",
        "Much of the images is pure white, and lint cannot be told from it.",
        "Lower the exposure, or dim the light.",
    ),
    "few_frames_registered": Meaning(
        "Some frames could not be placed",
        "The camera's position is unknown for these frames and they were not used.",
        "Look at the walk below for where they are; walk more slowly there, or film with more light.",
    ),
    "cameras_contradicted": Meaning(
        "The cameras contradict the images",
        "Pairs of images have something in common that their cameras do not explain: something moved while filming, or"
        " much of the scene looks alike. Shapes and sizes may be wrong.",
        "Film again with the plant and everything around it at rest.",
    ),
    "orbit_gap": Meaning(
        "One side was not filmed",
        "Bolls on that side are seen from few directions: some may be missing, and volumes are less sure.",
        "Film a full turn and end where you began.",
    ),
    "plant_out_of_view": Meaning(
        "The plant left the frame",
        "In some frames the plant's middle is outside the image.",
        "Keep the plant in the middle of the image.",
    ),
    "plant_cut": Meaning(
        "The frame cuts the plant",
        "In more than a quarter of the images a part of the plant lies beyond the edge, so height and canopy may be too"
        " small, and bolls there are seen by few images. Where nearly all images cut it, height, canopy and the"
        " intervals of count and volume are blank.",
        "Step back, or hold the phone upright, until the whole plant is in view.",
    ),
    "gaussians_culled": Meaning(
        "Part of the 3D model was left out",
        "Some of its elements could not be drawn and were dropped.",
        "Compare render and photo below; if they agree, ignore this.",
    ),
    "low_psnr": Meaning(
        "The 3D model differs from the photos",
        "Renders at views that were held out are not like the photos, so sizes are less sure.",
        "Compare render and photo below; film more slowly in steady light, or try --preset paper.",
    ),
    "training_steps_rejected": Meaning(
        "Steps of the training were undone",
        "Some steps gave no finite result and were taken back.",
        "Compare render and photo below; if they agree, ignore this.",
    ),
    "no_masks": Meaning(
        "No bolls were found in the images",
        "No mask, so there is nothing to count or measure.",
        "Look at the photos: if there is open lint, try another back end (masks --backend) or import masks.",
    ),
    "no_bolls": Meaning(
        "No bolls were found in 3D",
        "No boll was seen alike by at least two views.",
        "Look at the masks below; if they are right, give more images masks (masks --views).",
    ),
    "no_scale": Meaning(
        "No scale, so no centimetres",
        "Nothing of known size was found. Bolls are counted, but volumes, height and canopy are blank.",
        "Film so that all of the table top is seen, give its size, or lay printed markers beside the plant.",
    ),
    "table_size_assumed": Meaning(
        "The size of the table was assumed",
        "No size was given, so the table is taken for one of 120 x 60 cm. If yours is another, all lengths are wrong by"
        " the same share and volumes by three times as much; the errors do not allow for it.",
        "Measure the table top and give its sides (scale.table_length_cm, scale.table_width_cm), or lay a printed"
        " marker or card beside the plant.",
    ),
    "table_edge_unclear": Meaning(
        "One edge of the table is unclear",
        "It does not stand out from what is behind it. The scale rests on the other sides and is known to about 1 %.",
        "Lay something of another colour below the table, or a printed marker on it.",
    ),
    "scale_uncertain": Meaning(
        "The scale is uncertain",
        "Lengths are known less well than to 1 %, volumes less well than to 3 %.",
        "Check the table in the pictures below, and the sizes that were given.",
    ),
    "references_disagree": Meaning(
        "References disagree about the scale",
        "Two things of known size give scales that differ by more than their errors.",
        "Measure both again with a ruler and give their true sizes.",
    ),
    "no_plant": Meaning(
        "No plant on the table",
        "Nothing stands on the plane that was taken for the table; height and canopy are blank.",
        "Check in the pictures below that the outlined table is the right one.",
    ),
    "no_stem": Meaning(
        "The foot of the stem is a guess",
        "No stem was seen to rise from the clamp. Positions of bolls may be off; sizes are not.",
        "Film closer to the foot of the plant.",
    ),
    "no_map": Meaning(
        "There is no plant map",
        "No stem can be followed up from the clamp, so stem, branches and the bolls' places on them are blank.",
        "Film so that the whole stem is seen, and take off leaves that hide it.",
    ),
    "bolls_without_volume": Meaning(
        "Some bolls have no volume",
        "They are counted, but their total volume leaves them out.",
        "Look at the flagged rows of the boll table.",
    ),
    "touching_bolls": Meaning(
        "Many bolls touch each other",
        "About one touching boll in thirty is lost in its neighbour or counted twice, and where one ends is a guess,"
        " so volumes are less sure, too.",
        "Look at the numbered bolls below; the errors of count and volume allow for it.",
    ),
    "corrections_not_applied": Meaning(
        "Some corrections do not apply",
        "A boll that was corrected is not where it was; the warnings of the stage traits name it.",
        "Look at the bolls again; correct them anew, or take the correction back (cotton3dg correct --undo).",
    ),
    "bolls_off_plant": Meaning(
        "A boll does not hang on the plant",
        "Something taken for a boll hangs on nothing that hangs together with the stem: a boll that fell, or another"
        " white thing. It has a row of its own and is neither counted nor part of volume, height and canopy.",
        "Look at the flagged bolls below. If one is a boll of this plant, delete it and add it again (cotton3dg"
        " correct); clear the table.",
    ),
    "masks_by_colour": Meaning(
        "Masks by colour alone",
        "The back end lint knows bolls by their whiteness: those that touch can merge, and shaded sides can be lost."
        " The intervals of count and volume allow for it.",
        "Use the default, the bolls' network: masks --backend bolls.",
    ),
    "lost_tips": Meaning(
        "A twig may be cut short",
        "Solid specks hang in the air beside the plant, or its ends are very faint, as where the model lacks a thin"
        " twig. Height and canopy leave them out; their intervals allow for them.",
        "Compare photo and 3D view at the tips; film closer or in better light, or raise train.max_side.",
    ),
    "thin_ends": Meaning(
        "A twig was followed in the photos",
        "The model lacks the end of a thin twig. The photos show it, and height and canopy reach to where they lose it,"
        " to about 1 cm.",
        "Look at the plant map; film closer or in better light, or raise train.max_side.",
    ),
    "halves_disagree": Meaning(
        "Half of the images count otherwise",
        "Every second image alone gives another number of bolls than the others, so the count is less sure.",
        "Look at the numbered bolls below; film more slowly in even light, or mend what is wrong (cotton3dg correct).",
    ),
    "doubtful_bolls": Meaning(
        "Many bolls are doubtful",
        "One boll in ten or more has a flag of its own, so count and volume are less sure.",
        "Look at the flagged bolls below; film more slowly in even light, or correct the masks and import them.",
    ),
}

BOLL_FLAGS: Final = {
    "parted_by_shape": "was joined with a neighbour and parted by shape; its volume is less sure",
    "joined_by_shape": "was masked as two, which lie too deep in each other to be two bolls",
    "large": "much larger than the others: perhaps two bolls in one",
    "unround": "touches another and is less round than this plant's others: perhaps two bolls in one",
    "close": "nearer to another than bolls usually are: perhaps one boll counted twice",
    "disputed": "fewer than half of the views that see it agree on it",
    "few_views": "seen by few views; it may be hidden or no boll",
    "off_plant": "hangs on nothing that hangs together with the stem: no boll of this plant; it is not counted",
    "near_clamp": "as low as the clamp, whose gleam can pass for lint: perhaps no boll",
    "too_small": "narrower than 2.5 cm: perhaps a part of a boll, or none",
    "too_large": "wider than 7 cm: perhaps two bolls in one",
    "too_few_points": "too few Gaussians for a body, so it has no volume",
    "coincident_points": "its Gaussians are all in one place, so it has no volume",
    "collinear_points": "its Gaussians lie on a line, so it has no volume",
    "flat_points": "its Gaussians lie in a plane, so it has no volume",
    "not_finite": "its Gaussians are not finite, so it has no volume",
}


@dataclass(frozen=True)
class Advice:
    """One thing about how this video was filmed."""

    good: bool
    topic: str
    text: str


def meaning(flag: str) -> Meaning:
    """A flag in words; one that is not known here under its own name."""
    return FLAGS.get(flag) or Meaning(flag.replace("_", " "), "", "See the remarks of the stages below.")


def boll_doubts(row: Mapping[str, str]) -> str:
    """The flags of a boll in words."""
    return "; ".join(BOLL_FLAGS.get(flag, flag.replace("_", " ")) for flag in flags_of(row))


def advise_on_capture(facts: Facts, bolls_px: Sequence[float] = ()) -> list[Advice]:
    """What was filmed well and what to do better, with this video's figures; what needs a change comes first.

    Args:
        bolls_px: widths of the bolls in the training images.
    """
    frames, effects = facts.frames, facts.effects
    found = _advise_on_walk(facts.sfm) if facts.sfm else []
    found += [*_advise_on_images(frames), *_advise_on_length(frames)] if frames else []
    found += _advise_on_table(facts.scale) if facts.scale else []
    if effects:
        found += [*_advise_on_exposure(effects.exposure), *_advise_on_lens(effects.distortion)]
        found += [*_advise_on_blur(effects.motion_blur), *_advise_on_shutter(effects.rolling_shutter)]
    if len(bolls_px):
        width = float(np.median(bolls_px))
        good = width >= 2 * SMALL_BOLL_PX
        remedy = "" if good else "; go closer, or raise train.max_side: below 10 px bolls can be lost"
        found.append(Advice(good, "Distance", f"A middling boll is {width:.0f} px wide in the images used{remedy}."))
    hidden = [row["boll_id"] for row in facts.bolls if "few_views" in flags_of(row)]
    if hidden:
        text = f"Few views see boll {', '.join(hidden[:8])}; raise or lower the camera a little as you walk."
        found.append(Advice(False, "Hidden bolls", text))
    return sorted(found, key=lambda item: item.good)


def _advise_on_walk(sfm: SfmInfo) -> list[Advice]:
    covered, gap = sfm.orbit_coverage_deg, sfm.orbit_largest_gap_deg
    good = covered >= 340 and gap <= WIDE_GAP_DEG
    remedy = "" if good else "; walk a full turn and end where you began"
    text = f"You walked {covered:.0f}° around the plant, the widest gap is {gap:.0f}°{remedy}."
    found = [Advice(good, "Walk", text)]
    missed, n = sfm.unregistered, sfm.n_frames
    remedy = "" if not missed else "; walk more slowly where they are, and keep plant and table in view"
    text = f"{n - len(missed)} of {n} frames could be placed{remedy}."
    found.append(Advice(not missed, "Placed frames", text))
    lost = sfm.plant_out_of_view
    if lost:
        text = f"The plant leaves the image in {len(lost)} frames, first in {lost[0]}; keep it in the middle."
        found.append(Advice(False, "Framing", text))
    return found


def _advise_on_images(frames: FramesInfo) -> list[Advice]:
    images = frames.images
    if not images:
        return []
    blurs = np.array([image.blur for image in images])
    blurred = [image for image in images if image.blur > BLURRED]
    where = ""
    if blurred:
        times = [image.timestamp_s for image in blurred if image.timestamp_s is not None]
        where = f", from {min(times):.1f} to {max(times):.1f} s of the video" if times else ""
    remedy = "; walk more slowly there or switch on more light" if blurred else ""
    text = f"{len(blurred)} of {len(images)} frames are blurred{where}{remedy} (median blur {np.median(blurs):.2f})."
    found = [Advice(not blurred, "Sharpness", text)]
    light = np.array([image.mean_luminance for image in images])
    ratio = float(np.percentile(light, 95) / max(np.percentile(light, 5), 1e-3))
    good = ratio < EXPOSURE_RATIO and float(np.median([image.highlight for image in images])) > DARK_HIGHLIGHT
    remedy = "" if good else "; lock the exposure (long press on the plant) and light it evenly"
    text = f"Mean brightness {np.median(light):.0%}, brightest to darkest frame {ratio:.1f} : 1{remedy}."
    return [*found, Advice(good, "Light", text)]


def _advise_on_exposure(found: ExposureDecision) -> list[Advice]:
    """The evidence for or against the camera's exposure having drifted, and what was done about it."""
    if found.spread_pct is None:
        return []
    size = f"{found.spread_pct:.1f} % (± {found.error_pct or 0:.1f} %)"
    if found.on:
        text = f"Exposure or white balance drifted by {size}; it was corrected. Lock the exposure when you can."
        return [Advice(False, "Exposure", text)]
    visible_pct = found.visible_from_pct or 0.0
    visible = f"{visible_pct:.0f} % begins to matter"
    if found.likeness is not None and found.spread_pct > visible_pct and found.likeness <= ALIKE:
        text = f"Things change their brightness by {size} from image to image, dark and bright ones not alike: gleams,"
        return [Advice(True, "Exposure", f"{text} not the camera; nothing was corrected.")]
    return [Advice(True, "Exposure", f"Exposure and white balance were steady: {size}, where {visible}.")]


def _advise_on_lens(found: LensDecision | None) -> list[Advice]:
    """Whether the lens was found to bend what is straight; either is fine."""
    if found is None or found.rise_pct is None:
        return []
    if found.on:
        text = f"It bends straight lines, by {found.corner_px:.1f} px in the corners; corrected."
        return [Advice(True, "Lens", text)]
    needed = f"explains {max(found.rise_pct, 0):.2f} % of the error, needed from {found.needed_from_pct:.1f} %"
    return [Advice(True, "Lens", f"Straight: a distortion {needed}. The images were used as they are.")]


def _advise_on_blur(found: MotionBlurFound | None) -> list[Advice]:
    """By how much the walk blurred the images; the model does not allow for it."""
    if found is None or math.isnan(found.median_px):
        return []
    remedy = "; walk more slowly or switch on more light" if found.found else ""
    text = (
        f"Motion blurs the middle image by {found.median_px:.1f} px and nine of ten by less than"
        f" {found.strong_px:.1f} px, where {found.visible_from_px:.0f} px begin to matter{remedy}."
    )
    return [Advice(not found.found, "Motion blur", text)]


def _advise_on_shutter(found: RollingShutterFound | None) -> list[Advice]:
    """Whether rows were read out one after another while the camera moved; the model does not allow for it."""
    if found is None or math.isnan(found.error_frames):
        return []
    if not found.found:
        text = f"None to be seen: {found.shift_px:.2f} px, where {found.visible_from_px:.1f} px begin to matter."
        return [Advice(True, "Rolling shutter", text)]
    good = found.left_px < found.visible_from_px
    remedy = "" if good else "; walk more slowly and evenly"
    text = (
        f"It moves pixels by {found.shift_px:.1f} px; the cameras' positions take up all but"
        f" {found.left_px:.2f} px{remedy}."
    )
    return [Advice(good, "Rolling shutter", text)]


def _advise_on_length(frames: FramesInfo) -> list[Advice]:
    duration_s = frames.video.duration_s if frames.video else math.nan
    if not duration_s > 0:
        return []
    good = duration_s >= FEW_SECONDS
    remedy = "" if good else "; 20 to 60 s let you choose sharp frames from more"
    return [Advice(good, "Length", f"The video is {duration_s:.0f} s long{remedy}.")]


def _advise_on_table(scale: ScaleInfo) -> list[Advice]:
    support = (scale.evidence or {}).get("edge_support", [])
    if not support:
        return []
    good = min(support) >= WEAK_EDGE
    remedy = "" if good else "; keep all four edges of the table in view, and clear them"
    text = f"Of each table edge at least {min(support):.0%} was found in the photos{remedy}."
    return [Advice(good, "Table", text)]
