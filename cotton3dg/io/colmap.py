# SPDX-License-Identifier: Apache-2.0
"""Reading COLMAP's binary models (https://colmap.github.io/format.html), sizes checked before anything is allocated."""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, rotations
from ..errors import BadInput, MissingInput

log = logging.getLogger("cotton3dg")

PARAMETER_COUNTS: Final = {0: 3, 1: 4}
"""Number of parameters of COLMAP's camera models SIMPLE_PINHOLE (f, cx, cy) and PINHOLE (fx, fy, cx, cy), by id."""
MAX_COORDINATE: Final = 1e12
"""su; a pose or point beyond it is lost rather than far away, like one with NaN."""


OBSERVATION: Final = np.dtype([("x", "<f8"), ("y", "<f8"), ("point", "<i8")])
"""A feature of an image and the triangulated point it shows, -1 = none."""
POINT: Final = np.dtype([("id", "<u8"), ("xyz", "<f8", 3), ("rgb", "u1", 3), ("error", "<f8"), ("n_images", "<u8")])
"""A triangulated point; as many images and features, 8 bytes each, follow."""


class _Reader:
    """A binary file read field by field; a field beyond its end is BadInput."""

    def __init__(self, path: Path):
        self.path, self.at = path, 0
        try:
            self.content = path.read_bytes()
        except (FileNotFoundError, IsADirectoryError) as error:
            raise MissingInput(f"{path.name} is missing; run `cotton3dg sfm` first") from error

    def fields(self, layout: str) -> tuple[Any, ...]:
        try:
            values = struct.unpack_from(f"<{layout}", self.content, self.at)
        except struct.error as error:
            raise self.bad("ends too early") from error
        self.at += struct.calcsize(f"<{layout}")
        return values

    def count(self, least_bytes: int) -> int:
        """A number of entries that fit, at `least_bytes` each, into the rest of the file."""
        n: int = self.fields("Q")[0]
        if n * least_bytes > len(self.content) - self.at:
            raise self.bad(f"claims {n} entries")
        return n

    def array(self, kind: np.dtype, n: int) -> NDArray[np.void]:
        """The next `n` entries; `count` has checked that they exist."""
        values = np.frombuffer(self.content, kind, n, self.at)
        self.at += n * kind.itemsize
        return values

    def skip(self, n_bytes: int) -> None:
        self.at += n_bytes

    def name(self) -> str:
        end = self.content.find(b"\0", self.at)
        if end < 0:
            raise self.bad("has a name without an end")
        raw, self.at = self.content[self.at : end], end + 1
        try:
            return raw.decode("utf-8")
        except UnicodeDecodeError as error:
            raise self.bad("has a name that is not UTF-8") from error

    def bad(self, what: str) -> BadInput:
        return BadInput(f"{self.path.name} is not a COLMAP model: it {what}; run `cotton3dg sfm --force`")


def read_cameras(model_dir: Path) -> list[Camera]:
    """Cameras of a model of undistorted images, one per image.

    An image whose pose is not finite is left out, with a warning in the log.

    Returns:
        Sorted by name.
    Raises:
        MissingInput: a file does not exist.
        BadInput: a file is damaged, a camera is not a pinhole camera, or no image is left.
    """
    pinholes = _read_pinholes(model_dir / "cameras.bin")
    reader = _Reader(model_dir / "images.bin")
    cameras: dict[str, Camera] = {}
    for name, pose, camera_id, _ in _read_images(reader):
        if not (np.abs(pose) < MAX_COORDINATE).all() or not np.abs(pose[:4]).max() > 1e-6:
            log.warning("sfm: the pose of %s is not finite; the image is left out", name)
            continue
        if camera_id not in pinholes:
            raise reader.bad(f"names camera {camera_id}, which is not there")
        if name in cameras or not name or "/" in name or "\\" in name:
            raise reader.bad(f"names an image {name!r}, twice or unsafe")
        width, height, (fx, fy, cx, cy) = pinholes[camera_id]
        cam_from_scene = np.hstack([rotations(np.array([pose[:4]]))[0], np.array(pose[4:])[:, None]])
        cameras[name] = Camera(name, width, height, fx, fy, cx, cy, cam_from_scene)
    if not cameras:
        raise reader.bad("has no image with a pose")
    return [cameras[name] for name in sorted(cameras)]


def read_tracks(model_dir: Path) -> dict[str, tuple[NDArray[np.float64], NDArray[np.int64]]]:
    """Where each image shows the triangulated points.

    Returns:
        Image name -> places (K, 2) px, x and y, (0.5, 0.5) being the centre of the first pixel; ids of the points (K,).
    Raises:
        MissingInput: the file is not there.
        BadInput: it is damaged.
    """
    tracks = {}
    for name, _, _, observed in _read_images(_Reader(model_dir / "images.bin")):
        places = np.column_stack([observed["x"], observed["y"]])
        known = (observed["point"] >= 0) & (np.abs(places) < MAX_COORDINATE).all(axis=1)
        tracks[name] = places[known], observed["point"][known]
    return tracks


def _read_images(reader: _Reader) -> Iterator[tuple[str, list[float], int, NDArray[np.void]]]:
    """Name, pose, camera id and observed points of each image of images.bin."""
    for _ in range(reader.count(73)):
        _, *pose, camera_id = reader.fields("I7dI")
        name = reader.name()
        yield name, pose, camera_id, reader.array(OBSERVATION, reader.count(OBSERVATION.itemsize))


def _read_pinholes(path: Path) -> dict[int, tuple[int, int, tuple[float, float, float, float]]]:
    """Camera id -> width, height, (fx, fy, cx, cy)."""
    reader = _Reader(path)
    pinholes = {}
    for _ in range(reader.count(24)):
        camera_id, model, width, height = reader.fields("iiQQ")
        if model not in PARAMETER_COUNTS:
            raise reader.bad("holds a camera with lens distortion where undistorted images are needed")
        values = reader.fields(f"{PARAMETER_COUNTS[model]}d")
        fx, fy, cx, cy = (values[0], *values) if len(values) == 3 else values
        if not (np.isfinite(values).all() and fx > 0 and fy > 0 and 0 < width <= 65535 and 0 < height <= 65535):
            raise reader.bad("holds a camera of impossible size or focal length")
        pinholes[camera_id] = (width, height, (fx, fy, cx, cy))
    return pinholes


def read_points(
    model_dir: Path,
) -> tuple[NDArray[np.float64], NDArray[np.uint8], NDArray[np.float64], NDArray[np.int64]]:
    """Triangulated points of a model; those that are not finite are left out.

    Returns:
        xyz (P, 3) su, RGB (P, 3), mean reprojection error (P,) px or -1 where unknown, and number of images (P,) of
        each point, in the order of their ids.
    Raises:
        MissingInput: the file is not there.
        BadInput: it is damaged.
    """
    return _read_points(model_dir)[1:]


def read_positions(model_dir: Path) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Ids (P,), ascending, of the points that `read_points` returns, and their xyz (P, 3) su; raises as that does."""
    ids, xyz, *_ = _read_points(model_dir)
    return ids.astype(np.int64), xyz


def _read_points(
    model_dir: Path,
) -> tuple[NDArray[np.uint64], NDArray[np.float64], NDArray[np.uint8], NDArray[np.float64], NDArray[np.int64]]:
    reader = _Reader(model_dir / "points3D.bin")
    starts = np.empty(reader.count(POINT.itemsize), np.int64)
    for row in range(len(starts)):
        starts[row] = reader.at
        reader.skip(POINT.itemsize - 8)
        reader.skip(8 * reader.count(8))
    content = np.frombuffer(reader.content, np.uint8)
    points = content[starts[:, None] + np.arange(POINT.itemsize)].view(POINT)[:, 0]
    points = points[np.argsort(points["id"], kind="stable")]
    points = points[(np.abs(points["xyz"]) < MAX_COORDINATE).all(axis=1)]
    errors, lengths = points["error"].copy(), points["n_images"].astype(np.int64)
    errors[~np.isfinite(errors)] = -1.0
    return points["id"].copy(), points["xyz"].copy(), points["rgb"].copy(), errors, lengths
