"""Open bolls in one image by the bolls' network, run by OpenCV.

Every pixel that looks like lint votes for where the middle of its boll lies; where votes meet is a boll, and the pixels
that voted for it are its mask (Hough voting; the heads are those of Panoptic-DeepLab, see `bolls_network`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.training_picture import CLASSES, LINT
from ..errors import BadInput, MissingInput

Float32 = NDArray[np.float32]
CHANNELS = len(CLASSES) + 4
"""What the network gives for a pixel: classes, x and y of the way to the middle, border, size, in this order."""
OFFSET_PX = 32.0
"""What one unit of the way to the middle is worth; and the size at 0 of the network's binary logarithmic scale."""
STRIDE = 32
"""Sides of what the network sees are multiples of this."""
IMAGE_SIDE = 1280
"""px, longer side of what the network sees; larger images are scaled down, smaller ones up, ..."""
LARGEST_ZOOM = 2.0
"""... at most as many times: bolls of few pixels have edges between them that the maps, at half size, can show."""
LOOKS = (1.0, 0.5, 0.25)
"""Parts of that size at which one image alone is looked at, too: a boll that fills it is known only from afar."""
FAMILIAR_PX = 90.0
"""Width of a boll, in pixels that the network sees, that it knows best; ..."""
FAMILIAR_OCTAVES = 1.0
"""... one that is that many octaves (standard deviation) wider or narrower counts less."""
SURE = 0.5
"""Probability of lint from which a pixel is lint."""
VOTE_SPREAD = 0.10
"""Standard deviation, in diameters of the boll, that votes for one middle are gathered over."""
APART = 0.45
"""Least distance, in diameters, of the middles of two bolls in an image: one may stand partly before the other."""
LEAST_SHARE = 0.06
"""Share of its disc that a boll must show."""
REACH = 0.7
"""Farthest distance, in diameters, from a middle of a vote for it."""
MARGIN = 48
"""Width, in pixels of the maps, of the frame around them in which middles are looked for, too."""
OCTAVES = range(-2, 4)
"""Sizes of bolls, as powers of two of `OFFSET_PX`, whose votes are gathered together."""


@dataclass(frozen=True)
class Maps:
    """What the network says of each pixel of an image, at half the size that the network saw."""

    probabilities: Float32
    """(C, h, w) of each of `CLASSES`."""
    votes: Float32
    """(2, h, w) x, y of the middle of the pixel's boll, px of the image."""
    borders: Float32
    """(h, w) probability that another boll is next to the pixel."""
    diameters: Float32
    """(h, w) width of the pixel's boll, px of the image."""
    scale: float
    """Pixels of the image to one of the maps."""
    image_shape: tuple[int, int]

    @property
    def lint(self) -> Float32:
        """(h, w) probability of lint."""
        return self.probabilities[LINT]


def seen_size(height: int, width: int, look: float = 1.0) -> tuple[int, int]:
    """Width and height, px, of what the network sees of an image."""
    factor = look * min(LARGEST_ZOOM, IMAGE_SIDE / max(height, width))
    return max(round(width * factor), 1), max(round(height * factor), 1)


class BollNetwork:
    """Weights ready to run."""

    def __init__(self, weights: bytes, name: str):
        """
        Raises:
            BadInput: the weights are no network, or one that does not speak of bolls.
        """
        try:
            self._net = cv2.dnn.readNetFromONNX(np.frombuffer(weights, np.uint8))
        except cv2.error as error:
            raise BadInput(f"{name} is no network that OpenCV reads; {REMEDY}") from error
        if self._raw(np.zeros((1, 3, STRIDE, STRIDE), np.float32), name).shape[1] != CHANNELS:
            raise BadInput(f"{name} is no network of bolls; {REMEDY}")

    def maps(self, image: NDArray[np.uint8], look: float = 1.0) -> Maps:
        """What the network says of an (H, W, 3) sRGB image; of one that is seen smaller by `look`."""
        height, width = image.shape[:2]
        size = seen_size(height, width, look)
        smaller = size[0] < width
        seen = cv2.resize(image, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_CUBIC)
        rows, columns = seen.shape[:2]
        below, right = -rows % STRIDE, -columns % STRIDE
        padded = cv2.copyMakeBorder(seen, 0, below, 0, right, cv2.BORDER_REPLICATE)
        raw = self._raw(padded.transpose(2, 0, 1)[None].astype(np.float32))[0]
        raw = raw[:, : -(-rows // 2), : -(-columns // 2)]
        logits = raw[: len(CLASSES)]
        powers = np.exp(logits - logits.max(axis=0))
        scale = max(height / rows, width / columns)
        way = raw[len(CLASSES) : len(CLASSES) + 2] * np.float32(OFFSET_PX * scale)
        return Maps(
            probabilities=powers / powers.sum(axis=0),
            votes=_middles_of_pixels(raw.shape[1:], 2 * scale) + way,
            borders=1 / (1 + np.exp(-raw[len(CLASSES) + 2])),
            diameters=np.exp2(raw[len(CLASSES) + 3].clip(-3, 5)) * np.float32(OFFSET_PX * scale),
            scale=2 * scale,
            image_shape=(height, width),
        )

    def _raw(self, blob: Float32, name: str = "the network") -> Float32:
        try:
            self._net.setInput(np.ascontiguousarray(blob))
            maps = self._net.forward()
        except cv2.error as error:
            raise BadInput(f"{name} does not take images; {REMEDY}") from error
        if maps.ndim != 4 or maps.shape[2] != blob.shape[2] // 2:
            raise BadInput(f"{name} is no network of bolls; {REMEDY}")
        return np.asarray(maps, np.float32)


SHIPPED_FILE = Path(__file__).with_name("bolls.onnx")
"""The weights that the program brings; beside them, with .sha256 in its name, what they must add up to."""
REINSTALL = "install cotton3dg again, or use --backend lint"
REMEDY = "give a network that masks-train made, or none for the one that comes with cotton3dg, or use --backend lint"


def open_bolls(weights: Path | None = None) -> BollNetwork:
    """The network of a file, or the one that the program brings.

    Raises:
        MissingInput: there is no such file.
        BadInput: it holds no network of bolls.
    """
    if weights is None:
        return _shipped()
    if not weights.is_file():
        raise MissingInput(f"{weights} is not there; {REMEDY}")
    return BollNetwork(weights.read_bytes(), weights.name)


@cache
def _shipped() -> BollNetwork:
    return BollNetwork(*shipped_weights())


def shipped_weights() -> tuple[bytes, str]:
    """The network that the program brings, and its name.

    Raises:
        MissingInput: it is gone, or not what it was.
    """
    try:
        weights = SHIPPED_FILE.read_bytes()
        wanted = SHIPPED_FILE.with_name(f"{SHIPPED_FILE.name}.sha256").read_text(encoding="ascii").split()[0]
    except FileNotFoundError as error:
        raise MissingInput(f"{error.filename}, which comes with cotton3dg, is not there; {REINSTALL}") from error
    if hashlib.sha256(weights).hexdigest() != wanted:
        raise BadInput(f"{SHIPPED_FILE}, which comes with cotton3dg, is damaged; {REINSTALL}")
    return weights, SHIPPED_FILE.name


def find_bolls(image: NDArray[np.uint8], network: BollNetwork) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """Masks of the bolls in one image.

    Args:
        image: (H, W, 3) sRGB.
    Returns:
        ids (H, W), 1 ... B from the surest on, 0 = no lint; and each boll's score.
    """
    return group(mix_looks([network.maps(image, look) for look in LOOKS]))


def mix_looks(looks: Sequence[Maps]) -> Maps:
    """Maps of one image seen at several sizes as one, of the size of the first: where bolls are large, those count most
    in which they are small."""
    first = looks[0]
    height, width = first.lint.shape
    fitted = [_resize_maps(maps, height, width) for maps in looks]
    octaves = np.mean([np.log2(maps.diameters) for maps in fitted], axis=0)
    trust = np.stack(
        [np.exp(-0.5 * ((octaves - np.log2(FAMILIAR_PX * maps.scale / 2)) / FAMILIAR_OCTAVES) ** 2) for maps in looks]
    )
    trust = (trust + 1e-6) / (trust + 1e-6).sum(axis=0)

    def mean(parts: Iterable[Float32]) -> Float32:
        return np.sum([share * part for share, part in zip(trust, parts, strict=True)], axis=0, dtype=np.float32)

    return replace(
        first,
        probabilities=mean(maps.probabilities for maps in fitted),
        votes=mean(maps.votes for maps in fitted),
        borders=mean(maps.borders for maps in fitted),
        diameters=np.exp2(mean(np.log2(maps.diameters) for maps in fitted)),
    )


def _resize_maps(maps: Maps, height: int, width: int) -> Maps:
    """The maps with as many pixels as those of another look."""
    if maps.lint.shape == (height, width):
        return maps

    def resize(part: Float32) -> Float32:
        return cv2.resize(part.transpose(1, 2, 0), (width, height)).transpose(2, 0, 1)

    scale = maps.image_shape[1] / width
    ways = resize(maps.votes - _middles_of_pixels(maps.lint.shape, maps.scale))
    single = resize(np.stack([maps.borders, np.log2(maps.diameters)]))
    return Maps(
        probabilities=resize(maps.probabilities),
        votes=ways + _middles_of_pixels((height, width), scale),
        borders=single[0],
        diameters=np.exp2(single[1]),
        scale=scale,
        image_shape=maps.image_shape,
    )


def _middles_of_pixels(shape: tuple[int, int], scale: float) -> Float32:
    """(2, h, w) x, y of the middles of the pixels of maps, px of the image."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32) + np.float32(0.5)
    return np.stack([x, y]) * np.float32(scale)


def group(maps: Maps) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """Bolls where votes meet, and the pixels that voted for each."""
    rows, columns = np.nonzero(maps.lint > SURE)
    ids = np.zeros(maps.lint.shape, np.uint16)
    if len(rows):
        votes = maps.votes[:, rows, columns].T
        middles, sizes = _middles(votes, maps.diameters[rows, columns], maps)
        ids[rows, columns] = nearest_middles(votes, middles, sizes)
    return ids_of_image(ids, maps)


def _middles(votes: Float32, diameters: Float32, maps: Maps) -> tuple[Float32, Float32]:
    """(B, 2) places where enough votes meet, most first, and (B,) the mean size that these votes tell; px."""
    # The middle of a boll that the image's edge cuts may lie beyond it.
    shape = (maps.lint.shape[0] + 2 * MARGIN, maps.lint.shape[1] + 2 * MARGIN)
    # A boll seen whole gives votes of weight 1 in all.
    weights = (maps.scale**2 / (np.pi / 4 * diameters**2)).astype(np.float32)
    heat, sized = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    octaves = np.round(np.log2(diameters / (OFFSET_PX * maps.scale / 2))).clip(OCTAVES[0], OCTAVES[-1])
    x, y = (votes / maps.scale + MARGIN).T
    inside = (x >= 0) & (y >= 0) & (x < shape[1]) & (y < shape[0])
    for octave in OCTAVES:
        chosen = inside & (octaves == octave)
        if not chosen.any():
            continue
        sigma = VOTE_SPREAD * OFFSET_PX * 2.0**octave / 2
        cells = np.ravel_multi_index((y[chosen].astype(int), x[chosen].astype(int)), shape)
        heat += _gathered(cells, weights[chosen], shape, sigma)
        sized += _gathered(cells, weights[chosen] * diameters[chosen], shape, sigma)
    rows, columns = np.nonzero((heat >= cv2.dilate(heat, np.ones((3, 3), np.uint8))) & (heat > LEAST_SHARE))
    order = np.argsort(-heat[rows, columns], kind="stable")
    rows, columns = rows[order], columns[order]
    places = ((np.stack([columns, rows], axis=1) + 0.5 - MARGIN) * maps.scale).astype(np.float32)
    sizes = (sized[rows, columns] / heat[rows, columns]).astype(np.float32)
    kept = apart(places, sizes)
    return places[kept], sizes[kept]


def _gathered(cells: NDArray[np.intp], values: Float32, shape: tuple[int, int], sigma: float) -> Float32:
    """Values summed over their neighbourhood, (H, W): those that agree give their sum at the peak."""
    part = np.bincount(cells, values, minlength=shape[0] * shape[1]).reshape(shape).astype(np.float32)
    return cv2.GaussianBlur(part, (0, 0), sigma) * np.float32(2 * np.pi * sigma**2)


def apart(places: Float32, sizes: Float32) -> NDArray[np.intp]:
    """Which of (N, D) places, the surest first, are no nearer to a surer one than `APART` of the larger's size (N,)."""
    from scipy.spatial import cKDTree

    if not len(places):
        return np.zeros(0, np.intp)
    tree = cKDTree(places)
    alive = np.ones(len(places), bool)
    kept = []
    for number, size in enumerate(sizes):
        if not alive[number]:
            continue
        kept.append(number)
        near = np.array(tree.query_ball_point(places[number], APART * max(float(size), float(sizes.max()))), int)
        far = np.linalg.norm(places[near] - places[number], axis=1)
        alive[near[far < APART * np.maximum(sizes[near], size)]] = False
    return np.array(kept, np.intp)


def nearest_middles(points: Float32, middles: Float32, sizes: Float32, reach: float = REACH) -> NDArray[np.uint16]:
    """(N,) number of the middle (B, D), from 1, that each point (N, D) is nearest to, in diameters (B,) of the boll;
    0 = none within reach."""
    from scipy.spatial import cKDTree

    if not len(middles) or not len(points):
        return np.zeros(len(points), np.uint16)
    # The nearest in their own diameters is among the nearest few.
    distances, which = cKDTree(middles).query(points, k=min(6, len(middles)))
    distances, which = distances.reshape(len(points), -1), which.reshape(len(points), -1)
    relative = distances / sizes[which]
    best = relative.argmin(axis=1)
    rows = np.arange(len(points))
    return np.where(relative[rows, best] < reach, which[rows, best] + 1, 0).astype(np.uint16)


def ids_of_image(ids: NDArray[np.uint16], maps: Maps) -> tuple[NDArray[np.uint16], dict[int, float]]:
    """Ids at the size of the image, edged where the probability of lint, interpolated, is one half; and scores."""
    height, width = maps.image_shape
    size = (width, height)
    large = cv2.resize(ids, size, interpolation=cv2.INTER_NEAREST)
    lint = cv2.resize(maps.lint, size, interpolation=cv2.INTER_LINEAR)
    near = cv2.dilate(large, np.ones((5, 5), np.uint8))
    large = np.where(lint > SURE, np.where(large > 0, large, near), 0).astype(np.uint16)
    scores = {}
    for boll in np.unique(large[large > 0]):
        own = large == boll
        if own.sum() < 9:
            large[own] = 0
        else:
            scores[int(boll)] = round(float(lint[own].mean()), 3)
    return large, scores
