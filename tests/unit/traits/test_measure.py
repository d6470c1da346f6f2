"""What was taken for a boll and does not hang on the plant is told, and is in no sum."""

import numpy as np
import pytest
from scenes.measured_plant import SCALE, bolls_of, measure_plant
from scenes.table_scene import BOLL_RADIUS_CM, gaussians_at, joined, plant_scene

from cotton3dg.core.scene import Gaussians
from cotton3dg.traits.measure import measure_parts, measure_whole


def with_ball_beside(gaussians: Gaussians, labels: np.ndarray) -> tuple[Gaussians, np.ndarray]:
    """A scene with a white ball on the table that passes for one boll more."""
    ball = np.random.default_rng(1).normal(size=(400, 3))
    ball = BOLL_RADIUS_CM * ball / np.linalg.norm(ball, axis=1, keepdims=True)
    beside = gaussians_at(np.array([50.0, 20.0, 8.0]) + ball, 0.2)
    return joined(gaussians, beside), np.append(labels, np.full(len(ball), labels.max() + 1))


def test_what_stands_beside_the_plant_is_flagged_and_not_part_of_its_size():
    """A white ball on the table, taken for a boll, and a boll that fell between plant and rim."""
    gaussians, labels = plant_scene()
    with_ball, with_labels = with_ball_beside(gaussians, labels)
    alone = measure_plant(gaussians, bolls_of(gaussians, labels), SCALE, 0.0, 4.0)
    both = measure_plant(with_ball, bolls_of(with_ball, with_labels), SCALE, 0.0, 4.0)
    assert "bolls_off_plant" not in alone.flags
    assert "bolls_off_plant" in both.flags
    assert [boll.flags for boll in both.bolls] == [(), (), (), (), ("off_plant",)]
    assert any("boll 5" in warning for warning in both.warnings)
    for trait in ("plant_height_cm", "canopy_size_cm", "plant_height_published_cm"):
        assert getattr(both.traits, trait) == pytest.approx(getattr(alone.traits, trait), rel=1e-3)
    assert both.traits.boll_count_error == pytest.approx(np.hypot(alone.traits.boll_count_error, 0.5))
    assert both.traits.boll_count_interval[0] <= 4
    assert both.traits.boll_count == alone.traits.boll_count == 4
    assert "doubtful_bolls" not in both.flags
    assert both.traits.boll_volume_cm3 == pytest.approx(alone.traits.boll_volume_cm3, rel=1e-6)
    assert both.traits.boll_height_min_cm == pytest.approx(alone.traits.boll_height_min_cm)


def test_a_boll_that_a_person_added_is_of_the_plant_wherever_it_is():
    gaussians, labels = plant_scene()
    both, with_labels = with_ball_beside(gaussians, labels)
    bolls = bolls_of(both, with_labels)
    for added, count in (((), 4), ((5,), 5)):
        measured = measure_whole(measure_parts(both, bolls, SCALE, 0.0, 4.0, added=added))
        assert measured.traits.boll_count == count
        assert len(measured.bolls) == 5
    assert "bolls_off_plant" not in measured.flags
    halves = measure_whole(measure_parts(both, bolls, SCALE, 0.0, 4.0), halves=(5, 4)).traits.boll_count_halves
    assert halves == (4, 3)
