"""What a first look at a film says: bolls in space, the frame's edges, gaps in the walk, the verdict."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes.documents import frame_info, frames_info

from cotton3dg.capture_check import preview
from cotton3dg.capture_check.first_count import FoundBoll, find_bolls_in_space, find_sure
from cotton3dg.capture_check.framing import corners_in_view, find_cut_plants, find_cut_sides, find_gaps
from cotton3dg.capture_check.judge import conclude, judge, refuse
from cotton3dg.capture_check.plane_sweep import find_agreeing_places
from cotton3dg.capture_check.preview import Look
from cotton3dg.capture_check.view_detections import Sight
from cotton3dg.core.measurements import Scale
from cotton3dg.core.outcome import StageOutcome
from cotton3dg.core.scene import Camera
from cotton3dg.geometry.camera_orbit import fit_orbit
from cotton3dg.options import ScaleOptions
from cotton3dg.report.verdicts import of_placed, of_sharpness, of_walk
from cotton3dg.scale.estimate_scale import FoundScale, Plant, no_scale
from cotton3dg.schemas.check import GREEN, RED, YELLOW, CheckInfo, Finding
from cotton3dg.schemas.scale import ScaleInfo

WIDTH, HEIGHT, FOCAL_PX, RADIUS = 640, 360, 525.0, 1.4
BOLLS = np.array([[0.0, 0.0, 0.5], [0.12, 0.02, 0.42], [-0.1, 0.08, 0.3], [0.05, -0.13, 0.22], [0.02, 0.05, 0.36]])
DIAMETER = 0.04
AZIMUTHS = np.arange(0, 360, 15)


def camera_at(azimuth_deg: float, aim: float = 0.3, name: str = "") -> Camera:
    """A camera of the orbit, level with the plant's middle, that looks at a height above the table (m)."""
    a = np.radians(azimuth_deg)
    centre, target = np.array([RADIUS * np.cos(a), RADIUS * np.sin(a), 0.5]), np.array([0, 0, aim])
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.column_stack([rotation, -rotation @ centre])
    return Camera(name or f"{azimuth_deg:03.0f}.jpg", WIDTH, HEIGHT, FOCAL_PX, FOCAL_PX, WIDTH / 2, HEIGHT / 2, pose)


def sight_of(camera: Camera, bolls: np.ndarray = BOLLS, plant: np.ndarray | None = None) -> Sight:
    """What a network without faults says of bolls that hide nothing from each other."""
    pixels, depths = camera.project(bolls)
    parts = np.zeros((HEIGHT // 2, WIDTH // 2), np.int32) if plant is None else plant
    sizes = camera.fx * DIAMETER / depths
    return Sight(camera, np.zeros((HEIGHT, WIDTH), np.uint16), pixels, sizes, 0.7, 0.0, parts)


def look_of(cameras: list[Camera], **changes) -> Look:
    """A first look at a film without faults."""
    sights = [sight_of(camera) for camera in cameras]
    orbit = fit_orbit(cameras)
    corners = np.array([[-0.6, -0.3, 0], [0.6, -0.3, 0], [0.6, 0.3, 0], [-0.6, 0.3, 0]])
    scale = Scale(100.0, 0.002, "table", np.array([0, 0, 1.0]), np.array([0, 0, 1.0, 0]), corners)
    images = tuple(frame_info(camera.name) for camera in cameras)
    found = Look(
        frames=frames_info(list(images)),
        names=tuple(camera.name for camera in cameras),
        images=Path(),
        cameras=cameras,
        orbit=orbit,
        sights=sights,
        bolls=find_bolls_in_space(sights, orbit),
        scale=FoundScale(ScaleInfo.of_scale(scale), StageOutcome()),
    )
    return replace(found, **changes)


@pytest.fixture
def cameras() -> list[Camera]:
    return [camera_at(azimuth) for azimuth in AZIMUTHS]


def test_bolls_are_found_where_lines_of_sight_meet(cameras: list[Camera]) -> None:
    bolls = find_bolls_in_space([sight_of(camera) for camera in cameras], fit_orbit(cameras))
    far = np.linalg.norm(BOLLS[:, None] - np.stack([boll.centre for boll in bolls]), axis=2)
    assert len(bolls) == len(BOLLS) == len(find_sure(bolls, len(cameras)))
    assert far.min(axis=1).max() < 1e-6
    assert [boll.diameter_su for boll in bolls] == pytest.approx([DIAMETER] * 5, rel=0.05)


def test_bolls_that_some_images_hide_or_invent_are_still_counted_right(cameras: list[Camera]) -> None:
    rng = np.random.default_rng(0)
    sights = []
    for camera in cameras:
        sight = sight_of(camera)
        kept = rng.random(5) > 0.3
        invented = rng.uniform((0, 0), (WIDTH, HEIGHT), (2, 2))
        places = np.concatenate([sight.middles_px[kept] + rng.normal(0, 1, (kept.sum(), 2)), invented])
        sights.append(replace(sight, middles_px=places, diameters_px=np.append(sight.diameters_px[kept], [15.0, 15.0])))
    bolls = find_bolls_in_space(sights, fit_orbit(cameras))
    assert len(find_sure(bolls, len(cameras))) == 5


def test_images_without_bolls_give_none(cameras: list[Camera]) -> None:
    empty = [sight_of(camera, np.zeros((0, 3))) for camera in cameras]
    assert find_bolls_in_space(empty, fit_orbit(cameras)) == []


def test_a_boll_at_the_edge_is_cut_by_that_side() -> None:
    low = camera_at(0, aim=-0.05)  # it looks down: the top of the plant leaves the frame
    bolls = [FoundBoll(centre, DIAMETER, 12) for centre in BOLLS]
    assert find_cut_sides(bolls, [low, camera_at(90)]) == {low.name: ("top",)}
    assert find_cut_sides([], [low]) == {}


def test_a_plant_that_no_image_shows_whole_is_told_by_its_looks(cameras: list[Camera]) -> None:
    stem, shelf = np.zeros((2, HEIGHT // 2, WIDTH // 2), np.int32)
    stem[: HEIGHT // 3, WIDTH // 4 - 15 : WIDTH // 4 + 15] = 1  # from the top down to where the bolls are
    shelf[:, :4] = 1  # brown, at the edge, and no part of the plant
    bolls = [FoundBoll(centre, DIAMETER, 12) for centre in BOLLS]
    assert find_cut_plants(bolls, [sight_of(cameras[0], plant=stem)]) == {cameras[0].name: ("top",)}
    assert find_cut_plants(bolls, [sight_of(cameras[0], plant=shelf)]) == {}


@pytest.mark.parametrize("direction", [1, -1])
def test_gaps_are_counted_along_the_walk(direction: int) -> None:
    walked = [camera_at(40 + direction * a) for a in (*range(0, 100, 5), *range(180, 330, 5))]
    gaps = find_gaps(walked, fit_orbit(walked), 20.0)
    assert [tuple(round(end) for end in gap) for gap in gaps] == [(95, 180), (325, 360)]


def test_corners_of_the_table_are_seen_or_not(cameras: list[Camera]) -> None:
    corners = np.array([[0, 0, 0.3], [0, 0, 9.0], [1.39, 0, 0.5]])
    assert corners_in_view(corners, cameras[:1]).tolist() == [1.0, 0.0, 1.0]
    assert corners_in_view(corners[2:], [camera_at(0), camera_at(90)]).tolist() == [0.5]


def test_a_film_without_faults_is_green(cameras: list[Camera]) -> None:
    info = judge(look_of(cameras), 960, 12.34)
    assert info.verdict == GREEN
    assert info.line.startswith("360 degrees around the plant, 24 of 24 frames placed")
    assert "about 5 bolls" in info.line
    assert info.figures["bolls"] == 5
    assert info.seconds == 12.3


def test_a_table_of_assumed_size_is_named_and_no_fault_of_the_film(cameras: list[Camera]) -> None:
    look = look_of(cameras)
    info = replace(look.scale.info, table_cm=(120.0, 60.0), table_assumed=True)
    found = judge(replace(look, scale=replace(look.scale, info=info)), 960, 1.0)
    assert found.verdict == GREEN
    assert "scale to 0.2 %, table taken as 120 x 60 cm" in found.line


def test_the_report_judges_as_the_check_does(cameras: list[Camera]) -> None:
    """A fifth of the frames blurred and a gap of 45 degrees: usable, and called so on both pages."""
    images = tuple(frame_info(camera.name, blur=0.6 if i % 5 == 0 else 0.2) for i, camera in enumerate(cameras))
    look = look_of(cameras[:-2])
    checked = judge(replace(look, frames=frames_info(list(images))), 960, 1.0)
    reported = [
        of_walk(look.orbit.coverage_deg, look.orbit.largest_gap_deg),
        of_placed(len(look.cameras), len(look.names)),
        of_sharpness(images, 0.0, [15.0]),
    ]
    assert {finding.verdict for finding in reported} == {GREEN}
    assert {str(finding) for finding in reported} <= {str(finding) for finding in checked.findings}


def test_photos_of_the_check_show_the_bolls_that_it_counts(cameras: list[Camera]) -> None:
    """Every image also shows something white that no other shows."""
    sights = []
    for number, camera in enumerate(cameras):
        sight = sight_of(camera)
        odd = np.array([[20.0 + 9 * number, 12.0]])
        sights.append(
            replace(
                sight,
                middles_px=np.concatenate([odd, sight.middles_px]),
                diameters_px=np.append(15.0, sight.diameters_px),
            )
        )
    counted = find_sure(find_bolls_in_space(sights, fit_orbit(cameras)), len(cameras))
    assert len(counted) == 5
    assert all(own > 1 for boll in counted for _, own in boll.seen)
    seen = [sorted(own for boll in counted for view, own in boll.seen if view == number) for number in range(24)]
    assert seen == 24 * [[2, 3, 4, 5, 6]]


@pytest.mark.parametrize(
    ("change", "verdict", "said"),
    [
        ({"names": tuple(f"{i}.jpg" for i in range(40))}, YELLOW, "24 of 40 frames placed; walk more slowly"),
        (
            {"scale": no_scale("none", "no scale was found; film the table")},
            YELLOW,
            "no scale was found at a first look; film the",
        ),
        ({"bolls": []}, YELLOW, "no boll was found"),
    ],
)
def test_what_run_would_flag_is_yellow(cameras: list[Camera], change: dict, verdict: str, said: str) -> None:
    info = judge(look_of(cameras, **change), 960, 1.0)
    assert info.verdict == verdict
    assert said in info.line


def test_half_a_turn_says_which_part_is_missing() -> None:
    info = judge(look_of([camera_at(a) for a in range(0, 200, 10)]), 960, 1.0)
    assert info.verdict == YELLOW
    assert "you stopped 170 degrees before the turn was full" in info.line


def test_light_that_burns_the_lint_or_leaves_a_dark_side_is_yellow(cameras: list[Camera]) -> None:
    look = look_of(cameras)
    burnt = [replace(sight, burnt_share=0.5) for sight in look.sights]
    uneven = [replace(sight, lint_luminance=0.9 if i < 6 else 0.2) for i, sight in enumerate(look.sights)]
    assert "50% of the lint is burnt out white; lower the exposure" in judge(replace(look, sights=burnt), 960, 1.0).line
    assert "4.5 times brighter on one side" in judge(replace(look, sights=uneven), 960, 1.0).line


def test_small_bolls_are_told_by_their_width_in_the_training_images(cameras: list[Camera]) -> None:
    assert judge(look_of(cameras), 960, 1.0).figures["boll_px"] == pytest.approx(15.1, abs=0.5)
    assert "film closer" in judge(look_of(cameras), 320, 1.0).line


def test_a_plant_cut_nearly_everywhere_is_red(cameras: list[Camera]) -> None:
    stem = np.zeros((HEIGHT // 2, WIDTH // 2), np.int32)
    stem[:, WIDTH // 4 - 40 : WIDTH // 4 + 40] = 1
    look = look_of(cameras)
    info = judge(replace(look, sights=[sight_of(camera, plant=stem) for camera in cameras]), 960, 1.0)
    assert info.verdict == RED
    assert "cut by the top of the frame" in info.line
    assert "step back" in info.line


def test_motion_that_blurs_bolls_is_yellow_and_a_little_is_not(cameras: list[Camera]) -> None:
    look = look_of(cameras)
    width_px = float(np.median(np.concatenate([sight.diameters_px for sight in look.sights])))
    assert judge(replace(look, blur_px=0.2 * width_px), WIDTH, 1.0).verdict == GREEN
    info = judge(replace(look, blur_px=0.3 * width_px), WIDTH, 1.0)
    assert info.verdict == YELLOW
    assert "much of a boll's width; walk more slowly" in info.line
    assert info.figures["motion_blur_px"] == 0.3 * width_px


def test_the_worst_comes_first_and_the_others_are_counted(tmp_path: Path) -> None:
    found = [Finding(GREEN, "a", "good"), Finding(YELLOW, "b", "dark", "lamp"), Finding(RED, "c", "cut", "step back")]
    info = conclude(found, {"placed": 3}, 1.0)
    assert (info.verdict, info.line) == (RED, "cut; step back (and 1 more)")
    info.save(tmp_path / "check.json")
    assert CheckInfo.load(tmp_path / "check.json") == info


def test_a_refused_film_is_red_in_the_words_of_the_stage() -> None:
    info = refuse("walk.mp4 is too short: 1 s; film one slow full turn", 2.0)
    assert (info.verdict, info.line) == (RED, "walk.mp4 is too short: 1 s; film one slow full turn")
    assert info.findings[0].remedy == "film one slow full turn"


def photos_of_a_pattern(cameras: list[Camera], rng: np.random.Generator) -> list[np.ndarray]:
    """A pattern painted on z = 0 within 0.4; what is around it is of another colour in each photo."""
    photos = []
    for camera in cameras:
        y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
        rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], -1)
        rays = rays @ camera.rotation
        with np.errstate(divide="ignore"):
            hit = camera.centre + rays * (-camera.centre[2] / rays[..., 2])[..., None]
        on = (np.abs(hit[..., :2]).max(axis=-1) < 0.4) & (rays[..., 2] < 0)
        pattern = 128 + 100 * np.sin(9 * hit[..., 0]) * np.sin(7 * hit[..., 1])
        grey = np.where(on, pattern, rng.uniform(0, 255))
        photos.append(np.repeat(grey[..., None], 3, axis=2).astype(np.uint8))
    return photos


def assert_the_pattern_is_covered(places: np.ndarray, cameras: list[Camera]) -> None:
    inside = (np.abs(places[:, :2]).max(axis=1) < 0.41) & (np.abs(places[:, 2]) < 0.003)
    expected = (0.8 / (0.02 * fit_orbit(cameras).radius)) ** 2
    assert inside.sum() == pytest.approx(expected, rel=0.15)


def test_photos_agree_on_the_plane_that_is_there(cameras: list[Camera]) -> None:
    rng = np.random.default_rng(1)
    photos = photos_of_a_pattern(cameras, rng)
    tracks = np.column_stack([rng.uniform(-0.4, 0.4, (300, 2)), np.zeros(300)])
    places = find_agreeing_places(tracks, fit_orbit(cameras), cameras, photos, 6.0)
    assert (np.abs(places[:, :2]).max(axis=1) < 0.41).mean() > 0.98
    assert_the_pattern_is_covered(places, cameras)


@pytest.mark.parametrize(
    ("outlined", "found", "tried"),
    [
        ({0}, {0}, [0]),  # structure from motion has the whole table
        ({2}, {2}, [2]),  # only places at which photos agree have it
        ({1, 3}, {3}, [1, 3]),
        (set(), {1}, [0, 1]),  # nothing tells what to try first
        ({2}, {0}, [2, 0]),
        ({3}, set(), [3, 0, 1, 2]),
    ],
)
def test_the_scale_is_sought_first_where_points_outline_the_table(
    monkeypatch: pytest.MonkeyPatch, cameras: list[Camera], outlined: set[int], found: set[int], tried: list[int]
) -> None:
    """The sources are told by how many places they have besides the tracks: none, then more with each tolerance."""
    sought: list[int] = []
    a_scale = look_of(cameras).scale

    def seek_scale(plant: Plant, *_: object, **__: object) -> FoundScale:
        sought.append(len(plant.solid))
        return a_scale if len(plant.solid) in found else no_scale(f"no table in {len(plant.solid)}")

    monkeypatch.setattr(preview, "seek_scale", seek_scale)
    monkeypatch.setattr(preview, "outlines_table", lambda points, *_: len(points) in outlined)
    monkeypatch.setattr(
        preview, "find_agreeing_places", lambda *arguments: np.zeros((1 + preview.TOLERANCES.index(arguments[-1]), 3))
    )
    plant = Plant(cameras, lambda _: np.zeros((2, 2, 3), np.uint8), np.zeros((0, 3)), np.zeros((0, 3), np.float32))
    result = preview._seek_scale(plant, fit_orbit(cameras), cameras, [], ScaleOptions())
    assert sought == tried
    assert (result.info.scale is not None) == bool(found)
    if not found:
        assert result.info.reason == f"no table in {tried[0]}"
    assert preview._seek_scale(plant, fit_orbit(cameras), cameras, [], ScaleOptions(method="none")).info.scale is None


def test_a_bare_table_is_as_level_as_the_floor(cameras: list[Camera]) -> None:
    """Points on a sheet of paper and on a pot beside it lie on a plane as well, tilted by 14 degrees."""
    rng = np.random.default_rng(1)
    photos = photos_of_a_pattern(cameras, rng)
    paper = np.column_stack([rng.uniform(-0.08, 0.08, (60, 2)) + (0.2, 0), np.zeros(60)])
    pot = np.column_stack([rng.uniform(-0.04, 0.04, (60, 2)), np.full(60, 0.05)])
    floor = np.column_stack([rng.uniform(-2, 2, (600, 2)), np.full(600, -0.7)])
    places = find_agreeing_places(np.concatenate([paper, pot, floor]), fit_orbit(cameras), cameras, photos, 6.0)
    assert_the_pattern_is_covered(places, cameras)
