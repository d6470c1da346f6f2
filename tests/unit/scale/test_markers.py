# SPDX-License-Identifier: Apache-2.0
"""Printed markers in rendered photos, on paper, and what is refused."""

import zlib

import cv2
import numpy as np
import pytest
from scenes.marker_scene import board_picture, photo_of_top, top_picture
from scenes.table_scene import POSE, orbit

from cotton3dg.commands.markers import print_markers
from cotton3dg.errors import BadUsage
from cotton3dg.io.sheet import CM_PER_POINT, pdf_of, write_sheet
from cotton3dg.options import MarkersOptions
from cotton3dg.scale.markers import (
    MarkerFit,
    MarkerKind,
    board_squares,
    charuco_board,
    draw_crosses,
    draw_sheet,
    find_markers,
    scale_from_markers,
)
from cotton3dg.scale.references import NoReference

CAMERAS = orbit(12, 1280, 720)
KIND = MarkerKind("4x4_50", 12.0)
PLACES = {0: (-46, 10, 0.1), 1: (46, -12, -0.2), 2: (-46, -14, 0.05)}


@pytest.fixture(scope="module")
def photos():
    top = top_picture(PLACES)
    return [photo_of_top(camera, top) for camera in CAMERAS]


@pytest.fixture(scope="module")
def found(photos):
    return [find_markers(photo, KIND) for photo in photos]


def test_markers_give_the_scale_to_three_parts_in_a_thousand(found):
    fit = scale_from_markers(CAMERAS, found, KIND)
    assert isinstance(fit, MarkerFit)
    assert fit.reference.cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.003)
    assert 0.001 <= fit.reference.relative_error < 0.006
    assert fit.reference.evidence["residual_px"] < 0.5
    first = POSE.cm(fit.sightings["marker", 0, 0].point[None])[0]
    cos, sin = np.cos(0.1), np.sin(0.1)
    assert first == pytest.approx([-46 - 6 * cos - 6 * sin, 10 + 6 * cos - 6 * sin, 0], abs=0.15)


def test_a_wrong_size_gives_a_wrong_scale_in_proportion(found):
    fit = scale_from_markers(CAMERAS, found, MarkerKind("4x4_50", 6.0))
    assert fit.reference.cm_per_su == pytest.approx(0.5 * POSE.cm_per_su, rel=0.003)


def test_a_partly_hidden_marker_is_left_out(photos):
    """A finger over a corner of marker 0 in every photo: it cannot be read, the others still give the scale."""
    hidden = []
    corner_cm = np.array([[-46 + 6, 10 - 6, 0.0]])
    for camera, photo in zip(CAMERAS, photos, strict=True):
        (place,), _ = camera.project(POSE.scene(corner_cm))
        covered = cv2.ellipse(photo.copy(), (int(place[0]), int(place[1])), (26, 14), 0, 0, 360, (190, 150, 130), -1)
        hidden.append(find_markers(covered, KIND))
    fit = scale_from_markers(CAMERAS, hidden, KIND)
    assert fit.reference.evidence["markers"] == [1, 2]
    assert fit.reference.cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.004)


def test_slips_of_single_views_are_left_out(found):
    """One photo in which a marker is misread moves nothing."""
    rng = np.random.default_rng(0)
    spoilt = [dict(corners) for corners in found]
    spoilt[2] = {corner: place + rng.normal(0, 30, 2) for corner, place in spoilt[2].items()}
    fit = scale_from_markers(CAMERAS, spoilt, KIND)
    assert fit.reference.cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.003)


def test_a_board_gives_the_scale():
    kind = MarkerKind("4x4_50", 10.0, (3, 4))
    top = board_picture(charuco_board(kind), 3, 4, 10.0)
    found = [find_markers(photo_of_top(camera, top), kind) for camera in CAMERAS]
    fit = scale_from_markers(CAMERAS, found, kind)
    assert isinstance(fit, MarkerFit)
    assert len(fit.sightings) == 6
    assert fit.reference.cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.003)


def test_poor_evidence_is_refused(found):
    assert scale_from_markers(CAMERAS, [{} for _ in CAMERAS], KIND) == NoReference("no photo shows a marker")
    few = [corners if number < 4 else {} for number, corners in enumerate(found)]
    assert "6 photos" in scale_from_markers(CAMERAS, few, KIND).reason
    rng = np.random.default_rng(0)
    wild = [{corner: place + rng.normal(0, 40, 2) for corner, place in corners.items()} for corners in found]
    assert isinstance(scale_from_markers(CAMERAS, wild, KIND), NoReference)


def test_an_empty_photo_has_no_markers():
    assert find_markers(np.full((90, 160, 3), 128, np.uint8), KIND) == {}
    assert find_markers(np.full((90, 160, 3), 128, np.uint8), MarkerKind("4x4_50", 5.0, (3, 4))) == {}


def test_crosses_lie_on_the_corners(photos, found):
    fit = scale_from_markers(CAMERAS, found, KIND)
    points = np.array([sighting.point for sighting in fit.sightings.values()])
    drawn = draw_crosses(photos[0], CAMERAS[0], points)
    changed = np.argwhere((drawn != photos[0]).any(-1))[:, ::-1]
    pixels, _ = CAMERAS[0].project(points)
    inside = ((pixels > 0) & (pixels < (1280, 720))).all(axis=1)
    assert inside.any()
    for pixel in pixels[inside]:
        assert np.linalg.norm(changed + 0.5 - pixel, axis=1).min() < 1.5


def test_the_sheet_is_true_to_scale_and_can_be_read():
    sheet = draw_sheet(MarkerKind("5x5_100", 9.0), 21.0, 29.7, 100, first_id=3)
    assert sheet.shape == (2970, 2100)
    quads, ids, _ = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    ).detectMarkers(sheet)  # fmt: skip
    assert sorted(ids.ravel().tolist()) == [3, 4]
    for quad in quads:
        sides = np.linalg.norm(np.roll(quad[0], -1, axis=0) - quad[0], axis=1)
        assert sides == pytest.approx(np.full(4, 899), abs=1.5)
    # The ruler: the lowest long dark line.
    dark = (sheet < 128).sum(axis=1)
    ruler = np.flatnonzero(dark == 1000)
    assert ruler.min() > 2700
    columns = np.flatnonzero(sheet[ruler[0]] < 128)
    assert columns[-1] - columns[0] + 1 == 1000


def test_the_board_on_the_sheet_can_be_read():
    kind = MarkerKind("4x4_50", 6.0, (3, 4))
    sheet = draw_sheet(kind, 21.0, 29.7, 50)
    corners = find_markers(np.repeat(sheet[..., None], 3, axis=2), kind)
    assert len(corners) == 6
    assert np.linalg.norm(corners["board", 0, 1] - corners["board", 0, 0]) == pytest.approx(300, abs=0.5)


def test_pdf_and_png_say_their_size(tmp_path):
    sheet = np.arange(200, dtype=np.uint8).reshape(10, 20)
    pdf = pdf_of([sheet], 10)
    assert f"[0 0 {2 / CM_PER_POINT:.4f} {1 / CM_PER_POINT:.4f}]".encode() in pdf
    start = pdf.index(b"stream\n", pdf.index(b"/XObject/Subtype/Image")) + 7
    assert zlib.decompress(pdf[start : pdf.index(b"\nendstream", start)]) == sheet.tobytes()
    table = int(pdf.split(b"startxref\n")[1].split(b"\n")[0])
    assert pdf[table : table + 4] == b"xref"
    for number, line in enumerate(pdf[table:].splitlines()[3:8], 1):
        assert pdf[int(line[:10]) :].startswith(f"{number} 0 obj".encode())
    write_sheet(tmp_path / "sheet", sheet, 10, pdf=False)
    png = (tmp_path / "sheet").read_bytes()
    assert (cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED) == sheet).all()
    assert png[png.index(b"pHYs") + 4 :][:8] == (1000).to_bytes(4, "big") * 2


def test_the_command_writes_the_sheet_and_refuses_what_does_not_fit(tmp_path):
    said = print_markers(tmp_path / "new" / "sheet.pdf", MarkersOptions())
    assert (tmp_path / "new" / "sheet.pdf").read_bytes().startswith(b"%PDF")
    assert "scale.marker_cm=10" in said
    with pytest.raises(BadUsage, match=r"\.pdf"):
        print_markers(tmp_path / "sheet.txt", MarkersOptions())
    with pytest.raises(BadUsage, match="--paper"):
        print_markers(tmp_path / "sheet.pdf", MarkersOptions(marker_cm=25.0))
    with pytest.raises(BadUsage, match="COLUMNSxROWS"):
        board_squares("4by5")
    assert board_squares("4x5") == (4, 5)
