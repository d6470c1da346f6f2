# SPDX-License-Identifier: Apache-2.0
"""From plant, room and camera to an image: one ray cast, stored light, prefiltered textures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.scene import Camera, Float32
from ..core.srgb import to_linear, to_srgb
from .atlas import Atlas, pack
from .lighting import irradiance
from .mesh import Mesh, merge
from .plant import PlantMeshes
from .rays import Hits, Rays, build_rays, interpolate
from .room import Panel, Room

WHITE: Final = 0.88
"""Linear value of the brightest 2 % of the lint: the exposure is set for it, as a phone does for a white subject."""
VOID: Final = 0.05
"""Linear light where a ray leaves the room through its open top."""


@dataclass(frozen=True)
class RenderScene:
    """A lit room with a plant, ready for rays. Geometry 0 = panels (two triangles each), 1 = plant, then the things
    in the room."""

    rays: Rays
    atlas: Atlas
    densities: Float32
    """(P,) texels a metre of each panel."""
    panel_normals: Float32
    """(P, 3)"""
    plant_triangles: NDArray[np.int32]
    """(T, 3)"""
    plant_light: Float32
    """(V, 3) linear light that each of its vertices sends out."""
    boll_ids: NDArray[np.uint16]
    """(T,) id of the boll whose lint a triangle belongs to; 0 = none."""


def light_scene(plant: PlantMeshes, room: Room) -> RenderScene:
    """Build the ray tracer and let the lamps shine once on everything."""
    parts = [*plant.parts, *room.things]
    whole = merge(parts)
    triangle_counts = [len(mesh.triangles) for mesh in parts]
    boll_of_part = [0, 0, *(n for boll in range(1, len(plant.bolls) + 1) for n in (boll, 0)), *(0 for _ in room.things)]
    rays = _trace(room, whole, [True] * len(room.panels))
    vertices = whole.vertices.astype(np.float32)
    normals = np.concatenate([mesh.normals() for mesh in parts]).astype(np.float32)
    plant_light = irradiance(rays, vertices, normals, room.lamps, room.ambient, 0.12) * whole.colours.astype(np.float32)
    boll_ids = np.repeat(boll_of_part, triangle_counts).astype(np.uint16)
    lint = plant_light[whole.triangles[boll_ids > 0].ravel()]
    gain = np.float32(WHITE / np.quantile(lint if len(lint) else plant_light, 0.98))
    lights = _panel_light(rays, room)
    images = [to_linear(panel.image) * (gain * light) for panel, light in zip(room.panels, lights, strict=True)]
    return RenderScene(
        rays=rays,
        atlas=pack(images),
        densities=np.array([p.image.shape[1] / np.linalg.norm(p.across) for p in room.panels], np.float32),
        panel_normals=np.array([_normal(panel) for panel in room.panels], np.float32),
        plant_triangles=whole.triangles,
        plant_light=gain * plant_light,
        boll_ids=boll_ids,
    )


def on_turntable(scene: RenderScene, plant: PlantMeshes, room: Room) -> tuple[RenderScene, RenderScene]:
    """The turning part of a lit scene, i.e. the plant with its clamp, and the rest, which stands still."""
    whole = merge([*plant.parts, *room.things])
    turns = [panel.turns for panel in room.panels]
    # Vertex for vertex as in the lit scene; a part without size is not visible.
    of_plant = (np.arange(len(whole.vertices)) < len(plant.vertices))[:, None]
    turning = _trace(room, replace(whole, vertices=whole.vertices * of_plant), turns)
    standing = _trace(room, replace(whole, vertices=whole.vertices * ~of_plant), [not turn for turn in turns])
    return replace(scene, rays=turning), replace(scene, rays=standing)


def _trace(room: Room, plant: Mesh, shown: Sequence[bool]) -> Rays:
    """The ray tracer of a room and a plant; panels that are not shown have no size."""
    corners = np.concatenate([_corners(p) * float(s) for p, s in zip(room.panels, shown, strict=True)])
    quads = 4 * np.arange(len(room.panels))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    return build_rays([(corners, quads.reshape(-1, 3)), (plant.vertices, plant.triangles)])


def render(
    scene: RenderScene,
    camera: Camera,
    *,
    supersampling: int = 2,
    k1: float = 0.0,
    shift: tuple[float, float] = (0.0, 0.0),
    footprint_px: float = 0.0,
    behind: Float32 | None = None,
) -> Float32:
    """(H, W, 3) linear light.

    Args:
        camera: metres.
        supersampling: rays a pixel in each direction; pixels that show the plant get twice as many.
        k1: radial distortion of the lens (OpenCV); 0 = none.
        shift: px that all rays are moved by.
        footprint_px: width of the area that a ray covers, over which textures are filtered; 0 = the distance of rays.
        behind: (H, W, 3) linear light where there is nothing in the scene; None = the darkness above the room.
    """
    n, h, w = supersampling, camera.height, camera.width

    def void(x_px: Float32, y_px: Float32) -> Float32:
        if behind is None:
            return np.full((len(x_px), 3), VOID, np.float32)
        colours: Float32 = behind[y_px.astype(int), x_px.astype(int)]
        return colours

    y, x = np.mgrid[: h * n, : w * n].astype(np.float32)
    directions = _directions(camera, (x.ravel() + 0.5) / n + shift[0], (y.ravel() + 0.5) / n + shift[1], k1)
    background = void((x.ravel() + 0.5) / n, (y.ravel() + 0.5) / n)
    light, on_plant = _light(scene, camera, directions, footprint_px or 1 / n, background)
    image: Float32 = cv2.resize(light.reshape(h * n, w * n, 3), (w, h), interpolation=cv2.INTER_AREA)

    # Twigs and fibres are finer than a pixel; textured panels are not, because they are prefiltered.
    touched = on_plant.reshape(h, n, w, n).any(axis=(1, 3)).astype(np.uint8)
    rows, columns = np.nonzero(cv2.dilate(touched, np.ones((3, 3), np.uint8)))
    if len(rows):
        inside = (np.arange(2 * n, dtype=np.float32) + 0.5) / (2 * n)
        x = columns[:, None, None] + inside[None, None, :] + shift[0]
        y = rows[:, None, None] + inside[None, :, None] + shift[1]
        x, y = (np.broadcast_to(a, (len(rows), 2 * n, 2 * n)).ravel().astype(np.float32) for a in (x, y))
        background = void(x - np.float32(shift[0]), y - np.float32(shift[1]))
        light, _ = _light(scene, camera, _directions(camera, x, y, k1), 0.5 / n, background)
        image[rows, columns] = light.reshape(len(rows), -1, 3).mean(axis=1)
    return image


def instance_ids(scene: RenderScene, camera: Camera, *, k1: float = 0.0) -> NDArray[np.uint16]:
    """(H, W) id of the boll whose lint is seen at the centre of each pixel; 0 = something else."""
    y, x = np.mgrid[: camera.height, : camera.width].astype(np.float32) + np.float32(0.5)
    hits = _cast(scene, camera, _directions(camera, x.ravel(), y.ravel(), k1))
    on_plant = hits.meshes == 1
    ids = np.zeros(on_plant.shape, np.uint16)
    ids[on_plant] = scene.boll_ids[hits.triangles[on_plant]]
    return ids.reshape(camera.height, camera.width)


def develop(
    light: Float32, *, exposure_ev: float = 0.0, noise: float = 0.0, rng: np.random.Generator | None = None
) -> NDArray[np.uint8]:
    """(H, W, 3) 8-bit sRGB of linear light.

    Args:
        exposure_ev: stops added.
        noise: sigma of the sensor's noise in grey levels; `rng` draws it.
    """
    if exposure_ev:
        light = light * np.float32(2.0**exposure_ev)
    light = light.clip(0, 1)
    grey: NDArray[np.floating] = 255 * to_srgb(light)
    if noise and rng is not None:
        grey = grey + rng.normal(0, noise, grey.shape)
    return (grey + 0.5).clip(0, 255).astype(np.uint8)


def _directions(camera: Camera, x_px: Float32, y_px: Float32, k1: float) -> Float32:
    """(N, 3) viewing directions in the scene, with depth 1 along the optical axis."""
    x = (x_px - np.float32(camera.cx)) / np.float32(camera.fx)
    y = (y_px - np.float32(camera.cy)) / np.float32(camera.fy)
    if k1:
        # x_d = x_u (1 + k1 r_u²): the fixed point converges in a few steps for lenses of phones.
        seen_x, seen_y = x, y
        for _ in range(12):
            stretch = 1 + np.float32(k1) * (x * x + y * y)
            x, y = seen_x / stretch, seen_y / stretch
    right, down, forward = camera.rotation.astype(np.float32)
    directions: Float32 = x[:, None] * right + y[:, None] * down + forward
    return directions


def _cast(scene: RenderScene, camera: Camera, directions: Float32) -> Hits:
    return scene.rays.cast(camera.centre.astype(np.float32), directions)


def _light(
    scene: RenderScene, camera: Camera, directions: Float32, footprint_px: float, light: Float32
) -> tuple[Float32, NDArray[np.bool_]]:
    """(N, 3) linear light that comes in along each ray, and whether the ray hits the plant.

    Args:
        light: (N, 3) of rays that hit nothing; the others are written into it.
    """
    hits = _cast(scene, camera, directions)
    geometry, triangles, depths, barycentric = hits.meshes, hits.triangles, hits.depths, hits.weights

    hit = np.flatnonzero(geometry == 0)
    panels, second = np.divmod(triangles[hit].astype(np.intp), 2)
    u, v = barycentric[hit].T
    s, t = np.where(second, u, u + v), np.where(second, u + v, v)
    towards = directions[hit]
    slant = np.abs((towards * scene.panel_normals[panels]).sum(axis=1)) / np.sqrt((towards * towards).sum(axis=1))
    texels = depths[hit] * np.float32(footprint_px / camera.fx) * scene.densities[panels]
    levels = np.log2(texels / np.sqrt(np.maximum(slant, 0.02)))
    light[hit] = scene.atlas.sample(panels, s, t, levels)

    on_plant = geometry == 1
    hit = np.flatnonzero(on_plant)
    light[hit] = interpolate(scene.plant_light, scene.plant_triangles[triangles[hit]], barycentric[hit])
    return light, on_plant


def _corners(panel: Panel) -> NDArray[np.float64]:
    """(4, 3) in the order of texture coordinates (0, 0), (1, 0), (1, 1), (0, 1)."""
    c, a, d = panel.corner, panel.across, panel.down
    return np.stack([c, c + a, c + a + d, c + d])


def _normal(panel: Panel) -> NDArray[np.float64]:
    """(3,) towards the side from which the panel's picture reads upright."""
    normal = np.cross(panel.down, panel.across)
    return normal / np.linalg.norm(normal)


def _panel_light(rays: Rays, room: Room) -> list[Float32]:
    """(H, W, 3) irradiance of each panel, computed on a coarse grid."""
    grids = []
    for panel in room.panels:
        width, height = np.linalg.norm(panel.across), np.linalg.norm(panel.down)
        spacing = max(0.01, 0.01 * float(np.sqrt(width * height)))
        nx, ny = (int(np.clip(np.ceil(size / spacing), 2, 200)) for size in (width, height))
        s, t = (np.arange(nx) + 0.5) / nx, (np.arange(ny) + 0.5) / ny
        grids.append(panel.corner + s[None, :, None] * panel.across + t[:, None, None] * panel.down)
    sizes = [grid.shape[0] * grid.shape[1] for grid in grids]
    points = np.concatenate([grid.reshape(-1, 3) for grid in grids]).astype(np.float32)
    normals = np.repeat([_normal(panel) for panel in room.panels], sizes, axis=0).astype(np.float32)
    pieces = np.split(irradiance(rays, points, normals, room.lamps, room.ambient, 0.4), np.cumsum(sizes)[:-1])
    lights = []
    for panel, grid, piece in zip(room.panels, grids, pieces, strict=True):
        smooth = cv2.GaussianBlur(piece.reshape(grid.shape), (3, 3), 0.8)
        lights.append(cv2.resize(smooth, panel.image.shape[1::-1], interpolation=cv2.INTER_LINEAR))
    return lights
