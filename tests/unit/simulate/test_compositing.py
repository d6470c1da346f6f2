"""Scenes, plates and pictures that networks learn from: the same for the same number, true to their labels."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.spatial import KDTree

from cotton3dg.core.training_picture import CLASSES, LINT, NOT_LINT, OTHER, UNKNOWN
from cotton3dg.masks.annotated_pictures import AnnotatedPhoto, cut_picture
from cotton3dg.simulate import distractors, training_scenes
from cotton3dg.simulate import plates as plates_module
from cotton3dg.simulate.compositing import Layer, classes_in_blur, compose, draw_power
from cotton3dg.simulate.foliage import bracted_boll, empty_bracts, lint_wisps
from cotton3dg.simulate.mesh import SolidNoise, icosphere
from cotton3dg.simulate.organs import Site
from cotton3dg.simulate.plates import LIGHTS, load_plates, render_plates, save_plates
from cotton3dg.simulate.rays import build_rays
from cotton3dg.simulate.training_scenes import build_scene
from cotton3dg.simulate.varied_bolls import draw_kind, grow_boll

SEED = 5


@pytest.fixture(scope="module")
def few_plates():
    """Small ones, in little light, so that a test does not wait."""
    patch = pytest.MonkeyPatch()
    patch.setattr(plates_module, "PLATE_PX", 96)
    patch.setattr(plates_module, "HEMISPHERE_RAYS", 4)
    patch.setattr("cotton3dg.simulate.compositing.PLATE_PX", 96)
    yield render_plates(SEED, 6)
    patch.undo()


@pytest.fixture(scope="module")
def backgrounds():
    return np.random.default_rng(0).integers(0, 256, (2, 128, 128, 3), np.uint8)


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


@pytest.mark.parametrize("seed", range(12))
def test_bolls_of_every_kind_stand_at_their_sites(seed):
    rng = np.random.default_rng(seed)
    site = Site(np.array([0, 0, 0.5]), np.array([0.03, 0, 0.52]), np.array([1.0, 0, 0]), 0.045)
    kind = draw_kind(rng)
    boll = grow_boll(rng, SolidNoise(rng), site, kind)
    assert np.isfinite(boll.lint.vertices).all() and np.isfinite(boll.bur.vertices).all()
    assert (boll.lint.colours >= 0).all() and (boll.lint.colours <= 1).all()
    near = np.linalg.norm(boll.lint.vertices - site.centre, axis=1)
    assert np.median(near) < (0.6 + 1.2 * kind.droop + kind.hang) * site.diameter
    assert near.min() < 0.5 * site.diameter


@pytest.mark.parametrize("seed", range(6))
def test_a_closed_boll_is_wrapped_in_its_bracts_from_its_foot(seed):
    rng = np.random.default_rng(seed)
    whole = bracted_boll(rng, SolidNoise(rng), 0.045)
    boll = whole.vertices[: len(icosphere(3)[0])].astype(np.float32)
    bracts = whole.triangles[(whole.triangles >= len(boll)).all(axis=1)]
    away = boll * (1, 1, 0) / np.maximum(np.linalg.norm(boll[:, :2], axis=1, keepdims=True), 1e-9)
    hidden = build_rays([(whole.vertices, bracts)]).blocked(boll, away.astype(np.float32))
    assert hidden[boll[:, 2] < 0.5 * boll[:, 2].max()].mean() > 0.95
    assert np.ptp(whole.vertices[:, 2]) > 1.02 * np.ptp(boll[:, 2])


def locks_of(name: str, seed: int) -> list[np.ndarray]:
    """(V, 3) vertices of each lock of a boll of a kind whose diameter is 1."""
    rng = np.random.default_rng(seed)
    site = Site(np.zeros(3), np.array([0, 0, 0.6]), np.array([0.6, 0, 0.8]), 1.0)
    lint = grow_boll(rng, SolidNoise(rng), site, draw_kind(rng, name)).lint
    return list(lint.vertices.reshape(-1, len(icosphere(4)[0]), 3))


def test_separate_locks_are_apart_in_most_bolls_and_others_touch():
    far = {}
    for name in ("separate", "usual"):
        bolls = [locks_of(name, seed) for seed in range(30)]
        assert {len(locks) for locks in bolls} <= {2, 3, 4, 5}
        gaps = [min(KDTree(one).query(other)[0].min() for one, other in combinations(locks, 2)) for locks in bolls]
        far[name] = np.mean(np.array(gaps) > 0.02)
    assert far["separate"] > 0.5
    assert far["usual"] < 0.05


def test_points_of_the_bur_stand_between_separate_locks():
    site = Site(np.zeros(3), np.array([0, 0, 0.5]), np.array([0, 0, 1.0]), 1.0)
    kind = replace(draw_kind(np.random.default_rng(3), "separate"), locks=4, loose=0.0, lean=0.2, openness=1.0)
    for apart in (True, False):
        rng = np.random.default_rng(1)
        boll = grow_boll(rng, SolidNoise(rng), site, replace(kind, apart=apart))
        points = boll.bur.vertices[np.linalg.norm(boll.bur.vertices[:, :2], axis=1) > 0.55]
        locks = boll.lint.vertices.reshape(-1, len(icosphere(4)[0]), 3).mean(axis=1)
        cosines = (points[:, None, :2] * locks[None, :, :2]).sum(axis=2)
        cosines /= np.linalg.norm(points[:, None, :2], axis=2) * np.linalg.norm(locks[None, :, :2], axis=2)
        off = np.degrees(np.arccos(cosines.clip(-1, 1).max(axis=1)))
        assert (np.median(off) > 30) == apart


@pytest.mark.parametrize("seed", range(6))
def test_empty_bracts_are_bent_back_farther_than_those_around_a_boll(seed):
    """Seen from above, their teeth stand out beyond all else, and they hide nothing."""
    rng = np.random.default_rng(seed)
    empty = empty_bracts(rng, SolidNoise(rng), 0.045).vertices
    away = np.linalg.norm(empty[:, :2], axis=1)
    closed = bracted_boll(rng, SolidNoise(rng), 0.045).vertices
    assert away.max() > 0.5 * np.ptp(empty[:, 2])
    assert away.max() / np.ptp(empty[:, 2]) > np.linalg.norm(closed[:, :2], axis=1).max() / np.ptp(closed[:, 2])


@pytest.mark.parametrize("seed", range(6))
def test_wisps_of_lint_are_thin_and_white(seed):
    rng = np.random.default_rng(seed)
    wisps = lint_wisps(rng, SolidNoise(rng))
    _, inertia, _ = np.linalg.svd(wisps.vertices[:8] - wisps.vertices[:8].mean(axis=0))
    assert inertia[0] < 0.006
    assert np.linalg.norm(wisps.vertices, axis=1).max() < 0.3
    assert np.ptp(wisps.colours, axis=1).max() < 0.12 and wisps.colours.min() > 0.5


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


@pytest.mark.parametrize("shape", [distractors._pot, distractors._clamp, distractors._hand])
def test_what_holds_plants_is_closed_and_of_its_size(shape):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        mesh = shape(rng, SolidNoise(rng), np.full(3, 0.8))
        assert 0.06 < np.ptp(mesh.vertices, axis=0).max() < 0.6
        edges = np.sort(mesh.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}
        assert (mesh.colours > 0).all() and (mesh.colours < 1).all()


def test_some_pictures_are_lit_by_little_but_the_sun_and_their_shade_is_blue():
    powers = [draw_power(np.random.default_rng(number)) for number in range(200)]
    brightness = np.array([power.mean(axis=1) for power in powers])
    hard = (brightness[:, 1] == 0) & (brightness[:, 2] < 0.5 * brightness[:, 0])
    assert 0.2 < hard.mean() < 0.5
    blueness = np.array([np.log(power[2, 2] / power[2, 0]) - np.log(power[0, 2] / power[0, 0]) for power in powers])
    assert np.median(blueness[hard]) > np.median(blueness[~hard]) + 0.1


def test_locks_that_hang_reach_farther_down_than_those_that_stand():
    site = Site(np.array([0, 0, 0.5]), np.array([0, 0, 0.52]), np.array([0, 0, 1.0]), 0.045)
    kind = replace(draw_kind(np.random.default_rng(0)), droop=0.0, length=0.7, locks=4)
    lowest = []
    for hang in (0.0, 1.0):
        rng = np.random.default_rng(1)
        lowest.append(grow_boll(rng, SolidNoise(rng), site, replace(kind, hang=hang)).lint.vertices[:, 2].min())
    assert lowest[1] < lowest[0] - 0.3 * site.diameter


def test_light_that_is_spread_stays_within_its_boll_and_is_as_much_as_before():
    rng = np.random.default_rng(2)
    arriving, bolls = rng.uniform(0, 1, (LIGHTS, 60)).astype(np.float32), np.repeat([0, 1, 2], 20)
    spread = plates_module.spread_light(arriving, bolls, 0.5)
    np.testing.assert_array_equal(spread[:, bolls == 0], arriving[:, bolls == 0])
    for number in (1, 2):
        before, after = arriving[:, bolls == number], spread[:, bolls == number]
        np.testing.assert_allclose(after.mean(axis=1), before.mean(axis=1), rtol=1e-5)
        np.testing.assert_allclose(after.std(axis=1), 0.5 * before.std(axis=1), rtol=1e-4)


def test_plates_are_linear_in_their_lights(few_plates):
    plate = few_plates[0]
    assert plate.light.shape == (LIGHTS, 96, 96, 3)
    one, two = np.eye(LIGHTS, dtype=np.float32)[:2, :, None] * np.array([1.0, 0.8, 0.5], np.float32)
    np.testing.assert_allclose(plate.lit(one + 2 * two), plate.lit(one) + 2 * plate.lit(two), rtol=1e-4, atol=1e-5)


def test_plates_are_labelled_where_something_is_seen(few_plates):
    assert any((plate.ids > 0).any() for plate in few_plates)
    for plate in few_plates:
        assert (plate.classes[plate.ids > 0] == LINT).all()
        assert (plate.classes < len(CLASSES)).all()
        assert (plate.cover[plate.classes > 0] > 0).all()
        assert len(plate.centres_px) == len(plate.diameters_px)
        for boll in np.unique(plate.ids[plate.ids > 0]):
            rows, columns = np.nonzero(plate.ids == boll)
            far = np.linalg.norm(plate.centres_px[boll - 1] - np.stack([columns, rows], 1), axis=1)
            assert far.min() < 2.5 * plate.diameters_px[boll - 1]


def test_plates_survive_a_file(few_plates, tmp_path):
    save_plates(tmp_path / "scene", few_plates)
    for plate, again in zip(few_plates, load_plates(tmp_path / "scene"), strict=True):
        np.testing.assert_array_equal(plate.light, again.light)
        np.testing.assert_array_equal(plate.ids, again.ids)
        np.testing.assert_array_equal(plate.centres_px, again.centres_px)


def test_a_number_is_a_picture_and_its_labels_fit(few_plates, backgrounds):
    seen = 0
    for number in range(20):
        picture, again = (compose(np.random.default_rng(number), few_plates, backgrounds, 64) for _ in range(2))
        np.testing.assert_array_equal(picture.image, again.image)
        np.testing.assert_array_equal(picture.ids, again.ids)
        assert picture.image.shape == (64, 64, 3) and picture.image.dtype == np.uint8
        assert (picture.classes[picture.ids > 0] == LINT).all()
        assert set(np.unique(picture.classes)) <= {*range(len(CLASSES)), UNKNOWN}
        assert picture.ids.max() <= len(picture.centres_px) == len(picture.diameters_px)
        seen += bool((picture.ids > 0).any())
    assert seen > 5


def test_blur_hides_small_bolls_and_not_large_ones():
    classes = np.array([[LINT, LINT, CLASSES.index("bur"), LINT]], np.uint8)
    ids = np.array([[1, 2, 0, 2]], np.uint16)
    nothing = np.zeros((1, 4), np.float32)
    layer = Layer(nothing, nothing, classes, ids, np.zeros((2, 2), np.float32), np.array([20.0, 200.0], np.float32))
    np.testing.assert_array_equal(classes_in_blur(layer, 0.0), classes)
    np.testing.assert_array_equal(classes_in_blur(layer, 4.0), [[UNKNOWN, LINT, classes[0, 2], LINT]])
    np.testing.assert_array_equal(classes_in_blur(layer, 12.0), [[UNKNOWN, UNKNOWN, classes[0, 2], UNKNOWN]])


def test_a_picture_moves_its_middles_with_its_bolls(few_plates, backgrounds):
    """The way from a boll's pixels to its middle is as long, in diameters, as in the plate that it comes from."""
    ways = []
    for number in range(40):
        picture = compose(np.random.default_rng(number), few_plates, backgrounds, 64)
        for boll in np.unique(picture.ids[picture.ids > 0]):
            rows, columns = np.nonzero(picture.ids == boll)
            middle = np.array([columns.mean() + 0.5, rows.mean() + 0.5])
            way = np.linalg.norm(picture.centres_px[boll - 1] - middle) / picture.diameters_px[boll - 1]
            if len(rows) > 0.4 * picture.diameters_px[boll - 1] ** 2:
                ways.append(way)
    assert len(ways) > 5 and np.median(ways) < 0.3


def annotated() -> AnnotatedPhoto:
    ids = np.zeros((120, 160), np.uint16)
    ids[30:60, 40:70], ids[30:60, 70:100] = 7, 9
    image = np.where(ids[..., None] > 0, 200, 40).astype(np.uint8).repeat(3, axis=2)
    return AnnotatedPhoto(image, ids)


def test_pieces_of_annotated_photos_keep_their_bolls():
    counts = []
    for number in range(30):
        picture = cut_picture(np.random.default_rng(number), [annotated()], 64)
        assert set(np.unique(picture.classes)) <= {LINT, NOT_LINT}
        assert picture.ids.max() == len(picture.centres_px)
        counts.append(len(picture.centres_px))
        for boll in range(1, len(picture.centres_px) + 1):
            rows, columns = np.nonzero(picture.ids == boll)
            x, y = picture.centres_px[boll - 1]
            assert columns.min() <= x <= columns.max() + 1 and rows.min() <= y <= rows.max() + 1
    assert max(counts) == 2
