"""scale.json: the metric scale of a scene and the evidence for it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ..core.measurements import Scale
from ..errors import BadInput


def scale_facts(scale: Scale) -> dict[str, Any]:
    """The fields of a scale under their own names."""
    return {
        "source": scale.source,
        "cm_per_su": scale.cm_per_su,
        "relative_error": scale.relative_error,
        "up": scale.up.tolist(),
        "plane": scale.plane.tolist(),
        "corners": scale.corners.tolist(),
    }


def read_scale(path: Path) -> Scale | None:
    """The scale that `scale` saved; None when it found none (source `none`).

    Raises:
        BadInput: the file is damaged or its scale is zero, negative or not finite.
    """
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        if facts["source"] == "none":
            return None
        arrays = [np.array(facts[key], np.float64) for key in ("up", "plane", "corners")]
        scale = Scale(float(facts["cm_per_su"]), float(facts["relative_error"]), str(facts["source"]), *arrays)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInput(f"{path.name} is damaged ({error}); make it again with `cotton3dg scale`") from error
    shapes = [array.shape for array in arrays]
    finite = all(np.isfinite(array).all() for array in arrays)
    if shapes != [(3,), (4,), (4, 3)] or not finite or not 0 < scale.cm_per_su < np.inf:
        raise BadInput(f"{path.name} holds no usable scale; make it again with `cotton3dg scale`")
    return scale
