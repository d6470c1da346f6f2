# SPDX-License-Identifier: Apache-2.0
"""Masks in space on turns around varied plants: bolls of all kinds, in any light, before any background.

    python tests/accuracy/varied_turns.py FOLDER [--seeds 0 8] [--weights own FILE ...]
        [--set cluster.hough_voting.UNSURE=0.8 ...]

The plants are scenes of the kind that the bolls' network learns from, with numbers that no training reaches and 8 to 20
bolls; of odd ones most touch others. Each is filmed once around, in one light before one background, and a model is
trained from the true cameras; FOLDER keeps both, so that other networks or constants are judged on the same ones.

Prints a row a plant and network, and their means: bolls, found ones that are true (all masks of one together overlap
a true boll's by an IoU of 0.5) and that are not, mIoU of the masks, how much larger than the true ones these are,
and the shares of the true lint that is found, and of false lint.
"""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd
from markdown_tables import markdown
from numpy.typing import NDArray

from cotton3dg.cluster.locate_bolls import locate_bolls
from cotton3dg.core.scene import Camera, Float32, Float64, Gaussians
from cotton3dg.core.srgb import to_linear
from cotton3dg.evaluation.masks import match_ious, score_masks
from cotton3dg.gaussians.views import View
from cotton3dg.geometry.camera_orbit import find_up, fit_orbit, within_orbit
from cotton3dg.io.ply import read_gaussians, write_gaussians
from cotton3dg.masks.bolls import BollNetwork, open_bolls
from cotton3dg.options import resolve
from cotton3dg.segment.lint_share import gather_lint
from cotton3dg.simulate.backgrounds import paint_backgrounds
from cotton3dg.simulate.compositing import draw_power
from cotton3dg.simulate.mesh import unit
from cotton3dg.simulate.plates import LitScene, light_scene
from cotton3dg.simulate.rays import interpolate
from cotton3dg.simulate.training_scenes import LINT, Crowd, TrainingScene, build_scene
from cotton3dg.train.initialise import start_gaussians
from cotton3dg.train.trainer import fit

FIRST_SEED = 9_000_000
"""Far beyond the scenes that any network was trained on."""
VIEWS, WIDTH, HEIGHT = 36, 960, 540
SUPERSAMPLING = 2
FOCAL_PX = 0.95 * WIDTH
FAR_M = 5.0
"""Radius of the ball around the plant that the background is painted on. It has to stand somewhere: what moves with
the camera no model explains but by haze before each view."""
HIGH = 0.9
"""rad, half the height of what is painted on it."""
FILLED = 0.85
"""Share of the image's height that the plant fills ..."""
LEAST_PX = 22.0
"""... or more, if bolls would be narrower."""
TRAINING = {"steps": "1500", "max_gaussians": "80000", "holdout": "0"}


class Turn(NamedTuple):
    images: NDArray[np.uint8]
    """(VIEWS, H, W, 3)"""
    ids: NDArray[np.uint8]
    """(VIEWS, H, W) boll whose lint is seen; 0 = none."""
    cameras: list[Camera]
    gaussians: Gaussians


class Phone(NamedTuple):
    """What makes an image of the light."""

    gain: Float64
    """(3,)"""
    soft_px: float
    electrons: float
    contrast: float
    quality: int

    def develop(self, light: Float32, rng: np.random.Generator) -> NDArray[np.uint8]:
        light = cv2.GaussianBlur(light * self.gain.astype(np.float32), (0, 0), self.soft_px)
        noise = np.sqrt(light.clip(0) / np.float32(self.electrons) + np.float32(1e-6))
        bent = (light + noise * rng.standard_normal(light.shape, np.float32)).clip(0, 1) ** np.float32(1 / 2.2)
        bent += np.float32(self.contrast) * bent * (1 - bent) * (2 * bent - 1)
        picture = np.round(255 * bent.clip(0, 1)).astype(np.uint8)
        _, code = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, self.quality])
        return np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR))[..., ::-1]


def film(seed: int) -> tuple[list[View], NDArray[np.uint8], NDArray, NDArray[np.uint8]]:
    """A turn's images and ids, and points with colours that a training can start from."""
    rng = np.random.default_rng([seed, 21])
    clustered = rng.uniform(0.6, 0.9) if seed % 2 else 0.0
    crowd = Crowd(int(rng.integers(8, 21)), clustered, rng.uniform(0.66, 0.8))
    lit, power = light_scene(build_scene(FIRST_SEED + seed, crowd), rng), draw_power(rng)
    seen = np.einsum("lvc,lc->vc", lit.radiance, power)
    reference = float(np.quantile(seen[lit.scene.classes == LINT].mean(axis=1), 0.95))
    around = _paint_around(seed, reference, rng)
    phone = Phone(
        np.exp(rng.normal(np.log(0.6), 0.25) + rng.normal(0, 0.06) * np.array([1, 0, -1])) / reference,
        soft_px=rng.uniform(0.3, 0.9),
        electrons=np.exp(rng.uniform(np.log(800), np.log(8000))),
        contrast=rng.uniform(-0.4, 1.0),
        quality=int(rng.integers(60, 95)),
    )
    views, ids = [], []
    for camera in _turn_around(lit.scene, rng):
        light, of_view = _look(lit, seen, around, camera)
        views.append(View(camera, phone.develop(light, rng)))
        ids.append(of_view)
    near, far = rng.permutation(len(seen))[:15_000], unit(rng.normal(0, 1, (4000, 3)))
    backdrop = _background(around, np.zeros(3), far[None].astype(np.float32))[0]
    light = np.concatenate([seen[near], backdrop]) * phone.gain
    colours = np.round(255 * light.clip(0, 1) ** (1 / 2.2)).astype(np.uint8)
    return views, np.stack(ids), np.concatenate([lit.scene.mesh.vertices[near], FAR_M * far]), colours


def _paint_around(seed: int, reference: float, rng: np.random.Generator) -> Float32:
    """(H, W, 3) linear light by height and azimuth: two backgrounds and their mirror images."""
    pictures = paint_backgrounds(FIRST_SEED + seed)
    chosen = [to_linear(pictures[int(k)].astype(np.float32) / 255) for k in rng.integers(len(pictures), size=2)]
    row = np.concatenate([side for picture in chosen for side in (picture, picture[:, ::-1])], axis=1)
    brightness = np.exp(rng.uniform(np.log(0.06), np.log(1.7))) * reference / max(float(np.quantile(row, 0.9)), 1e-4)
    return (row * brightness).astype(np.float32)


def _background(around: Float32, eye: Float64, directions: Float32) -> Float32:
    """What is far away from a place within the ball in directions (H, W, 3)."""
    square, along = np.einsum("...i,...i", directions, directions), directions @ eye.astype(np.float32)
    reach = (np.sqrt(along**2 + square * np.float32(FAR_M**2 - eye @ eye)) - along) / square
    x, y, z = np.moveaxis(eye.astype(np.float32) + reach[..., None] * directions, -1, 0)
    columns = (np.arctan2(y, x) / (2 * np.pi) + 0.5) * around.shape[1]
    rows = (0.5 - 0.5 * np.arctan2(z, np.hypot(x, y)) / HIGH).clip(0, 1) * (around.shape[0] - 1)
    return cv2.remap(around, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)


def _turn_around(scene: TrainingScene, rng: np.random.Generator) -> list[Camera]:
    """Cameras on a circle around the plant, at about the height of a head."""
    low, high = (np.concatenate([scene.targets, np.zeros((1, 3))]).min(axis=0), scene.targets.max(axis=0))
    boll_m = float(np.median(scene.diameters))
    wide_px = max(FILLED * HEIGHT / float(high[2] - low[2] + boll_m) * boll_m, LEAST_PX)
    cameras = []
    for k in range(VIEWS):
        azimuth, slope = 2 * np.pi * k / VIEWS, rng.normal(0.25, 0.06)
        out = np.array([np.cos(azimuth) * np.cos(slope), np.sin(azimuth) * np.cos(slope), np.sin(slope)])
        right = unit(np.cross(-out, (0, 0, 1.0)))
        rotation = np.stack([right, np.cross(-out, right), -out])
        centre = 0.5 * (low + high) + (FOCAL_PX * boll_m / wide_px + 0.1) * out
        cameras.append(_camera(k, np.column_stack([rotation, -rotation @ centre])))
    return cameras


def _camera(number: int, pose: Float64) -> Camera:
    return Camera(f"{number:04d}.jpg", WIDTH, HEIGHT, FOCAL_PX, FOCAL_PX, WIDTH / 2, HEIGHT / 2, pose)


def _look(lit: LitScene, seen: NDArray, around: Float32, camera: Camera) -> tuple[Float32, NDArray[np.uint8]]:
    """Linear light and boll ids of an image; `seen`: light (V, 3) of the scene's vertices."""
    n = SUPERSAMPLING
    x, y = ((np.arange(n * side, dtype=np.float32) + 0.5) / n - 0.5 * side for side in (WIDTH, HEIGHT))
    grid = np.stack([*np.meshgrid(x / FOCAL_PX, y / FOCAL_PX), np.ones((len(y), len(x)))], axis=-1)
    directions = (grid @ camera.rotation).astype(np.float32)
    found = lit.rays.cast(camera.centre.astype(np.float32), directions.reshape(-1, 3))
    light = _background(around, camera.centre, directions).reshape(-1, 3)
    hit = np.flatnonzero(found.meshes >= 0)
    corners = lit.scene.mesh.triangles[found.triangles[hit]]
    light[hit] = interpolate(seen, corners, found.weights[hit])
    ids = np.zeros(len(light), np.uint8)
    ids[hit] = lit.scene.boll_ids[found.triangles[hit]]
    small = cv2.resize(light.reshape(*grid.shape), (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    return small, ids.reshape(grid.shape[:2])[n // 2 :: n, n // 2 :: n].copy()


def open_turn(folder: Path, seed: int) -> Turn:
    """The turn of a seed, filmed and trained if it is not there yet."""
    film_npz, model_ply = folder / f"{seed}.npz", folder / f"{seed}.ply"
    if not model_ply.exists():
        folder.mkdir(parents=True, exist_ok=True)
        views, ids, points, colours = film(seed)
        options = resolve("train", TRAINING)
        gaussians = fit(start_gaussians(points, colours, views, options), views, options).gaussians
        images, poses = np.stack([v.image for v in views]), np.stack([v.camera.cam_from_scene for v in views])
        np.savez_compressed(film_npz, images=images, ids=ids, poses=poses)
        write_gaussians(model_ply, gaussians)
    with np.load(film_npz) as kept:
        cameras = [_camera(number, pose) for number, pose in enumerate(kept["poses"])]
        return Turn(kept["images"], kept["ids"], cameras, read_gaussians(model_ply))


def measure(turn: Turn, network: BollNetwork) -> dict[str, float]:
    """What all images together make of a turn."""
    orbit = fit_orbit(turn.cameras)
    maps = [network.maps(image) for image in turn.images]
    of_plant = within_orbit(turn.gaussians.means, turn.cameras, orbit)
    shares = gather_lint(maps, turn.cameras, turn.gaussians, of_plant)
    located = locate_bolls(maps, turn.cameras, turn.gaussians, shares, find_up(turn.cameras))
    return score(turn, np.stack([located.images[camera.name] for camera in turn.cameras]))


def score(turn: Turn, found: NDArray[np.uint16]) -> dict[str, float]:
    """How bolls drawn into the images (V, H, W) agree with the true ones."""
    true = turn.ids.astype(np.uint16)
    anything = (found > 0) | (true > 0)
    ious, ours, theirs = match_ious(found[anything], true[anything])
    hits = ious >= 0.5
    return {
        "bolls": int((theirs > 0).sum()),
        "true": int(hits.sum()),
        "false": int((ours > 0).sum() - hits.sum()),
        "mIoU": score_masks(zip(found, true, strict=True))[1],
        "larger": float(np.median(ours[hits] / theirs[hits])) - 1,
        "lint found": float((found[true > 0] > 0).mean()),
        "lint false": float((found[true == 0] > 0).sum() / (true > 0).sum()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 8), metavar=("FIRST", "END"))
    parser.add_argument("--weights", nargs="+", default=["own"], help="networks, .onnx; own = the program's")
    parser.add_argument("--set", nargs="*", default=[], metavar="MODULE.CONSTANT=VALUE", help="of cotton3dg")
    wanted = parser.parse_args()
    for place, _, value in (text.partition("=") for text in wanted.set):
        module, _, constant = place.rpartition(".")
        setattr(importlib.import_module(f"cotton3dg.{module}"), constant, float(value))
    networks = {name: open_bolls(None if name == "own" else Path(name)) for name in wanted.weights}
    rows = []
    for seed in range(*wanted.seeds):
        turn = open_turn(wanted.folder, seed)
        for name, network in networks.items():
            rows.append({"seed": seed, "network": Path(name).stem, **measure(turn, network)})
            print(rows[-1], flush=True)
    means = pd.DataFrame(rows).groupby("network", sort=False).mean().drop(columns="seed").reset_index()
    print(markdown(pd.DataFrame(rows), 3), markdown(means, 3), sep="\n")


if __name__ == "__main__":
    main()
