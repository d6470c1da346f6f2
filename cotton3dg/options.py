# SPDX-License-Identifier: Apache-2.0
"""Options: one frozen dataclass a stage, and one for each of its methods; read from the command line and from TOML.

Each option is written once, here; the command line, `cotton3dg.toml` and the records derive from it. `choices.py`
decides which of several given values wins.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from .command_options import (
    MARKER_DICTIONARIES,
    CardsOptions,
    MarkersOptions,
    MasksTrainOptions,
    RenderOptions,
    SimulateOptions,
)
from .errors import unknown
from .option_rules import Retired, given_values, option, options_of, resolved

FINER_PRESETS: Final = ("draft", "standard", "paper")
"""Coarse to fine."""
USUAL_TABLE_CM: Final = (120.0, 60.0)
"""Size of the published table. The program assumes it where nobody measured the table."""
PRESETS: Final = (*FINER_PRESETS, "paper1", "paper2")
STANDARD: Final = "standard"
"""All defaults."""


@dataclass(frozen=True)
class FramesOptions:
    """Choose images from the video, sharp ones at even steps of the camera's way."""

    count: int = option(
        100,
        "images to take, at even steps of the camera's way",
        paper="about 100; 150 in Table 3",
        at_least=8,
        at_most=2000,
    )
    max_side: int = option(1920, "longer side of the images; larger ones are scaled down", unit="px", at_least=64)


@dataclass(frozen=True)
class SfmOptions:
    """Find where each image was taken from, by structure from motion."""

    max_features: int = option(
        2048, "SIFT features an image; photos get 4 times as many, few photos 8 times", at_least=256, at_most=65536
    )
    overlap: int = option(8, "neighbours in time that each image is matched with", at_least=1)
    distortion: str = option("auto", "model the lens's radial distortion", choices=("auto", "on", "off"))
    seed: int = option(0, "seed of RANSAC and of the mapper", at_least=0)


@dataclass(frozen=True)
class TrainOptions:
    """Train the Gaussian model on the images."""

    max_side: int = option(960, "longer side of the training images", unit="px", paper="960", at_least=64)
    steps: int = option(2500, "optimisation steps, one image each", paper="30000", at_least=1)
    max_gaussians: int = option(150_000, "hard budget of Gaussians", at_least=100, at_most=20_000_000)
    sh_degree: int = option(3, "degree of the view-dependent colour", paper="3 in Kerbl et al.", at_least=0, at_most=3)
    dssim: float = option(0.2, "weight λ of D-SSIM in the loss", paper="0.2 in Kerbl et al.", at_least=0.0, at_most=1.0)
    start: str = option(
        "dense",
        "what training begins with: a Gaussian for each point of sfm, and dense points besides",
        paper="points",
        choices=("dense", "points"),
    )
    plant_window: bool = option(
        True, "look at the plant alone in most of the last steps; off = at whole images", paper="off"
    )
    exposure: str = option(
        "auto", "bring images of varying exposure and white balance to a common one", choices=("auto", "on", "off")
    )
    model: str = option("", "a model that another program trained on these images, .ply; nothing is trained then")
    transforms: str = option("", "of the model: nerfstudio's dataparser_transforms.json; none = in the cameras' frame")
    holdout: int = option(8, "every n-th image is held out for PSNR; 0 = none", at_least=0)
    seed: int = option(0, "seed of the starting Gaussians and of the image order", at_least=0)


@dataclass(frozen=True)
class BollsNetworkOptions:
    """Masks by the bolls' network."""

    weights: str = option("", "a network of your own, .onnx")


@dataclass(frozen=True)
class ImportOptions:
    """Masks that were made elsewhere."""

    source: str = option("", "folder or file of masks (PNG, COCO, Labelme, YOLO labels); default: own_masks")
    classes: str = option("", "classes that are bolls, by comma; default: the only one")


@dataclass(frozen=True)
class NetworkOptions:
    """Masks by a network whose weights are the user's."""

    trust_weights: bool = option(
        False, "read weights that are pickles, which can run any program; no file can give this", permits=True
    )
    confidence: float = option(0.25, "least score of a boll", at_least=0.0, at_most=1.0)
    tile: int = option(
        0, "side of squares looked at one by one, for small bolls; 0 = whole images", unit="px", at_least=0
    )


@dataclass(frozen=True)
class YoloOptions(NetworkOptions):
    """Masks by YOLO."""

    weights: str = option("", ".pt or .onnx")
    classes: str = option("", "classes that are bolls, by comma; default: the only one")
    image_size: int = option(
        1280, "longer side of what the model sees", unit="px", paper="1280", at_least=32, at_most=8192
    )
    nms_iou: float = option(0.7, "overlap of boxes above which only the surest stays", at_least=0.0, at_most=1.0)


@dataclass(frozen=True)
class AnySamOptions(NetworkOptions):
    """Masks by SAM, whatever prompts it."""

    weights: str = option("", "folder of a SAM or SAM 2 model")


@dataclass(frozen=True)
class SamOptions(AnySamOptions):
    """Masks by SAM, prompted by points or boxes."""

    prompts: str = option("", "table of points (image,x,y) or boxes (image,x1,y1,x2,y2); default: what bolls finds")


@dataclass(frozen=True)
class GroundedSamOptions(AnySamOptions):
    """Masks by SAM in the boxes of Grounding DINO."""

    detector: str = option("", "folder of a Grounding DINO model")
    prompt: str = option("cotton boll", "what to look for")
    text_confidence: float = option(0.35, "least score of a box", at_least=0.0, at_most=1.0)


@dataclass(frozen=True)
class MasksOptions:
    """Find what each image shows of bolls, as maps or masks."""

    backend: str = option(
        "bolls",
        "who finds the bolls in the images",
        paper="yolo, sam, grounded-sam",
        choices=("bolls", "import", "yolo", "sam", "grounded-sam"),
        retired={"lint": Retired("bolls")},
    )
    views: int = option(
        36, "images that get masks, evenly spaced around the plant", paper="4", at_least=2, idle_with=("import",)
    )
    bolls: BollsNetworkOptions = options_of(BollsNetworkOptions, "bolls")
    imported: ImportOptions = options_of(ImportOptions, "import")
    yolo: YoloOptions = options_of(YoloOptions, "yolo")
    sam: SamOptions = options_of(SamOptions, "sam")
    grounded_sam: GroundedSamOptions = options_of(GroundedSamOptions, "grounded-sam")


@dataclass(frozen=True)
class ProbabilityOptions:
    """A probability of lint for each Gaussian, as the paper on binary segmentation has it."""

    threshold: float = option(0.75, "least p of lint", paper="0.75 clear, 0.9 accurate", at_least=0.0, at_most=1.0)
    steps: int = option(7000, "optimisation steps, one view each", paper="7000; up to 12000 in Table I", at_least=1)
    spacing: int = option(
        4, "one ray for each square of so many px; 1 = all, 5 GB", unit="px", paper="1", at_least=1, at_most=16
    )
    holdout: int = option(8, "every n-th view with masks is held out for mBIoU; 0 = none", at_least=0)
    seed: int = option(0, "seed of rays, order of views and first features", at_least=0)


@dataclass(frozen=True)
class AffinityOptions:
    """A feature for each Gaussian, alike within a boll, as SAGA has it."""

    views: int = option(4, "views that prompt, evenly around the plant", paper="4", at_least=2)
    features: int = option(16, "length of a feature", paper="32 in SAGA", at_least=2, at_most=64)
    feature_steps: int = option(3000, "optimisation steps, one view each", paper="10000 in SAGA", at_least=1)
    seed: int = option(0, "seed of rays, order of views and first features", at_least=0)


@dataclass(frozen=True)
class SegmentOptions:
    """Lift what the images show onto the Gaussians."""

    method: str = option(
        "lint",
        "how Gaussians are labelled; lint = by the network's maps, or lift where masks have none",
        choices=("lint", "lift", "probability", "affinity"),
    )
    max_side: int = option(960, "longer side of the renders that masks are compared with", unit="px", at_least=64)
    target: int = option(0, "take this mask id alone, in every view; 0 = all masks", at_least=0, at_most=65534)
    probability: ProbabilityOptions = options_of(ProbabilityOptions, "probability")
    affinity: AffinityOptions = options_of(AffinityOptions, "affinity")


@dataclass(frozen=True)
class DbscanOptions:
    """Bolls as DBSCAN clusters of the points of the views' objects, as Cotton3DGaussians has it."""

    eps: float = option(
        0.4, "radius that has to hold min-samples points, in median widths of an object", paper="0.3 su", at_least=0.0
    )
    min_samples: int = option(10, "points within eps of a core point, itself among them", paper="10", at_least=1)


@dataclass(frozen=True)
class ClusterOptions:
    """Find the bolls of the plant by all views together."""

    method: str = option(
        "votes",
        "how views are reconciled; votes = in space, or consensus where masks were lifted",
        paper="dbscan",
        choices=("votes", "consensus", "dbscan"),
        retired={"agglomerative": Retired("votes", ("reach",))},
    )
    boll_plys: bool = option(False, "save each boll's Gaussians as a PLY of its own")
    dbscan: DbscanOptions = options_of(DbscanOptions, "dbscan")


@dataclass(frozen=True)
class ArucoOptions:
    """Scale by printed markers."""

    marker_cm: float = option(10.0, "black square of a printed marker, or a square of a board", unit="cm", at_least=0.5)
    dictionary: str = option("4x4_50", "OpenCV's name of the markers", choices=MARKER_DICTIONARIES)
    board: str = option("", "COLUMNSxROWS of squares of a ChArUco board, e.g. 4x5; none = loose markers")


@dataclass(frozen=True)
class CardOptions:
    """Scale by a plant's printed card."""

    ruler_cm: float = option(
        10.0, "the printed card's ruler of 10 cm, as measured", unit="cm", at_least=5.0, at_most=20.0
    )
    patches: str = option("", "reflectances of its grey patches from white to black, %, as measured; none = usual")


@dataclass(frozen=True)
class DistanceOptions:
    """Scale by two points."""

    distance_cm: float = option(0.0, "between the two points of scale_points.csv", unit="cm", at_least=0.0)


@dataclass(frozen=True)
class ScaleOptions:
    """Find the metric scale and the table, this by its shape whatever gives the scale."""

    method: str = option(
        "table",
        "the reference of known size; all = every one there is, reconciled",
        paper="sections",
        choices=("table", "sections", "all-sections", "aruco", "card", "distance", "all", "none"),
    )
    table_length_cm: float = option(
        0.0,
        f"long side of the table top; 0 = not measured, taken as {USUAL_TABLE_CM[0]:g}",
        unit="cm",
        paper="120",
        at_least=10.0,
        idle_with=("none",),
    )
    table_width_cm: float = option(
        0.0,
        f"short side of the table top; 0 = not measured, taken as {USUAL_TABLE_CM[1]:g}",
        unit="cm",
        paper="60",
        at_least=10.0,
        idle_with=("none",),
    )
    require_scale: bool = option(False, "fail (exit 5) instead of leaving the metric cells blank")
    aruco: ArucoOptions = options_of(ArucoOptions, "aruco", "all")
    distance: DistanceOptions = options_of(DistanceOptions, "distance", "all")
    card: CardOptions = options_of(CardOptions, "card", "all")

    @property
    def table_cm(self) -> tuple[float, float]:
        """The long and the short side of the table top, in whichever order they were given."""
        sides = self.table_length_cm or USUAL_TABLE_CM[0], self.table_width_cm or USUAL_TABLE_CM[1]
        return max(sides), min(sides)

    @property
    def table_is_assumed(self) -> bool:
        """Whether the size of the table is the default, and no option gives it."""
        return not (self.table_length_cm and self.table_width_cm)


@dataclass(frozen=True)
class TraitsOptions:
    """Measure the plant and its bolls, and save the tables."""

    plant_id: str = option("", "name in the tables; default: the folder's name")
    tube_height_cm: float = option(4.0, "height of the clamp on the table", unit="cm", paper="4", at_least=0.0)
    weight_model: str = option("", "weights.json of evaluate-weights, for the weight of unweighed plants")
    excel: bool = option(False, "write a byte-order mark so that Excel reads UTF-8")


STAGE_OPTIONS: Final[dict[str, type]] = {
    "frames": FramesOptions,
    "sfm": SfmOptions,
    "train": TrainOptions,
    "scale": ScaleOptions,
    "masks": MasksOptions,
    "segment": SegmentOptions,
    "cluster": ClusterOptions,
    "traits": TraitsOptions,
}

COMMAND_OPTIONS: Final[dict[str, type]] = {
    **STAGE_OPTIONS,
    "simulate": SimulateOptions,
    "render": RenderOptions,
    "masks-train": MasksTrainOptions,
    "markers": MarkersOptions,
    "cards": CardsOptions,
}

PRESET_VALUES: Final[dict[str, dict[str, dict[str, Any]]]] = {
    "draft": {
        "frames": {"count": 60},
        "train": {"max_side": 640, "steps": 1500, "max_gaussians": 60_000},
        "masks": {"views": 24},
    },
    "standard": {},
    "paper": {
        "frames": {"count": 150},
        "train": {"steps": 30_000, "max_gaussians": 1_000_000, "plant_window": False},
    },
    "paper1": {"segment": {"method": "probability", "probability": {"threshold": 0.75, "steps": 7000, "spacing": 1}}},
    "paper2": {
        "frames": {"count": 100},
        "train": {"steps": 30_000, "max_gaussians": 1_000_000, "start": "points", "plant_window": False},
        "masks": {"views": 4},
        # The paper gives neither; 32 is the default of SAGA's code, 10,000 what its instructions ask for.
        "segment": {"method": "affinity", "affinity": {"views": 4, "features": 32, "feature_steps": 10_000}},
        "cluster": {"method": "dbscan"},
        "scale": {"method": "sections"},
    },
}
"""`paper`: the published number of images and steps with the default methods. `paper1` and `paper2`: the methods of the
paper on binary segmentation, on a model that is there, and of Cotton3DGaussians; docs/papers.md."""


def check_preset(name: Any) -> None:
    """Raises BadUsage unless there is a preset of this name."""
    if name not in PRESETS:
        raise unknown(f"preset {name!r}", str(name), PRESETS)


def resolve(stage: str, *layers: Mapping[str, Any], asked: Mapping[str, Any] | None = None) -> Any:
    """Options of a stage or command with `layers` of values applied in order, later ones winning; checked.

    An option of a method stands in the method's table, `{"probability": {"threshold": 0.9}}`, where it waits until the
    method is chosen. Its name alone means that of the chosen method.

    Args:
        asked: the last layer, from the command line.
    Raises:
        BadUsage: no such option, a value that it does not take, or an option without an effect: one that was asked for,
            or one that stands outside of its method's table.
    """
    return resolved(stage, COMMAND_OPTIONS[stage](), layers, asked or {})


def origins(stage: str, *layers: Mapping[str, Any]) -> dict[str, int]:
    """Option, as TOML writes it behind the stage -> number of the layer whose value `resolve` takes."""
    return {given.place.path: given.layer for given in given_values(stage, COMMAND_OPTIONS[stage](), layers, {})}
