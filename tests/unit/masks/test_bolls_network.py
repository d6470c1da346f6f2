# SPDX-License-Identifier: Apache-2.0
"""The bolls' network: torch and OpenCV agree, weights survive a file, training goes on where it ended."""

import copy

import cv2
import numpy as np
import pytest
import torch
from scenes.imagenet_weights import published_weights

from cotton3dg.core.network_maps import middles_of_pixels
from cotton3dg.core.training_picture import LINT, NOT_LINT, UNKNOWN, TrainingPicture
from cotton3dg.errors import BadInput, MissingInput
from cotton3dg.masks.bolls import CHANNELS, OFFSET_PX, BollNetwork, open_bolls
from cotton3dg.masks.bolls_network import BollsNetwork, from_onnx, load_imagenet, to_onnx
from cotton3dg.masks.bolls_training import BORDER_PX, TrainingSettings, losses, restore_norms, targets, train


@pytest.fixture(scope="module")
def network() -> BollsNetwork:
    """With statistics unlike those of a new one."""
    torch.manual_seed(1)
    network = BollsNetwork()
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_mean.normal_(0, 0.2)
            module.running_var.uniform_(0.5, 2)
            torch.nn.init.uniform_(module.weight, 0.5, 1.5)
            torch.nn.init.normal_(module.bias, 0, 0.2)
    return network.eval()


def maps_of(network: BollsNetwork, image: np.ndarray) -> np.ndarray:
    with torch.no_grad():
        return network(torch.from_numpy(image.transpose(2, 0, 1)[None].astype(np.float32)))[0].numpy()


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("shape", [(64, 96), (50, 70)])
def test_opencv_says_what_torch_says(network, half, shape):
    image = np.random.default_rng(0).integers(0, 256, (*shape, 3), np.uint8)
    reader = BollNetwork(to_onnx(network, half=half), "net")
    maps = reader.maps(image)
    seen = cv2.resize(image, (2 * shape[1], 2 * shape[0]), interpolation=cv2.INTER_CUBIC)
    below, right = -seen.shape[0] % 32, -seen.shape[1] % 32
    raw = maps_of(network, np.pad(seen, ((0, below), (0, right), (0, 0)), mode="edge"))
    raw = raw[:, : shape[0], : shape[1]]
    assert raw.shape[0] == CHANNELS
    assert maps.scale == 1
    probabilities = np.exp(raw[:5]) / np.exp(raw[:5]).sum(axis=0)
    tolerance = 5e-3 if half else 1e-4
    np.testing.assert_allclose(maps.probabilities, probabilities, atol=tolerance)
    np.testing.assert_allclose(maps.diameters, 0.5 * OFFSET_PX * 2.0 ** raw[8].clip(-3, 5), rtol=5 * tolerance)
    middle_of_first = maps.votes[:, 0, 0] - 0.5 * OFFSET_PX * raw[5:7, 0, 0]
    np.testing.assert_allclose(middle_of_first, 0.5, atol=OFFSET_PX * tolerance)


def test_large_images_are_seen_smaller_and_votes_are_in_their_pixels(network):
    image = np.random.default_rng(0).integers(0, 256, (96, 1920, 3), np.uint8)
    maps = BollNetwork(to_onnx(network), "net").maps(image)
    assert maps.lint.shape == (32, 640)
    assert maps.scale == 3
    assert maps.image_shape == (96, 1920)


@pytest.mark.parametrize(
    ("shape", "window"),
    [((320, 480), (96, 112, 160, 96)), ((180, 330), (290, 131, 40, 49)), ((96, 1920), (0, 0, 700, 96))],
)
def test_within_a_window_it_says_the_same_and_outside_nothing(shape, window):
    # The shipped network: how far around itself a pixel looks is what training made of it.
    network = open_bolls()
    image = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (*shape, 3), np.uint8), (0, 0), 2)
    left, top, width, height = window
    image[top : top + height, left : left + width] = 235
    whole, part = network.maps(image), network.maps(image, window=window)
    assert part.lint.shape == whole.lint.shape
    assert part.scale == whole.scale
    x, y = middles_of_pixels(whole.lint.shape, whole.scale)
    margin = 48 * whole.scale
    reach = np.maximum.reduce([left - x, x - left - width, top - y, y - top - height])
    far = reach > 32 * whole.scale
    assert (part.probabilities[0][far] > 0.99).all()
    # At an edge of the image the window's edge is the image's.
    inner = np.maximum.reduce(
        [
            np.where(left > 0, left - x, -np.inf),
            np.where(left + width < shape[1], x - left - width, -np.inf),
            np.where(top > 0, top - y, -np.inf),
            np.where(top + height < shape[0], y - top - height, -np.inf),
        ]
    )
    deep = inner < -min(margin, 0.4 * min(width, height))
    assert deep.any()
    assert np.abs(part.lint - whole.lint)[deep].mean() < 0.05


def test_a_window_of_everything_changes_no_bit(network):
    image = np.random.default_rng(0).integers(0, 256, (50, 70, 3), np.uint8)
    reader = BollNetwork(to_onnx(network), "net")
    whole, part = reader.maps(image), reader.maps(image, window=(0, 0, 70, 50))
    np.testing.assert_array_equal(part.probabilities, whole.probabilities)
    np.testing.assert_array_equal(part.votes, whole.votes)


def test_weights_survive_a_file(network):
    image = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
    again = from_onnx(to_onnx(network), "net")
    np.testing.assert_allclose(maps_of(again, image), maps_of(network, image), atol=1e-4)


def test_foreign_and_missing_weights_name_the_remedy(network, tmp_path):
    whole = to_onnx(network)
    for text in (b"", b"no network", whole[: len(whole) // 2]):
        with pytest.raises(BadInput, match="masks-train made, or none"):
            BollNetwork(text, "net.onnx")
    with pytest.raises(BadInput, match=r"net\.onnx"):
        from_onnx(whole[: len(whole) // 2], "net.onnx")
    with pytest.raises(MissingInput, match="masks-train made, or none"):
        open_bolls(tmp_path / "none.onnx")


def picture() -> TrainingPicture:
    """Two touching bolls, and a third whose pixels teach nothing."""
    ids = np.zeros((64, 64), np.uint16)
    ids[10:30, 10:30] = 1
    ids[10:30, 30:50] = 2
    classes = np.where(ids > 0, LINT, 0).astype(np.uint8)
    classes[50:, 50:] = UNKNOWN
    image = np.where(ids[..., None] > 0, 220, 60).astype(np.uint8).repeat(3, axis=2)
    image[10:30, 30] = 150
    centres = np.array([[20, 22], [40, 20]], np.float32)
    return TrainingPicture(image, classes, ids, centres, np.array([20, 20], np.float32))


def test_targets_point_to_the_middles_and_mark_the_border():
    classes, wanted, border = targets(picture())
    assert classes[20, 20] == LINT
    np.testing.assert_allclose(wanted[:, 20, 10], [20 - 10.5, 22 - 20.5, 20])
    np.testing.assert_allclose(wanted[:, 0, 0], 0)
    assert border[20, 30 - BORDER_PX : 30 + BORDER_PX].all()
    assert not border[20, 15] and not border[20, 10], "where lint ends at something else there is no other boll"


def perfect_maps() -> torch.Tensor:
    """What the network should give for `picture`, at full size (losses enlarge it, so at twice the size)."""
    classes, wanted, border = targets(picture())
    maps = np.zeros((1, CHANNELS, 64, 64), np.float32)
    maps[0, :5] = -20
    for number in range(5):
        maps[0, number][classes == number] = 20
    maps[0, 5:7] = wanted[:2] / OFFSET_PX
    maps[0, 7] = np.where(border, 20, -20)
    maps[0, 8] = np.log2(np.maximum(wanted[2], 1) / OFFSET_PX)
    return torch.from_numpy(maps)


def test_loss_is_least_where_all_is_right_and_unknown_pixels_teach_nothing():
    arrays = [torch.from_numpy(np.repeat(np.repeat(a[None], 2, -1), 2, -2)) for a in targets(picture())]
    right = losses(perfect_maps(), *arrays)
    for name, value in right.items():
        assert float(value) < 0.35, name
    wrong = perfect_maps()
    wrong[0, 5] += 10 / OFFSET_PX
    assert float(losses(wrong, *arrays)["middles"]) == pytest.approx(float(right["middles"]) + 0.5, abs=0.2)
    elsewhere = perfect_maps()
    elsewhere[0, 0, 52:, 52:] = -20
    elsewhere[0, 3, 52:, 52:] = 20
    assert float(losses(elsewhere, *arrays)["classes"]) == pytest.approx(float(right["classes"]), abs=1e-4)


def test_what_is_only_known_not_to_be_lint_may_be_anything_else():
    classes = torch.full((1, 4, 4), NOT_LINT, dtype=torch.uint8)
    nothing = torch.zeros(1, 3, 4, 4), torch.zeros(1, 4, 4, dtype=torch.bool)
    values = []
    for winner in range(5):
        maps = torch.full((1, CHANNELS, 2, 2), -20.0)
        maps[:, winner] = 20
        values.append(float(losses(maps, classes, *nothing)["classes"]))
    assert values[LINT] > 30
    assert max(values[:LINT] + values[LINT + 1 :]) < 1e-4


def noisy_picture(number: int) -> TrainingPicture:
    base = picture()
    noise = np.random.default_rng(number).integers(0, 20, base.image.shape).astype(np.uint8)
    return TrainingPicture(base.image + noise, base.classes, base.ids, base.centres_px, base.diameters_px)


def first_weights(network: BollsNetwork) -> np.ndarray:
    return network.stem.conv.weight.detach().numpy().copy()


def test_training_learns_and_goes_on_to_the_step_after_a_kill(tmp_path, monkeypatch):
    monkeypatch.setattr("cotton3dg.masks.bolls_training.CHECKPOINT_STEPS", 3)
    settings = TrainingSettings(steps=12, batch=2, makers=0, pretrained=False)
    torch.manual_seed(0)
    whole = BollsNetwork()
    reports = list(train(whole, noisy_picture, settings, tmp_path / "whole.npz"))
    assert [report.step for report in reports] == [3, 6, 9, 12]
    assert reports[-1].losses["classes"] < reports[0].losses["classes"]

    torch.manual_seed(0)
    killed = BollsNetwork()
    for report in train(killed, noisy_picture, settings, tmp_path / "killed.npz"):
        if report.step == 6:
            continue
        if report.step == 9:
            break  # the checkpoint of step 9 is not written any more: that of step 6 is what there is
    again = BollsNetwork()
    steps = [report.step for report in train(again, noisy_picture, settings, tmp_path / "killed.npz")]
    assert steps == [9, 12]
    np.testing.assert_array_equal(first_weights(again), first_weights(whole))


def test_frozen_norms_stay_what_they_were(network, tmp_path):
    tuned = from_onnx(to_onnx(network), "net")
    before = tuned.stem.norm.running_var.clone()
    list(train(tuned, lambda _: picture(), TrainingSettings(steps=1, batch=1, makers=0, frozen_norms=True)))
    torch.testing.assert_close(tuned.stem.norm.running_var, before)
    assert not np.array_equal(first_weights(tuned), first_weights(network))


def test_of_a_pretrained_encoder_the_first_blocks_and_the_norms_stay(network):
    tuned, before = copy.deepcopy(network), network.state_dict()
    list(train(tuned, noisy_picture, TrainingSettings(steps=1, batch=2, makers=0)))
    changed = {name for name, values in tuned.state_dict().items() if not torch.equal(values, before[name])}
    first = ("stem", *(f"stages.{k}" for k in range(2)))
    assert not any(name.startswith(first) for name in changed), "the stem and three blocks"
    assert not any("running" in name for name in changed if name.startswith("stages"))
    assert "stages.2.0.expand.conv.weight" in changed
    assert "up.0.norm.running_mean" in changed and "head.weight" in changed


def test_imagenets_weights_come_where_they_belong():
    weights = published_weights()
    network = BollsNetwork()
    load_imagenet(network, weights)
    network.eval()
    x = torch.rand(1, 112, 8, 8, generator=torch.Generator().manual_seed(0))

    def norm(x: torch.Tensor, name: str) -> torch.Tensor:
        values = [weights[f"_blocks.11.{name}.{key}"] for key in ("running_mean", "running_var", "weight", "bias")]
        return torch.nn.functional.batch_norm(x, *values, eps=1e-3)

    wide = torch.nn.functional.conv2d(x, weights["_blocks.11._expand_conv.weight"])
    wide = norm(wide, "_bn0").clip(0, 6)
    wide = torch.nn.functional.pad(wide, (1, 2, 1, 2))  # "same" padding for a stride of 2
    wide = torch.nn.functional.conv2d(wide, weights["_blocks.11._depthwise_conv.weight"], stride=2, groups=672)
    narrow = torch.nn.functional.conv2d(norm(wide, "_bn1").clip(0, 6), weights["_blocks.11._project_conv.weight"])
    with torch.no_grad():
        torch.testing.assert_close(network.stages[5][0](x), norm(narrow, "_bn2"), rtol=1e-4, atol=1e-4)
    with pytest.raises(BadInput, match="EfficientNet-Lite0"):
        load_imagenet(network, {name: values[:8] for name, values in weights.items()})
    del weights["_bn0.bias"]
    with pytest.raises(BadInput, match="EfficientNet-Lite0"):
        load_imagenet(network, weights)


def test_restored_norms_change_nothing_but_know_the_pictures(network):
    again = from_onnx(to_onnx(network), "net")
    restore_norms(again, noisy_picture, 4)
    image = noisy_picture(9).image
    np.testing.assert_allclose(maps_of(again, image), maps_of(network, image), atol=2e-4)
    again.train_decoder()  # statistics of the batch in place of those kept: about the same on the same pictures
    batch = torch.from_numpy(np.stack([noisy_picture(k).image.transpose(2, 0, 1) for k in range(4)])).float()
    with torch.no_grad():
        of_batch = again(batch).numpy()
    for k in range(4):
        np.testing.assert_allclose(of_batch[k], maps_of(network, noisy_picture(k).image), atol=2e-3)
