"""The simulated plant: its truth recomputed by other means, its images against its cameras, its effects one by one."""

import json
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import open3d as o3d
import pytest
from scipy.spatial import ConvexHull

from cotton3dg.choices import read_toml
from cotton3dg.commands.simulate import simulate
from cotton3dg.core.scene import Camera
from cotton3dg.errors import BadUsage
from cotton3dg.io.images import read_ids
from cotton3dg.options import SimulateOptions, resolve
from cotton3dg.simulate.atlas import pack
from cotton3dg.simulate.camera import Orbit, orbit
from cotton3dg.simulate.camera_effects import exposure_ev, film, film_ids
from cotton3dg.simulate.mesh import Mesh, icosphere, sheet, smooth_curve, tube
from cotton3dg.simulate.plant import PlantMeshes, grow_plant
from cotton3dg.simulate.render import RenderScene, develop, instance_ids, light_scene, render
from cotton3dg.simulate.room import build_room
from cotton3dg.simulate.truth import plant_truth

SMALL = SimulateOptions(seed=3, bolls=4, frames=16, width=192, height=108)


@cache
def small() -> tuple[PlantMeshes, RenderScene, Orbit]:
    plant = grow_plant(SMALL)
    return plant, light_scene(plant, build_room(SMALL, plant.stem_base)), orbit(SMALL, plant.vertices)


def signed_volume(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
    return float((np.cross(a, b) * c).sum() / 6)


def is_closed(mesh: Mesh) -> bool:
    edges = {(int(t[i]), int(t[(i + 1) % 3])) for t in mesh.triangles for i in range(3)}
    return len(edges) == 3 * len(mesh.triangles) and all((b, a) in edges for a, b in edges)


def test_meshes_are_closed_and_face_outwards():
    sphere = Mesh(*icosphere(3), np.zeros((642, 3)))
    curve = smooth_curve([(0, 0, 0), (0.01, 0, 0.1), (0, 0, 0.2)], 0.005)
    twig = tube(curve, np.full(len(curve), 0.01), np.zeros((len(curve), 3)), sides=32)
    grid = np.stack(np.meshgrid(np.linspace(0, 2, 5), np.linspace(0, 1, 7), 0.0, indexing="ij"), axis=-1)[:, :, 0]
    plate = sheet(grid, np.zeros((5, 7, 3)), 0.01)
    for mesh, volume in ((sphere, 4 / 3 * np.pi), (twig, np.pi * 1e-4 * 0.2), (plate, 0.02)):
        assert is_closed(mesh)
        assert signed_volume(mesh) == pytest.approx(volume, rel=0.03)
    np.testing.assert_allclose(sphere.normals(), sphere.vertices, atol=0.02)


def test_truth_agrees_with_other_ways_to_compute_it():
    plant = small()[0]
    truth = plant_truth(plant, SMALL)
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for boll, record in zip(plant.bolls, truth["bolls"], strict=True):
        lint = boll.lint.vertices
        for points, key in (
            (lint, "convex_volume_cm3"),
            (np.concatenate([lint, boll.bur.vertices]), "convex_volume_with_bur_cm3"),
        ):
            cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
            hull, _ = cloud.compute_convex_hull()
            hull.orient_triangles()
            assert record[key] == pytest.approx(1e6 * abs(hull.get_volume()), rel=1e-3)
        along = lint @ directions.T
        assert record["diameter_cm"] == pytest.approx(100 * np.ptp(along, axis=0).mean(), rel=0.01)
        assert record["max_diameter_cm"] == pytest.approx(100 * np.ptp(along, axis=0).max(), rel=0.01)
        assert record["convex_volume_cm3"] > 1e6 * signed_volume(boll.lint) * 0.5
        # Points drawn inside the hull average to its centroid.
        box = rng.uniform(lint.min(axis=0), lint.max(axis=0), (40_000, 3))
        ray_scene = o3d.t.geometry.RaycastingScene()
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(lint))
        ray_scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(cloud.compute_convex_hull()[0]))
        inside = ray_scene.compute_occupancy(o3d.core.Tensor(box.astype(np.float32))).numpy() > 0
        np.testing.assert_allclose(record["centre_xyz_m"], box[inside].mean(axis=0), atol=3e-4)

    vertices = plant.vertices
    _, sides, _ = cv2.minAreaRect((100 * vertices[:, :2]).astype(np.float32))
    assert truth["canopy_length_cm"] == pytest.approx(max(sides), rel=1e-3)
    assert truth["canopy_width_cm"] == pytest.approx(min(sides), rel=1e-3)
    assert truth["canopy_size_cm"] == pytest.approx(sum(sides) / 2, rel=1e-3)
    assert vertices[:, 2].min() == 0
    assert truth["plant_height_cm"] == pytest.approx(100 * vertices[:, 2].max(), abs=1e-3)
    assert truth["boll_count"] == 4
    total = sum(record["convex_volume_cm3"] for record in truth["bolls"])
    assert truth["total_boll_convex_volume_cm3"] == pytest.approx(total)


def lint_spheres(plant: PlantMeshes) -> tuple[np.ndarray, np.ndarray]:
    """(B, 3) middles of the lint and (B,) radii of spheres as large as its hull, m."""
    volumes = np.array([ConvexHull(boll.lint.vertices).volume for boll in plant.bolls])
    return np.array([boll.lint.vertices.mean(axis=0) for boll in plant.bolls]), np.cbrt(0.75 / np.pi * volumes)


def gaps(plant: PlantMeshes) -> np.ndarray:
    """(B,) distance of each boll's centre to its nearest neighbour's, in sums of the two radii."""
    centres, radii = lint_spheres(plant)
    distances = np.linalg.norm(centres[:, None] - centres, axis=2) / (radii[:, None] + radii)
    return np.where(np.eye(len(radii), dtype=bool), np.inf, distances).min(axis=1)


@pytest.mark.parametrize("seed", range(4))
def test_bolls_are_as_many_and_as_close_as_asked(seed):
    spread = grow_plant(SimulateOptions(seed=seed, bolls=14))
    clustered = grow_plant(SimulateOptions(seed=seed, bolls=14, clustered=0.6))
    assert len(spread.bolls) == len(clustered.bolls) == 14
    assert 8 <= len(grow_plant(SimulateOptions(seed=seed)).bolls) <= 20
    assert gaps(spread).min() > 0.95
    assert (gaps(clustered) < 1.1).sum() >= 8
    assert gaps(clustered).min() > 0.7
    for plant in (spread, clustered):
        heights = lint_spheres(plant)[0][:, 2]
        assert heights.min() > 0.1
        assert heights.max() < 1.0


def test_clustered_bolls_hang_higher_than_the_others():
    plant = grow_plant(SimulateOptions(seed=1, bolls=16, clustered=0.5))
    close = gaps(plant) < 1.1
    heights = lint_spheres(plant)[0][:, 2]
    assert heights[close].mean() > heights[~close].mean()


def test_same_seed_same_bytes_and_another_seed_another_plant():
    plant, scene, path = small()
    again = grow_plant(SMALL)
    assert again.vertices.tobytes() == plant.vertices.tobytes()
    repeated = light_scene(again, build_room(SMALL, again.stem_base))
    assert film(repeated, orbit(SMALL, again.vertices), 5, SMALL).tobytes() == film(scene, path, 5, SMALL).tobytes()
    assert grow_plant(replace(SMALL, seed=4)).vertices.shape != plant.vertices.shape or not np.allclose(
        grow_plant(replace(SMALL, seed=4)).vertices, plant.vertices
    )


def test_the_turn_closes_and_keeps_the_whole_plant_in_view():
    plant, _, path = small()
    cameras = path.cameras()
    assert len(cameras) == SMALL.frames
    centres = np.array([camera.centre for camera in cameras]) - path.centre
    angles = np.unwrap(np.arctan2(centres[:, 1], centres[:, 0]))
    assert 360 < abs(np.rad2deg(angles[-1] - angles[0])) < 385
    assert 1.0 < np.linalg.norm(centres[:, :2], axis=1).min() < 1.8
    assert np.ptp(centres[:, 2]) > 0.03
    for camera in cameras:
        pixels, depths = camera.project(plant.vertices)
        assert (depths > 0.5).all()
        assert ((pixels > 0) & (pixels < (camera.width, camera.height))).all()
        np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(camera.rotation) == pytest.approx(1)


def test_masks_lie_where_the_bolls_project():
    plant, scene, path = small()
    records = plant_truth(plant, SMALL)["bolls"]
    seen = set()
    for frame in range(0, SMALL.frames, 3):
        camera = path.at(frame)
        ids = instance_ids(scene, camera)
        assert ids.dtype == np.uint16
        assert ids.shape == (108, 192)
        for record in records:
            rows, columns = np.nonzero(ids == record["id"])
            if len(rows) < 6:
                continue
            seen.add(record["id"])
            pixels, depths = camera.project(np.array([record["centre_xyz_m"]]))
            radius = 0.005 * record["max_diameter_cm"] * camera.fx / depths[0]
            offsets = np.hypot(columns + 0.5 - pixels[0, 0], rows + 0.5 - pixels[0, 1])
            assert offsets.max() < radius + 1.5
            assert offsets.mean() < 0.9 * radius
    assert seen == {1, 2, 3, 4}


def test_lint_is_bright_and_the_room_is_textured():
    _, scene, path = small()
    image, ids = film(scene, path, 2, SMALL), instance_ids(scene, path.at(2))
    assert np.median(image[cv2.erode(ids, np.ones((3, 3))) > 0].min(axis=1)) > 120
    assert (image == 255).all(axis=2).mean() < 0.02
    keypoints = cv2.SIFT_create().detect(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), None)
    assert len(keypoints) > 150
    quarters = {(int(point.pt[0] // 96), int(point.pt[1] // 54)) for point in keypoints}
    assert len(quarters) == 4


def test_supersampling_converges():
    _, scene, path = small()
    camera = path.at(7)
    reference = render(scene, camera, supersampling=6)
    errors = [np.abs(render(scene, camera, supersampling=n) - reference).mean() for n in (1, 2, 4)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[1] < 0.02


def test_effects_that_are_off_change_no_pixel():
    _, scene, path = small()
    plain = develop(render(scene, path.at(3), supersampling=SMALL.supersampling))
    assert np.array_equal(film(scene, path, 3, SMALL), plain)
    assert np.array_equal(film_ids(scene, path, 3, SMALL), instance_ids(scene, path.at(3)))
    for effect in ({"blur": 0.5}, {"exposure": 0.5}, {"distortion": -0.05}, {"noise": 3.0}, {"rolling_shutter": 0.5}):
        assert not np.array_equal(film(scene, path, 3, replace(SMALL, **effect)), plain)


def test_exposure_multiplies_the_light_by_powers_of_two():
    light = np.full((2, 2, 3), 0.2, np.float32)
    assert np.array_equal(develop(light, exposure_ev=1.0), develop(2 * light))
    drift = [exposure_ev(frame, replace(SMALL, exposure=0.4)) for frame in range(SMALL.frames)]
    assert 0.3 < max(map(abs, drift)) <= 0.4
    assert np.ptp(drift) > 0.4
    assert exposure_ev(3, SMALL) == 0.0


def test_noise_has_the_sigma_that_was_asked_for():
    light = np.full((200, 200, 3), 0.2, np.float32)
    noisy = develop(light, noise=4.0, rng=np.random.default_rng(0))
    assert noisy.std() == pytest.approx(4.0, rel=0.03)
    assert noisy.mean() == pytest.approx(develop(light).mean(), abs=0.5)


def test_distortion_is_that_of_opencv():
    _, scene, path = small()
    camera, k1 = path.at(3), -0.15
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    bent, ideal = render(scene, camera, k1=k1), render(scene, camera)
    # OpenCV counts pixels from their centres.
    matrix[:2, 2] -= 0.5
    straight = cv2.undistort(bent, matrix, np.array([k1, 0, 0, 0]))
    corner = np.s_[5:35, 8:50]
    assert np.abs(straight - ideal)[corner].mean() < 0.4 * np.abs(bent - ideal)[corner].mean()


def test_blur_is_the_mean_of_the_light_while_the_shutter_is_open():
    _, scene, path = small()
    blurred = film(scene, path, 8, replace(SMALL, blur=0.1)).astype(float)
    exact = develop(np.mean([render(scene, path.at(8 + 0.1 * t)) for t in np.linspace(-0.5, 0.5, 25)], axis=0))
    sharp = film(scene, path, 8, SMALL)
    errors = [np.sqrt(((blurred - image) ** 2).mean()) for image in (exact, sharp)]
    assert errors[0] < 6
    assert errors[0] < 0.5 * errors[1]


def test_much_blur_is_no_row_of_sharp_edges():
    _, scene, path = small()
    blurred = film(scene, path, 8, replace(SMALL, blur=1.0)).astype(float)
    exact = develop(np.mean([render(scene, path.at(8 + t)) for t in np.linspace(-0.5, 0.5, 121)], axis=0))
    assert np.sqrt(((blurred - exact) ** 2).mean()) < 3  # grey levels; with 8 renders it is 6


def test_a_rolling_shutter_reads_each_row_at_its_own_time():
    _, scene, path = small()
    options = replace(SMALL, rolling_shutter=0.5)
    rolled, ids = film(scene, path, 8, options).astype(float), film_ids(scene, path, 8, options)
    still = film(scene, path, 8, SMALL)
    for row in (0, 52, 104):
        camera = path.at(8 + 0.5 * ((row + 2) / 108 - 0.5))
        rows = slice(row, row + 4)
        error = np.abs(rolled[rows] - develop(render(scene, camera))[rows]).mean()
        assert error < 0.5
        assert row == 52 or error < 0.1 * np.abs(rolled[rows] - still[rows]).mean()
        assert np.array_equal(ids[rows], instance_ids(scene, camera)[rows])
    assert not np.array_equal(ids, instance_ids(scene, path.at(8)))


def test_atlas_filters_and_keeps_textures_apart():
    ramp = np.linspace(0, 1, 64, dtype=np.float32)[None, :, None] * np.ones((32, 1, 3), np.float32)
    checks = np.indices((64, 64)).sum(axis=0)[..., None] % 2 * np.ones(3, np.float32)
    atlas = pack([ramp, checks.astype(np.float32), np.full((8, 200, 3), 0.25, np.float32)])
    s = np.random.default_rng(0).uniform(0, 1, 500).astype(np.float32)
    levels = np.linspace(0, 9, 500, dtype=np.float32)
    flat = atlas.sample(np.full(500, 2), s, s[::-1].copy(), levels)
    np.testing.assert_allclose(flat, 0.25, atol=1e-3)
    coarse = atlas.sample(np.full(500, 1), s, s[::-1].copy(), np.full(500, 1.0, np.float32))
    np.testing.assert_allclose(coarse, 0.5, atol=1e-3)
    fine = atlas.sample(np.zeros(500, int), s, s, np.zeros(500, np.float32))
    np.testing.assert_allclose(fine[:, 0], ((64 * s - 0.5) / 63).clip(0, 1), atol=0.002)


def test_the_table_has_the_size_asked_for_or_is_absent():
    stem_base = np.zeros(3)

    def top(options):
        """Length and width of the largest level panel at the height of the table top."""
        panels = build_room(options, stem_base).panels
        level = [p for p in panels if abs(p.corner[2]) < 1e-9 and p.across[2] == p.down[2] == 0]
        return max(((np.linalg.norm(p.across), np.linalg.norm(p.down)) for p in level), default=None)

    assert top(SMALL) == pytest.approx((1.2, 0.6))
    assert top(replace(SMALL, table_length_cm=90, table_width_cm=45)) == pytest.approx((0.9, 0.45))
    assert top(replace(SMALL, table=False)) is None
    assert plant_truth(small()[0], replace(SMALL, table=False))["table"] is None


def test_simulate_writes_video_and_truth(tmp_path):
    options = replace(SMALL, frames=9, mask_interval=4, noise=2.0)
    folder = simulate(tmp_path / "plant", options)
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    masks = [f"instances/frame_{frame:04d}.png" for frame in (0, 4, 8)]
    assert names == ["cameras.json", "cotton3dg.toml", *masks, "instances/frames.json", "truth.json", "video.mp4"]
    size = resolve("scale", read_toml(folder / "cotton3dg.toml")["scale"])
    assert (size.table_cm, size.table_is_assumed) == ((120.0, 60.0), False)

    video = cv2.VideoCapture(str(folder / "video.mp4"))
    images = []
    while (image := video.read()[1]) is not None:
        images.append(image[..., ::-1])
    assert len(images) == 9
    assert images[0].shape == (108, 192, 3)
    plant = grow_plant(options)
    scene, path = light_scene(plant, build_room(options, plant.stem_base)), orbit(options, plant.vertices)
    for frame in (0, 5):
        difference = images[frame].astype(float) - film(scene, path, frame, options)
        assert 10 * np.log10(255**2 / (difference**2).mean()) > 28

    cameras = json.loads((folder / "cameras.json").read_text())
    truth = json.loads((folder / "truth.json").read_text())
    frames = json.loads((folder / "instances" / "frames.json").read_text())["frames"]
    assert frames == {f"frame_{frame:04d}.png": frame for frame in (0, 4, 8)}
    largest = np.zeros(5, int)
    for name, frame in frames.items():
        ids = read_ids(folder / "instances" / name)
        largest = np.maximum(largest, np.bincount(ids.ravel(), minlength=5))
        pose = np.linalg.inv(cameras["frames"][frame]["camera_to_world"])[:3]
        lens = {key: cameras[key] for key in ("width", "height", "fx", "fy", "cx", "cy")}
        camera = Camera(name=name, cam_from_scene=pose, **lens)
        for record in truth["bolls"]:
            rows, columns = np.nonzero(ids == record["id"])
            pixel = camera.project(np.array([record["centre_xyz_m"]]))[0][0]
            if len(rows) > 20:
                assert np.hypot(columns.mean() + 0.5 - pixel[0], rows.mean() + 0.5 - pixel[1]) < 5
    assert [record["visible_pixel_max"] for record in truth["bolls"]] == largest[1:].tolist()
    assert len(cameras["frames"]) == 9

    simulate(folder, replace(options, frames=3))
    assert sorted(path.name for path in (folder / "instances").iterdir()) == ["frame_0000.png", "frames.json"]


def test_simulate_never_replaces_what_it_did_not_write(tmp_path):
    (tmp_path / "video.mp4").write_bytes(b"a user's video")
    with pytest.raises(BadUsage, match="not made by simulate"):
        simulate(tmp_path, SMALL)
    with pytest.raises(BadUsage, match="even"):
        simulate(tmp_path / "new", replace(SMALL, width=101))
    assert (tmp_path / "video.mp4").read_bytes() == b"a user's video"


def test_markers_a_box_and_a_second_table_leave_the_room_as_it_is():
    plain = build_room(SimulateOptions(seed=4, width=160), np.zeros(3))
    more = build_room(SimulateOptions(seed=4, width=160, markers=3, hidden=0.25, second_table=True), np.zeros(3))
    assert len(more.panels) == len(plain.panels) + 3 + 5 + 5
    for before, after in zip(plain.panels, more.panels, strict=False):
        assert (before.corner == after.corner).all()
        assert (before.image == after.image).all()
    paper = more.panels[len(plain.panels)]
    assert np.linalg.norm(paper.across) == pytest.approx(0.12 * 8 / 6)
    assert paper.across @ paper.down == pytest.approx(0, abs=1e-12)


def test_touching_bolls_lie_in_each_other_as_deep_as_is_asked_for():
    nearest = {}
    for contact in (0.90, 0.72):
        options = SimulateOptions(seed=605, bolls=20, clustered=0.85, contact=contact)
        bolls = plant_truth(grow_plant(options), options)["bolls"]
        centres = np.array([boll["centre_xyz_m"] for boll in bolls])
        widths = np.array([boll["diameter_cm"] for boll in bolls]) / 100
        apart = np.linalg.norm(centres[:, None] - centres, axis=2) / (0.5 * (widths[:, None] + widths))
        nearest[contact] = (apart + 9 * np.eye(len(apart))).min(axis=1)
    assert (nearest[0.90] < 1).sum() >= 15
    assert (nearest[0.72] < 1).sum() >= 15
    assert 0.65 < nearest[0.72].min() < 0.75 < nearest[0.90].min()


def test_local_shots_go_round_close_by_at_three_heights():
    """A stick of 0.9 m: the thirds' middles are 0.3 m apart, and the camera is half a metre away."""
    stick = np.column_stack([np.zeros((200, 2)), np.linspace(0, 0.9, 200)])
    near = orbit(SimulateOptions(shot="local", frames=301), stick)
    far = orbit(SimulateOptions(frames=301), stick)
    places = np.array([camera.centre for camera in near.cameras()])
    away = np.linalg.norm(places[:, :2], axis=1)
    assert np.median(away) == pytest.approx(0.55, abs=0.05) and np.linalg.norm(far.at(0).centre[:2]) > 1.0
    levels = [np.median(places[part, 2]) for part in (slice(5, 85), slice(105, 185), slice(205, 295))]
    assert np.diff(levels) == pytest.approx([0.3, 0.3], abs=0.12)  # a hand sways by up to 6 cm
    angles = np.unwrap(np.arctan2(places[:, 1], places[:, 0]))
    assert abs(angles[-1] - angles[0]) == pytest.approx(3 * abs(near.turn), abs=0.1)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps.max() < 3 * np.median(steps)  # no jump between two heights
