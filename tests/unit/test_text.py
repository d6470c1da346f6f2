# SPDX-License-Identifier: Apache-2.0
"""Text in the encodings in which editors and spreadsheets of all countries save it."""

from __future__ import annotations

import codecs
from pathlib import Path

import pytest

from cotton3dg.choices import read_toml
from cotton3dg.errors import BadInput, BadUsage
from cotton3dg.field.study import read_study
from cotton3dg.schemas.corrections import Correction, Corrections, Place
from cotton3dg.text import decode_text, read_text

TEXT = "Größe 鲁棉 °C\n"


@pytest.mark.parametrize(
    "content",
    [
        TEXT.encode(),
        TEXT.encode("utf-8-sig"),
        codecs.BOM_UTF16_LE + TEXT.encode("utf-16-le"),
        codecs.BOM_UTF16_BE + TEXT.encode("utf-16-be"),
        codecs.BOM_UTF32_LE + TEXT.encode("utf-32-le"),
    ],
)
def test_a_mark_says_the_encoding(content: bytes) -> None:
    assert decode_text(content, "a.txt") == TEXT


def test_line_ends_of_all_systems_are_one(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes(b"a\r\nb\rc\n")
    assert read_text(tmp_path / "a.txt") == "a\nb\nc\n"


@pytest.mark.parametrize("text", ["Größe", "Weiß; Öl", "épi, créée", "20 °C", "cápsula"])
def test_older_latin_text_is_read_where_all_code_pages_agree(text: str) -> None:
    assert decode_text(text.encode("cp1252"), "a.txt") == text


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        ("鲁棉研28号", "gbk"),
        ("棉花A株", "big5"),
        ("コットン", "shift-jis"),
        ("목화", "cp949"),
        ("Сорт", "cp1251"),
        ("μέγεθος", "cp1253"),
        ("Ścieżka", "cp1250"),
        ("algodão", "cp1252"),  # "algodăo" in Romania
        ("Größe", "mac-roman"),
        ("Größe", "cp850"),
        ("UTF-16 without its mark", "utf-16-le"),
    ],
)
def test_what_could_be_something_else_is_refused(text: str, encoding: str) -> None:
    with pytest.raises(BadInput, match=r"^a\.txt.* UTF-8 text$"):
        decode_text(f"plain\n{text}\n".encode(encoding), "a.txt")


def test_the_line_is_named() -> None:
    with pytest.raises(BadInput, match=r"a\.txt, line 3, is not in UTF-8; save the file as UTF-8"):
        decode_text("a\r\nb\r\n鲁棉".encode("gbk"), "a.txt")


def test_toml_files_may_have_a_mark(tmp_path: Path) -> None:
    """Notepad puts one in front of UTF-8; the first line was an "Invalid statement"."""
    (tmp_path / "cotton3dg.toml").write_bytes(codecs.BOM_UTF8 + b"[frames]\r\ncount = 60\r\n")
    assert read_toml(tmp_path / "cotton3dg.toml") == {"frames": {"count": 60}}
    (tmp_path / "study.toml").write_text("[Study]\nDM-5 = 'Größe'\n", encoding="utf-16")
    assert read_study(tmp_path).get("Study", "DM-5") == "Größe"
    (tmp_path / "cotton3dg.toml").write_bytes('[traits]\nplant_id = "鲁棉"\n'.encode("gbk"))
    with pytest.raises(BadUsage, match=r"cotton3dg\.toml, line 2, is not in UTF-8"):
        read_toml(tmp_path / "cotton3dg.toml")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_corrections_that_an_editor_saved_are_read(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "corrections.json"
    path.write_text('{\r\n "corrections": [{"kind": "delete", "bolls": [{"boll_id": 3}]}]\r\n}', encoding=encoding)
    assert Corrections.load(path) == Corrections((Correction("delete", (Place(3),)),))
    path.write_bytes('{"corrections": [], "note": "棉铃"}'.encode("gbk"))
    with pytest.raises(BadInput, match=r"corrections\.json, line 1, is not in UTF-8"):
        Corrections.load(path)
