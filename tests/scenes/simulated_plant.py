# SPDX-License-Identifier: Apache-2.0
"""A small simulated plant, its lit room and the walk around it."""

from dataclasses import replace
from functools import cache

import numpy as np

from cotton3dg.options import SimulateOptions
from cotton3dg.simulate.camera import Orbit, orbit
from cotton3dg.simulate.mesh import Mesh
from cotton3dg.simulate.plant import PlantMeshes, grow_plant
from cotton3dg.simulate.render import RenderScene, light_scene
from cotton3dg.simulate.room import build_room

SMALL = SimulateOptions(seed=3, bolls=4, frames=16, width=192, height=108)
TINY = replace(SMALL, frames=24, width=128, height=72, supersampling=1)
"""The same plant in smaller images."""


@cache
def small_plant() -> PlantMeshes:
    """The plant alone."""
    return grow_plant(SMALL)


@cache
def small() -> tuple[PlantMeshes, RenderScene, Orbit]:
    """The plant, its room in light, and the walk."""
    plant = small_plant()
    return plant, light_scene(plant, build_room(SMALL, plant.stem_base)), orbit(SMALL, plant.vertices)


def signed_volume(mesh: Mesh) -> float:
    """Volume of a closed mesh, negative if it is turned inside out."""
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    return float((np.cross(a, b) * c).sum() / 6)
