# SPDX-License-Identifier: Apache-2.0
"""Cameras and Gaussians, the two halves of a splatted scene.

Lengths are in su, the arbitrary scene unit of the structure-from-motion model, until `Scale` turns them into cm.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
SH_CONSTANT: Final = 0.28209479177387814
"""Value of the constant spherical harmonic, 1 / (2 sqrt(pi))."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with a pose.

    Axes follow OpenCV (x right, y down, z forward). Pixel (0, 0) is the top-left corner of the top-left
    pixel, whose centre is (0.5, 0.5), as in COLMAP.
    """

    name: str
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    cam_from_scene: Float64
    """(3, 4) rigid transform."""

    @property
    def rotation(self) -> Float64:
        """(3, 3) rotation part of `cam_from_scene`."""
        return self.cam_from_scene[:, :3]

    @property
    def centre(self) -> Float64:
        """(3,) position of the camera in the scene, su."""
        return -self.cam_from_scene[:, :3].T @ self.cam_from_scene[:, 3]

    @property
    def forward(self) -> Float64:
        """(3,) unit viewing direction in the scene."""
        return self.cam_from_scene[2, :3]

    def resized(self, width: int, height: int) -> Camera:
        """The same camera with its image scaled to width x height pixels."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self, width=width, height=height, fx=self.fx * sx, fy=self.fy * sy, cx=self.cx * sx, cy=self.cy * sy
        )

    def project(self, points: NDArray[Any]) -> tuple[Float64, Float64]:
        """Project scene points.

        Args:
            points: (N, 3) su.
        Returns:
            pixels (N, 2) px and depths (N,) su; pixels of points with depth <= 0 are NaN.
        """
        in_camera = np.asarray(points, np.float64) @ self.cam_from_scene[:, :3].T + self.cam_from_scene[:, 3]
        depths = in_camera[:, 2]
        z = np.where(depths > 0, depths, np.nan)[:, None]
        return in_camera[:, :2] / z * (self.fx, self.fy) + (self.cx, self.cy), depths

    def rays(self, pixels: NDArray[Any]) -> Float64:
        """(..., 3) viewing rays of unit depth, in the camera's axes, through (..., 2) px."""
        flat = (np.asarray(pixels, np.float64) - (self.cx, self.cy)) / (self.fx, self.fy)
        return np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1)


@dataclass(frozen=True)
class Gaussians:
    """N anisotropic 3D Gaussians in the parametrisation of 3D Gaussian splatting (Kerbl et al. 2023)."""

    means: Float32
    """(N, 3) su."""
    quats: Float32
    """(N, 4) wxyz, not necessarily normalised."""
    log_scales: Float32
    """(N, 3) natural logarithm of the standard deviations in su."""
    opacity_logits: Float32
    """(N,)"""
    sh: Float32
    """(N, K, 3) spherical harmonics of the colour, K = 1, 4, 9 or 16."""

    def __post_init__(self) -> None:
        n = len(self.means)
        expected = {"means": (n, 3), "quats": (n, 4), "log_scales": (n, 3), "opacity_logits": (n,)}
        for name, shape in expected.items():
            array = getattr(self, name)
            if array.shape != shape or array.dtype != np.float32:
                raise ValueError(f"{name} must be float32 {shape}, got {array.dtype} {array.shape}")
        if self.sh.dtype != np.float32 or self.sh.ndim != 3 or len(self.sh) != n or self.sh.shape[2] != 3:
            raise ValueError(f"sh must be float32 ({n}, K, 3), got {self.sh.dtype} {self.sh.shape}")
        if self.sh.shape[1] not in (1, 4, 9, 16):
            raise ValueError(f"sh must have 1, 4, 9 or 16 coefficients, got {self.sh.shape[1]}")

    def __len__(self) -> int:
        return len(self.means)

    def __getitem__(self, rows: NDArray[Any] | slice) -> Gaussians:
        """The Gaussians at `rows` (indices, a mask or a slice)."""
        return Gaussians(
            self.means[rows], self.quats[rows], self.log_scales[rows], self.opacity_logits[rows], self.sh[rows]
        )

    @property
    def opacities(self) -> Float32:
        """(N,) in 0..1."""
        return np.exp(-np.logaddexp(np.float32(0.0), -self.opacity_logits))

    @property
    def scales(self) -> Float32:
        """(N, 3) standard deviations, su."""
        return np.exp(self.log_scales)

    @property
    def colours(self) -> Float32:
        """(N, 3) RGB of the constant spherical harmonic, clipped to 0..1."""
        colours: Float32 = np.clip(0.5 + SH_CONSTANT * self.sh[:, 0], 0.0, 1.0)
        return colours

    @property
    def sh_degree(self) -> int:
        """0, 1, 2 or 3."""
        return int(np.sqrt(self.sh.shape[1])) - 1

    @property
    def finite_rows(self) -> NDArray[np.bool_]:
        """(N,) whether all parameters of a Gaussian are finite."""
        rows = np.isfinite(self.opacity_logits) & np.isfinite(self.sh).all(axis=(1, 2))
        for array in (self.means, self.quats, self.log_scales):
            rows &= np.isfinite(array).all(axis=1)
        return rows

    def sha256(self) -> str:
        """Hash of all parameters, so that per-Gaussian fields can name the model they belong to."""
        digest = hashlib.sha256()
        for array in (self.means, self.quats, self.log_scales, self.opacity_logits, self.sh):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()


def rotations(quats: NDArray[Any]) -> Float64:
    """(N, 3, 3) rotation matrices of (N, 4) wxyz quaternions of any non-zero length."""
    q = np.asarray(quats, np.float64)
    w, x, y, z = (q / np.maximum(np.linalg.norm(q, axis=1, keepdims=True), 1e-12)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
