"""Open bolls in the images of one plant, found by the bolls' network and told apart by all views together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.bolls import MaskSet
from ..core.progress import Progress, silent
from ..core.scene import Camera, Gaussians
from .bolls import BollNetwork, group
from .meeting_votes import find_middles, painted, votes_in_space


def detect_bolls(
    images: Sequence[NDArray[np.uint8]],
    cameras: Sequence[Camera],
    network: BollNetwork,
    gaussians: Gaussians | None = None,
    progress: Progress = silent,
) -> MaskSet:
    """Masks of each image.

    Args:
        images: (H, W, 3) sRGB.
        cameras: theirs.
        gaussians: the plant's model, which makes votes places in space; None = each image is taken alone.
    """
    ids: dict[str, NDArray[np.uint16]] = {}
    scores: dict[str, dict[int, float]] = {}
    maps = []
    for done, (image, camera) in enumerate(zip(images, cameras, strict=True)):
        progress(done, len(images), camera.name)
        maps.append(network.maps(image))
    if gaussians is None:
        for view, camera in zip(maps, cameras, strict=True):
            ids[camera.name], scores[camera.name] = group(view)
        return MaskSet(ids, scores)
    votes = [votes_in_space(view, camera, gaussians) for view, camera in zip(maps, cameras, strict=True)]
    middles = find_middles(votes)
    for view, own, camera in zip(maps, votes, cameras, strict=True):
        ids[camera.name], scores[camera.name] = painted(view, own, middles)
    return MaskSet(ids, scores)
