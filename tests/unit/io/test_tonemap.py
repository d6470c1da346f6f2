# SPDX-License-Identifier: Apache-2.0
"""HDR signal levels of the standards become the sRGB levels they should."""

import numpy as np
import pytest

from cotton3dg.io.tonemap import HLG, PQ, tone_map


def grey(signal):
    return np.full((2, 2, 3), round(signal * 65535), np.uint16)


@pytest.mark.parametrize("transfer", [PQ, HLG])
def test_black_is_black_and_brighter_is_never_darker(transfer):
    levels = [tone_map(grey(signal), transfer)[0, 0, 1] for signal in np.linspace(0, 1, 64)]
    assert levels[0] == 0 and levels[-1] >= 250
    assert levels == sorted(levels)


# BT.2408, table 1: diffuse white (203 nits) is 58 % of PQ and 75 % of HLG; a grey card (26 nits) is 38 % of both.
@pytest.mark.parametrize(("transfer", "white", "middle"), [(PQ, 0.58, 0.38), (HLG, 0.75, 0.38)])
def test_reference_levels(transfer, white, middle):
    assert 235 <= tone_map(grey(white), transfer)[0, 0, 0] <= 248
    srgb_of_grey_card = 255 * (1.055 * (26 / 203) ** (1 / 2.4) - 0.055)
    assert tone_map(grey(middle), transfer)[0, 0, 0] == pytest.approx(srgb_of_grey_card, abs=3)


@pytest.mark.parametrize("transfer", [PQ, HLG])
def test_neutral_stays_neutral_and_hue_survives_highlights(transfer):
    mapped = tone_map(grey(0.9), transfer)[0, 0].astype(int)
    assert np.ptp(mapped) <= 1
    red = grey(0.5)
    red[..., 0] = 60000
    r, g, b = tone_map(red, transfer)[0, 0].astype(int)
    assert r > g + 60 and r > b + 60


def test_unknown_transfer_is_a_fault_of_the_caller():
    with pytest.raises(ValueError, match="unknown transfer"):
        tone_map(grey(0.5), "bt709")
