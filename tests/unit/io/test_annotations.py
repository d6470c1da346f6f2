# SPDX-License-Identifier: Apache-2.0
"""Imported masks: PNG folders, COCO polygons and run lengths, damaged files, sizes and distortion."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from scenes.lint_scene import orbit_cameras

from cotton3dg.errors import BadInput, MissingInput
from cotton3dg.io.annotations import read_masks, undistort_ids
from cotton3dg.io.coco import decompress_counts, fill_segmentation
from cotton3dg.io.images import write_ids

H, W = 12, 20
SQUARE = [[3, 2, 9, 2, 9, 8, 3, 8]]


def coco(path: Path, segmentations: list, *, file_name: str = "frames/000003.jpg", **changes) -> Path:
    document = {
        "images": [{"id": 7, "file_name": file_name, "height": H, "width": W}],
        "annotations": [
            {"id": i, "image_id": 7, "category_id": 1, "segmentation": s, "score": 0.5 + i / 10}
            for i, s in enumerate(segmentations)
        ],
        "categories": [],
    }
    path.write_text(json.dumps(document | changes))
    return path


def compressed(counts: list[int]) -> str:
    """COCO's encoder, as in maskApi.c."""
    text = ""
    for i, count in enumerate(counts):
        x = count - (counts[i - 2] if i > 2 else 0)
        more = True
        while more:
            bits = x & 0x1F
            x >>= 5
            more = x != -1 if bits & 0x10 else x != 0
            text += chr((bits | 0x20 if more else bits) + 48)
    return text


def test_polygons_cover_the_pixels_between_their_corners(tmp_path: Path) -> None:
    masks = read_masks(coco(tmp_path / "a.json", [SQUARE]))
    ids = masks.ids["000003"]
    assert ids.shape == (H, W) and ids.dtype == np.uint16
    assert (ids[2:8, 3:9] == 1).all()
    assert (ids > 0).sum() == 6 * 6
    assert masks.scores == {"000003": {1: 0.5}}


def test_the_smaller_of_two_overlapping_instances_is_in_front(tmp_path: Path) -> None:
    inner = [[4, 3, 6, 3, 6, 5, 4, 5]]
    for order in ([SQUARE, inner], [inner, SQUARE]):
        ids = read_masks(coco(tmp_path / "a.json", order)).ids["000003"]
        assert ids[4, 5] == 1 + order.index(inner) and ids[7, 8] == 1 + order.index(SQUARE)


def test_plain_and_compressed_run_lengths_go_down_the_columns() -> None:
    counts = [1, 2, 3, 4, H * W - 10]
    expected = np.zeros(H * W, bool)
    expected[1:3] = expected[6:10] = True
    for form in (counts, compressed(counts)):
        mask = np.zeros(H * W, bool)
        mask[fill_segmentation({"size": [H, W], "counts": form}, H, W)] = True
        np.testing.assert_array_equal(mask.reshape(H, W).ravel(order="F"), expected)


def test_a_compressed_string_worked_out_by_hand() -> None:
    # Rows 1-3 of columns 1-2 of a 5 x 4 mask: runs 6 3 2 3 6; the last two are written as 3 - 3 and 6 - 2.
    expected = np.zeros((5, 4), bool)
    expected[1:4, 1:3] = True
    pixels = fill_segmentation({"size": [5, 4], "counts": "63204"}, 5, 4)
    np.testing.assert_array_equal(pixels, np.flatnonzero(expected))


@given(st.lists(st.integers(0, 5000), min_size=1, max_size=30))
@settings(max_examples=200, deadline=None)
def test_compressed_counts_come_back(counts: list[int]) -> None:
    assert decompress_counts(compressed(counts)) == counts


def test_a_folder_of_masks(tmp_path: Path) -> None:
    ids = np.zeros((H, W), np.uint16)
    ids[3:6, 3:6] = 300
    write_ids(tmp_path / "000001.png", ids)
    np.testing.assert_array_equal(read_masks(tmp_path).ids["000001"], ids)


def disks() -> np.ndarray:
    """(60, 100) ids of two bolls apart and one of two that touch."""
    y, x = np.mgrid[:60, :100]
    ids = np.zeros((60, 100), np.uint16)
    for number, (at_x, at_y) in enumerate([(15, 15), (50, 40), (85, 20)], 1):
        ids[(x - at_x) ** 2 + (y - at_y) ** 2 < 81] = number
    return ids


def write_png(path: Path, pixels: np.ndarray) -> None:
    path.write_bytes(cv2.imencode(".png", pixels)[1].tobytes())


def test_white_on_black_is_told_apart_by_pieces(tmp_path: Path) -> None:
    """All bolls of an image were one, and no word was said."""
    white = (disks() > 0).astype(np.uint8)
    smoothed = cv2.GaussianBlur(255 * white, (0, 0), 0.8)
    for pixels in (255 * white, white, 65535 * white.astype(np.uint16), smoothed, cv2.merge([255 * white] * 3)):
        write_png(tmp_path / "a.png", pixels)
        write_png(tmp_path / "b.png", 0 * pixels)
        found = read_masks(tmp_path)
        assert np.array_equal(np.unique(found.ids["a"]), [0, 1, 2, 3])
        assert abs(np.count_nonzero(found.ids["a"]) - white.sum()) < 20
        assert not found.ids["b"].any()
        assert "each connected piece counts as a boll" in found.notes[0]


def test_ids_are_taken_as_they_are(tmp_path: Path) -> None:
    ids = disks()
    ids[0, 0] = 3  # a boll in two pieces
    write_ids(tmp_path / "a.png", ids)
    write_ids(tmp_path / "b.png", np.where(ids == 1, ids, np.uint16(0)))
    found = read_masks(tmp_path)
    assert np.array_equal(found.ids["a"], ids)
    assert found.notes == ()


def test_a_colour_an_object(tmp_path: Path) -> None:
    ids = disks()
    colours = np.array([[0, 0, 0], [0, 0, 128], [0, 128, 0], [60, 20, 220]], np.uint8)[ids]
    write_png(tmp_path / "a.png", colours)
    palette = Image.fromarray(ids.astype(np.uint8), "P")
    palette.putpalette([0, 0, 0, 128, 0, 0, 0, 128, 0, 220, 20, 60])
    palette.save(tmp_path / "b.png")
    for name in ("a", "b"):
        found = read_masks(tmp_path).ids[name]
        assert [len(np.unique(found[ids == number])) for number in range(4)] == [1, 1, 1, 1]
        assert len(np.unique(found)) == 4 and not found[ids == 0].any()


def test_what_is_transparent_is_no_object(tmp_path: Path) -> None:
    """Colours go on below what an editor erased."""
    ids = disks()
    colours = np.array([[7, 7, 7], [0, 0, 128], [0, 128, 0], [60, 20, 220]], np.uint8)[ids]
    write_png(tmp_path / "a.png", np.dstack([colours, np.where((ids == 1) | (ids == 2), 255, 0).astype(np.uint8)]))
    found = read_masks(tmp_path).ids["a"]
    assert len(np.unique(found)) == 3 and not found[(ids == 0) | (ids == 3)].any()


def test_photos_and_smoothed_ids_are_no_masks(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    smoothed = cv2.GaussianBlur((40 * disks()).astype(np.uint8), (0, 0), 1.5)
    for pixels in (
        rng.integers(0, 255, (90, 120, 3), np.uint8),
        rng.integers(0, 60000, (90, 120), np.uint16),
        smoothed,
    ):
        write_png(tmp_path / "a.png", pixels)
        with pytest.raises(BadInput, match=r"a\.png .*smooth"):
            read_masks(tmp_path)


def test_instances_without_an_outline_are_counted(tmp_path: Path) -> None:
    """Boxes of COCO have an empty segmentation, or none."""
    found = read_masks(coco(tmp_path / "a.json", [SQUARE, [], []]))
    assert found.notes == ("2 of 3 instances of a.json have no outline and are left out; draw theirs too",)
    assert np.unique(found.ids["000003"]).tolist() == [0, 1]
    boxes = [{"id": 1, "image_id": 7, "category_id": 1, "bbox": [1, 1, 5, 5]}]
    with pytest.raises(BadInput, match=r"a\.json: none of 1 instances has an outline"):
        read_masks(coco(tmp_path / "a.json", [], annotations=boxes))


def test_files_that_systems_leave_beside_annotations_are_no_annotations(tmp_path: Path) -> None:
    coco(tmp_path / "bolls.JSON", [SQUARE], file_name="a.jpg")
    (tmp_path / "__MACOSX").mkdir()
    for name in ("._bolls.JSON", "__MACOSX/._bolls.json", "__MACOSX/bolls.json"):
        (tmp_path / name).write_bytes(b"\x00\x05\x16\x07")
    assert set(read_masks(tmp_path).ids) == {"a"}
    (tmp_path / "bolls.JSON").unlink()
    write_ids(tmp_path / "b.png", disks())
    (tmp_path / "._b.png").write_bytes(b"\x00\x05\x16\x07")
    assert set(read_masks(tmp_path).ids) == {"b"}


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_annotations_may_have_a_mark(tmp_path: Path, encoding: str) -> None:
    path = coco(tmp_path / "a.json", [SQUARE])
    path.write_text(path.read_text(), encoding=encoding)
    assert set(read_masks(path).ids) == {"000003"}


def test_a_folder_with_one_coco_file(tmp_path: Path) -> None:
    coco(tmp_path / "bolls.json", [SQUARE])
    assert set(read_masks(tmp_path).ids) == {"000003"}


def test_nothing_to_import_is_said_plainly(tmp_path: Path) -> None:
    with pytest.raises(MissingInput, match="is not there; give a folder of masks"):
        read_masks(tmp_path / "absent")
    with pytest.raises(MissingInput, match="holds no masks"):
        read_masks(tmp_path)


@pytest.mark.parametrize("content", ["", "[]", "{}", "null", "[" * 100_000, '{"images": 3, "annotations": []}', "\xff"])
def test_what_is_no_coco_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "a.json"
    path.write_bytes(content.encode("latin-1"))
    with pytest.raises(BadInput, match=r"a\.json"):
        read_masks(path)


@pytest.mark.parametrize(
    "segmentation",
    [
        3,
        [[1, 2, 3]],
        [[1, 2, 3, 4]],
        [["a", "b"]],
        [[float("nan"), 1, 2, 2, 3, 1]],
        [[1e300, 1, 2, 2, 3, 1]],
        {"size": [H, W], "counts": [1, 2]},
        {"size": [H, W], "counts": [-1, H * W + 1]},
        {"size": [H, W], "counts": [2**62, 2**62, 2**62, 2**62, H * W]},
        {"size": [W, H], "counts": [H * W]},
        {"size": [H, W], "counts": "~~~~"},
        {"size": [H, W], "counts": "P"},
        {"size": [H, W], "counts": "é"},
        {"size": [H], "counts": [H * W]},
        {"counts": [H * W]},
    ],
)
def test_damaged_instances_are_refused(tmp_path: Path, segmentation) -> None:
    with pytest.raises(BadInput, match=r"a\.json"):
        read_masks(coco(tmp_path / "a.json", [segmentation]))


@pytest.mark.parametrize("size", [(0, 5), (-1, -5), (10**6, 10**6)])
def test_absurd_sizes_are_refused_before_memory_is_taken(tmp_path: Path, size: tuple[int, int]) -> None:
    images = [{"id": 7, "file_name": "a.jpg", "height": size[0], "width": size[1]}]
    with pytest.raises(BadInput, match=r"a\.json"):
        read_masks(coco(tmp_path / "a.json", [], images=images))


def test_annotations_of_an_image_that_is_not_listed_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"a\.json"):
        read_masks(coco(tmp_path / "a.json", [SQUARE], images=[]))


def write_filmed_model(folder: Path, k: float) -> None:
    """A COLMAP model of one frame with radial distortion, 500 x 290 px around the centre of the undistorted image."""
    import pycolmap

    view = orbit_cameras(4)[0]
    model = pycolmap.Reconstruction()
    parameters = [view.fx, 250.0, 145.0, k]
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(model="SIMPLE_RADIAL", width=500, height=290, params=parameters, camera_id=1)
    )
    image = pycolmap.Image(name=view.name, camera_id=1, image_id=1)
    model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(view.cam_from_scene))
    folder.mkdir()
    model.write_binary(str(folder))


def test_distortion_is_taken_out_of_masks_drawn_on_frames(tmp_path: Path) -> None:
    write_filmed_model(tmp_path / "sfm", -0.2)
    camera = orbit_cameras(4)[0]
    # A pixel far from the centre, and where the lens puts what it shows.
    x, y = 430, 40
    ray = np.array([(x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy])
    filmed = camera.fx * ray * (1 - 0.2 * (ray @ ray)) + (250, 145)
    ids = np.zeros((290, 500), np.uint16)
    ids[int(filmed[1]), int(filmed[0])] = 5
    undistorted = undistort_ids("a", ids, camera, tmp_path / "sfm")
    assert undistorted.shape == (camera.height, camera.width)
    assert undistorted[y, x] == 5
    assert (undistorted > 0).sum() <= 4


def test_masks_of_the_same_shape_are_scaled_and_others_refused(tmp_path: Path) -> None:
    write_filmed_model(tmp_path / "sfm", 0.0)
    camera = orbit_cameras(4)[0]
    ids = np.arange(camera.height // 2 * (camera.width // 2), dtype=np.uint16).reshape(camera.height // 2, -1)
    scaled = undistort_ids("a", ids, camera, tmp_path / "sfm")
    np.testing.assert_array_equal(scaled, ids.repeat(2, 0).repeat(2, 1))
    np.testing.assert_array_equal(undistort_ids("a", scaled, camera, tmp_path / "absent"), scaled)
    with pytest.raises(BadInput, match="100 x 100"):
        undistort_ids("a", np.zeros((100, 100), np.uint16), camera, tmp_path / "sfm")
