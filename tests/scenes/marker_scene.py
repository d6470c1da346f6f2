# SPDX-License-Identifier: Apache-2.0
"""Photos of printed markers that lie on a table, by homographies of a picture of the table top, in linear light."""

from __future__ import annotations

import cv2
import numpy as np

from cotton3dg.core.scene import Camera
from scenes.table_scene import POSE, Pose

DOTS_PER_CM = 25
LENGTH_CM, WIDTH_CM = 120.0, 60.0


def top_picture(markers: dict[int, tuple[float, float, float]], side_cm: float = 12.0) -> np.ndarray:
    """(H, W) linear light of a table top; markers are id -> x, y (cm, from the middle) and turn (rad)."""
    d = DOTS_PER_CM
    picture = np.full((round(WIDTH_CM * d), round(LENGTH_CM * d)), 0.25, np.float32)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for number, (x, y, turn) in markers.items():
        size = 600
        bits = cv2.aruco.generateImageMarker(dictionary, number, size)
        paper = np.pad(0.04 + 0.8 * (bits / 255.0).astype(np.float32), 100, constant_values=0.84)
        per = side_cm * d / size
        cos, sin = np.cos(turn) * per, np.sin(turn) * per
        # Pixel (u, v) counted from the centre of the first; y points up, rows down.
        linear = np.array([[cos, sin], [-sin, cos]])
        middle = np.array([(x + LENGTH_CM / 2) * d, (WIDTH_CM / 2 - y) * d]) - 0.5
        shift = middle - linear @ np.full(2, (len(paper) - 1) / 2)
        where = (picture.shape[1], picture.shape[0])
        warp = np.column_stack([linear, shift]).astype(np.float64)
        inside = cv2.warpAffine(np.ones_like(paper), warp, where, flags=cv2.INTER_LINEAR)
        picture = picture * (1 - inside) + cv2.warpAffine(paper, warp, where, flags=cv2.INTER_LINEAR)
    return cv2.GaussianBlur(picture, (0, 0), 0.05 * d)


def board_picture(board: cv2.aruco.CharucoBoard, columns: int, rows: int, square_cm: float) -> np.ndarray:
    """The same with a ChArUco board in the middle, its rows along the table's width."""
    picture = np.full((round(WIDTH_CM * DOTS_PER_CM), round(LENGTH_CM * DOTS_PER_CM)), 0.25, np.float32)
    size = (round(columns * square_cm * DOTS_PER_CM), round(rows * square_cm * DOTS_PER_CM))
    drawn = 0.04 + 0.8 * board.generateImage(size, None, 0, 1).astype(np.float32) / 255
    rim = 2 * DOTS_PER_CM
    drawn = np.pad(drawn, rim, constant_values=0.84)
    y, x = (picture.shape[0] - drawn.shape[0]) // 2, (picture.shape[1] - drawn.shape[1]) // 2
    picture[y : y + drawn.shape[0], x : x + drawn.shape[1]] = drawn
    return picture


def photo_of_top(
    camera: Camera, top: np.ndarray, pose: Pose = POSE, blur_px: float = 0.6, noise: float = 2.0
) -> np.ndarray:
    """(H, W, 3) uint8 sRGB of the table top before a grey room."""
    n = 2
    corners_cm = np.array([[-LENGTH_CM / 2, WIDTH_CM / 2, 0], [LENGTH_CM / 2, WIDTH_CM / 2, 0],
                           [LENGTH_CM / 2, -WIDTH_CM / 2, 0], [-LENGTH_CM / 2, -WIDTH_CM / 2, 0]])  # fmt: skip
    pixels, _ = camera.project(pose.scene(corners_cm))
    height, width = top.shape
    source = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32) - 0.5
    target = (n * pixels - 0.5).astype(np.float32)
    warp = cv2.getPerspectiveTransform(source, target)
    large = cv2.warpPerspective(
        top, warp, (n * camera.width, n * camera.height), flags=cv2.INTER_LINEAR, borderValue=0.12
    )
    light = cv2.resize(large, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    light = cv2.GaussianBlur(light, (0, 0), blur_px)
    grey = 255 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-6) ** (1 / 2.4) - 0.055)
    rng = np.random.default_rng(sum(camera.name.encode()))
    grey = grey + noise * rng.standard_normal(grey.shape, np.float32)
    return np.repeat(np.clip(grey + 0.5, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
