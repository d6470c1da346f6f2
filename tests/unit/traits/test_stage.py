# SPDX-License-Identifier: Apache-2.0
"""The colour of lint in the tables of a plant whose card was seen, and blank cells where it was not."""

import numpy as np
import pytest
from scenes.finished_scene import finished_workspace
from scipy.ndimage import binary_erosion

from cotton3dg.core.card import PATCH_LEVELS, printed_reflectance
from cotton3dg.io.images import read_ids, read_image
from cotton3dg.io.tables import read_rows
from cotton3dg.options import resolve
from cotton3dg.schemas.bolls import read_bolls
from cotton3dg.schemas.scale import PatchesInfo
from cotton3dg.traits import stage as traits
from cotton3dg.traits.lint_colour import calibrate, cielab

LEVELS = np.array([240.0, 210, 165, 120, 80, 62])[:, None] * (1.0, 0.97, 0.9)


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    return finished_workspace(tmp_path_factory.mktemp("colour") / "plant")


def with_patches(plant, views):
    """The patches that these views would show."""
    reflectances = tuple(printed_reflectance(np.array(PATCH_LEVELS)).tolist())
    info = PatchesInfo(reflectances, {view: tuple(map(tuple, LEVELS.tolist())) for view in views})
    info.save(plant.patches_json)
    traits.run(plant, resolve("traits"))
    return reflectances


def test_without_a_card_the_cells_are_blank(plant):
    plant.patches_json.unlink(missing_ok=True)
    traits.run(plant, resolve("traits"))
    for row in (*read_rows(plant.traits_csv), *read_rows(plant.bolls_csv)):
        assert not any(row[name] for name in row if name.startswith(("lint_cie", "lint_rd", "lint_plus")))
        assert not row.get("lint_colour_views")


def test_colour_is_that_of_the_masks_in_the_photos_with_patches(plant):
    views = [f"{number:06d}.jpg" for number in range(0, 16, 3)]
    reflectances = with_patches(plant, views)
    calibration = calibrate(LEVELS, reflectances)
    bolls = read_bolls(plant.bolls_json, plant.labels_npy)[0]
    rows = {int(row["boll_id"]): row for row in read_rows(plant.bolls_csv)}
    means = []
    for boll in bolls:
        seen = []
        for view, mask_id in boll.masks:
            # Without the rim of a pixel, which mixes with what is behind.
            inside = binary_erosion(read_ids(plant.mask_png(view)) == mask_id, np.ones((3, 3)))
            if view in views and inside.sum() >= 30:
                seen.append(calibration.reflectance(read_image(plant.undistorted_image(view))[inside]).mean(axis=0))
        lightness, a, b = cielab(np.median(seen, axis=0))
        row = rows[boll.boll_id]
        assert float(row["lint_cie_l"]) == pytest.approx(lightness, abs=0.06)
        assert float(row["lint_cie_a"]) == pytest.approx(a, abs=0.06)
        assert float(row["lint_cie_b"]) == pytest.approx(b, abs=0.06)
        assert int(row["lint_colour_views"]) == len(seen) >= 3
        means.append(float(row["lint_rd_pct"]))
    (whole,) = read_rows(plant.traits_csv)
    assert float(whole["lint_rd_pct"]) == pytest.approx(np.mean(means), abs=0.2)


def test_two_photos_with_patches_are_too_few(plant):
    with_patches(plant, ["000000.jpg", "000003.jpg"])
    assert all(row["lint_cie_l"] == "" for row in read_rows(plant.bolls_csv))
    assert read_rows(plant.traits_csv)[0]["lint_rd_pct"] == ""


def test_traits_depend_on_masks_only_where_there_are_patches_and_always_on_photos(plant):
    plant.patches_json.unlink(missing_ok=True)
    assert plant.folder("masks") not in traits.inputs(plant) and plant.undistorted in traits.inputs(plant)
    with_patches(plant, ["000000.jpg"])
    assert {plant.patches_json, plant.folder("masks"), plant.undistorted} <= set(traits.inputs(plant))
