"""Losses on rendered maps of probabilities and features that stay finite where their formulas do not."""

from __future__ import annotations

import torch

PROBABILITY_MARGIN = 1e-4
"""Probabilities are kept this far from 0 and 1: beyond it the logarithm's gradient would hide all others, and at 0 and
1 there would be none that leads back."""

LEAST_LENGTH = 1e-6
"""Features shorter than this have no direction. torch's own 1e-12 would turn rounding errors into unit vectors."""


def binary_cross_entropy(probabilities: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
    """Mean of -t ln p - (1 - t) ln(1 - p), with p held within PROBABILITY_MARGIN of the ends.

    The gradient is that at the margin where p lies beyond it, so that what was driven too far still comes back.
    """
    held = probabilities + (probabilities.clamp(PROBABILITY_MARGIN, 1 - PROBABILITY_MARGIN) - probabilities).detach()
    return -(targets * held.log() + (1 - targets) * (1 - held).log()).mean()


def clamp_probabilities(probabilities: torch.Tensor) -> None:
    """Bring optimised probabilities back within the margin, in place; to be called after every step."""
    with torch.no_grad():
        probabilities.nan_to_num_(0.5).clamp_(PROBABILITY_MARGIN, 1 - PROBABILITY_MARGIN)


def unit_features(features: torch.Tensor) -> torch.Tensor:
    """(N, D) rows at unit length; rows without direction become zero and get no gradient."""
    lengths = features.norm(dim=1, keepdim=True)
    known = lengths > LEAST_LENGTH
    return torch.where(known, features, 0.0) / torch.where(known, lengths, 1.0)
