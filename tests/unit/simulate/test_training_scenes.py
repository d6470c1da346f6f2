# SPDX-License-Identifier: Apache-2.0
"""Scenes that networks learn from: the same for the same number, their parts named."""

from dataclasses import replace

import numpy as np

from cotton3dg.core.training_picture import LINT, OTHER
from cotton3dg.simulate import training_scenes
from cotton3dg.simulate.foliage import lint_wisps
from cotton3dg.simulate.training_scenes import build_scene

SEED = 5


def test_a_seed_is_a_scene_whose_parts_are_named():
    scene, again = build_scene(SEED), build_scene(SEED)
    np.testing.assert_array_equal(scene.mesh.vertices, again.mesh.vertices)
    assert not np.array_equal(scene.mesh.vertices[:100], build_scene(SEED + 1).mesh.vertices[:100])
    assert len(scene.classes) == len(scene.mesh.vertices)
    assert len(scene.boll_ids) == len(scene.mesh.triangles)
    assert scene.boll_ids.max() == len(scene.centres) == len(scene.diameters) > 0
    lint = scene.classes[scene.mesh.triangles] == LINT
    np.testing.assert_array_equal(scene.boll_ids > 0, lint.all(axis=1))
    for number, centre in enumerate(scene.centres, start=1):
        own = scene.mesh.vertices[scene.mesh.triangles[scene.boll_ids == number].ravel()]
        assert (own.min(axis=0) <= centre).all() and (centre <= own.max(axis=0)).all()


def test_wisps_belong_to_no_boll(monkeypatch):
    def marked(rng, noise):
        wisps = lint_wisps(rng, noise)
        return replace(wisps, colours=np.full_like(wisps.colours, 0.123))

    monkeypatch.setattr(training_scenes, "lint_wisps", marked)
    seen = 0
    for seed in range(8):
        scene = build_scene(seed)
        wisps = (scene.mesh.colours == 0.123).all(axis=1)
        assert (scene.classes[wisps] == OTHER).all()
        seen += wisps.any()
    assert seen
