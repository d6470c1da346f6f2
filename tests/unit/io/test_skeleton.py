# SPDX-License-Identifier: Apache-2.0
"""The plant map as PLY and as a drawing."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from itertools import combinations

import numpy as np
import open3d as o3d
import pytest
from scenes.branch_scene import mapped

from cotton3dg.core.plant_map import PlantMap
from cotton3dg.evaluation.plant_map import true_map
from cotton3dg.geometry.polylines import length_of
from cotton3dg.io.skeleton import draw_map, skeleton_ply
from cotton3dg.options import SimulateOptions
from cotton3dg.schemas.truth import Truth
from cotton3dg.simulate.plant import grow_plant
from cotton3dg.simulate.truth import plant_truth


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


def test_a_narrow_drawing_keeps_letters_and_heights():
    narrow, wide = (
        ET.fromstring(draw_map(mapped(), most_px=most_px)).attrib["viewBox"].split()[2:] for most_px in (320.0, np.inf)
    )
    assert float(narrow[0]) == pytest.approx(320, abs=1) and float(wide[0]) > 340
    assert narrow[1] == wide[1]


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
