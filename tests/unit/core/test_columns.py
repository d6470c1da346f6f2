# SPDX-License-Identifier: Apache-2.0
"""Units of columns, in tables and in data exchange."""

import pytest

from cotton3dg.core.columns import columns_of
from cotton3dg.core.measurements import BollTraits, LintColour, PlantEvidence, PlantTraits

COLUMNS = {kind: columns_of(kind) for kind in (BollTraits, PlantTraits, PlantEvidence, LintColour)}


@pytest.mark.parametrize("kind", COLUMNS)
def test_a_number_has_a_unit(kind):
    """Without one, `compare` and `repeat` take it for text."""
    assert [column.name for column in COLUMNS[kind] if column.digits is not None and not column.unit] == []


def test_only_whole_numbers_without_a_unit_are_counts():
    named = {column.name: column.scale_name for kind in COLUMNS for column in COLUMNS[kind]}
    assert named["boll_count"] == named["boll_count_low"] == "count"
    assert named["boll_count_error"] == named["lint_cie_l"] == named["confidence"] == "1"
    assert named["plant_height_cm"] == "cm"
