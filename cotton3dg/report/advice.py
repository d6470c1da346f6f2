# SPDX-License-Identifier: Apache-2.0
"""Quality flags in words, and advice from this video on how to film the next one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from ..core.measurements import is_counted
from ..io.tables import flags_of, parse_number
from ..schemas.check import GREEN, VERDICTS, YELLOW, Finding
from ..schemas.sfm import LensDecision
from ..schemas.train import ExposureDecision, MotionBlurFound, RollingShutterFound
from ..train.effects.exposure import ALIKE
from ..traits.error_model import find_touching, nearest_neighbours
from .facts import Facts
from .verdicts import WELL_LIT, of_distance, of_framing, of_length, of_light, of_placed, of_scale, of_sharpness, of_walk


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
        "The video is too short for the wanted number of frames, so fewer images show each boll.",
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
        "Much of the images is pure white, and lint cannot be distinguished from it.",
        "Lower the exposure, or dim the light.",
    ),
    "few_frames_registered": Meaning(
        "Some frames could not be placed",
        "The camera's position is unknown for these frames and they were not used.",
        "Look at the walk below for where they are; walk more slowly there, or film with more light.",
    ),
    "cameras_contradicted": Meaning(
        "The cameras contradict the images",
        "Pairs of images match in a way that their cameras do not allow: something moved while filming, or much of the"
        " scene looks alike. Shapes and sizes may be wrong.",
        "Film again with the plant and everything around it at rest.",
    ),
    "orbit_gap": Meaning(
        "One side was not filmed",
        "Few images show the bolls on that side: some may be missing, and volumes are less sure.",
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
        " small, and few images show the bolls there. If nearly all images cut the plant, height, canopy and the"
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
        "Renders do not look like the photos that were held out of the training, so sizes are less sure.",
        "Compare render and photo below; film more slowly in steady light, or try --preset paper.",
    ),
    "training_steps_rejected": Meaning(
        "Steps of the training were undone",
        "Some steps gave no finite result and were taken back.",
        "Compare render and photo below; if they agree, ignore this.",
    ),
    "no_masks": Meaning(
        "No bolls were found in the images",
        "There is nothing to count or measure.",
        "Look at the photos: if there is open lint, try another back end (masks --backend) or import masks.",
    ),
    "masks_misfit": Meaning(
        "Many masks do not fit the plant",
        "Masks of several images mark different places, as those of another plant or of shifted images do. Count and"
        " volumes cannot be trusted.",
        "Look at the masks below: are they of this plant, and named like its images? Import the right ones, or take"
        " another back end (masks --backend).",
    ),
    "no_bolls": Meaning(
        "No bolls were found in 3D",
        "Several images have to agree on a boll, and they agree on none.",
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
        "Measure the table top and give its sides (“Table, cm” on the page of cotton3dg view, or"
        " scale.table_length_cm and scale.table_width_cm), or lay a printed marker or card beside the plant.",
    ),
    "table_edge_unclear": Meaning(
        "One edge of the table is unclear",
        "It does not stand out from what is behind it. The scale rests on the other sides and is known to about 1 %.",
        "Lay something of another colour below the table, or a printed marker on it.",
    ),
    "scale_uncertain": Meaning(
        "The scale is uncertain",
        "The error of lengths is above 1 %, that of volumes above 3 %.",
        "Check the table in the pictures below, and the sizes that were given.",
    ),
    "references_disagree": Meaning(
        "References disagree about the scale",
        "Two things of known size give scales that differ by more than their errors.",
        "Measure both again with a ruler and give their true sizes.",
    ),
    "no_plant": Meaning(
        "No plant on the table",
        "Nothing stands on the table that was found; height and canopy are blank.",
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
        "A touching boll may be lost in its neighbour, above all one below the other, or be counted twice. The border"
        " between two bolls is a guess, so volumes are less sure, too.",
        "Look at the bolls of least confidence in the table below; the errors of count and volume allow for it.",
    ),
    "corrections_not_applied": Meaning(
        "Some corrections do not apply",
        "A boll that was corrected is not where it was; the warnings of the stage traits name it.",
        "Look at the bolls again; correct them anew, or take the correction back (cotton3dg correct --undo).",
    ),
    "bolls_off_plant": Meaning(
        "A boll does not hang on the plant",
        "Something that looks like a boll is not connected with the stem: a fallen boll, or another white thing. It has"
        " a row of its own, but is not part of count, volume, height and canopy.",
        "Look at the flagged bolls below. If one is a boll of this plant, delete it and add it again (cotton3dg"
        " correct); clear the table.",
    ),
    "bolls_left_out": Meaning(
        "Something that may be a boll does not count",
        "Something in the images resembles a boll. But few images show it as lint, or no part of a plant is beside it."
        " The intervals of count and volume allow for it.",
        "The warning says where it is; if it is a boll, add it (cotton3dg correct).",
    ),
    "lost_tips": Meaning(
        "A twig may be cut short",
        "Solid specks hang in the air beside the plant, or its ends are very faint: perhaps the model lacks a thin"
        " twig. Height and canopy leave these out; their intervals allow for them.",
        "Compare photo and 3D view at the tips; film closer or in better light, or raise train.max_side.",
    ),
    "thin_ends": Meaning(
        "A twig was followed in the photos",
        "The model lacks the end of a thin twig, but the photos show it. Height and canopy reach to this end, to about"
        " 1 cm.",
        "Look at the plant map; film closer or in better light, or raise train.max_side.",
    ),
    "halves_disagree": Meaning(
        "Two halves of the images disagree",
        "Every second image gives another number of bolls than the other images, so the count is less sure.",
        "Look at the numbered bolls below; film more slowly in even light, or mend what is wrong (cotton3dg correct).",
    ),
    "doubtful_bolls": Meaning(
        "Many bolls are doubtful",
        "One boll in ten or more has a flag of its own, so count and volume are less sure.",
        "Look at the flagged bolls below; film more slowly in even light, or correct the masks and import them.",
    ),
    "same_film": Meaning(
        "The film of another plant",
        "Another folder of the batch holds the same film, so one of the two rows is of the wrong plant.",
        "Put each plant's own film into its folder.",
    ),
}

BOLL_FLAGS: Final = {
    "parted_by_shape": "the masks joined it with a neighbour, and its shape separated the two; its volume is less sure",
    "joined_by_shape": "the masks showed two bolls, which lie too deep in each other to be two",
    "large": "much larger than the others: perhaps two bolls in one",
    "unround": "touches another boll and is less round than the others of this plant: perhaps two bolls in one",
    "close": "nearer to another boll than usual: perhaps one boll counted twice",
    "disputed": "its confidence is below 0.5: perhaps part of a boll, or several",
    "few_views": "fewer than three images show it: perhaps hidden, perhaps no boll",
    "off_plant": "not connected with the stem: no boll of this plant, and not counted",
    "near_clamp": "as low as the clamp, which can gleam like lint: perhaps no boll",
    "too_small": "narrower than 2.5 cm: perhaps a part of a boll, or none",
    "too_large": "wider than 7 cm: perhaps two bolls in one",
    "too_few_points": "too few Gaussians for a body, so it has no volume",
    "coincident_points": "its Gaussians are all in one place, so it has no volume",
    "collinear_points": "its Gaussians lie on a line, so it has no volume",
    "flat_points": "its Gaussians lie in a plane, so it has no volume",
    "not_finite": "its Gaussians are not finite, so it has no volume",
}


FLAG_OF_BOLLS: Final[Mapping[str, Callable[[Mapping[str, str]], bool]]] = {
    "doubtful_bolls": lambda row: bool(flags_of(row)) and is_counted(flags_of(row)),
    "bolls_without_volume": lambda row: math.isnan(parse_number(row.get("volume_cm3"))),
    "bolls_off_plant": lambda row: not is_counted(flags_of(row)),
}
"""Flag of a plant -> whether it is about a boll."""
MOST_NAMED: Final = 8
LARGE: Final = {"large", "unround", "too_large"}
"""Flags of a boll that may be two."""


def meaning(flag: str) -> Meaning:
    """A flag in words; an unknown flag keeps its own name."""
    return FLAGS.get(flag) or Meaning(flag.replace("_", " "), "", "See the remarks of the stages below.")


def boll_doubts(row: Mapping[str, str]) -> str:
    """The flags of a boll in words; one that a person merged is not two because it is large."""
    merged = row.get("corrected") == "merged"
    flags = [flag for flag in flags_of(row) if not (merged and flag in LARGE)]
    return "; ".join(BOLL_FLAGS.get(flag, flag.replace("_", " ")) for flag in flags)


def flagged_bolls(facts: Facts, flag: str) -> str:
    """The bolls that a flag of the plant is about, as `boll 3, boll 7` or `bolls 3 and 7`; the first `MOST_NAMED`."""
    if flag == "touching_bolls":
        found = [f"bolls {first} and {second}" for first, second in _touching_pairs(facts.bolls)]
    elif concerned := FLAG_OF_BOLLS.get(flag):
        found = [f"boll {row['boll_id']}" for row in facts.bolls if concerned(row)]
    else:
        return ""
    more = f" and {len(found) - MOST_NAMED} more" if len(found) > MOST_NAMED else ""
    return ", ".join(found[:MOST_NAMED]) + more


def _touching_pairs(rows: Sequence[Mapping[str, str]]) -> list[tuple[str, str]]:
    """Numbers of bolls that may touch each other, those that lie deepest in each other first."""
    counted = [row for row in rows if is_counted(flags_of(row))]
    places = np.array([[parse_number(row.get(f"{axis}_cm")) for axis in "xyz"] for row in counted]).reshape(-1, 3)
    widths = np.array([parse_number(row.get("diameter_cm")) for row in counted])
    pairs = np.array(list(combinations(range(len(counted)), 2)), np.int64).reshape(-1, 2)
    away = np.array([nearest_neighbours(places[pair], widths[pair])[0] for pair in pairs])
    touching = pairs[np.argsort(away, kind="stable")][: int(find_touching(away).sum())]
    return [(counted[i]["boll_id"], counted[j]["boll_id"]) for i, j in touching]


def advise_on_capture(facts: Facts, bolls_px: Sequence[float] = ()) -> list[Finding]:
    """What was filmed well and what to do better, with this video's figures; advice to change something comes first.

    Points that `check` also judges have the same verdict as there; the rest is for information.

    Args:
        bolls_px: widths of the bolls in the training images.
    """
    frames, effects, sfm = facts.frames, facts.effects, facts.sfm
    blur = effects.motion_blur if effects else None
    blur_px = blur.median_px if blur and blur.found else 0.0
    found: list[Finding | None] = []
    if sfm:
        n_placed = sfm.n_frames - len(sfm.unregistered)
        found.append(of_walk(sfm.orbit_coverage_deg, sfm.orbit_largest_gap_deg))
        found += [of_placed(n_placed, sfm.n_frames), of_framing(len(sfm.plant_out_of_view), n_placed)]
    if frames and frames.images:
        found.append(of_sharpness(frames.images, blur_px, bolls_px))
        found += [*(of_light(frames.images) or [WELL_LIT]), of_length(frames.video)]
    if facts.scale and facts.scale.relative_error is not None:
        found += of_scale(facts.scale, facts.warnings("scale"))
    if effects:
        found += [_advise_on_exposure(effects.exposure), _advise_on_lens(effects.distortion)]
        found += [_advise_on_blur(blur), _advise_on_shutter(effects.rolling_shutter)]
    if len(bolls_px):
        width = float(np.median(bolls_px))
        found.append(of_distance(width, f"a middling boll is {width:.0f} px wide in the images used"))
    hidden = [row["boll_id"] for row in facts.bolls if "few_views" in flags_of(row)]
    if hidden:
        text = f"few views see boll {', '.join(hidden[:8])}"
        found.append(Finding(YELLOW, "Hidden bolls", text, "raise or lower the camera a little as you walk"))
    return sorted((item for item in found if item), key=lambda item: -VERDICTS.index(item.verdict))


def _advise_on_exposure(found: ExposureDecision) -> Finding | None:
    """The evidence for or against a drift of the camera's exposure, and what was done about it."""
    if found.spread_pct is None:
        return None
    size = f"{found.spread_pct:.1f} % (± {found.error_pct or 0:.1f} %)"
    if found.on:
        text = f"exposure or white balance drifted by {size}; it was corrected, but lock the exposure when you can"
        return Finding(GREEN, "Exposure", text)
    visible_pct = found.visible_from_pct or 0.0
    if found.likeness is not None and found.spread_pct > visible_pct and found.likeness <= ALIKE:
        text = f"things change their brightness by {size} from image to image, dark and bright ones not alike: gleams,"
        return Finding(GREEN, "Exposure", f"{text} not the camera; nothing was corrected")
    text = f"exposure and white balance were steady: {size}, where {visible_pct:.0f} % begins to matter"
    return Finding(GREEN, "Exposure", text)


def _advise_on_lens(found: LensDecision | None) -> Finding | None:
    """Whether the lens bends straight lines; both cases are fine."""
    if found is None or found.rise_pct is None:
        return None
    if found.on:
        text = f"it bends straight lines, by {found.corner_px:.1f} px in the corners; corrected"
        return Finding(GREEN, "Lens", text)
    needed = f"explains {max(found.rise_pct, 0):.2f} % of the error, needed from {found.needed_from_pct:.1f} %"
    return Finding(GREEN, "Lens", f"straight: a distortion {needed}. The images were used as they are")


def _advise_on_blur(found: MotionBlurFound | None) -> Finding | None:
    """By how much the walk blurred the images; the finding on sharpness says whether that matters for the bolls."""
    if found is None or math.isnan(found.median_px):
        return None
    remark = "; walking more slowly, or more light, helps" if found.found else ""
    text = (
        f"motion blurs the middle image by {found.median_px:.1f} px and nine of ten by less than"
        f" {found.strong_px:.1f} px, where {found.visible_from_px:.0f} px can be seen{remark}"
    )
    return Finding(GREEN, "Motion blur", text)


def _advise_on_shutter(found: RollingShutterFound | None) -> Finding | None:
    """Whether the camera read out rows one after another while it moved; the model does not allow for it."""
    if found is None or math.isnan(found.error_frames):
        return None
    if not found.found:
        text = f"none to be seen: {found.shift_px:.2f} px, where {found.visible_from_px:.1f} px can be seen"
        return Finding(GREEN, "Rolling shutter", text)
    remark = "" if found.left_px < found.visible_from_px else "; walking more slowly and evenly helps"
    text = f"it moves pixels by {found.shift_px:.1f} px; the cameras' positions take up all but {found.left_px:.2f} px"
    return Finding(GREEN, "Rolling shutter", text + remark)
