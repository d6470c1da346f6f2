"""Edges of lint in one image: what the network is told, that it learns, and that the shipped one finds shaded lint."""

import cv2
import numpy as np
import pytest
import torch

from cotton3dg.errors import BadInput
from cotton3dg.masks.edge_training import EdgePicture, build_network, to_onnx, train_edges, varied
from cotton3dg.masks.lint_edges import CHANNELS, EdgeNetwork, describe, open_edges

WALL, LINT = (90, 120, 150), (235, 232, 225)


def scene(side=160, radius=14, shade=0.0, seed=0):
    """Discs of lint before a wall of bricks, with knowledge that is right about where and blurred: an `EdgePicture`."""
    rng = np.random.default_rng(seed)
    true = np.zeros((side, side), np.uint16)
    for number, (y, x) in enumerate([(45, 40), (50, 115), (115, 75)], start=1):
        cv2.circle(true, (x, y), radius, number, -1)
    image = np.where(true[..., None] > 0, LINT, WALL).astype(np.float32)
    down = (np.arange(side)[:, None] % 70) / 70
    image *= np.where(true > 0, 1 - shade * (down > 0.75), 1)[..., None]
    image = (image + rng.normal(0, 4, image.shape)).clip(0, 255).astype(np.uint8)
    soft = cv2.GaussianBlur((true > 0).astype(np.float32), (0, 0), 2.5)
    moved = np.roll(soft, (1, -1), (0, 1))
    return EdgePicture(image, moved, soft, true)


def overlap(found, true):
    return (found & (true > 0)).sum() / (found | (true > 0)).sum()


def test_what_the_network_is_told():
    seen = scene()
    told = describe(seen.image, seen.share, seen.likely)
    assert told.shape == (CHANNELS, *seen.true.shape) and told.dtype == np.float32 and np.isfinite(told).all()
    core, wall = seen.share > 0.95, (seen.share < 0.01) & (cv2.GaussianBlur(seen.share, (0, 0), 6) > 0.05)
    along, beside, length = told[:3]
    np.testing.assert_allclose(np.median(along[core]), 1, atol=0.05)
    np.testing.assert_allclose(np.median(along[wall]), 0, atol=0.05)
    assert np.median(beside[core | wall]) < 0.2 and np.median(length[core]) > 0.3


@pytest.mark.parametrize("value", [0, 255])
def test_nothing_to_compare_with_is_no_number_out_of_bounds(value):
    image, none = np.full((40, 50, 3), value, np.uint8), np.zeros((40, 50), np.float32)
    for share in (none, none + 1):
        assert np.isfinite(describe(image, share, none)).all()
    assert not open_edges().find_lint(image, none, none, 25.0).any()


@pytest.mark.parametrize("shade", [0.0, 0.4])
def test_the_shipped_network_puts_the_edge_where_the_image_has_it(shade):
    seen = scene(shade=shade)
    found = open_edges().find_lint(seen.image, seen.share, seen.likely, 28.0)
    assert overlap(found, seen.true) > 0.93 > overlap(seen.share > 0.5, seen.true)


def test_large_bolls_are_seen_smaller():
    seen, factor = scene(), 6
    larger = [cv2.resize(v, None, fx=factor, fy=factor) for v in (seen.image, seen.share, seen.likely)]
    found = open_edges().find_lint(*larger, 28.0 * factor)
    assert found.shape == larger[1].shape
    true = cv2.resize(seen.true, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST)
    assert overlap(found, true) > 0.9


@pytest.mark.slow
def test_training_teaches_what_its_pictures_show_and_is_repeatable():
    pictures = [scene(seed=seed) for seed in range(3)]
    first, again = (to_onnx(train_edges(pictures, 60, seed=1)) for _ in "ab")
    assert first == again
    unseen = scene(radius=11, seed=9)
    found = EdgeNetwork(first, "trained").find_lint(unseen.image, unseen.share, unseen.likely, 22.0)
    assert overlap(found, unseen.true) > overlap(unseen.share > 0.5, unseen.true)


def test_opencv_computes_what_torch_does():
    torch.manual_seed(0)
    network, seen = build_network(), scene()
    told = describe(seen.image, seen.share, seen.likely)
    with torch.no_grad():
        wanted = network(torch.from_numpy(told)[None])[0, 0].numpy()
    np.testing.assert_allclose(EdgeNetwork(to_onnx(network), "random")._logits(told[None])[0], wanted, atol=1e-4)


def test_tiles_say_what_the_whole_says():
    seen, network = scene(side=150), open_edges()
    told, inner = describe(seen.image, seen.share, seen.likely), slice(3, -3)
    asked = seen.share > 0.05
    whole, tiled = network._logits(told[None])[0], network._logits_where(asked, told)
    np.testing.assert_allclose(
        tiled[inner, inner][asked[inner, inner]], whole[inner, inner][asked[inner, inner]], atol=1e-4
    )
    assert (tiled == -1).sum() > 0.2 * tiled.size and not (tiled == -1)[asked].any()


def test_pictures_are_varied_within_bounds():
    rng, seen = np.random.default_rng(0), scene()
    for _ in range(5):
        other = varied(seen, rng)
        assert other.image.dtype == np.uint8 and not np.array_equal(other.image, seen.image)
        for known in (other.share, other.likely):
            assert known.dtype == np.float32 and known.min() >= 0 and known.max() <= 1
        assert other.true is seen.true


def test_foreign_weights_are_named():
    with pytest.raises(BadInput, match=r"mine\.onnx is not a network of edges"):
        EdgeNetwork(b"not a network", "mine.onnx")
