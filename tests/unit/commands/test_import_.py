# SPDX-License-Identifier: Apache-2.0
"""A phone's folder of unnamed videos: whose they are, what is in doubt, and that nothing is lost or replaced."""

import shutil

import numpy as np
import pytest
from scenes.card_scene import card_sheet, film_card

from cotton3dg.commands import import_ as module
from cotton3dg.commands.import_ import DOUBT, IMPORTED, LEFT_OUT, TABLE, THERE, Import, import_videos
from cotton3dg.errors import BadInput, BadUsage, MissingInput
from cotton3dg.io.encode import video_encoder
from cotton3dg.io.tables import read_rows
from cotton3dg.workspace import Workspace

BOOK = "plant_id,genotype\nA-1,x\nA-2,y\nB/3,z\nC-4,w\n"


@pytest.fixture(scope="module")
def filmed(tmp_path_factory):
    """DCIM folder as phones leave it."""
    folder = tmp_path_factory.mktemp("phone") / "DCIM"
    (folder / "100APPLE").mkdir(parents=True)
    small = {"n_frames": 12, "size": (640, 480)}
    film_card(folder / "100APPLE" / "VID_20261123_1.mp4", card_sheet("A-1", 20), seed=1, **small)
    film_card(folder / "100APPLE" / "VID_20261123_2.mp4", card_sheet("B/3", 20), seed=2, **small)
    film_card(folder / "VID_20261123_3.MOV", card_sheet("A-2", 20), seed=3, **small)
    film_card(folder / "VID_20261123_4.mp4", card_sheet("A-2", 20), seed=4, **small)
    film_card(folder / "VID_20261123_5.mp4", None, seed=5, **small)
    film_card(folder / "VID_20261123_6.mp4", card_sheet("Z-9", 20), seed=6, **small)
    shutil.copyfile(folder / "100APPLE" / "VID_20261123_1.mp4", folder / "copy of 1.mp4")
    (folder / "VID_20261123_7.mp4").write_bytes(b"\0" * 1000)
    (folder / ".trashed-1.mp4").write_bytes(b"")
    with video_encoder(folder / "IMG_0008.MOV", 64, 64, 10, 30) as write:
        for _ in range(25):
            write(np.zeros((64, 64, 3), np.uint8))
    (folder / "IMG_0008.HEIC").write_bytes(b"a photo")
    (folder / "GX010009.LRV").write_bytes(b"small")
    return folder


@pytest.fixture
def phone(filmed, tmp_path):
    shutil.copytree(filmed, tmp_path / "DCIM")
    (tmp_path / "book.csv").write_text(BOOK)
    return tmp_path


def of(rows):
    return {row.file.rpartition("/")[2]: row for row in rows}


def tree(folder):
    return {str(path.relative_to(folder)): path.stat().st_size for path in folder.rglob("*") if path.is_file()}


def test_a_phones_folder_becomes_plants_or_listed_doubts(phone):
    field, book = phone / "field", phone / "book.csv"
    before = tree(phone)
    planned = import_videos([phone / "DCIM"], Import(field, book, dry_run=True))
    assert tree(phone) == before  # a dry run changes nothing
    rows = of(import_videos([phone / "DCIM"], Import(field, book)))
    assert rows == of(planned)
    states = {name: row.state for name, row in rows.items()}
    assert states == {
        "VID_20261123_1.mp4": IMPORTED,
        "VID_20261123_2.mp4": IMPORTED,
        "VID_20261123_3.MOV": DOUBT,
        "VID_20261123_4.mp4": DOUBT,
        "VID_20261123_5.mp4": DOUBT,
        "VID_20261123_6.mp4": DOUBT,
        "VID_20261123_7.mp4": DOUBT,
        "copy of 1.mp4": LEFT_OUT,
        "IMG_0008.MOV": LEFT_OUT,
        "GX010009.LRV": LEFT_OUT,
    }
    assert rows["VID_20261123_1.mp4"].folder == "A-1"
    assert "VID_20261123_4.mp4 (A-2)" in rows["VID_20261123_3.MOV"].reason
    assert "no card was read" in rows["VID_20261123_5.mp4"].reason
    assert "Z-9, which is not in the field book" in rows["VID_20261123_6.mp4"].reason
    assert "not a video that can be read" in rows["VID_20261123_7.mp4"].reason
    assert "IMG_0008.HEIC" in rows["IMG_0008.MOV"].reason
    assert all(row.plant_id == "" for row in rows.values() if row.state == DOUBT)
    # The videos are where `run` looks for them, and the names where `run` finds them.
    assert Workspace(field / "A-1").capture().name == "VID_20261123_1.mp4"
    strange = next(path for path in field.iterdir() if path.name.startswith("B_3_"))
    assert 'plant_id = "B/3"' in (strange / "cotton3dg.toml").read_text()
    assert {path.name for path in field.iterdir() if path.is_dir()} == {"A-1", strange.name}
    assert (field / "fieldbook.csv").read_text().startswith("plant_id,genotype")
    assert tree(phone / "DCIM") == {name[5:]: size for name, size in before.items() if name.startswith("DCIM/")}
    assert (
        of([module.Row(**{k: row[k] for k in ("file", "state")}) for row in read_rows(field / TABLE)]).keys()
        == rows.keys()
    )


def test_it_goes_on_and_replaces_nothing(phone, monkeypatch):
    field, book = phone / "field", phone / "book.csv"
    import_videos([phone / "DCIM" / "100APPLE"], Import(field, book))
    (field / "A-1" / "notes.txt").write_text("mine")
    monkeypatch.setattr(module, "read_video", lambda path: pytest.fail(f"{path} is read again"))
    before = tree(field)
    rows = import_videos([phone / "DCIM" / "100APPLE"], Import(field))
    assert [row.state for row in rows] == [THERE, THERE]
    assert {k: v for k, v in tree(field).items() if k != TABLE} == {k: v for k, v in before.items() if k != TABLE}
    # Another film of the same plant never takes the place of the first.
    names = phone / "names.csv"
    names.write_text("file,plant_id\nVID_20261123_5.mp4,A-1\nVID_20261123_3.MOV,C-4\nVID_20261123_4.mp4,=x\n")
    files = [phone / "DCIM" / f"VID_20261123_{end}" for end in ("3.MOV", "4.mp4", "5.mp4")]
    rows = of(import_videos(files, Import(field, names=names)))
    assert "is there with something else in it" in rows["VID_20261123_5.mp4"].reason
    assert rows["VID_20261123_3.MOV"].state == IMPORTED and rows["VID_20261123_3.MOV"].plant_id == "C-4"
    assert "not in the field book" in rows["VID_20261123_4.mp4"].reason
    assert len(read_rows(field / TABLE)) == 5
    other = phone / "other.csv"
    other.write_text("plant_id,genotype\nA-1,CHANGED\n")
    with pytest.raises(BadUsage, match="says something else"):
        import_videos(files, Import(field, other))


def test_ways_to_take_a_video(phone):
    video = phone / "DCIM" / "100APPLE" / "VID_20261123_1.mp4"
    for how in ("link", "move"):
        field = phone / how
        (row,) = import_videos([video], Import(field, how=how))
        assert row.state == IMPORTED
        assert video.exists() == (how == "link")
        taken = field / "A-1" / video.name
        assert taken.stat().st_nlink == (2 if how == "link" else 1) or how == "move"
    assert not list(phone.rglob("*.partial"))
    with pytest.raises(BadUsage, match="--how steal"):
        import_videos([phone / "DCIM"], Import(phone / "x", how="steal"))


def test_killed_while_it_copies(phone, monkeypatch):
    """What a kill leaves is a hidden folder, which is no plant; the next import makes it whole."""
    video = phone / "DCIM" / "100APPLE" / "VID_20261123_1.mp4"

    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(module, "_take", killed)
        with pytest.raises(KeyboardInterrupt):
            import_videos([video], Import(phone / "field"))
    assert not (phone / "field" / "A-1").exists()
    (row,) = import_videos([video], Import(phone / "field"))
    assert row.state == IMPORTED
    assert (phone / "field" / "A-1" / video.name).read_bytes() == video.read_bytes()


def test_what_is_wrong_is_told(phone):
    with pytest.raises(MissingInput, match="is not there"):
        import_videos([phone / "nowhere"], Import(phone / "field"))
    (phone / "empty").mkdir()
    with pytest.raises(MissingInput, match="no video"):
        import_videos([phone / "empty"], Import(phone / "field"))
    names = phone / "names.csv"
    for text, words in (("file,id\na,b\n", "needs the columns"), ("file,plant_id\na,b\na,c\n", "twice")):
        names.write_text(text)
        with pytest.raises(BadInput, match=words):
            import_videos([phone / "DCIM"], Import(phone / "field", names=names))


def test_two_ids_that_make_one_folder_on_a_mac_are_a_doubt(phone, monkeypatch):
    reads = {"VID_20261123_3.MOV": "abc", "VID_20261123_4.mp4": "ABC"}
    names = phone / "names.csv"
    names.write_text("file,plant_id\n" + "".join(f"{file},{plant_id}\n" for file, plant_id in reads.items()))
    rows = import_videos([phone / "DCIM" / file for file in reads], Import(phone / "field", names=names))
    assert [row.state for row in rows] == [DOUBT, DOUBT]
    assert [path.name for path in (phone / "field").iterdir() if not path.name.startswith(".")] == [TABLE]
