# SPDX-License-Identifier: Apache-2.0
"""The rasterizer of cotton3dg once more, in plain float64 torch: slow, short, and differentiable by autograd.

It states what native/src computes. Every Gaussian is blended over every pixel; there are no tiles, no SIMD and no
hand-written gradients.
"""

from __future__ import annotations

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812

ALPHA_CAP, ALPHA_CUT, STOP, DILATION, MAX_LOG_SCALE = 0.99, 1 / 255, 1e-4, 0.3, 30.0


def rotation_matrices(quats: torch.Tensor) -> torch.Tensor:
    """(N, 3, 3) of (N, 4) wxyz quaternions of any length."""
    w, x, y, z = F.normalize(quats, dim=1, eps=1e-40).T
    return torch.stack(
        [
            torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            torch.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
            torch.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
        ],
        1,
    )


def sh_basis(directions: torch.Tensor, degree: int) -> torch.Tensor:
    """(N, (degree + 1)²) real spherical harmonics with the signs and constants of Kerbl et al."""
    x, y, z = directions.T
    xx, yy, zz = x * x, y * y, z * z
    basis = [
        torch.full_like(x, 0.28209479177387814),
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (2 * zz - xx - yy),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3 * xx - yy),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (4 * zz - xx - yy),
        0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
        -0.4570457994644658 * x * (4 * zz - xx - yy),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3 * yy),
    ]
    return torch.stack(basis[: (degree + 1) ** 2], 1)


def colours(means: torch.Tensor, sh: torch.Tensor, camera, degree: int) -> torch.Tensor:
    """(N, 3) view-dependent colour, not negative."""
    directions = F.normalize(means - torch.from_numpy(camera.centre), dim=1)
    basis = sh_basis(directions, degree)
    return torch.relu(0.5 + torch.einsum("nk,nkc->nc", basis, sh[:, : basis.shape[1]]))


def footprints(means, quats, log_scales, camera):
    """Projected means (N, 2) px, inverse covariances (N, 2, 2) px⁻² and depths (N,) su.

    The determinant is the sum of the factor's squared minors plus what the dilation adds: needles stay exact.
    """
    pose = torch.from_numpy(camera.cam_from_scene)
    in_camera = means @ pose[:, :3].T + pose[:, 3]
    z = in_camera[:, 2]
    focal = torch.tensor([camera.fx, camera.fy], dtype=torch.float64)
    centre = torch.tensor([camera.cx, camera.cy], dtype=torch.float64)
    size = torch.tensor([camera.width, camera.height], dtype=torch.float64)
    ratio = in_camera[:, :2] / z[:, None]
    margin = 0.15 * size / focal
    clamped = torch.minimum(torch.maximum(ratio, -centre / focal - margin), (size - centre) / focal + margin)
    jacobian = torch.zeros(len(means), 2, 3, dtype=torch.float64)
    jacobian[:, 0, 0] = focal[0] / z
    jacobian[:, 1, 1] = focal[1] / z
    jacobian = torch.cat([jacobian[:, :, :2], (-focal * clamped / z[:, None])[:, :, None]], 2)
    scales = torch.exp(torch.clamp(log_scales, -MAX_LOG_SCALE, MAX_LOG_SCALE))
    factor = jacobian @ pose[:, :3] @ rotation_matrices(quats) @ torch.diag_embed(scales)
    xx, xy, _, yy = (factor @ factor.mT).flatten(1).T
    minors = torch.linalg.cross(factor[:, 0], factor[:, 1])
    determinants = minors.square().sum(1) + DILATION * (xx + yy) + DILATION**2
    conics = torch.stack([yy + DILATION, -xy, -xy, xx + DILATION], 1).view(-1, 2, 2) / determinants[:, None, None]
    return focal * ratio + centre, conics, z


def blend(means, quats, log_scales, opacity_logits, values, camera, background, near_su):
    """Image (H, W, C) and transmittance (H, W) of any per-Gaussian values (N, C)."""
    centres, conics, z = footprints(means, quats, log_scales, camera)
    opacities = torch.sigmoid(opacity_logits)
    order = np.lexsort((np.arange(len(z)), z.detach().numpy()))
    y, x = torch.meshgrid(torch.arange(camera.height) + 0.5, torch.arange(camera.width) + 0.5, indexing="ij")
    pixels = torch.stack([x, y], -1).double()
    image = torch.zeros(camera.height, camera.width, values.shape[1], dtype=torch.float64)
    transmittance = torch.ones(camera.height, camera.width, dtype=torch.float64)
    for i in order:
        if z[i] < near_su:
            continue
        d = pixels - centres[i]
        alpha = opacities[i] * torch.exp(-0.5 * (d @ conics[i] * d).sum(-1))
        taken = (alpha >= ALPHA_CUT) & (transmittance > STOP)
        alpha = torch.where(taken, torch.clamp(alpha, max=ALPHA_CAP), 0.0)
        image = image + (transmittance * alpha)[..., None] * values[i]
        transmittance = transmittance * (1 - alpha)
    return image + transmittance[..., None] * background, transmittance


def render(means, quats, log_scales, opacity_logits, sh, camera, degree, background, near_su):
    """Image (H, W, 3) of the spherical harmonics."""
    values = colours(means, sh, camera, degree)
    return blend(means, quats, log_scales, opacity_logits, values, camera, background, near_su)[0]


def ssim_map(image: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """(1, 3, H, W) structural similarity of two (H, W, 3) images."""
    offsets = torch.arange(-5, 6, dtype=torch.float64)
    window = torch.exp(-(offsets**2) / (2 * 1.5**2))
    window = window / window.sum()
    kernel = (window[:, None] * window)[None, None].expand(3, 1, 11, 11)

    def blur(a: torch.Tensor) -> torch.Tensor:
        return F.conv2d(a, kernel, padding=5, groups=3)

    a, b = image.permute(2, 0, 1)[None], target.permute(2, 0, 1)[None]
    mean_a, mean_b = blur(a), blur(b)
    var_a, var_b = blur(a * a) - mean_a**2, blur(b * b) - mean_b**2
    covariance = blur(a * b) - mean_a * mean_b
    c1, c2 = 0.01**2, 0.03**2
    return ((2 * mean_a * mean_b + c1) * (2 * covariance + c2)) / ((mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2))


def loss(image: torch.Tensor, target: np.ndarray, dssim: float) -> torch.Tensor:
    """(1 - dssim) L1 + dssim (1 - SSIM), a mean over pixels."""
    photograph = torch.from_numpy(target.astype(np.float64) / 255.0)
    l1 = (image - photograph).abs().mean()
    return (1 - dssim) * l1 + dssim * (1 - ssim_map(image, photograph).mean())
