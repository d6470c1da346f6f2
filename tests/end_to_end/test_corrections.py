# SPDX-License-Identifier: Apache-2.0
"""A person's corrections: applied, marked, taken back, replayed to the same bytes, and found again after a rerun."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from scenes.measured_plant import measure_plant
from scenes.table_scene import BOLL_RADIUS_CM, BOLLS_CM, POSE
from typer.testing import CliRunner

from cotton3dg.cli.app import app
from cotton3dg.commands.correct import Asked, correct
from cotton3dg.core.columns import columns_of
from cotton3dg.core.measurements import BollTraits, PlantFrame
from cotton3dg.errors import BadInput, BadUsage, MissingInput
from cotton3dg.io.colmap import read_cameras
from cotton3dg.io.ply import read_gaussians
from cotton3dg.io.tables import read_rows
from cotton3dg.options import resolve
from cotton3dg.report.facts import read_facts
from cotton3dg.scale import stage as scale_stage
from cotton3dg.schemas.bolls import read_bolls
from cotton3dg.schemas.corrections import Correction, Corrections, Pick, Place
from cotton3dg.schemas.scale import ScaleInfo, read_scale
from cotton3dg.traits.corrections import apply_corrections
from cotton3dg.workspace import Workspace


def rows(workspace):
    return {int(row["boll_id"]): row for row in read_rows(workspace.bolls_csv)}


def plant_row(workspace):
    return read_rows(workspace.traits_csv)[0]


def tables(workspace):
    return [path.read_bytes() for path in (workspace.traits_csv, workspace.bolls_csv)]


def test_without_corrections_their_columns_are_blank(reported):
    assert plant_row(reported)["corrections"] == plant_row(reported)["original_boll_count"] == ""
    assert {row["corrected"] for row in rows(reported).values()} == {""}
    assert not reported.corrected_bolls_json.exists()


def test_merge_and_delete_are_marked_and_replay_to_the_same_bytes(reported_copy, tmp_path):
    before, plant = rows(reported_copy), plant_row(reported_copy)
    outcome = correct(reported_copy, Asked(merge=["3,4"], delete=[1]))
    assert (outcome.before, outcome.after, outcome.refused) == (4, 2, ())
    after = rows(reported_copy)
    assert set(after) == {2, 3}  # numbers stay
    own = [column.name for column in columns_of(BollTraits)]  # where it sits on the plant's map depends on the others
    assert [after[2][name] for name in own] == [before[2][name] for name in own]
    assert after[3]["corrected"] == "merged" and after[3]["original_bolls"] == "3+4"
    whole = sum(float(before[k]["volume_cm3"]) for k in (3, 4))
    assert float(after[3]["original_volume_cm3"]) == pytest.approx(whole, abs=0.011)
    assert float(after[3]["volume_cm3"]) > whole  # the hull of both
    row = plant_row(reported_copy)
    assert row["corrections"] == "2" and row["boll_count"] == "2"
    assert row["original_boll_count"] == "4" and row["original_boll_volume_cm3"] == plant["boll_volume_cm3"]
    # The page shows what was measured.
    assert [row["boll_id"] for row in read_facts(reported_copy).bolls] == ["2", "3"]
    page = reported_copy.report_html.read_text(encoding="utf-8")
    assert 'data-boll="3"' in page and 'data-boll="4"' not in page
    # The same file on another copy gives the same tables, and again on the same one.
    again = Workspace(shutil.copytree(reported_copy.root, tmp_path / "again" / "plant_017"))
    saved = tmp_path / "saved.json"
    shutil.copyfile(reported_copy.corrections_json, saved)
    first = tables(reported_copy)
    again.corrections_json.unlink()
    correct(again, Asked(file=saved))
    assert tables(again) == first
    assert correct(again, Asked(file=saved)).kept == Corrections.load(saved)  # said twice, kept once
    assert tables(again) == first
    correct(again, Asked(undo=True))
    assert set(rows(again)) == {1, 2, 3}
    correct(again, Asked(undo=True))
    assert not again.corrections_json.exists() and not again.corrected_bolls_json.exists()
    assert rows(again) == before


@pytest.mark.slow
def test_split_undoes_a_wrong_merge(reported_copy):
    before = rows(reported_copy)
    correct(reported_copy, Asked(merge=["3,4"]))
    correct(reported_copy, Asked(split=[3]))
    after = rows(reported_copy)
    assert set(after) == {1, 2, 3, 5}
    assert {after[k]["corrected"] for k in (3, 5)} == {"split"}
    assert {after[k]["original_bolls"] for k in (3, 5)} == {"3+4"}
    volumes = sorted(float(after[k]["volume_cm3"]) for k in (3, 5))
    assert volumes == pytest.approx(sorted(float(before[k]["volume_cm3"]) for k in (3, 4)), rel=0.05)


def test_a_boll_is_added_where_two_photos_show_it(reported_copy):
    """Boll 2 is deleted, and put back by two clicks."""
    bolls = {boll.boll_id: boll for boll in read_bolls(*reported_copy.final_bolls())[0]}
    cameras = read_cameras(reported_copy.undistorted / "sparse")
    correct(reported_copy, Asked(branch=[2]))
    picks = []
    for camera in (cameras[1], cameras[4]):
        ((x, y),), _ = camera.project(bolls[2].centre[None])
        picks.append(f"{camera.name}:{x + 0.4:.1f},{y - 0.3:.1f}")
    correct(reported_copy, Asked(add=[" ".join(picks)]))
    added = rows(reported_copy)[5]
    assert added["corrected"] == "added" and added["original_bolls"] == ""
    assert float(added["volume_cm3"]) == pytest.approx(4 / 3 * np.pi * BOLL_RADIUS_CM**3, rel=0.25)
    place = [float(added[f"{axis}_cm"]) for axis in "xyz"]
    told = Corrections.load(reported_copy.corrections_json).corrections[1].bolls[0].centre_cm
    assert np.linalg.norm(np.subtract(place, told)) < 1.0


def picks_of(cameras, point, off_px=(0.4, -0.3)):
    """A scene point as a hand picks it in two images."""
    return " ".join(
        f"{camera.name}:{x + off_px[0]:.2f},{y + off_px[1]:.2f}"
        for camera in cameras
        for x, y in camera.project(point[None])[0]
    )


@pytest.mark.slow
def test_a_moved_corner_is_a_new_scale_and_the_old_values_are_kept(reported_copy, tmp_path):
    before, plant = rows(reported_copy), plant_row(reported_copy)
    found = read_scale(reported_copy.scale_json)
    cameras = read_cameras(reported_copy.undistorted / "sparse")
    # 4 cm out along both sides of corner 3.
    there = found.corners[2] + (found.table_frame[0] + found.table_frame[1]) * 4 / found.cm_per_su
    factor = (120**2 + 60**2) / (124 * 120 + 64 * 60)  # by least squares over both sides
    outcome = correct(reported_copy, Asked(delete=[1], corner=[picks_of((cameras[1], cameras[5]), there)]))
    assert (outcome.before, outcome.after, outcome.refused) == (4, 3, ())
    info = ScaleInfo.load(reported_copy.scale_json)
    assert info.source == "corners" and info.moved_corners == 1
    assert info.cm_per_su == pytest.approx(found.cm_per_su * factor, rel=5e-3)
    assert 0.003 < info.relative_error < 0.02
    assert info.found.scale.cm_per_su == pytest.approx(found.cm_per_su, rel=5e-3)
    assert info.scale.corners[2] == pytest.approx(there, abs=1.5 / found.cm_per_su)
    row = plant_row(reported_copy)
    assert row["scale_source"] == "corners" and row["corrections"] == "2"
    for name in ("plant_height_cm", "canopy_size_cm"):
        assert float(row[f"original_{name}"]) == pytest.approx(float(plant[name]), abs=1.0)
        assert float(row[name]) == pytest.approx(float(row[f"original_{name}"]) * factor, rel=0.01)
    after = rows(reported_copy)
    assert set(after) == {2, 3, 4} and {boll["corrected"] for boll in after.values()} == {"rescaled"}
    for boll_id, boll in after.items():
        assert boll["original_bolls"] == str(boll_id)
        assert float(boll["original_volume_cm3"]) == pytest.approx(float(before[boll_id]["volume_cm3"]), rel=0.02)
        assert float(boll["volume_cm3"]) == pytest.approx(float(boll["original_volume_cm3"]) * factor**3, rel=0.02)
    # What is said from now on is said in the new scale, and is kept in that of the table as it was found.
    correct(reported_copy, Asked(split=[3]))
    told = Corrections.load(reported_copy.corrections_json).corrections[-1].bolls[0].centre_cm
    assert told == pytest.approx([float(before[3][f"{axis}_cm"]) for axis in "xyz"], abs=1.0)
    # The same file on another copy gives the same bytes; taken back, the scale is what it was.
    saved = tmp_path / "saved.json"
    shutil.copyfile(reported_copy.corrections_json, saved)
    first = tables(reported_copy)
    again = Workspace(shutil.copytree(reported_copy.root, tmp_path / "again" / "plant_017"))
    for _ in range(3):
        correct(again, Asked(undo=True))
    assert not again.corrections_json.exists() and ScaleInfo.load(again.scale_json) == info.found
    assert plant_row(again)["original_plant_height_cm"] == ""
    correct(again, Asked(file=saved))
    assert tables(again) == first


@pytest.mark.slow
def test_a_corner_is_for_the_photos_that_were_pointed_at(reported_copy):
    cameras = read_cameras(reported_copy.undistorted / "sparse")
    found = read_scale(reported_copy.scale_json)
    picks = picks_of((cameras[1], cameras[5]), found.corners[1])
    correct(reported_copy, Asked(corner=[picks]))
    assert ScaleInfo.load(reported_copy.scale_json).found
    # Another image under the name of one that was pointed at, as another run makes it.
    shutil.copyfile(reported_copy.undistorted_image(cameras[2].name), reported_copy.undistorted_image(cameras[1].name))
    outcome = correct(reported_copy, Asked(delete=[1], corner=[picks_of((cameras[3], cameras[6]), found.corners[0])]))
    assert outcome.refused == ("correction not applied: corner: a photo that was pointed at is another one now",)
    info = ScaleInfo.load(reported_copy.scale_json)
    assert info.evidence == {"moved_corners": [1]}
    assert "corrections_not_applied" in plant_row(reported_copy)["qc_flags"]
    told = json.loads(reported_copy.corrections_json.read_text())["corrections"][-1]
    told["picks"][0]["sha256"], told["model"] = "0" * 64, ""
    saved = reported_copy.root / "old_page.json"
    saved.write_text(json.dumps({"corrections": [told]}))
    with pytest.raises(BadUsage, match="another image now; open the plant's report anew"):
        correct(reported_copy, Asked(file=saved))


def test_other_corrections_leave_the_scale_as_it_is(reported_copy):
    options = resolve("scale")
    assert scale_stage.parts(reported_copy, options) == {}
    correct(reported_copy, Asked(delete=[1]))
    assert scale_stage.parts(reported_copy, options) == {}
    corner = Correction("corner", picks=(Pick("a.jpg", 1.0, 2.0), Pick("b.jpg", 1.0, 2.0)))
    Corrections((corner,)).save(reported_copy.corrections_json)
    (one,) = scale_stage.parts(reported_copy, options).values()
    Corrections((corner, Correction("delete", (Place(1),)))).save(reported_copy.corrections_json)
    assert list(scale_stage.parts(reported_copy, options).values()) == [one]


@pytest.mark.slow
def test_a_ruler_measures_and_changes_nothing(reported_copy):
    before = tables(reported_copy)
    bolls = {boll.boll_id: boll for boll in read_bolls(*reported_copy.final_bolls())[0]}
    cameras = read_cameras(reported_copy.undistorted / "sparse")
    ends = [picks_of(pair, bolls[k].centre) for k, pair in ((1, cameras[1:5:3]), (4, cameras[3:7:3]))]
    outcome = correct(reported_copy, Asked(ruler=[" / ".join(ends)]))
    true_cm = np.linalg.norm(np.subtract(*BOLLS_CM[[0, 3]]))
    (length,) = outcome.lengths
    assert length.length_cm == pytest.approx(true_cm, abs=1.0)
    assert abs(length.length_cm - true_cm) < 3 * length.error_cm and length.error_cm < 1.0
    assert tables(reported_copy) == before
    # Copied into the plant's folder as the page saved it, a file does as well.
    shutil.copyfile(reported_copy.corrections_json, reported_copy.root / "kept.json")
    said = json.loads(reported_copy.corrections_json.read_text())["corrections"][0]
    bare = [{key: pick[key] for key in ("image", "x_px", "y_px", "end")} for pick in said["picks"]]
    reported_copy.corrections_json.write_text(json.dumps({"corrections": [{"kind": "ruler", "picks": bare}]}))
    assert correct(reported_copy, Asked()).lengths == outcome.lengths
    assert reported_copy.corrections_json.read_bytes() == (reported_copy.root / "kept.json").read_bytes()
    # Picked in 3D it has places and no picks, and without its model it is not known.
    places = tuple(Place(0, tuple(float(rows(reported_copy)[k][f"{axis}_cm"]) for axis in "xyz")) for k in (1, 4))
    (reported_copy.root / "said.json").write_text(
        json.dumps({"corrections": [{"kind": "ruler", "bolls": [{"centre_cm": place.centre_cm} for place in places]}]})
    )
    outcome = correct(reported_copy, Asked(file=reported_copy.root / "said.json"))
    assert outcome.lengths[1].length_cm == pytest.approx(true_cm, abs=1.0)
    kept = Corrections.load(reported_copy.corrections_json)
    Corrections(tuple(replace(said, model="other", picks=()) for said in kept.corrections)).save(
        reported_copy.corrections_json
    )
    told = CliRunner().invoke(app, ["correct", str(reported_copy.root)])
    assert told.exit_code == 0, told.output
    assert told.output.count("ruler (its ends or the scale are not known)") == 2


def test_what_makes_no_sense_is_refused(reported_copy, tmp_path):
    for asked, words in (
        (Asked(delete=[9]), "there is no boll 9; its bolls are 1, 2, 3, 4"),
        (Asked(merge=["3"]), "merge needs 2 bolls"),
        (Asked(merge=["a,b"]), "--merge a,b"),
        (Asked(add=["000000.jpg"]), "write IMAGE:X,Y twice"),
        (Asked(add=["000000.jpg:1,2 nowhere.jpg:3,4"]), "nowhere.jpg is not a placed image"),
        (Asked(add=["000000.jpg:1,2"]), "two images"),
        (Asked(add=["000000.jpg:1,nan 000003.jpg:3,4"]), "a place needs three finite numbers"),
        (Asked(add=["000000.jpg:1,2 000003.jpg:300,230"]), "the picks do not meet in space"),
        (Asked(corner=["000000.jpg:1,2"]), "corner needs its place in two images"),
        (Asked(ruler=["000000.jpg:1,2 000003.jpg:3,4"]), "a slash between them"),
        (Asked(ruler=["000000.jpg:1,2 000003.jpg:3,4 / 000000.jpg:1,2"]), "both its ends in two images"),
        (Asked(undo=True), "no correction to take back"),
    ):
        with pytest.raises(BadUsage, match=words):
            correct(reported_copy, asked)
        assert not reported_copy.corrections_json.exists()
    for text in ("", "[]", '{"corrections": 3}', '{"corrections": [{"kind": "merge", "bolls": [{"boll_id": "x"}]}]}'):
        (tmp_path / "bad.json").write_text(text)
        with pytest.raises((BadInput, BadUsage)):
            correct(reported_copy, Asked(file=tmp_path / "bad.json"))
    Corrections((Correction("delete", (Place(1, None, (0.0, 0.0, 0.0)),), model="other"),)).save(tmp_path / "o.json")
    with pytest.raises(BadUsage, match=r"o\.json is of another plant or model; give the file"):
        correct(reported_copy, Asked(file=tmp_path / "o.json"))
    assert not reported_copy.corrections_json.exists()
    (tmp_path / "empty").mkdir()
    with pytest.raises(MissingInput, match="no finished result"):
        correct(Workspace(tmp_path / "empty"), Asked(delete=[1]))


def test_a_plant_that_used_a_method_which_is_gone_is_not_corrected_but_keeps_its_page(reported_copy):
    for stage, options in (("cluster", {"method": "agglomerative"}), ("masks", {"backend": "lint"})):
        reported_copy.write_record(replace(reported_copy.read_record(stage), options=options))
        with pytest.raises(BadUsage, match=f"is gone; use .*; run `cotton3dg {stage}` again"):
            correct(reported_copy, Asked(delete=[1]))
    assert not reported_copy.corrections_json.exists()
    reported_copy.report_html.unlink()
    told = CliRunner().invoke(app, ["report", str(reported_copy.root)])
    assert told.exit_code == 0 and reported_copy.report_html.exists()
    assert CliRunner().invoke(app, ["status", str(reported_copy.root)]).exit_code == 0


def test_they_outlive_another_model_or_are_told_not_to_apply(reported_copy):
    """The scene turned, moved, of another size and with other Gaussians: the plant's frame finds the bolls again."""
    bolls, sha = read_bolls(*reported_copy.final_bolls())
    gaussians = read_gaussians(reported_copy.gaussians_ply)
    scale = read_scale(reported_copy.scale_json)
    measured = measure_plant(gaussians, bolls, scale, 0.01, 4.0)
    frame = PlantFrame(scale, measured.plant.foot)
    for boll, row in zip(bolls, measured.bolls, strict=True):
        assert frame.scene(row.centre_cm) == pytest.approx(boll.centre, abs=1e-9)
        assert frame.cm(boll.centre) == pytest.approx(row.centre_cm, abs=1e-9)
    said = Correction(
        "delete", (Place(1, tuple(measured.bolls[0].centre_cm + 0.5), (99.0, 99.0, 99.0)),), model="other"
    )
    renumbered = [replace(boll, boll_id=boll.boll_id + 10) for boll in bolls]
    corrected = apply_corrections(renumbered, [said], gaussians, "another", frame)
    assert [boll.boll_id for boll in corrected.bolls] == [12, 13, 14]
    gone = apply_corrections(renumbered[1:], [said], gaussians, "another", frame)
    assert gone.refused == ("delete 1: no boll is there any more",) and len(gone.bolls) == 3
    blind = apply_corrections(renumbered, [said], gaussians, "another", None)
    assert "without a scale" in blind.refused[0] and len(blind.bolls) == 4
    own = replace(said, model=sha, bolls=(Place(1, None, tuple(bolls[0].centre)),))
    assert len(apply_corrections(bolls, [own], gaussians, sha, None).bolls) == 3
    empty = apply_corrections(bolls, [Correction("add", (Place(0, (0.0, 0.0, 150.0)),))], gaussians, sha, frame)
    assert "no lint there" in empty.refused[0]
    assert POSE.cm(bolls[0].centre[None]) == pytest.approx(BOLLS_CM[:1], abs=1.0)


def test_the_command_line(reported_copy):
    told = CliRunner().invoke(app, ["correct", str(reported_copy.root), "--merge", "3,4", "--delete", "1"])
    assert told.exit_code == 0, told.output
    assert "merge 3 + 4\ndelete 1\n2 corrections kept; bolls: 4 → 2, volume: " in told.output
    content = json.loads(reported_copy.corrections_json.read_text())
    content["corrections"][1]["bolls"][0] |= {"centre_cm": [0.0, 0.0, 0.0], "centre_su": [0.0, 0.0, 0.0]}
    reported_copy.corrections_json.write_text(json.dumps(content))
    told = CliRunner().invoke(app, ["correct", str(reported_copy.root)])
    assert told.exit_code == 8
    assert "delete 1: no boll is there any more" in told.output
    assert "corrections_not_applied" in plant_row(reported_copy)["qc_flags"]


def test_a_boll_is_added_where_all_were_missed(reported_copy):
    """Its size is then that of a usual boll; without a scale nothing tells it."""
    bolls, sha = read_bolls(*reported_copy.final_bolls())
    gaussians = read_gaussians(reported_copy.gaussians_ply)
    scale = read_scale(reported_copy.scale_json)
    frame = PlantFrame(scale, measure_plant(gaussians, bolls, scale, 0.01, 4.0).plant.foot)
    said = [Correction("add", (Place(0, None, tuple(bolls[1].centre)),), model=sha)]
    (added,) = apply_corrections([], said, gaussians, sha, frame).bolls
    true, made = set(bolls[1].indices.tolist()), set(added.indices.tolist())
    assert len(true & made) > 0.9 * len(true | made)
    blind = apply_corrections([], said, gaussians, sha, None)
    assert blind.bolls == [] and "neither another boll nor a scale" in blind.refused[0]
