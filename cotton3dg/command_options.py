# SPDX-License-Identifier: Apache-2.0
"""Options of the commands that are not stages; `options.py` has those of the stages and resolves both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from .option_rules import option

MARKER_DICTIONARIES: Final = (
    "4x4_50",
    "5x5_100",
    "6x6_250",
    "7x7_1000",
    "aruco_original",
    "apriltag_16h5",
    "apriltag_25h9",
    "apriltag_36h10",
    "apriltag_36h11",
)

ENGINES: Final = ("local", "slurm")
"""Where a batch runs its plants: in processes here, or as jobs of a cluster."""
HOW: Final = ("copy", "move", "link")
"""How an import puts videos into the folders of their plants."""
FORMATS: Final = ("brapi", "miappe", "frictionless", "cottongen", "fieldbook", "xlsx")
"""Formats of an export."""
CM_PER_UNIT: Final = {"m": 100.0, "cm": 1.0, "mm": 0.1}
"""Units of a point cloud."""


@dataclass(frozen=True)
class SimulateOptions:
    """Film a simulated plant and save its exact truth; effects are off (0) unless asked for."""

    seed: int = option(0, "another seed is another plant in another room", at_least=0)
    bolls: int = option(0, "open bolls; 0 = 8 to 20, drawn", at_least=0, at_most=60)
    clustered: float = option(0.0, "share of the bolls that touch others near the top", at_least=0.0, at_most=1.0)
    contact: float = option(
        0.90, "least distance of the centres of touching bolls, in their diameters", at_least=0.5, at_most=0.97
    )
    boll_kind: str = option(
        "plain",
        "bolls that are round, or of a kind with locks, fibres and tints of its own, drawn",
        choices=("plain", "usual", "separate", "tight", "fluffy", "drooping", "hanging", "torn", "half_open"),
    )
    hanging: float = option(
        0.25, "share of the bolls of separate locks that let some of these hang", at_least=0.0, at_most=1.0
    )
    stem_cm: float = option(0.0, "length of the stem; 0 = 56 to 80, drawn", unit="cm", at_least=0.0, at_most=120.0)
    picked: int = option(0, "bolls of this plant that were taken off with their burs", at_least=0, at_most=60)
    turned_deg: float = option(
        0.0, "how far the plant was turned about its foot", unit="degrees", at_least=-360.0, at_most=360.0
    )
    walk: int = option(0, "another walk of the camera around the same plant in the same room", at_least=0)
    light: int = option(0, "other lamps in the same room", at_least=0)
    farther: float = option(
        0.0, "how much farther away than where the plant fills the image, share", at_least=0.0, at_most=0.5
    )
    frames: int = option(80, "images of the video, a little more than one turn", at_least=2, at_most=2000)
    shot: str = option(
        "whole", "one turn with the whole plant in view, or close by at three heights", choices=("whole", "local")
    )
    width: int = option(640, "width of the video", unit="px", at_least=64, at_most=3840)
    height: int = option(360, "height of the video", unit="px", at_least=36, at_most=2160)
    turn_deg: float = option(
        0.0, "how far the camera goes round; 0 = a little more than a turn", unit="degrees", at_least=0.0, at_most=720.0
    )
    uneven: float = option(0.0, "share by which the pace rises and falls, twice a walk", at_least=0.0, at_most=0.98)
    cut: float = option(0.0, "share of the plant, from its top, that the frame cuts", at_least=0.0, at_most=0.6)
    turntable: bool = option(False, "the plant turns before a camera that stands still")
    white_room: bool = option(False, "bare white walls and a bare floor")
    one_sided: bool = option(False, "light from one window only")
    pale_table: bool = option(False, "a table that is nearly white")
    supersampling: int = option(2, "rays a pixel, in each direction", at_least=1, at_most=8)
    mask_interval: int = option(10, "true masks of every n-th image", at_least=1)
    table: bool = option(True, "whether the plant stands on a table")
    table_length_cm: float = option(120.0, "long side of the table top", unit="cm", at_least=50.0, at_most=200.0)
    table_width_cm: float = option(60.0, "short side of the table top", unit="cm", at_least=30.0, at_most=120.0)
    markers: int = option(0, "printed ArUco markers (4x4_50) that lie on the table", at_least=0, at_most=6)
    marker_cm: float = option(12.0, "black square of a marker", unit="cm", at_least=2.0, at_most=20.0)
    card: str = option("", "id of a plant's card (cotton3dg cards) that lies on the table; none = no card")
    hidden: float = option(0.0, "share of the table that a box hides at one end", at_least=0.0, at_most=0.5)
    things: int = option(
        0, "mugs, balls, labels, cloths, boxes on the table, most of them white", at_least=0, at_most=20
    )
    second_table: bool = option(False, "another table, of another shape, beside the plant's")
    blur: float = option(0.0, "motion blur: open time of the shutter, share of a frame", at_least=0.0, at_most=1.0)
    rolling_shutter: float = option(
        0.0, "read-out time of the sensor, first row to last, share of a frame", at_least=0.0, at_most=1.0
    )
    exposure: float = option(0.0, "drift of the exposure, up and down", unit="EV", at_least=0.0, at_most=2.0)
    dark: float = option(0.0, "how much too dark the whole film is", unit="EV", at_least=0.0, at_most=6.0)
    distortion: float = option(0.0, "radial distortion k1 of the lens (OpenCV)", at_least=-0.2, at_most=0.2)
    noise: float = option(0.0, "sensor noise, sigma in grey levels of 255", at_least=0.0, at_most=30.0)
    architecture: str = option(
        "simple", "a branch for each boll or two, or one at every node of the stem", choices=("simple", "natural")
    )
    vegetative: int = option(0, "vegetative branches of a natural plant", at_least=0, at_most=4)
    barren: float = option(0.0, "share of a natural plant's branches without bolls", at_least=0.0, at_most=1.0)
    broken: float = option(0.0, "share of a natural plant's branches with a broken tip", at_least=0.0, at_most=1.0)
    crossing: int = option(0, "branches of a natural plant that bend and touch another", at_least=0, at_most=8)
    lean: float = option(0.0, "lean of a natural plant's stem at its foot", unit="deg", at_least=0.0, at_most=30.0)


@dataclass(frozen=True)
class MasksTrainOptions:
    """Train a network on annotated images, or on simulated ones; writes its weights and training.json."""

    network: str = option(
        "bolls", "what to train: the network of the bolls back end, or YOLO", paper="yolo", choices=("bolls", "yolo")
    )
    annotations: str = option("", "folder of images with COCO, Labelme or YOLO labels; several by comma")
    classes: str = option("", "classes that are bolls, by comma; default: the only one")
    weights: str = option(
        "",
        "what to start from; bolls: .onnx, or none = from scratch, default: the network that comes with cotton3dg; "
        "yolo: pretrained .pt, or an architecture, e.g. yolo11n-seg.yaml, from scratch",
    )
    trust_weights: bool = option(False, "read weights that are pickles, which can run any program")
    scenes: int = option(0, "bolls: simulated scenes to learn from, 20 pictures each", at_least=0, at_most=100_000)
    steps: int = option(300, "bolls: optimisation steps", at_least=1)
    image_size: int = option(
        1280, "yolo: longer side of the images", unit="px", paper="1280", at_least=32, at_most=8192
    )
    batch: int = option(0, "images a step; 0 = 12 of bolls, 16 of yolo", paper="16", at_least=0)
    epochs: int = option(500, "yolo: times each image is seen", paper="500", at_least=1)
    validation: float = option(0.2, "share of the images that judges and never trains", at_least=0.01, at_most=0.9)
    brightness: float = option(0.4, "yolo: brightness changes by up to this share", at_least=0.0, at_most=1.0)
    blur: float = option(0.5, "yolo: share of the images that are also shown blurred", at_least=0.0, at_most=1.0)
    rotation: float = option(15.0, "yolo: largest turn", unit="°", at_least=0.0, at_most=180.0)
    rescaling: float = option(0.5, "yolo: size changes by up to this share", at_least=0.0, at_most=0.9)
    seed: int = option(0, "seed of the split, the order and the first weights", at_least=0)


@dataclass(frozen=True)
class MarkersOptions:
    """Make a sheet of markers to print; measure its ruler of 10 cm before use."""

    paper: str = option("a4", "size of the sheet", choices=("a4", "a3", "letter"))
    marker_cm: float = option(10.0, "black square of a marker, or a square of the board", unit="cm", at_least=0.5)
    dictionary: str = option("4x4_50", "OpenCV's name of the markers", choices=MARKER_DICTIONARIES)
    board: str = option("", "COLUMNSxROWS of squares of a ChArUco board, e.g. 4x5; none = loose markers")
    first: int = option(0, "id of the first marker; a second sheet needs others", at_least=0)


@dataclass(frozen=True)
class CardsOptions:
    """Make a card to print for each plant of a field book, or blank ones: code, markers, grey patches."""

    paper: str = option("a4", "size of the sheets", choices=("a4", "letter"))
    columns: str = option("", "columns of the field book to print, by comma; default: the first six")
    id_column: str = option("", "column of the field book that has the ids; default: plant_id and the like")
    blank: int = option(0, "so many numbered cards without a field book", at_least=0, at_most=9999)
    first: int = option(1, "number of the first blank card", at_least=0, at_most=9999)


@dataclass(frozen=True)
class RenderOptions:
    """Film the trained model; save the film below render/ in the plant's folder."""

    view: str = option("turntable", "around the plant, or as the camera walked", choices=("turntable", "orbit"))
    show: str = option("colour", "what the pixels tell", choices=("colour", "bolls", "depth"))
    plant_only: bool = option(False, "leave out everything that traits did not measure as plant")
    background: str = option("black", "behind the model", choices=("black", "white"))
    frames: int = option(240, "images of the film", at_least=1, at_most=100_000)
    fps: float = option(30.0, "images a second of the film", unit="1/s", at_least=1.0, at_most=240.0)
    width: int = option(0, "width; 0 = by the height, or as the training images", unit="px", at_least=0, at_most=8192)
    height: int = option(0, "height; 0 = by the width, or as the training images", unit="px", at_least=0, at_most=8192)
    format: str = option("mp4", "a video, or an image a frame", choices=("mp4", "png", "jpg"))
    threads: int = option(0, "threads that render; 0 = one a core", at_least=0)
