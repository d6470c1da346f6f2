# SPDX-License-Identifier: Apache-2.0
"""What is measured on a plant, with its units: scale, boll traits, plant traits.

Fields of the traits are the columns of the tables; columns.csv and docs/csv.md repeat the descriptions given here.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from math import nan
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .columns import column, columns
from .scene import Float64

OFF_PLANT: Final = "off_plant"
"""Flag of a supposed boll that does not hang on the plant. It has a row of its own and does not count in any sum."""


def is_counted(flags: Collection[str]) -> bool:
    """Whether a boll with these flags is one of the plant's."""
    return OFF_PLANT not in flags


@dataclass(frozen=True)
class Scale:
    """Metric size and orientation of a scene."""

    cm_per_su: float
    relative_error: float
    """Estimated standard error of `cm_per_su`, relative."""
    source: str
    """The reference that gave it, e.g. `table`."""
    up: Float64
    """(3,) unit vector in the scene."""
    plane: Float64
    """(4,) a, b, c, d of the table top: a x + b y + c z + d = height above the table, su; (a, b, c) = up."""
    corners: Float64
    """(4, 3) corners of the table top in order around it, su; edge 0-1 is a long side."""

    @property
    def table_frame(self) -> Float64:
        """(3, 3) rows: unit x (long side), y, z (up) of the table in the scene."""
        x = self.corners[1] - self.corners[0]
        x = x - self.up * (x @ self.up)
        x /= np.linalg.norm(x)
        return np.stack([x, np.cross(self.up, x), self.up])

    @property
    def cm_from_scene(self) -> Float64:
        """(3, 3) `table_frame`, times cm per su."""
        return self.table_frame * self.cm_per_su

    def height_cm(self, points: NDArray[Any]) -> Float64:
        """(N,) height of (N, 3) scene points above the table top."""
        heights: Float64 = (np.asarray(points, np.float64) @ self.plane[:3] + self.plane[3]) * self.cm_per_su
        return heights


@dataclass(frozen=True)
class PlantFrame:
    """The frame for places on a plant, cm: z up from the table top, x along the table's long side."""

    scale: Scale
    foot: Float64
    """(3,) su, its origin: where the stem meets the table."""

    def cm(self, places_su: NDArray[Any]) -> Float64:
        """(..., 3) places of the scene in this frame."""
        return np.asarray((places_su - self.foot) @ self.scale.table_frame.T * self.scale.cm_per_su, np.float64)

    def scene(self, places_cm: ArrayLike) -> Float64:
        """(..., 3) su of places in this frame."""
        return self.foot + np.asarray(places_cm, np.float64) / self.scale.cm_per_su @ self.scale.table_frame


NO_SCALE: Final = "no scale"
NO_PLANT: Final = "no scale; no plant on the table"
NEVER_WHOLE: Final = "nearly all images cut the plant (flagged)"
NO_SIZE: Final = f"{NO_PLANT}; {NEVER_WHOLE}"
NO_BODY: Final = "no scale; too few Gaussians for a body (flagged)"
NO_WEIGHT: Final = "no fit of weights (`traits.weight_model`); the volume or count that it needs is blank"
NOT_CORRECTED: Final = "not corrected"
NO_VOLUME: Final = "no scale; no boll with a volume"
NO_PATCHES: Final = "fewer than three views show the grey patches of a card (`scale.method` card or all)"


@dataclass(frozen=True)
class BollTraits:
    """One row of bolls.csv; NaN = not measurable, the reason is among the flags."""

    boll_id: int = column("", "number of the boll in this plant")
    centre_cm: Float64 = columns(
        {
            "x_cm": "centre along the table's long side, from the foot of the stem",
            "y_cm": "centre along the table's short side, from the foot of the stem",
            "z_cm": "height of the centre above the table top",
        },
        "cm",
        2,
        blank_when=NO_PLANT,
    )
    """(3,) in the plant frame."""
    volume_cm3: float = column("cm3", "volume of the convex body around its silhouettes", 2, blank_when=NO_BODY)
    alpha_volume_cm3: float = column(
        "cm3", "volume that a rolling ball, a quarter of diameter_cm in radius, cannot enter", 2, blank_when=NO_BODY
    )
    diameter_cm: float = column("cm", "mean calliper width of that convex body", 2, blank_when=NO_BODY)
    n_gaussians: int = column("1", "Gaussians of the boll")
    n_views: int = column("1", "images that show the boll; of lifted masks, those whose masks agree on it")
    confidence: float = column(
        "1", "probability that it is one boll; of lifted masks, share of the views that agree on it", 3
    )
    flags: tuple[str, ...] = column(
        "", "quality flags of the boll, separated by vertical bars", name="qc_flags", blank_when="no flag", default=()
    )
    volume_error_cm3: float = column(
        "cm3", "standard error of volume_cm3: scale, edges, shape, neighbours", 2, blank_when=NO_BODY, default=nan
    )
    projected_area_cm2: float = column(
        "cm2", "area of the shadow of that convex body, mean over all directions", 2, blank_when=NO_BODY, default=nan
    )
    volume_published_cm3: float = column(
        "cm3",
        "volume of the convex hull around the middles of the boll's Gaussians (Cotton3DGaussians)",
        2,
        blank_when=NO_BODY,
        default=nan,
    )
    corrected: str = column(
        "",
        "correction by a person: merged, split or added; or rescaled, because the table's corners were moved",
        blank_when=NOT_CORRECTED,
        default="",
    )
    original_bolls: str = column(
        "", "boll_id of the bolls that it was made from, joined by +", blank_when=f"{NOT_CORRECTED}; added", default=""
    )
    original_volume_cm3: float = column(
        "cm3", "sum of the volumes of original_bolls", 2, blank_when=f"{NOT_CORRECTED}; added; {NO_BODY}", default=nan
    )


@dataclass(frozen=True, kw_only=True)
class PlantTraits:
    """The traits in a row of traits.csv; NaN = not measurable, the reason is among the flags."""

    boll_count: int = column("1", "open bolls found on the plant", ontology="CO_358:0001327", leading=True)
    boll_count_interval: tuple[int, int] | None = columns(
        {
            "boll_count_low": "lower end of the 95 % interval of boll_count",
            "boll_count_high": "upper end of the same interval",
        },
        "1",
        blank_when=f"no bolls; {NEVER_WHOLE}",
        default=None,
        leading=True,
    )
    boll_volume_cm3: float = column(
        "cm3", "sum of volume_cm3 over the counted bolls", 2, blank_when=NO_VOLUME, leading=True
    )
    boll_volume_interval_cm3: tuple[float, float] | None = columns(
        {
            "boll_volume_low_cm3": "lower end of the 95 % interval of boll_volume_cm3",
            "boll_volume_high_cm3": "upper end of the same interval",
        },
        "cm3",
        2,
        blank_when=f"{NO_VOLUME}; {NEVER_WHOLE}",
        default=None,
        leading=True,
    )
    plant_height_cm: float = column(
        "cm",
        "height above the table top where the plant's second-highest Gaussian ends, at an opacity of 0.2",
        2,
        ontology="CO_358:0001138",
        blank_when=NO_SIZE,
        leading=True,
    )
    plant_height_interval_cm: tuple[float, float] | None = columns(
        {
            "plant_height_low_cm": "lower end of the 95 % interval of plant_height_cm",
            "plant_height_high_cm": "upper end of the same interval",
        },
        "cm",
        2,
        blank_when=NO_SIZE,
        default=None,
        leading=True,
    )
    canopy_size_cm: float = column(
        "cm", "mean of canopy_length_cm and canopy_width_cm", 2, blank_when=NO_SIZE, leading=True
    )
    canopy_size_interval_cm: tuple[float, float] | None = columns(
        {
            "canopy_size_low_cm": "lower end of the 95 % interval of canopy_size_cm",
            "canopy_size_high_cm": "upper end of the same interval",
        },
        "cm",
        2,
        blank_when=NO_SIZE,
        default=None,
        leading=True,
    )
    flags: tuple[str, ...] = ()
    """Flags of the stage traits; the row has the flags of all stages."""
    boll_count_error: float = column(
        "1",
        "standard error of boll_count, from bolls that may be none or two, and bolls that touch",
        2,
        blank_when=f"no bolls; {NEVER_WHOLE}",
        default=nan,
    )
    boll_volume_error_cm3: float = column(
        "cm3",
        "standard error of boll_volume_cm3, from scale, edges, shape, neighbours, unfilmed sides and miscounts",
        2,
        blank_when=f"{NO_VOLUME}; {NEVER_WHOLE}",
        default=nan,
    )
    plant_height_error_cm: float = column(
        "cm", "standard error of plant_height_cm, from scale, pixels and lost tips", 2, blank_when=NO_SIZE, default=nan
    )
    canopy_size_error_cm: float = column(
        "cm",
        "standard error of canopy_size_cm, from scale, pixels, blur, lost tips or another rectangle about as small",
        2,
        blank_when=NO_SIZE,
        default=nan,
    )
    boll_volume_mean_cm3: float = column("cm3", "mean of volume_cm3 over the counted bolls", 2, blank_when=NO_VOLUME)
    lint_area_cm2: float = column(
        "cm2", "sum of projected_area_cm2 over the counted bolls", 2, blank_when=NO_VOLUME, default=nan
    )
    boll_count_halves: tuple[int, int] | None = columns(
        {
            "boll_count_odd": "bolls counted with every second image",
            "boll_count_even": "bolls counted with the other images",
        },
        "1",
        blank_when="the masks do not come from the bolls' network on a trained model; corrected",
        default=None,
    )
    boll_height_mean_cm: float = column(
        "cm",
        "mean height of the bolls' centres above the table top",
        2,
        blank_when=f"{NO_PLANT}; no bolls",
        default=nan,
    )
    boll_height_sd_cm: float = column(
        "cm",
        "standard deviation of the heights of the bolls' centres",
        2,
        blank_when=f"{NO_PLANT}; fewer than two bolls",
        default=nan,
    )
    boll_height_min_cm: float = column(
        "cm",
        "height of the lowest boll's centre above the table top",
        2,
        blank_when=f"{NO_PLANT}; no bolls",
        default=nan,
    )
    boll_height_max_cm: float = column(
        "cm",
        "height of the highest boll's centre above the table top",
        2,
        blank_when=f"{NO_PLANT}; no bolls",
        default=nan,
    )
    bolls_by_third: tuple[int, int, int] | None = columns(
        {
            f"bolls_{third}": f"bolls with their centre in the {third} third of plant_height_cm"
            for third in ("lower", "middle", "upper")
        },
        "1",
        blank_when=NO_SIZE,
        default=None,
    )
    """None = not measurable."""
    canopy_length_cm: float = column(
        "cm", "long side of the least-area rectangle around the plant seen from above", 2, blank_when=NO_SIZE
    )
    canopy_width_cm: float = column(
        "cm", "short side of the least-area rectangle around the plant seen from above", 2, blank_when=NO_SIZE
    )
    plant_height_obb_cm: float = column(
        "cm", "upright side of the plant's oriented bounding box, which leans with the plant", 2, blank_when=NO_SIZE
    )
    plant_hull_volume_cm3: float = column(
        "cm3", "volume of the convex hull of the plant and its foot", 1, blank_when=NO_SIZE, default=nan
    )
    seed_cotton_g: float = column(
        "g",
        "weight of the seed cotton, as the fit of traits.weight_model predicts it",
        1,
        blank_when=NO_WEIGHT,
        default=nan,
    )
    seed_cotton_low_g: float = column(
        "g", "lower end of the 95 % prediction interval of seed_cotton_g", 1, blank_when=NO_WEIGHT, default=nan
    )
    seed_cotton_high_g: float = column("g", "upper end of the same interval", 1, blank_when=NO_WEIGHT, default=nan)
    lint_g: float = column(
        "g",
        "lint in seed_cotton_g, by the lint percentage of the weighed plants",
        1,
        blank_when=f"{NO_WEIGHT}; no lint percentage",
        default=nan,
    )
    boll_volume_published_cm3: float = column(
        "cm3", "sum of volume_published_cm3 over the counted bolls", 2, blank_when=NO_VOLUME, default=nan
    )
    plant_height_published_cm: float = column(
        "cm",
        "upright side of the oriented box around the foot and the middles of the plant's Gaussians (Cotton3DGaussians)",
        2,
        blank_when=NO_SIZE,
        default=nan,
    )
    canopy_size_published_cm: float = column(
        "cm", "mean of the other two sides of that box (Cotton3DGaussians)", 2, blank_when=NO_SIZE, default=nan
    )
    corrections: int | None = column(
        "1", "number of corrections by a person that apply", blank_when=NOT_CORRECTED, default=None
    )
    original_boll_count: int | None = column(
        "1", "boll_count before the corrections", blank_when=NOT_CORRECTED, default=None
    )
    original_boll_volume_cm3: float = column(
        "cm3", "boll_volume_cm3 before the corrections", 2, blank_when=f"{NOT_CORRECTED}; {NO_VOLUME}", default=nan
    )
    original_plant_height_cm: float = column(
        "cm", "plant_height_cm before the corrections", 2, blank_when=f"{NOT_CORRECTED}; {NO_SIZE}", default=nan
    )
    original_canopy_size_cm: float = column(
        "cm", "canopy_size_cm before the corrections", 2, blank_when=f"{NOT_CORRECTED}; {NO_SIZE}", default=nan
    )


@dataclass(frozen=True)
class PlantEvidence:
    """The evidence for the traits in a row of traits.csv; None = not known."""

    scale_source: str = column("", "reference that gave the scale; none = all metric traits are blank")
    scale_error_pct: float | None = column(
        "%", "standard error of the scale and of lengths; a third of that of volumes", 3, blank_when=NO_SCALE
    )
    n_frames: int | None = column("1", "images taken from the video")
    registered_pct: float | None = column("%", "share of the images whose camera structure from motion found", 1)
    psnr_db: float | None = column(
        "dB", "PSNR of renders against the images that were held out", 2, blank_when="`train.holdout = 0`"
    )
    seconds: float = column("s", "computing time of all stages", 1)
    flags: tuple[str, ...] = column(
        "",
        "quality flags of all stages, separated by vertical bars",
        name="qc_flags",
        blank_when="no flag",
        leading=True,
    )
    version: str = column("", "version of cotton3dg")


@dataclass(frozen=True)
class LintColour:
    """Colour of lint relative to a matt surface beside the card; NaN = not known."""

    lint_cie_l: float = column("1", "lightness L* of the lint (CIELAB, D65)", 1, blank_when=NO_PATCHES, default=nan)
    lint_cie_a: float = column("1", "a* of the lint, red above 0", 1, blank_when=NO_PATCHES, default=nan)
    lint_cie_b: float = column("1", "b* of the lint, yellow above 0", 1, blank_when=NO_PATCHES, default=nan)
    lint_rd_pct: float = column(
        "%", "reflectance Rd of the lint, by cotton grading (Hunter 1958)", 1, blank_when=NO_PATCHES, default=nan
    )
    lint_plus_b: float = column(
        "1", "yellowness +b of the lint, by the formula of cotton grading", 1, blank_when=NO_PATCHES, default=nan
    )


@dataclass(frozen=True)
class BollColour(LintColour):
    """Colour of one boll's lint."""

    lint_colour_views: int | None = column(
        "1", "images in which the colour was measured", blank_when=NO_PATCHES, default=None
    )
