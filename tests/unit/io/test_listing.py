# SPDX-License-Identifier: Apache-2.0
"""What a person put into a folder, without what systems leave there."""

from __future__ import annotations

from pathlib import Path

from cotton3dg.io.listing import files_below, files_in, folders_in

LEFT_BEHIND = ("._a.json", ".DS_Store", "Thumbs.db", "desktop.ini", "__MACOSX/._a.json", "@eaDir/a.json/thumb.json")


def make(folder: Path, *names: str) -> None:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x", encoding="utf-8")


def test_what_systems_leave_in_folders_is_left_out(tmp_path: Path) -> None:
    make(tmp_path, "b.JSON", "a.json", "deep/er/c.json", "deep/__MACOSX/c.json", *LEFT_BEHIND)
    (tmp_path / "d.json").mkdir()
    assert [path.name for path in files_in(tmp_path)] == ["a.json", "b.JSON"]
    assert [path.name for path in files_below(tmp_path, [".json"])] == ["a.json", "b.JSON", "c.json"]
    assert [path.name for path in folders_in(tmp_path)] == ["d.json", "deep"]


def test_only_files_with_a_suffix_are_given(tmp_path: Path) -> None:
    make(tmp_path, "a.json", "a.txt", "deep/b.TXT")
    assert [path.name for path in files_in(tmp_path, [".txt"])] == ["a.txt"]
    assert [path.name for path in files_below(tmp_path, [".txt"])] == ["a.txt", "b.TXT"]
