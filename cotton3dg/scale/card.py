"""The scale by a plant's printed card.

All markers of a card make one rigid body: the scale comes from distances of up to 30 cm between their corners.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from ..core.card import MARKER_CM, MARKER_DICTIONARY, MARKERS_CM, RULER_CM, marker_corner_cm
from ..core.scene import Camera, Float64
from .markers import Corner, MarkerFit, MarkerKind, fit_bodies
from .references import NoReference

CARD_MARKERS: Final = MarkerKind(MARKER_DICTIONARY, MARKER_CM)


def scale_from_card(
    cameras: Sequence[Camera], found: Sequence[Mapping[Corner, Float64]], ruler_cm: float = RULER_CM
) -> MarkerFit | NoReference:
    """The scale at which the card has its known size.

    Args:
        found: what `find_markers` found of `CARD_MARKERS` in the photo of each camera.
        ruler_cm: length of the printed ruler as measured; printers scale.
    """
    own = [{corner: place for corner, place in corners.items() if corner[1] in MARKERS_CM} for corners in found]
    if not any(own):
        return NoReference("no photo shows a card")
    stretch = ruler_cm / RULER_CM
    return fit_bodies(
        cameras,
        own,
        lambda corner: stretch * np.array(marker_corner_cm(corner[1], corner[2])),
        lambda corner: "card",
        "card",
    )
