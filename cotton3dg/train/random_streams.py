# SPDX-License-Identifier: Apache-2.0
"""Random numbers of the training: one seed gives each purpose a stream of its own."""

from __future__ import annotations

import zlib

import numpy as np


def open_stream(seed: int, purpose: str) -> np.random.Generator:
    """The random stream of `purpose` with `seed`; it is independent of the streams of other purposes."""
    return np.random.default_rng([seed, zlib.crc32(purpose.encode())])
