"""The picture of accuracy against time."""

import numpy as np

from cotton3dg.files.tradeoff_plot import COLOURS, HEIGHT, WIDTH, Dot, Panel, tradeoff
from cotton3dg.study.settings import TITLES


def n_pixels(picture, colour):
    return int((picture == colour).all(axis=2).sum())


def test_each_sweep_has_its_colour_and_each_dot_is_drawn():
    dots = [Dot("steps", str(n), 10.0 * n, 20.0 + n, True) for n in range(1, 4)]
    dots += [Dot("views", "4", 25.0, 20.5, False)]
    one = tradeoff([Panel("PSNR", dots)], "seconds")
    two = tradeoff([Panel("PSNR", dots), Panel("error", dots)], "seconds")
    assert one.shape == two.shape == (HEIGHT, WIDTH, 3)
    for colour, n in ((COLOURS[0], 3), (COLOURS[1], 1)):
        disc, key = n_pixels(two, colour) - n_pixels(one, colour), n_pixels(one, colour)
        assert disc >= 60 * n and key > disc  # the key has one more
    assert n_pixels(one, COLOURS[2]) == 0


def test_base_and_every_sweep_differ_in_colour():
    assert len(set(COLOURS)) == len(COLOURS) > len(TITLES)


def test_times_are_on_a_logarithmic_axis():
    def middle(seconds):
        dots = [Dot("a", "", 1.0, 0.0, False), Dot("b", "", seconds, 1.0, False), Dot("a", "", 100.0, 0.0, False)]
        columns = np.flatnonzero((tradeoff([Panel("", dots)], "s")[80:560] == COLOURS[1]).all(axis=2).any(axis=0))
        return columns.mean()

    step = middle(10.0) - middle(1.0)
    assert abs(middle(100.0) - middle(10.0) - step) <= 1.5


def test_one_dot_and_none_are_no_trouble():
    assert (tradeoff([Panel("", [])], "s") == 255).all()
    assert (tradeoff([Panel("", [Dot("a", "1", 5.0, 0.0, True)])], "s") != 255).any()
