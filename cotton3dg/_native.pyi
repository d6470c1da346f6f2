# SPDX-License-Identifier: Apache-2.0
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]

class View:
    def __init__(
        self,
        width: int,
        height: int,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        cam_from_scene: NDArray[Any],
        near_plane: float,
        window: tuple[int, int, int, int] | None = None,
    ) -> None: ...

def instruction_sets() -> list[str]: ...
def instruction_set() -> str: ...
def use_instruction_set(name: str) -> None: ...
def render(
    gaussians: Arrays, view: View, sh_degree: int, background: NDArray[Any], threads: int
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]: ...
def render_values(
    gaussians: Arrays, values: NDArray[Any], view: View, background: NDArray[Any], threads: int
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]: ...
def accumulate_weights(
    gaussians: Arrays, view: View, mask_ids: NDArray[Any], threads: int
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]: ...
def ray_weights(
    gaussians: Arrays, view: View, pixels: NDArray[Any], threads: int
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[Any]]: ...
def match_descriptors(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> tuple[NDArray[np.int32], NDArray[np.int32]]: ...
def line_evidence(
    pictures: list[NDArray[np.uint8]],
    views: list[View],
    places: NDArray[Any],
    directions: NDArray[Any],
    colours: NDArray[Any],
    aside_px: tuple[float, ...],
    noise: float,
    colour_share: float,
    threads: int,
) -> tuple[NDArray[Any], NDArray[Any]]: ...

class LearningRates:
    def __init__(
        self,
        *,
        means: float,
        quats: float,
        log_scales: float,
        opacity_logits: float,
        sh0: float,
        sh_rest: float,
        beta1: float,
        beta2: float,
        epsilon: float,
    ) -> None: ...

class OptimiserState:
    def __init__(self, *, gaussians: Arrays, first: Arrays, second: Arrays, steps: NDArray[Any]) -> None: ...

class Statistics:
    def __init__(self, *, abs_grad_px: NDArray[Any], weight: NDArray[Any], count: NDArray[Any]) -> None: ...

def train_step(
    *,
    state: OptimiserState,
    statistics: Statistics,
    view: View,
    sh_degree: int,
    background: NDArray[Any],
    target: NDArray[Any],
    dssim: float,
    rates: LearningRates,
    rate_factors: NDArray[Any],
    threads: int,
) -> dict[str, Any]: ...

class for_tests:  # noqa: N801  # a submodule
    @staticmethod
    def available_memory(root: str) -> int: ...
    @staticmethod
    def pretend_available_memory(bytes: int) -> None: ...
    @staticmethod
    def image_loss(
        image: NDArray[Any], target: NDArray[Any], dssim: float, threads: int
    ) -> tuple[dict[str, float], NDArray[Any]]: ...
    @staticmethod
    def gradients(
        gaussians: Arrays,
        view: View,
        sh_degree: int,
        background: NDArray[Any],
        target: NDArray[Any],
        dssim: float,
        threads: int,
    ) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]: ...
    @staticmethod
    def image_gradient(
        gaussians: Arrays, view: View, sh_degree: int, background: NDArray[Any], v_image: NDArray[Any], threads: int
    ) -> tuple[dict[str, Any], dict[str, NDArray[Any]], dict[str, Any]]: ...
