# SPDX-License-Identifier: Apache-2.0
"""Cards on paper: what is printed where, for whom, and that the card alone gives the scale."""

import re
import zlib
from pathlib import Path

import cv2
import matplotlib
import numpy as np
import pytest
from scenes.card_scene import DOTS, PAPER_CM, card_sheet
from scenes.marker_scene import DOTS_PER_CM, LENGTH_CM, WIDTH_CM, photo_of_top
from scenes.table_scene import POSE, orbit

from cotton3dg.commands.cards import print_cards
from cotton3dg.core.card import MARKERS_CM, marker_corner_cm
from cotton3dg.errors import BadInput, BadUsage
from cotton3dg.identity import fonts
from cotton3dg.identity.codes import read_codes
from cotton3dg.identity.names import card_id
from cotton3dg.options import CardsOptions
from cotton3dg.scale.card import CARD_MARKERS, scale_from_card
from cotton3dg.scale.markers import MarkerFit, MarkerKind, find_markers
from cotton3dg.scale.references import NoReference


def pages_of(pdf: bytes) -> list[np.ndarray]:
    """The pictures of the pages."""
    found = []
    for image in re.finditer(rb"/Subtype/Image/Width (\d+)/Height (\d+).*?stream\n(.*?)\nendstream", pdf, re.S):
        width, height = int(image[1]), int(image[2])
        found.append(np.frombuffer(zlib.decompress(image[3]), np.uint8).reshape(height, width))
    return found


@pytest.fixture
def fonts_of_matplotlib(monkeypatch):
    """A machine without fonts of its own."""
    folder = Path(matplotlib.get_data_path()) / "fonts/ttf"
    monkeypatch.setattr(fonts, "_fonts", lambda: [folder / "DejaVuSans.ttf", folder / "STIXGeneral.ttf"])
    fonts._font_file.cache_clear()
    yield folder
    fonts._font_file.cache_clear()


def test_a_font_that_has_the_letters_is_found(fonts_of_matplotlib):
    assert Path(fonts.font("Größe Ж", 20).path).name == "DejaVuSans.ttf"
    assert Path(fonts.font("\u1d81 1", 20).path).name == "STIXGeneral.ttf"
    assert fonts.unprintable(["A1", "\u1d81", "棉1", "क1"]) == ["棉1", "क1"]


def test_ids_that_no_font_of_the_machine_has_are_named(tmp_path, fonts_of_matplotlib):
    """Boxes were printed, and not a word said."""
    (tmp_path / "book.csv").write_text("plant_id,genotype\n棉1,x\nA2,y\n", encoding="utf-8")
    told = print_cards(tmp_path / "book.csv", tmp_path / "cards.pdf", CardsOptions())
    assert "no font of this machine has the letters of 棉1, so boxes stand" in told
    assert "fonts-noto-cjk" in told
    pages = pages_of((tmp_path / "cards.pdf").read_bytes())
    assert [[card_id(text) for text in read_codes(page)] for page in pages] == [["棉1"], ["A2"]]
    (tmp_path / "book.csv").write_text("plant_id,genotype\nA1,x\n", encoding="utf-8")
    assert "warning" not in print_cards(tmp_path / "book.csv", tmp_path / "cards.pdf", CardsOptions())


@pytest.mark.parametrize("paper", ["a4", "letter"])
def test_each_row_of_a_field_book_has_a_card(tmp_path, paper):
    (tmp_path / "book.csv").write_text("plant_id,genotype\nA-1,Größe\nB/2,x\n")
    told = print_cards(tmp_path / "book.csv", tmp_path / "new" / "cards.pdf", CardsOptions(paper=paper))
    assert "2 cards" in told
    pdf = (tmp_path / "new" / "cards.pdf").read_bytes()
    pages = pages_of(pdf)
    assert [[card_id(text) for text in read_codes(page)] for page in pages] == [["A-1"], ["B/2"]]
    size_pt = {"a4": b"[0 0 595.2756 841.8898]", "letter": b"[0 0 612.0000 792.0000]"}[paper]
    assert pdf.count(size_pt) == 2
    # White paper all around, and four markers that are true to size.
    for page in pages:
        assert page[:60].min() == page[-60:].min() == page[:, :60].min() == page[:, -60:].min() == 255
    corners = find_markers(np.repeat(pages[0][..., None], 3, axis=2), CARD_MARKERS)
    assert {corner[1] for corner in corners} == set(MARKERS_CM)
    for (_, number, corner), place in corners.items():
        first = corners["marker", 96, 0]
        away = np.array(marker_corner_cm(number, corner)) - marker_corner_cm(96, 0)
        assert place - first == pytest.approx(100 * away, abs=1.0)


def test_blank_cards_are_numbered(tmp_path):
    print_cards(None, tmp_path / "cards.pdf", CardsOptions(blank=2, first=7))
    pages = pages_of((tmp_path / "cards.pdf").read_bytes())
    assert [card_id(read_codes(page)[0]) for page in pages] == ["card-0007", "card-0008"]


def test_what_cannot_be_printed_is_told(tmp_path):
    (tmp_path / "book.csv").write_text("plant_id,genotype\nA\tB,x\n")
    for book, name, options, error, words in (
        (None, "cards.png", CardsOptions(blank=1), BadUsage, "not .pdf"),
        (None, "cards.pdf", CardsOptions(), BadUsage, "--blank"),
        (tmp_path / "book.csv", "cards.pdf", CardsOptions(), BadInput, "cannot be printed"),
        (tmp_path / "book.csv", "cards.pdf", CardsOptions(columns="plot"), BadUsage, "no column 'plot'"),
    ):
        with pytest.raises(error, match=words):
            print_cards(book, tmp_path / name, options)


def top_with_card(x_cm: float, y_cm: float, turn: float) -> np.ndarray:
    """(H, W) linear light of a table top on which a card lies."""
    d = DOTS_PER_CM
    picture = np.full((round(WIDTH_CM * d), round(LENGTH_CM * d)), 0.25, np.float32)
    sheet = card_sheet("plant_017").astype(np.float32) / 255
    paper = 0.04 + 0.8 * cv2.resize(
        sheet, (round(PAPER_CM[0] * d), round(PAPER_CM[1] * d)), interpolation=cv2.INTER_AREA
    )
    cos, sin = np.cos(turn), np.sin(turn)
    linear = np.array([[cos, sin], [-sin, cos]])
    middle = np.array([(x_cm + LENGTH_CM / 2) * d, (WIDTH_CM / 2 - y_cm) * d]) - 0.5
    shift = middle - linear @ ((np.array(paper.shape[::-1]) - 1) / 2)
    warp, where = np.column_stack([linear, shift]), (picture.shape[1], picture.shape[0])
    inside = cv2.warpAffine(np.ones_like(paper), warp, where)
    return picture * (1 - inside) + cv2.warpAffine(paper, warp, where)


def test_the_card_alone_gives_the_scale_to_half_a_percent():
    assert DOTS > DOTS_PER_CM
    cameras = orbit(16, 1280, 720)
    top = top_with_card(-42.0, 2.0, 0.3)
    photos = [photo_of_top(camera, top) for camera in cameras]
    found = [find_markers(photo, CARD_MARKERS) for photo in photos]
    fit = scale_from_card(cameras, found)
    assert isinstance(fit, MarkerFit)
    assert fit.reference.source == "card"
    assert fit.reference.cm_per_su == pytest.approx(POSE.cm_per_su, rel=0.005)
    assert 0.001 <= fit.reference.relative_error < 0.005
    # A printer that shrank the page is allowed for.
    shrunk = scale_from_card(cameras, found, ruler_cm=9.7)
    assert shrunk.reference.cm_per_su == pytest.approx(0.97 * fit.reference.cm_per_su)
    # Loose markers of the usual kind are no card, and the card is none of them.
    assert find_markers(photos[0], MarkerKind("4x4_50", 4.8)) == {}
    loose = [{("marker", 0, k): place for k, place in enumerate(corners.values())} for corners in found]
    assert scale_from_card(cameras, loose) == NoReference("no photo shows a card")
