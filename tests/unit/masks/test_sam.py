# SPDX-License-Identifier: Apache-2.0
"""SAM around a segmenter that can be worked out by hand; the real classes of transformers with random weights."""

import json
from pathlib import Path

import numpy as np
import pytest

from cotton3dg.errors import BadInput, BadUsage, MissingInput
from cotton3dg.masks.grounding_dino import find_boxes, open_grounding_dino
from cotton3dg.masks.sam import Prompts, detect_sam, open_sam, prompts_around
from cotton3dg.masks.transformer_models import normalise

rng = np.random.default_rng(0)
PHOTO = rng.integers(0, 256, (90, 160, 3)).astype(np.uint8)


def flooding(image: np.ndarray, prompts: Prompts) -> tuple[np.ndarray, np.ndarray]:
    """For each prompt the bright piece at its centre; sure of large ones."""
    import cv2

    _, pieces = cv2.connectedComponents((image[..., 0] > 128).astype(np.uint8))
    masks = [pieces == pieces[int(y), int(x)] if pieces[int(y), int(x)] else pieces < 0 for x, y in prompts.centres]
    return np.array(masks), np.array([min(mask.sum() / 1000, 1.0) for mask in masks], np.float32)


def blobs() -> np.ndarray:
    image = np.zeros((120, 200, 3), np.uint8)
    image[10:40, 20:60] = image[80:110, 150:190] = image[60:70, 60:64] = 255
    return image


def test_each_prompt_becomes_a_mask_and_duplicates_are_one() -> None:
    prompts = Prompts(points=np.array([[30.0, 20], [50, 30], [160, 90], [62, 65], [5, 5]]))
    ids, scores = detect_sam(blobs(), flooding, prompts, confidence=0.5)
    assert set(scores) == {1, 2}
    np.testing.assert_array_equal(ids > 0, (blobs()[..., 0] > 0) & ~((np.arange(200) >= 60) & (np.arange(200) < 64)))
    assert len(detect_sam(blobs(), flooding, prompts, confidence=0.01)[1]) == 3


def test_prompts_go_to_the_tile_that_they_are_amid() -> None:
    boxes = np.array([[15.0, 5, 65, 45], [145, 75, 195, 115]])
    whole, _ = detect_sam(blobs(), flooding, Prompts(boxes=boxes), confidence=0.5)
    tiled, _ = detect_sam(blobs(), flooding, Prompts(boxes=boxes), confidence=0.5, tile_px=100)
    np.testing.assert_array_equal(tiled > 0, whole > 0)


def test_no_prompts_no_masks() -> None:
    ids, scores = detect_sam(blobs(), flooding, Prompts(boxes=np.zeros((0, 4))), confidence=0.5)
    assert not ids.any() and scores == {}


def test_masks_prompt_by_their_box_and_their_deepest_point() -> None:
    ids = np.zeros((50, 80), np.uint16)
    ids[10:31, 20:61] = 7
    ids[0:3, 70:80] = 9
    prompts = prompts_around(ids)
    x, y = prompts.points[0]
    assert 30 <= x <= 51 and y == 20.5
    np.testing.assert_allclose(prompts.boxes[0], [20 - 2.05, 10 - 1.05, 61 + 2.05, 31 + 1.05])
    np.testing.assert_allclose(prompts.boxes[1], [69.5, 0, 80, 3.15])  # not out of the image
    assert prompts_around(np.zeros((5, 5), np.uint16)).boxes.shape == (0, 4)


def test_boxes_that_are_cut_huge_unsure_or_double_do_not_count() -> None:
    answers = np.array([[10, 10, 30, 30], [11, 10, 31, 30], [0, 0, 150, 90], [50, 50, 60, 60], [40, 40, 40, 50]], float)

    def find(_: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return answers, np.array([0.8, 0.9, 0.9, 0.2, 0.9])

    np.testing.assert_array_equal(find_boxes(PHOTO, find, confidence=0.35), answers[[1]])


def test_colours_are_relative_to_those_of_imagenet() -> None:
    grey = normalise(np.full((10, 20, 3), 128, np.uint8), 5, 10)
    assert grey.shape == (3, 5, 10)
    np.testing.assert_allclose(
        grey[:, 0, 0], (128 / 255 - np.array([0.485, 0.456, 0.406])) / [0.229, 0.224, 0.225], 1e-5
    )


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    pytest.importorskip("transformers")
    from scenes.transformer_scene import save

    root = tmp_path_factory.mktemp("models")
    return {kind: save(root / kind, kind) for kind in ("sam", "sam2", "grounding-dino")}


@pytest.mark.parametrize("kind", ["sam", "sam2"])
def test_sam_answers_points_boxes_and_both(folders, kind: str) -> None:
    segment = open_sam(folders[kind], trusted=False)
    points, boxes = np.array([[30.0, 40], [100, 50]]), np.array([[10.0, 10, 60, 60], [80, 20, 140, 80]])
    answers = [segment(PHOTO, prompts) for prompts in (Prompts(points), Prompts(boxes=boxes), Prompts(points, boxes))]
    for masks, scores in answers:
        assert masks.shape == (2, 90, 160) and masks.dtype == bool and scores.shape == (2,)
        assert ((scores >= 0) & (scores <= 1)).all()
    many = Prompts(boxes=np.repeat(boxes, 20, axis=0))
    masks, _ = segment(PHOTO, many)
    # The same in whatever batch, but for rounding where an answer is hardly one.
    assert (masks[::20] != answers[1][0]).mean() < 1e-3


@pytest.mark.parametrize("kind", ["sam", "sam2"])
def test_sam_sees_what_its_own_processing_would_show_it(folders, kind: str) -> None:
    """Our resizing, padding and way back against those of transformers, on an image that needs no interpolation."""
    import torch
    import transformers

    model = {"sam": "SamModel", "sam2": "Sam2Model"}[kind]
    model = getattr(transformers, model).from_pretrained(folders[kind]).eval()
    photo = PHOTO[:64, :128] if kind == "sam" else np.resize(PHOTO, (128, 128, 3))
    frame = np.zeros((1, 3, 128, 128), np.float32)
    frame[0, :, : len(photo)] = normalise(photo, *photo.shape[:2])
    box = torch.tensor([[[10.0, 10, 60, 60]]])
    with torch.inference_mode():
        logits = model(pixel_values=torch.from_numpy(frame), input_boxes=box, multimask_output=False).pred_masks[0, 0]
    logits = torch.nn.functional.interpolate(logits[None], (128, 128), mode="bilinear")[0, 0, : len(photo)]
    masks, _ = open_sam(folders[kind], trusted=False)(photo, Prompts(boxes=box[0].double().numpy()))
    sure = logits.abs().numpy() > 1e-4 * float(logits.abs().max())
    assert sure.mean() > 0.99
    np.testing.assert_array_equal(masks[0][sure], (logits > 0).numpy()[sure])


def test_grounding_dino_answers_boxes(folders) -> None:
    find = open_grounding_dino(folders["grounding-dino"], "Cotton boll", trusted=False)
    boxes, scores = find(PHOTO)
    assert boxes.shape == (20, 4) and scores.shape == (20,) and ((scores > 0) & (scores < 1)).all()
    assert (boxes >= 0).all() and (boxes[:, ::2] <= 160).all() and (boxes[:, 1::2] <= 90).all()
    others = open_grounding_dino(folders["grounding-dino"], "boll", trusted=False)(PHOTO)[1]
    assert abs(scores - others).max() > 1e-6  # the text matters


def test_folders_that_hold_no_such_model(folders, tmp_path: Path) -> None:
    import torch
    from safetensors.torch import load_file

    with pytest.raises(MissingInput, match="is not a folder"):
        open_sam(tmp_path / "absent", trusted=False)
    with pytest.raises(MissingInput, match=r"config\.json"):
        open_sam(tmp_path, trusted=False)
    with pytest.raises(BadInput, match="kind 'grounding-dino'; --weights takes sam or sam2"):
        open_sam(folders["grounding-dino"], trusted=False)
    with pytest.raises(BadInput, match="kind 'sam'; --detector takes grounding-dino"):
        open_grounding_dino(folders["sam"], "boll", trusted=False)
    config = (folders["sam"] / "config.json").read_text()
    (tmp_path / "config.json").write_text(config)
    with pytest.raises(MissingInput, match=r"no model\.safetensors"):
        open_sam(tmp_path, trusted=False)
    weights = load_file(folders["sam"] / "model.safetensors")
    torch.save(weights, tmp_path / "pytorch_model.bin")
    with pytest.raises(BadUsage, match="--trust-weights"):
        open_sam(tmp_path, trusted=False)
    assert open_sam(tmp_path, trusted=True)(PHOTO, Prompts(points=np.array([[5.0, 5]])))[0].shape == (1, 90, 160)
    (tmp_path / "model.safetensors").write_bytes((folders["sam"] / "model.safetensors").read_bytes()[:5000])
    with pytest.raises(BadInput, match="cannot be read"):
        open_sam(tmp_path, trusted=False)
    (tmp_path / "model.safetensors").write_bytes((folders["sam2"] / "model.safetensors").read_bytes())
    with pytest.raises(BadInput, match="lack"):
        open_sam(tmp_path, trusted=False)
    (tmp_path / "config.json").write_text(json.dumps([]))
    with pytest.raises(BadInput, match="damaged"):
        open_sam(tmp_path, trusted=False)
