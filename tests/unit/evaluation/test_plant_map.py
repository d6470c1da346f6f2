"""The plant map on disk and against the truth: documents, PLY, drawing, scores."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import open3d as o3d
import pytest
from scenes.branch_scene import branch_scene

from cotton3dg.cli.display import print_map_scores
from cotton3dg.core.plant_map import Axis, PlantMap
from cotton3dg.evaluation.plant_map import compare_maps, match_branches, true_map
from cotton3dg.geometry.polylines import length_of
from cotton3dg.io.skeleton import draw_map, skeleton_ply
from cotton3dg.options import SimulateOptions
from cotton3dg.plant_map.map_plant import map_places
from cotton3dg.plant_map.wood import thinned
from cotton3dg.schemas.skeleton import SkeletonInfo, describe_map, read_map
from cotton3dg.schemas.truth import Truth
from cotton3dg.simulate.plant import grow_plant
from cotton3dg.simulate.truth import plant_truth


@cache
def mapped() -> PlantMap:
    scene = branch_scene()
    return map_places(thinned(scene.places, 0.25), scene.bolls)


@cache
def natural() -> tuple[PlantMap, np.ndarray]:
    """The true map of a simulated plant, and its bolls' centres, cm."""
    options = SimulateOptions(seed=8, architecture="natural", bolls=10, vegetative=1)
    truth = Truth.parsed(plant_truth(grow_plant(options), options))
    centres = np.array([boll.centre_xyz_m for boll in truth.bolls]) - truth.stem_base_xyz_m
    return true_map(truth), 100 * centres


def test_a_map_that_was_written_is_read_again(tmp_path):
    describe_map(mapped()).save(tmp_path / "skeleton.json")
    again = read_map(SkeletonInfo.load(tmp_path / "skeleton.json"))
    for axis, other in zip(mapped().axes, again.axes, strict=True):
        assert other.curve == pytest.approx(axis.curve, abs=1e-4)
        assert (axis.rank, axis.kind, axis.parent, axis.bolls) == (other.rank, other.kind, other.parent, other.bolls)
    assert [boll.position for boll in again.bolls] == [boll.position for boll in mapped().bolls]
    describe_map(PlantMap((), (), "no_stem")).save(tmp_path / "none.json")
    assert read_map(SkeletonInfo.load(tmp_path / "none.json")).reason == "no_stem"


def test_other_programs_read_the_skeleton(tmp_path):
    path = tmp_path / "skeleton.ply"
    path.write_text(skeleton_ply(mapped()))
    points = o3d.io.read_point_cloud(str(path))
    wanted = sum(len(axis.curve) for axis in mapped().axes) + sum(len(boll.stalk) for boll in mapped().bolls)
    assert len(points.points) == wanted
    text = path.read_text().split("end_header\n")[1].splitlines()
    edges = np.array([line.split() for line in text[wanted:]], int)
    assert edges.max() == wanted - 1
    assert len(edges) == wanted - len(mapped().axes) - len(mapped().bolls)


def test_the_drawing_has_every_branch_and_boll():
    root = ET.fromstring(draw_map(mapped(), "a < b"))
    kinds = [child.tag.rpartition("}")[2] for child in root]
    assert kinds.count("circle") == len(mapped().bolls)
    texts = [child.text for child in root if child.tag.endswith("text")]
    assert "a < b" in texts
    for axis in mapped().branches:
        assert f"{axis.rank} · {length_of(axis.curve):.0f} cm" in texts
    assert draw_map(PlantMap((), (), "no_stem")) == ""


def test_bolls_whose_branch_is_doubtful_are_open_circles():
    doubtful = replace(mapped(), bolls=tuple(replace(boll, confidence=0.69) for boll in mapped().bolls))
    for plant_map, fill, words in ((mapped(), "#1f5fa8", 0), (doubtful, "#fff", len(doubtful.bolls))):
        root = ET.fromstring(draw_map(plant_map))
        circles = [child for child in root if child.tag.endswith("circle")]
        assert {circle.attrib["fill"] for circle in circles} == {fill}
        assert sum("doubtful" in (circle[0].text or "") for circle in circles) == words


@pytest.mark.parametrize("seed", [3, 8])
def test_no_label_of_a_crowded_plant_hides_another(seed):
    options = SimulateOptions(seed=seed, architecture="natural", bolls=40, vegetative=1)
    plant_map = true_map(Truth.parsed(plant_truth(grow_plant(options), options)))
    root = ET.fromstring(draw_map(plant_map))
    size = [float(side) for side in root.attrib["viewBox"].split()[2:]]
    named = [child for child in root if child.tag.endswith("text") and not re.fullmatch(r"[123]\+?", child.text)]
    assert len(named) == 1 + len(plant_map.bolls) + len(plant_map.branches) + int(plant_map.stem.curve[-1, 2]) // 10
    boxes = []
    for item in named:
        font = float(re.search(r"font-size:(\d+)px", item.attrib["style"])[1])
        x, y, wide = float(item.attrib["x"]), float(item.attrib["y"]), 0.5 * font * len(item.text)
        left = x - wide * {"start": 0, "middle": 0.5, "end": 1}[item.attrib["text-anchor"]]
        boxes.append((left, y - 0.7 * font, left + wide, y))
        assert left >= 0 and left + wide <= size[0] and 0 <= y <= size[1]
    circles = [child.attrib for child in root if child.tag.endswith("circle")]
    boxes += [(float(c["cx"]) - 6, float(c["cy"]) - 6, float(c["cx"]) + 6, float(c["cy"]) + 6) for c in circles]
    for one, other in combinations(range(len(boxes)), 2):
        if one < len(named):
            a, b = boxes[one], boxes[other]
            assert not (a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]), named[one].text


def test_the_truth_scores_full_marks_against_itself():
    true, centres = natural()
    scores = compare_maps(true, centres, list(range(1, len(centres) + 1)), true, centres)
    assert scores.f1 == 1
    assert scores.angle_error_deg == pytest.approx(0)
    assert scores.bolls_on_branch == scores.bolls == len(centres)
    assert scores.positions_right == scores.positions
    assert scores.stem_diameter_error_mm == pytest.approx(0)
    assert {"stem", "fruiting", "vegetative"} == {axis.kind for axis in true.axes}


def test_no_word_of_fruiting_positions_where_the_truth_has_none(capsys):
    true, centres = natural()
    scores = compare_maps(true, centres, list(range(1, len(centres) + 1)), true, centres)
    print_map_scores(scores)
    assert f"fruiting position right: {scores.positions} of {scores.positions}" in capsys.readouterr().out
    print_map_scores(replace(scores, positions=0, positions_right=0))
    assert "position" not in capsys.readouterr().out


def test_half_a_turn_of_the_table_is_no_error():
    true, centres = natural()
    turn = np.array([-1, -1, 1])
    turned = replace(true, axes=tuple(replace(axis, curve=axis.curve * turn) for axis in true.axes))
    assert compare_maps(turned, centres * turn, list(range(1, len(centres) + 1)), true, centres).f1 == 1


def test_missed_false_and_mistaken_branches_cost():
    true, centres = natural()
    fruiting = [axis for axis in true.branches if axis.kind == "fruiting" and length_of(axis.curve) > 6]
    lost = fruiting[0]
    kept = tuple(replace(axis, curve=axis.curve + (9, 9, 0)) if axis.rank == lost.rank else axis for axis in true.axes)
    scores = compare_maps(replace(true, axes=kept), centres, list(range(1, len(centres) + 1)), true, centres)
    assert scores.matched_branches == scores.true_branches - 1
    assert scores.precision == scores.recall < 1
    assert scores.bolls_on_branch == len(centres) - len(lost.bolls)
    assert scores.doubtful == scores.doubtful_on_branch == 0
    doubts = tuple(replace(boll, confidence=0.69 if boll.boll_id in lost.bolls[:1] else 1.0) for boll in true.bolls)
    doubted = compare_maps(
        replace(true, axes=kept, bolls=doubts), centres, list(range(1, len(centres) + 1)), true, centres
    )
    assert (doubted.doubtful, doubted.doubtful_on_branch) == (1, 0)
    nothing = compare_maps(PlantMap(true.axes[:1], ()), centres, list(range(1, 11)), true, centres)
    assert nothing.recall == 0
    assert nothing.bolls_on_branch == 0


def test_branches_are_matched_by_foot_and_direction():
    def branch(foot, tip):
        curve = np.linspace(foot, tip, 20)
        return Axis(1, "fruiting", 0, curve, np.full(20, 0.2), 1.0)

    true = (branch((0, 0, 10), (10, 0, 15)), branch((0, 0, 14), (-10, 0, 19)))
    found = (branch((0, 0, 14.5), (-10, 1, 20)), branch((0, 0, 10), (0, 10, 15)))
    assert match_branches(found, true) == [(0, 1)]
