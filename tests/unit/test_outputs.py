# SPDX-License-Identifier: Apache-2.0
"""What a command saves where a person says: made again of the same, never in place of anything else."""

import json
import zipfile
from pathlib import Path

import pytest
from scenes.finished_scene import finished_workspace

from cotton3dg.commands.bug_report import pack
from cotton3dg.commands.cards import print_cards
from cotton3dg.commands.import_ import Import, import_videos
from cotton3dg.commands.markers import print_markers
from cotton3dg.commands.masks_export import export
from cotton3dg.commands.masks_train import train
from cotton3dg.commands.simulate import simulate
from cotton3dg.errors import BadInput, BadUsage
from cotton3dg.evaluation.mask_table import add_to_table
from cotton3dg.options import CardsOptions, MarkersOptions, MasksTrainOptions, SimulateOptions
from cotton3dg.outputs import LIST, made_of, saving
from cotton3dg.schemas.masks import MaskedImage, MasksInfo
from cotton3dg.workspace import OWNER_MARK, Workspace


def save(folder: Path, text: str, of: str = "a", name: str = "table.csv") -> None:
    with saving(folder, of) as partial:
        (partial / name).write_text(text)


def shown(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))


def test_the_same_is_made_again_and_several_commands_share_a_folder(tmp_path):
    out = tmp_path / "deep" / "out"
    save(out, "1")
    assert (out / OWNER_MARK).exists()  # no plant
    save(out, "2")
    save(out, "3", "b", "other.csv")
    (out / "notes.txt").write_text("mine")
    save(out, "4")
    assert {path.name: path.read_text() for path in out.glob("*.*") if not path.name.startswith(".")} == {
        "table.csv": "4", "other.csv": "3", "notes.txt": "mine"
    }  # fmt: skip


@pytest.mark.parametrize(
    "prepare, said",
    [
        (lambda out: (out.mkdir(), (out / "table.csv").write_text("mine")), "was not made by this command"),
        (lambda out: save(out, "old", "b"), "was made by `cotton3dg b`"),
        (lambda out: (save(out, "old"), (out / "table.csv").write_text("mended")), "was changed since"),
        (lambda out: out.write_text("a file"), "is a file where a folder is due"),
    ],
)
def test_anything_else_stays(tmp_path, prepare, said):
    out = tmp_path / "out"
    prepare(out)
    before = {path: path.read_bytes() for path in [out, *out.rglob("*")] if path.is_file()}
    with pytest.raises(BadUsage, match=f"{said}.*give another --out"):
        save(out, "new")
    assert {path: path.read_bytes() for path in [out, *out.rglob("*")] if path.is_file()} == before


def test_a_stages_folder_takes_no_outputs(tmp_path):
    with Workspace(tmp_path).writing("traits"):
        pass
    with pytest.raises(BadUsage, match="own folder"):
        save(tmp_path / "traits", "new")
    assert shown(tmp_path / "traits") == []


def test_what_failed_leaves_nothing_and_what_was_killed_is_made_again(tmp_path):
    with pytest.raises(ValueError), saving(tmp_path / "out", "a") as partial:
        (partial / "table.csv").write_text("half")
        raise ValueError
    assert shown(tmp_path) == []
    save(tmp_path / "out", "1")
    listed = json.loads((tmp_path / "out" / LIST).read_text())
    listed["table.csv"]["sha256"] = ""  # as it stands while the file is put there
    (tmp_path / "out" / LIST).write_text(json.dumps(listed))
    save(tmp_path / "out", "2")
    assert (tmp_path / "out" / "table.csv").read_text() == "2"


def test_sheets_and_packages_replace_no_file_of_the_users(tmp_path):
    (tmp_path / "book.csv").write_text("plant_id\np1\n")
    (tmp_path / "mine.pdf").write_text("a paper")
    workspace = Workspace(tmp_path)
    workspace.log_file.write_text("log")

    def each(name: str):
        yield lambda: print_cards(tmp_path / "book.csv", tmp_path / f"{name}.pdf", CardsOptions())
        yield lambda: print_markers(tmp_path / f"{name}.pdf", MarkersOptions())

    for command in each("mine"):
        with pytest.raises(BadUsage, match=r"mine\.pdf is there and was not made by this command; .* another name"):
            command()
    assert (tmp_path / "mine.pdf").read_text() == "a paper"
    cards, markers = each("sheet")
    for _ in range(2):
        cards()
    with pytest.raises(BadUsage, match="was made by `cotton3dg cards"):
        markers()
    print_markers(tmp_path / "m.png", MarkersOptions())
    with pytest.raises(BadUsage, match=r"was made by `cotton3dg markers .*marker_cm=10"):
        print_markers(tmp_path / "m.png", MarkersOptions(marker_cm=8))
    for _ in range(2):
        pack(workspace, tmp_path / "a.zip", "")
    assert zipfile.ZipFile(tmp_path / "a.zip").read("run.log") == b"log"
    (tmp_path / "b.zip").write_text("holiday")
    with pytest.raises(BadUsage, match=r"b\.zip is there"):
        pack(workspace, tmp_path / "b.zip", "")


def test_masks_that_were_drawn_upon_are_not_exported_over(tmp_path):
    workspace = finished_workspace(tmp_path / "plant")
    masked = (MaskedImage(workspace.frame_images()[0].name, 1, {}),)
    MasksInfo("bolls", {}, {}, 0.0, masked).save(workspace.masks_json)
    file = export(workspace)
    assert export(workspace) == file
    (file.parent / "images" / "000000.json").write_text("{}")  # Labelme saves beside the image
    with pytest.raises(BadUsage, match=r"annotations/images/000000\.json was changed or added by hand"):
        export(workspace)
    (file.parent / "images" / "000000.json").unlink()
    file.write_text("{}")
    with pytest.raises(BadUsage, match=r"annotations/bolls\.json"):
        export(workspace)
    assert file.read_text() == "{}"
    with pytest.raises(BadUsage, match="holds results of its film"):
        simulate(workspace.root, SimulateOptions())


def test_a_table_of_the_users_is_not_taken_for_ones_own(tmp_path):
    (tmp_path / "masks.csv").write_text("mask,seller\n")
    with pytest.raises(BadInput, match=r"masks\.csv stands where"):
        add_to_table(tmp_path / "masks.csv", "p1", "bolls", {})
    (tmp_path / "import.csv").write_text("invoice,item\n")
    (tmp_path / "a.mp4").touch()
    with pytest.raises(BadInput, match=r"import\.csv stands where"):
        import_videos([tmp_path / "a.mp4"], Import(tmp_path))
    assert shown(tmp_path) == ["a.mp4", "import.csv", "masks.csv"]


def test_another_training_is_not_replaced(tmp_path):
    (tmp_path / "training.json").write_text(json.dumps({"finished": True, "options": {"network": "bolls",
                                                        "annotations": "a", "weights": ""}}))  # fmt: skip
    with pytest.raises(BadUsage, match="holds a training with --annotations 'a'; give a new folder"):
        train(tmp_path, MasksTrainOptions(annotations="b"))


def test_inputs_tell_outputs_apart(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert made_of("compare", Path("june"), Path("july")) == f"compare {tmp_path}/june {tmp_path}/july"
