"""Keeps losses on rendered feature maps finite where their formulas are not."""

from __future__ import annotations

from typing import Final

import torch

LEAST_LENGTH: Final = 1e-6
"""Features shorter than this have no direction. torch's own 1e-12 would turn rounding errors into unit vectors."""


def normalise(features: torch.Tensor) -> torch.Tensor:
    """(N, D) rows at unit length; rows without direction become zero and get no gradient."""
    lengths = features.norm(dim=1, keepdim=True)
    known = lengths > LEAST_LENGTH
    return torch.where(known, features, 0.0) / torch.where(known, lengths, 1.0)
