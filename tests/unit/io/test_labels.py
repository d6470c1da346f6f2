# SPDX-License-Identifier: Apache-2.0
"""YOLO labels, Labelme files, prompts as tables, and COCO as it is exported."""

import base64
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from cotton3dg.errors import BadInput, MissingInput
from cotton3dg.io.annotations import read_masks
from cotton3dg.io.coco import coco_document
from cotton3dg.io.images import write_image
from cotton3dg.io.instances import fill_polygons, trace_outlines
from cotton3dg.io.prompt_table import read_prompts
from cotton3dg.io.yolo_labels import read_class_names, write_yolo_labels

H, W = 60, 100


def drawing() -> np.ndarray:
    """A disc, an ellipse, and a boll in two pieces."""
    ids = np.zeros((H, W), np.uint16)
    y, x = np.mgrid[:H, :W]
    ids[(x - 20) ** 2 + (y - 30) ** 2 < 200] = 1
    ids[((x - 60) / 2) ** 2 + (y - 40) ** 2 < 60] = 5
    ids[5:15, 70:78] = ids[5:15, 82:95] = 9
    return ids


def iou(one: np.ndarray, other: np.ndarray) -> float:
    return (one & other).sum() / (one | other).sum()


def write_photo(path: Path, height: int = H, width: int = W) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_image(path, np.zeros((height, width, 3), np.uint8))


def labelme(path: Path, shapes: list[dict], **changes) -> Path:
    document = {"shapes": shapes, "imagePath": "../frames/000004.jpg", "imageHeight": H, "imageWidth": W}
    path.write_text(json.dumps(document | changes))
    return path


def shape(points: list, label: str = "boll", kind: str | None = "polygon", **more) -> dict:
    return {"label": label, "points": points, "shape_type": kind} | more


SQUARE = [[10, 10], [20, 10], [20, 20], [10, 20]]


def test_what_is_exported_as_coco_is_read_back(tmp_path: Path) -> None:
    ids = drawing()
    (tmp_path / "bolls.json").write_text(json.dumps(coco_document({"000004.jpg": ids, "000005.jpg": 0 * ids})))
    back = read_masks(tmp_path).ids
    assert not back["000005"].any()
    for number, value in enumerate((1, 5, 9), start=1):
        assert iou(back["000004"] == number, ids == value) > 0.95
    document = json.loads((tmp_path / "bolls.json").read_text())
    assert [len(item["segmentation"]) for item in document["annotations"]] == [1, 1, 2]
    assert document["annotations"][2]["bbox"] == pytest.approx([70, 5, 25, 10], abs=0.3)
    assert document["annotations"][2]["area"] == 210


def test_outlines_follow_the_edge_of_the_pixels() -> None:
    mask = drawing() == 9
    for corners in trace_outlines(mask, 0.0):
        inside = np.zeros(H * W, bool)
        inside[fill_polygons([corners], H, W)] = True
        assert (inside.reshape(H, W) & ~mask).sum() == 0
    left, right = sorted(trace_outlines(mask, 0.5), key=lambda corners: corners[:, 0].min())
    np.testing.assert_allclose([left.min(axis=0), left.max(axis=0)], [[70, 5], [78, 15]], atol=0.13)
    assert len(right) == 4


def test_yolo_labels_come_back_also_of_a_boll_in_pieces(tmp_path: Path) -> None:
    ids = drawing()
    write_yolo_labels(tmp_path / "000004.txt", ids)
    assert len((tmp_path / "000004.txt").read_text().splitlines()) == 3
    back = read_masks(tmp_path, sizes={"000004": (H, W)}).ids["000004"]
    for number, value in enumerate((1, 5, 9), start=1):
        assert iou(back == number, ids == value) > 0.95


def test_yolo_labels_take_the_size_of_the_photo_beside_them(tmp_path: Path) -> None:
    write_photo(tmp_path / "images" / "train" / "a.jpg", 30, 50)
    (tmp_path / "labels" / "train").mkdir(parents=True)
    (tmp_path / "labels" / "train" / "a.txt").write_text("0 0.2 0.2 0.6 0.2 0.6 0.6 0.2 0.6\n")
    ids = read_masks(tmp_path, sizes={"a": (H, W)}).ids["a"]
    expected = np.zeros((30, 50), bool)
    expected[6:18, 10:30] = True
    np.testing.assert_array_equal(ids == 1, expected)


def test_a_label_file_without_lines_is_an_image_without_bolls(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("0 0.2 0.2 0.6 0.2 0.6 0.6 0.75\n")
    (tmp_path / "b.txt").write_text("\n")
    masks = read_masks(tmp_path, sizes={"a": (H, W), "b": (H, W)})
    assert masks.ids["a"].any() and not masks.ids["b"].any()
    assert masks.scores == {"a": {1: 0.75}, "b": {}}


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("0 0.5 0.5 0.2 0.2", "line 1 is a box"),
        ("boll 0.2 0.2 0.6 0.2 0.6 0.6", "not a class and x y"),
        ("0 0.2 0.2 0.6 0.2 nan 0.6", "not a class and x y"),
        ("0 20 20 60 20 60 60", "not a class and x y"),
        ("-1 0.2 0.2 0.6 0.2 0.6 0.6", "not a class and x y"),
        ("0", "2 corners|0 corners"),
    ],
)
def test_lines_that_are_no_outline_are_refused(tmp_path: Path, line: str, words: str) -> None:
    (tmp_path / "a.txt").write_text(line)
    with pytest.raises(BadInput, match=words):
        read_masks(tmp_path, sizes={"a": (H, W)})


def test_labels_of_an_unknown_image_and_labels_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("0 0.1 0.1 0.2 0.1 0.2 0.2\n")
    with pytest.raises(BadInput, match="no known image"):
        read_masks(tmp_path)
    (tmp_path / "a.txt").write_bytes(b"\xff\x00")
    with pytest.raises(BadInput, match=r"a\.txt, line 1, is not in UTF-8"):
        read_masks(tmp_path, sizes={"a": (H, W)})


LINES = "0 0.1 0.1 0.2 0.1 0.2 0.2\n1 0.5 0.5 0.9 0.5 0.9 0.9\n"


@pytest.mark.parametrize("folder", ["labels", "train/labels", "labels/train"])
def test_an_export_with_all_that_programs_put_beside_the_labels_is_read(tmp_path: Path, folder: str) -> None:
    (tmp_path / folder).mkdir(parents=True)
    (tmp_path / folder / "a.txt").write_text(LINES)
    (tmp_path / "README.dataset.txt").write_text("# bolls > 2026\nhttps://example.org\n")
    (tmp_path / "train.txt").write_text("images/a.jpg\n")
    (tmp_path / "data.yaml").write_text("train: ../train/images\nnc: 2\nnames:\n- 'open boll'\n- leaf\nsource: x\n")
    for litter in (f"{folder}/._a.txt", "__MACOSX/a.txt", f"{folder}/.DS_Store"):
        (tmp_path / litter).parent.mkdir(exist_ok=True)
        (tmp_path / litter).write_bytes(b"\x00\x05\x16\x07\xff")
    assert len(read_masks(tmp_path, {"a": (H, W)}, ["open boll"]).scores["a"]) == 1
    with pytest.raises(BadInput, match=r"2 classes \(leaf, open boll\)"):
        read_masks(tmp_path, {"a": (H, W)})


def test_labels_beside_notes_and_lists_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("0 0.1 0.1 0.2 0.1 0.2 0.2\n")
    (tmp_path / "notes.txt").write_bytes("第一次标注".encode("gbk"))
    (tmp_path / "train.txt").write_text("a.jpg\n")
    assert set(read_masks(tmp_path, {"a": (H, W)}).ids) == {"a"}


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_names_of_classes_are_read_in_any_certain_encoding(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "a.txt").write_text(LINES)
    (tmp_path / "classes.txt").write_bytes("cápsula\r\nhoja\r\n".encode(encoding))
    assert len(read_masks(tmp_path, {"a": (H, W)}, ["cápsula"]).scores["a"]) == 1


def test_names_of_classes_in_another_encoding_are_numbers_until_they_are_asked_for(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("0 0.1 0.1 0.2 0.1 0.2 0.2\n")
    (tmp_path / "classes.txt").write_bytes("棉铃\n叶子\n".encode("gbk"))
    assert len(read_masks(tmp_path, {"a": (H, W)}).scores["a"]) == 1
    assert len(read_masks(tmp_path, {"a": (H, W)}, ["0"]).scores["a"]) == 1
    with pytest.raises(BadInput, match=r"classes\.txt, line 1, is not in UTF-8"):
        read_masks(tmp_path, {"a": (H, W)}, ["棉铃"])


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("names: ['boll', \"leaf, dry\"]\nnc: 2\n", {0: "boll", 1: "leaf, dry"}),
        ("names: {0: boll, 2: leaf}\n", {0: "boll", 2: "leaf"}),
        ('names:\n  0: open, dry boll  # ripe\n  1: "\\u68C9"\n\nval: x\n', {0: "open, dry boll", 1: "棉"}),
        ("nc: 1\nnames:\n- 'it''s'\nval: 7\n", {0: "it's"}),
        ("names: [\n  boll,\n  leaf,\n]\n", {0: "boll", 1: "leaf"}),
        ("nc: 1\n", {}),
    ],
)
def test_names_of_classes_in_yaml(tmp_path: Path, text: str, names: dict[int, str]) -> None:
    (tmp_path / "data.yaml").write_text(text)
    assert read_class_names(tmp_path) == names


def test_of_several_classes_the_user_names_the_bolls(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("0 0.1 0.1 0.2 0.1 0.2 0.2\n2 0.5 0.5 0.9 0.5 0.9 0.9\n")
    sizes = {"a": (H, W)}
    with pytest.raises(BadInput, match=r"2 classes .*--classes"):
        read_masks(tmp_path, sizes)
    (tmp_path / "classes.txt").write_text("boll\nleaf\nstem\n")
    assert len(read_masks(tmp_path, sizes, ["boll", "stem"]).scores["a"]) == 2
    ids = read_masks(tmp_path, sizes, ["boll"]).ids["a"]
    assert ids[7:11, 11:19].any() and not ids[30:].any()
    with pytest.raises(BadInput, match="no class 'lint'; it has boll, stem"):
        read_masks(tmp_path, sizes, ["lint"])


def test_labelme_polygons_groups_and_masks(tmp_path: Path) -> None:
    coded = base64.b64encode(cv2.imencode(".png", np.full((5, 8), 255, np.uint8))[1].tobytes()).decode()
    right = [[30, 10], [34, 10], [34, 20], [30, 20]]
    labelme(
        tmp_path / "drawn.json",
        [
            shape(SQUARE, group_id=3),
            shape(right, kind=None, group_id=3),
            shape([[60, 40], [67, 44]], kind="mask", mask=coded),
        ],
    )
    ids = read_masks(tmp_path).ids["000004"]
    expected = np.zeros((H, W), np.uint16)
    expected[10:20, 10:20] = expected[10:20, 30:34] = 1
    expected[40:45, 60:68] = 2
    np.testing.assert_array_equal(ids, expected)


@pytest.mark.parametrize(
    ("shapes", "words"),
    [
        ([shape([[1, 1], [5, 5]], kind="rectangle")], "rectangle, not an outline"),
        ([shape(SQUARE[:2])], "2 corners"),
        ([shape([[1, 1], [5, 5]], kind="mask", mask="@@")], "damaged"),
        ([shape([[1, 1], [5, 5]], kind="mask", mask="AAAA")], "damaged"),
        ([shape([[1, 1], [5, 5]], kind="mask")], "not a whole Labelme"),
        ([3], "not a whole Labelme"),
    ],
)
def test_shapes_that_are_no_mask_are_refused(tmp_path: Path, shapes: list, words: str) -> None:
    with pytest.raises(BadInput, match=rf"a\.json.*{words}"):
        read_masks(labelme(tmp_path / "a.json", shapes))


def test_a_mask_that_reaches_out_of_its_image_is_refused(tmp_path: Path) -> None:
    coded = base64.b64encode(cv2.imencode(".png", np.full((5, 8), 255, np.uint8))[1].tobytes()).decode()
    path = labelme(tmp_path / "a.json", [shape([[95, 40], [102, 44]], kind="mask", mask=coded)])
    with pytest.raises(BadInput, match="reaches out"):
        read_masks(path)


def test_an_image_annotated_twice_is_refused(tmp_path: Path) -> None:
    for name in ("a.json", "b.json"):
        labelme(tmp_path / name, [shape(SQUARE)])
    with pytest.raises(BadInput, match=r"b\.json annotates 000004"):
        read_masks(tmp_path)


def test_other_json_files_beside_png_masks_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "frames.json").write_text("{}")
    with pytest.raises(MissingInput, match="holds no masks"):
        read_masks(tmp_path)
    with pytest.raises(BadInput, match="neither COCO nor Labelme"):
        read_masks(tmp_path / "frames.json")
    (tmp_path / "empty.json").write_text("")
    with pytest.raises(BadInput, match=r"empty\.json is empty"):
        read_masks(tmp_path)


def test_points_and_boxes_from_a_table(tmp_path: Path) -> None:
    table = tmp_path / "clicks.csv"
    table.write_text("image,x,y\nframes/000004.jpg,3,4.5\n000004,7,8\n000005,1,2\n", encoding="utf-8-sig")
    points = read_prompts(table)
    np.testing.assert_array_equal(points["000004"], [[3, 4.5], [7, 8]])
    table.write_text("x1,y1,x2,y2,image\n1,2,3,4,000004.png\n")
    np.testing.assert_array_equal(read_prompts(table)["000004"], [[1, 2, 3, 4]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("image,a,b\n1,2,3\n", "needs the columns"),
        ("", "holds no prompt"),
        ("image,x,y\n", "holds no prompt"),
        ("image,x,y\n000004,1\n", "row 2.*not a point"),
        ("image,x,y\n000004,one,2\n", "row 2, column x: 'one' is not a number"),
        ("image,x,y\n000004,nan,2\n", "row 2.*not a point"),
        ("image,x1,y1,x2,y2\n000004,5,5,2,9\n", "row 2.*not a box"),
    ],
)
def test_tables_that_are_no_prompts_are_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "clicks.csv").write_text(text)
    with pytest.raises(BadInput, match=words):
        read_prompts(tmp_path / "clicks.csv")
    with pytest.raises(MissingInput, match="--prompts"):
        read_prompts(tmp_path / "absent.csv")
