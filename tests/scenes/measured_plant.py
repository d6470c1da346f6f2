"""A plant measured in one call."""

from collections.abc import Sequence

from numpy.typing import NDArray

from cotton3dg.core.bolls import BollInstance
from cotton3dg.core.measurements import Scale
from cotton3dg.core.scene import Gaussians
from cotton3dg.traits.error_model import WELL_FILMED, Filming
from cotton3dg.traits.measure import Measured, measure_parts, measure_whole


def measure_plant(
    gaussians: Gaussians,
    bolls: Sequence[BollInstance],
    scale: Scale | None,
    pixel_su: float,
    clamp_cm: float,
    filming: Filming = WELL_FILMED,
    thin_ends: Sequence[NDArray] = (),
) -> Measured:
    parts = measure_parts(gaussians, bolls, scale, pixel_su, clamp_cm, filming=filming)
    return measure_whole(parts, thin_ends=thin_ends)
