"""dataparser_transforms.json, which nerfstudio writes beside a model: where its frame lies in that of the cameras."""

from __future__ import annotations

from dataclasses import dataclass

from .document import Document


@dataclass(frozen=True)
class DataparserTransforms(Document):
    """x' = scale (R x + t)."""

    REMEDY = "give the one that nerfstudio wrote beside the model's config.yml"

    transform: tuple[tuple[float, ...], ...]
    """Three rows of R and t."""
    scale: float
