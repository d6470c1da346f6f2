# SPDX-License-Identifier: Apache-2.0
"""Pieces of annotated photos, to learn from."""

import numpy as np

from cotton3dg.core.training_picture import LINT, NOT_LINT
from cotton3dg.masks.annotated_pictures import AnnotatedPhoto, cut_picture


def annotated() -> AnnotatedPhoto:
    ids = np.zeros((120, 160), np.uint16)
    ids[30:60, 40:70], ids[30:60, 70:100] = 7, 9
    image = np.where(ids[..., None] > 0, 200, 40).astype(np.uint8).repeat(3, axis=2)
    return AnnotatedPhoto(image, ids)


def test_pieces_of_annotated_photos_keep_their_bolls():
    counts = []
    for number in range(30):
        picture = cut_picture(np.random.default_rng(number), [annotated()], 64)
        assert set(np.unique(picture.classes)) <= {LINT, NOT_LINT}
        assert picture.ids.max() == len(picture.centres_px)
        counts.append(len(picture.centres_px))
        for boll in range(1, len(picture.centres_px) + 1):
            rows, columns = np.nonzero(picture.ids == boll)
            x, y = picture.centres_px[boll - 1]
            assert columns.min() <= x <= columns.max() + 1 and rows.min() <= y <= rows.max() + 1
    assert max(counts) == 2
