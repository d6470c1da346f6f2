# SPDX-License-Identifier: Apache-2.0
"""Plates: small pictures of a training scene, one for each light source, to be lit and laid over backgrounds later.

Light is linear, so a scene that was rendered once under each of a few lamps can be shown in any mixture of them: at
noon, dim, from behind, in two colours. A plate costs a fraction of a second, a picture made from it a few milliseconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from shutil import rmtree
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.scene import Float32, Float64
from .mesh import unit
from .rays import Rays, build_rays, interpolate
from .training_scenes import LINT, TrainingScene, build_scene

PLATE_PX: Final = 288
"""Side of a plate; crops of it are what networks see."""
SUPERSAMPLING: Final = 2
LIGHTS: Final = 4
"""Two lamps, the sky above, and light from all around."""
HEMISPHERE_RAYS: Final = 24
LAMP_SAMPLES: Final = 8
WRAP: Final = (0.25, 0.9)
"""Cosine beyond the terminator at which the shade of lint begins, because lint lets light through: the least value, and
that of loose lint."""
SPREAD: Final = 0.6
"""Largest share of a boll's light that spreads all over it before it leaves."""
BOLL_PX: Final = (15.0, 220.0)
"""Widths of bolls in the plates, drawn on a logarithmic scale."""


@dataclass(frozen=True)
class Plate:
    light: NDArray[np.uint8]
    """(LIGHTS, H, W, 3) linear light, weighted with `cover`: square roots, 255 = the root of the light's brightest."""
    brightest: Float32
    """(LIGHTS,) linear light."""
    cover: NDArray[np.uint8]
    """(H, W) share of the pixel that the scene covers, of 255."""
    classes: NDArray[np.uint8]
    """(H, W) `CLASSES` of what covers the pixel's middle; 0 where nothing does."""
    ids: NDArray[np.uint8]
    """(H, W) boll whose lint covers the pixel's middle; 0 = none."""
    centres_px: NDArray[np.float32]
    """(B, 2) x, y of the middle of boll b + 1, seen or not."""
    diameters_px: NDArray[np.float32]
    """(B,)"""

    def lit(self, power: Float32, light: NDArray[np.uint8] | None = None) -> Float32:
        """(H, W, 3) linear light under a mixture of the lights, (LIGHTS, 3) RGB.

        Args:
            light: the plate's own, bent or cut; None = as it is.
        """
        passes = self.light if light is None else light
        total = np.zeros(passes.shape[1:], np.float32)
        for roots, brightest, colour in zip(passes, self.brightest, power, strict=True):
            values = roots.astype(np.float32)
            total += values * values * (colour * (brightest / 65025)).astype(np.float32)
        return total


@dataclass(frozen=True)
class LitScene:
    scene: TrainingScene
    rays: Rays
    radiance: Float32
    """(LIGHTS, V, 3) light that each vertex sends out under each light source."""


def light_scene(scene: TrainingScene, rng: np.random.Generator) -> LitScene:
    """Let each light shine once on everything; the lit surfaces reflect it, once."""
    mesh = scene.mesh
    rays, vertices = build_rays([(mesh.vertices, mesh.triangles)]), mesh.vertices.astype(np.float32)
    normals = mesh.normals().astype(np.float32)
    starts = vertices + 0.0006 * normals
    loose = rng.uniform() if rng.random() < 0.6 else 0.0
    wrap = np.where(scene.classes == LINT, np.float32(WRAP[0] + loose * (WRAP[1] - WRAP[0])), np.float32(0))
    direct = np.zeros((LIGHTS, len(vertices)), np.float32)
    for lamp in range(2):
        direct[lamp] = _from_lamp(rays, starts, normals, wrap, _lamp_directions(rng))
    albedo = mesh.colours.astype(np.float32)
    hits = []
    for towards in _hemisphere(normals, HEMISPHERE_RAYS):
        found = rays.cast(starts, towards)
        free = found.meshes < 0
        hits.append(found.triangles)
        direct[2] += free * (0.25 + 0.75 * (towards[:, 2] > 0)) / HEMISPHERE_RAYS
        direct[3] += free / np.float32(HEMISPHERE_RAYS)
    direct = spread_light(direct, _bolls_of_vertices(scene), SPREAD * loose)
    sent = direct[:, :, None] * albedo
    bounced = np.zeros_like(sent)
    first = mesh.triangles[:, 0]
    for hit in hits:
        lit = np.flatnonzero(hit >= 0)
        bounced[:, lit] += sent[:, first[hit[lit]]] / np.float32(HEMISPHERE_RAYS)
    return LitScene(scene, rays, (sent + bounced * albedo).astype(np.float32))


def _bolls_of_vertices(scene: TrainingScene) -> NDArray[np.int64]:
    """(V,) boll whose lint a vertex belongs to, 1, 2, ...; 0 = none."""
    bolls = np.zeros(len(scene.mesh.vertices), np.int64)
    bolls[scene.mesh.triangles.ravel()] = np.repeat(scene.boll_ids, 3)
    return bolls


def spread_light(arriving: Float32, bolls: NDArray[np.int64], share: float) -> Float32:
    """Light (LIGHTS, V) with a share of it spread evenly over each boll's lint, as between loose fibres."""
    counts = np.bincount(bolls).clip(min=1)
    means = np.stack([np.bincount(bolls, light) / counts for light in arriving]).astype(np.float32)
    return np.where(bolls > 0, arriving + np.float32(share) * (means[:, bolls] - arriving), arriving)


def _lamp_directions(rng: np.random.Generator) -> Float32:
    """(LAMP_SAMPLES, 3) towards a lamp far away: the sun (small), a window or a row of tubes (large); mostly above."""
    to = unit(rng.normal(0, 1, 3) * (1, 1, 0.7) + (0, 0, 0.45))
    size = rng.choice([0.03, 0.15, 0.45])
    return unit(to + size * rng.normal(0, 1, (LAMP_SAMPLES, 3))).astype(np.float32)


def _from_lamp(rays: Rays, starts: Float32, normals: Float32, wrap: Float32, directions: Float32) -> Float32:
    total = np.zeros(len(starts), np.float32)
    for towards in directions:
        cosines = ((normals @ towards + wrap) / (1 + wrap)).clip(min=0)
        lit = np.flatnonzero(cosines > 0)
        total[lit] += ~rays.blocked(starts[lit], towards) * cosines[lit]
    return total / np.float32(len(directions))


def _hemisphere(normals: Float32, count: int) -> list[Float32]:
    """`count` times (V, 3) directions, cosine-weighted around each normal: a Fibonacci spiral."""
    k = np.arange(count)
    radius, angle = np.sqrt((k + 0.5) / count), k * np.pi * (3 - np.sqrt(5))
    helper = np.where(np.abs(normals[:, 1:2]) < 0.9, [[0, 1, 0]], [[1, 0, 0]]).astype(np.float32)
    x = np.cross(helper, normals)
    x /= np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-9)
    y = np.cross(normals, x)
    spiral = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], axis=1)
    return [a * x + b * y + c * normals for a, b, c in spiral.astype(np.float32)]


@dataclass(frozen=True)
class _View:
    centre: Float64
    rotation: Float64
    """(3, 3) camera from scene, OpenCV axes."""
    focal_px: float


def _look_at(target: Float64, width_m: float, width_px: float, rng: np.random.Generator) -> _View:
    """A camera that shows a width of `width_m` at the target as `width_px`, off the plate's middle."""
    distance = rng.uniform(0.5, 2.2)
    slope = np.clip(rng.normal(0.15, 0.35), -0.9, 1.1)
    azimuth = rng.uniform(0, 2 * np.pi)
    out = np.array([np.cos(azimuth) * np.cos(slope), np.sin(azimuth) * np.cos(slope), np.sin(slope)])
    focal = width_px * distance / width_m
    forward = -out
    level = unit(np.cross(forward, (0, 0, 1.0)))
    roll = rng.normal(0, 0.15)
    right = np.cos(roll) * level + np.sin(roll) * np.cross(forward, level)
    down = np.cross(forward, right)
    off = rng.uniform(-0.4, 0.4, 2) * PLATE_PX / focal * distance
    return _View(target + distance * out + off[0] * right + off[1] * down, np.stack([right, down, forward]), focal)


def render_plate(lit: LitScene, rng: np.random.Generator) -> Plate:
    """A plate of a scene from somewhere, at some size."""
    scene = lit.scene
    target = scene.targets[int(rng.integers(len(scene.targets)))]
    wide = float(np.median(scene.diameters)) if len(scene.diameters) else 0.045
    view = _look_at(target, wide, float(np.exp(rng.uniform(*np.log(BOLL_PX)))), rng)
    n, size = SUPERSAMPLING, PLATE_PX
    grid = (np.arange(size * n, dtype=np.float32) + 0.5) / n - 0.5 * size
    x, y = np.meshgrid(grid / view.focal_px, grid / view.focal_px)
    directions = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3) @ view.rotation.astype(np.float32)
    found = lit.rays.cast(view.centre.astype(np.float32), directions.astype(np.float32))
    hit = found.meshes >= 0
    where = np.flatnonzero(hit)
    triangles = found.triangles[where]
    corners = scene.mesh.triangles[triangles]
    light = np.zeros((LIGHTS, len(hit), 3), np.float32)
    for number in range(LIGHTS):
        light[number, where] = interpolate(lit.radiance[number], corners, found.weights[where])
    shape = (size * n, size * n)
    shrunk = np.stack([cv2.resize(p.reshape(*shape, 3), (size, size), interpolation=cv2.INTER_AREA) for p in light])
    brightest = np.maximum(shrunk.reshape(LIGHTS, -1).max(axis=1), 1e-6)
    # At a triangle's edge, weights are as little below zero as single precision rounds.
    roots = np.sqrt(shrunk.clip(min=0) / brightest[:, None, None, None])
    cover = cv2.resize(hit.reshape(shape).astype(np.float32), (size, size), interpolation=cv2.INTER_AREA)
    classes, ids = np.zeros(len(hit), np.uint8), np.zeros(len(hit), np.uint8)
    classes[where] = scene.classes[corners[:, 0]]
    ids[where] = scene.boll_ids[triangles]
    middle = np.s_[n // 2 :: n, n // 2 :: n]
    local = (scene.centres - view.centre) @ view.rotation.T
    depth = np.maximum(local[:, 2:], 1e-3)
    return Plate(
        light=np.round(255 * roots).astype(np.uint8),
        brightest=brightest,
        cover=np.round(255 * cover).astype(np.uint8),
        classes=classes.reshape(shape)[middle].copy(),
        ids=ids.reshape(shape)[middle].copy(),
        centres_px=(local[:, :2] / depth * view.focal_px + 0.5 * size).astype(np.float32),
        diameters_px=(scene.diameters / depth[:, 0] * view.focal_px).astype(np.float32),
    )


def render_plates(seed: int, count: int) -> list[Plate]:
    """`count` plates of the scene of a seed."""
    rng = np.random.default_rng([seed, 12])
    lit = light_scene(build_scene(seed), rng)
    return [render_plate(lit, rng) for _ in range(count)]


def save_plates(folder: Path, plates: Sequence[Plate]) -> None:
    """Write the plates of a scene, an array a field, as they are: readers map them instead of holding them."""
    partial = folder.with_suffix(".partial")
    rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    for item in fields(Plate):
        np.save(partial / f"{item.name}.npy", np.stack([getattr(plate, item.name) for plate in plates]))
    partial.replace(folder)


def load_plates(folder: Path) -> list[Plate]:
    """The plates that `save_plates` wrote, mapped into memory."""
    names = [item.name for item in fields(Plate)]
    arrays = {name: np.load(folder / f"{name}.npy", mmap_mode="r", allow_pickle=False) for name in names}
    count = len(arrays["brightest"])
    return [Plate(**{name: values[k] for name, values in arrays.items()}) for k in range(count)]
