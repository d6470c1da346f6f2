# SPDX-License-Identifier: Apache-2.0
"""A textured room with a box in it, seen by a pinhole camera on a circle: pictures for structure from motion."""

import cv2
import numpy as np

WIDTH, HEIGHT, FOCAL_PX = 400, 300, 380.0
RADIUS = 1.3


def textures(seed=1):
    """(12, 512, 512, 3): six faces of the room, six of the box; blobs of all sizes."""
    rng = np.random.default_rng(seed)
    sizes = (8, 32, 96, 256)
    layers = [
        np.array([cv2.resize(rng.random((size, size, 3), np.float32), (512, 512)) for _ in range(12)]) for size in sizes
    ]
    return (np.mean(layers, axis=0) * 440 - 90).clip(0, 255).astype(np.uint8)


def pose(angle):
    """Camera on the circle, looking at the centre: cam_from_scene rotation rows and centre."""
    centre = np.array([RADIUS * np.cos(angle), RADIUS * np.sin(angle), 0.35 + 0.05 * np.sin(3 * angle)])
    forward = -centre / np.linalg.norm(centre)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward]), centre


def render(faces, angle, yaw=0.0, k1=0.0):
    """Cast a ray a pixel onto the inside of the room (4 x 4 x 2.4) and the outside of the box (0.8 x 0.6 x 0.7).

    `yaw` turns the camera away from the box, radians; `k1` is the radial distortion of its lens.
    """
    rotation, centre = pose(angle)
    rotation = cv2.Rodrigues(np.array([0.0, yaw, 0.0]))[0] @ rotation
    x, y = np.meshgrid(
        (np.arange(WIDTH) + 0.5 - WIDTH / 2) / FOCAL_PX, (np.arange(HEIGHT) + 0.5 - HEIGHT / 2) / FOCAL_PX
    )
    distorted = np.stack([x, y], axis=2).reshape(-1, 1, 2)
    straight = cv2.undistortPoints(distorted, np.eye(3), np.array([k1, 0, 0, 0])).reshape(HEIGHT, WIDTH, 2)
    rays = np.concatenate([straight, np.ones_like(x)[..., None]], axis=2) @ rotation
    picture = None
    for first, half in ((0, np.array([2, 2, 1.2])), (6, np.array([0.4, 0.3, 0.35]))):
        near = np.minimum((-half - centre) / rays, (half - centre) / rays)
        far = np.maximum((-half - centre) / rays, (half - centre) / rays)
        if first:
            axis, t = near.argmax(axis=2), near.max(axis=2)
            hit = t < far.min(axis=2)
        else:
            axis, t = far.argmin(axis=2), far.min(axis=2)
            hit = np.ones_like(t, bool)
        points = (centre + rays * t[..., None]) / half
        along = np.take_along_axis(points, axis[..., None], axis=2)[..., 0]
        u = np.where(axis == 0, points[..., 1], points[..., 0])
        v = np.where(axis == 2, points[..., 1], points[..., 2])
        u, v = ((w.clip(-1, 1) + 1) / 2 * 510 for w in (u, v))
        face = first + 2 * axis + (along > 0)
        colours = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        for index in range(first, first + 6):
            mapped = cv2.remap(faces[index], u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
            colours[face == index] = mapped[face == index]
        picture = colours if picture is None else np.where(hit[..., None], colours, picture)
    return picture
