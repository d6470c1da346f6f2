# SPDX-License-Identifier: Apache-2.0
"""The picture of accuracy against time."""

import numpy as np
from matplotlib.colors import to_hex

from cotton3dg.io.images import read_image
from cotton3dg.io.tradeoff_plot import Dot, Panel, plot_tradeoff, write_tradeoff
from cotton3dg.study.settings import TITLES


def drawn(axes):
    """Colour and places of the dots of each series."""
    return {
        dots.get_label(): (to_hex(dots.get_facecolor()[0]), dots.get_offsets().tolist()) for dots in axes.collections
    }


def test_each_sweep_has_its_colour_and_each_dot_is_drawn():
    dots = [Dot("steps", str(n), 10.0 * n, 20.0 + n, True) for n in range(1, 4)]
    dots += [Dot("views", "4", 25.0, 20.5, False)]
    figure = plot_tradeoff([Panel("PSNR", dots), Panel("error", dots)], "seconds")
    first, second = (drawn(axes) for axes in figure.axes)
    assert first == second and first["steps"][0] != first["views"][0]
    assert first["steps"][1] == [[10, 21], [20, 22], [30, 23]] and first["views"][1] == [[25, 20.5]]
    assert [words.get_text() for words in figure.legends[0].texts] == ["steps", "views"]
    front = figure.axes[0].lines[0]
    assert front.get_xydata().tolist() == first["steps"][1]
    assert front.get_drawstyle() == "steps-post", "a setting is the best until the next one is done"


def test_base_and_every_sweep_differ_in_colour():
    names = ["base", *TITLES]
    figure = plot_tradeoff([Panel("", [Dot(name, "", 1.0, 1.0, False) for name in names])], "s")
    assert len({colour for colour, _ in drawn(figure.axes[0]).values()}) == len(names)


def test_times_are_on_a_logarithmic_axis():
    figure = plot_tradeoff([Panel("", [Dot("a", "", 10.0**n, 0.0, False) for n in range(3)])], "s")
    places = figure.axes[0].transData.transform([(1, 0), (10, 0), (100, 0)])[:, 0]
    np.testing.assert_allclose(*np.diff(places))


def test_no_label_covers_another():
    dots = [Dot("a", f"setting {n}", 10.0 + 0.01 * n, 20.0, n == 0) for n in range(12)]
    dots.append(Dot("a", "far", 1000.0, 0.0, False))
    texts = plot_tradeoff([Panel("", dots)], "s").axes[0].texts
    boxes = [words.get_window_extent() for words in texts]
    assert 1 < len(boxes) < len(dots), "there is room for some"
    assert not any(box.count_overlaps(boxes[:n]) for n, box in enumerate(boxes))


def test_one_dot_and_none_are_no_trouble(tmp_path):
    for panels, width in (([Panel("", [])], 750), ([Panel("", [Dot("a", "1", 5.0, 0.0, True)]), Panel("", [])], 1500)):
        write_tradeoff(tmp_path / "a.part", panels, "s")
        (tmp_path / "a.part").replace(tmp_path / "a.png")
        assert read_image(tmp_path / "a.png").shape == (660, width, 3)
