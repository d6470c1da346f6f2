# SPDX-License-Identifier: Apache-2.0
"""Documents between stages: what is written is read again, and what cannot be read is refused with a remedy."""

import json
import math
from dataclasses import fields, replace

import pytest
from scenes.documents import effects, frame_info, frames_info, sfm_info, table_scale, train_metrics

from cotton3dg.errors import BadInput
from cotton3dg.schemas.batch import Jobs, PlantOutcome
from cotton3dg.schemas.bolls import BollFacts, BollMask, BollsInfo
from cotton3dg.schemas.frames import FramesInfo
from cotton3dg.schemas.masks import MaskedImage, MasksInfo
from cotton3dg.schemas.record import DroppedFiles
from cotton3dg.schemas.scale import ScaleInfo, read_scale
from cotton3dg.schemas.segment import MeanIous, ReachedIous, SegmentInfo
from cotton3dg.schemas.sfm import LensDecision, SfmInfo
from cotton3dg.schemas.train import ExposureDecision, RejectedStep
from cotton3dg.schemas.truth import TrueMasks

DOCUMENTS = [
    frames_info([frame_info("a.jpg", timestamp_s=0.5), frame_info("b.jpg", source_index=7)]),
    frames_info([frame_info("a.jpg", file="IMG_1.jpg")], ordered=False),
    sfm_info(["a", "b"], ("b",), distortion=LensDecision("auto", False, -0.1, 0.1, 0.5)),
    replace(train_metrics(held_out=("a",)), culled={"tiny": 3}, rejected_steps=(RejectedStep(7, "a"),)),
    effects(exposure=ExposureDecision("auto", True, 2.0, 0.1, 1.0, 900, {"a": (1.0, 0.9, 1.1)})),
    MasksInfo("bolls", {"views": 36}, {}, 0.25, (MaskedImage("a", 2, {"1": 0.5}), MaskedImage("b", 0, {}))),
    SegmentInfo("lift", 0, rim_px=1, weights_seconds=0.5),
    SegmentInfo("probability", 0, vote=MeanIous({"0.5": 0.9}), by_steps=(ReachedIous({"0.5": 0.8}, None, 100, 2.0),)),
    BollsInfo("0" * 64, (BollFacts(1, (0.0, 1.0, 2.0), 0.1, 400, ("a", "b"), 0.75, ("large",), (BollMask("a", 3),)),)),
    table_scale(evidence={"edge_support": [0.9]}, references=({"source": "table"},), refused={"aruco": "none"}),
    ScaleInfo("none", "no table"),
    PlantOutcome("a", "failed", 8, "too short"),
    TrueMasks("of lint", {"frame_0000.png": 0}),
]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda document: type(document).__name__)
def test_what_was_written_is_read_again(tmp_path, document):
    path = tmp_path / "document.json"
    document.save(path)
    assert type(document).load(path) == document
    assert json.loads(path.read_text()).keys() == {
        item.name for item in fields(document) if getattr(document, item.name) is not None
    }
    path.write_text(json.dumps(json.loads(path.read_text()) | {"of_a_later_version": [1]}))
    assert type(document).load(path) == document


def test_a_number_that_is_none_is_null(tmp_path):
    path = tmp_path / "metrics.json"
    replace(train_metrics(), psnr_db=math.nan).save(path)
    assert json.loads(path.read_text())["psnr_db"] is None
    assert math.isnan(type(train_metrics()).load(path).psnr_db)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"n_frames": "many"}, "n_frames is not int"),
        ({"n_frames": True}, "n_frames is not int"),
        ({"registered": "a"}, "registered is not a list"),
        ({"registered": ["a", 1]}, r"registered\[1\] is not str"),
        ({"distortion": 1}, "distortion is not a table"),
        ({"distortion": {"option": "on"}}, "distortion has no on"),
        ({"orbit_radius_su": "wide"}, "orbit_radius_su is not float"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, changes, words):
    path = tmp_path / "sfm.json"
    sfm_info(["a"]).save(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    with pytest.raises(BadInput, match=rf"sfm\.json is damaged .*{words}.*; run `cotton3dg sfm --force`"):
        SfmInfo.load(path)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", "{}", "\udcff"])
def test_damaged_files_are_refused(tmp_path, text):
    path = tmp_path / "frames.json"
    path.write_text(text, errors="surrogateescape")
    with pytest.raises(BadInput, match=r"frames\.json is damaged .*; run `cotton3dg frames --force`"):
        FramesInfo.load(path)
    assert FramesInfo.load_if_there(tmp_path / "none.json") is None


@pytest.mark.parametrize("known", [{"up": (0.0, 1.0)}, {"corners": ((0.0,), (1.0, 2.0))}, {"relative_error": None}])
def test_a_scale_that_is_not_complete_is_refused(tmp_path, known):
    path = tmp_path / "scale.json"
    replace(table_scale(), **known).save(path)
    with pytest.raises(BadInput, match="no usable scale; run `cotton3dg scale --force`"):
        read_scale(path)


def test_bolls_of_a_program_that_kept_no_masks_are_refused(tmp_path):
    path = tmp_path / "bolls.json"
    boll = {"id": 1, "centre_su": [0, 1, 2], "diameter_su": 0.1, "n_gaussians": 400, "views": ["a"], "confidence": 1.0}
    path.write_text(json.dumps({"gaussians_sha256": "0" * 64, "bolls": [boll | {"flags": []}]}))
    with pytest.raises(BadInput, match=r"bolls\[0\] has no masks.*; run `cotton3dg cluster --force`"):
        BollsInfo.load(path)


@pytest.mark.parametrize(
    ("document", "content"),
    [(Jobs({"a": "17_0"}), {"a": "17_0"}), (DroppedFiles(("frames/000000.jpg",)), ["frames/000000.jpg"])],
)
def test_a_document_of_one_field_is_the_whole_file(tmp_path, document, content):
    path = tmp_path / "document.json"
    document.save(path)
    assert json.loads(path.read_text()) == content
    assert type(document).load(path) == document
    for text in ("{", "3", json.dumps([3]), json.dumps({"a": 3}), json.dumps({"a": ["b"]})):
        path.write_text(text)
        with pytest.raises(BadInput, match=r"document\.json .*; (submit|run) "):
            type(document).load(path)


def test_frames_of_true_masks_may_stand_alone(tmp_path):
    (tmp_path / "frames.json").write_text('{"frame_0010.png": 10}')
    assert TrueMasks.load(tmp_path / "frames.json").frames == {"frame_0010.png": 10}
