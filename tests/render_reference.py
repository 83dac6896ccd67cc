"""Slow float64 renderer in torch with autograd: the truth that the fast kernels are tested against.

Every Gaussian is evaluated at every pixel, with matrix products and inverses as the equations are
printed; nothing is shared with the Numba kernels but the constants of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

ALPHA_MAX = 0.99
ALPHA_MIN = 1.0 / 255.0
LOW_PASS = 0.3
FOV_MARGIN = 0.3
NEAR = 0.01  # internal units, as in render.cpu
STOP = 1e-4


@dataclass(frozen=True)
class ReferenceImages:
    """Images of render_reference, differentiable except median_depth.

    Attributes:
        color: [H, W, 3], background included.
        alpha: [H, W].
        depth: [H, W] sum of w_i z_i.
        extra: [H, W, C].
        median_depth: [H, W], 0 where alpha < 0.5.
    """

    color: Tensor
    alpha: Tensor
    depth: Tensor
    extra: Tensor
    median_depth: Tensor


def render_reference(means: Tensor, quats: Tensor, scales: Tensor, opacities: Tensor,
                     colors: Tensor, viewmat: Tensor, K: Tensor, width: int, height: int, *,
                     extra: Tensor | None = None, background: Tensor | None = None
                     ) -> ReferenceImages:
    """Render Gaussians as render.cpu does, from float64 tensors one by one.

    Args:
        means: [N, 3] world frame, scene units.
        quats: [N, 4] wxyz of any length.
        scales: [N, 3] standard deviations, scene units.
        opacities: [N] in [0, 1].
        colors: [N, 3].
        viewmat: [4, 4] camera_from_world, OpenCV axes.
        K: [3, 3] pixels, pixel centres at +0.5.
        width: pixels.
        height: pixels.
        extra: [N, C] further channels.
        background: [3]; black without.

    Returns:
        The images. Source: Kerbl 2023, eqs. 3 to 6.
    """
    extra = means.new_zeros((len(means), 0)) if extra is None else extra
    background = means.new_zeros(3) if background is None else background
    camera_means = means @ viewmat[:3, :3].T + viewmat[:3, 3]
    centers, covariances = _project(camera_means, _covariances(quats, scales), viewmat, K,
                                    width, height)
    channels = torch.cat([colors, camera_means[:, 2:], extra], dim=1)
    grid = torch.stack(torch.meshgrid(torch.arange(width), torch.arange(height), indexing="xy"),
                       dim=-1).to(means.dtype) + 0.5
    through = means.new_ones((height, width))
    image = means.new_zeros((height, width, channels.shape[1]))
    median = means.new_zeros((height, width))
    for i in torch.argsort(camera_means[:, 2].detach(), stable=True):
        if camera_means[i, 2] <= NEAR:
            continue
        alpha = _alpha(grid - centers[i], covariances[i], opacities[i])
        alpha = torch.where(through >= STOP, alpha, 0.0)
        crossing = (alpha > 0) & (through >= 0.5)
        median = torch.where(crossing, camera_means[i, 2].detach(), median)
        image = image + (through * alpha)[..., None] * channels[i]
        through = through * (1.0 - alpha)
    median = torch.where(through < 0.5, median, 0.0)
    return ReferenceImages(image[..., :3] + through[..., None] * background, 1.0 - through,
                           image[..., 3], image[..., 4:], median)


def _covariances(quats: Tensor, scales: Tensor) -> Tensor:
    """[N, 3, 3] covariances R S S R^T in the world frame. Source: Kerbl 2023, eq. 6."""
    w, x, y, z = (quats / quats.norm(dim=1, keepdim=True)).unbind(dim=1)
    rows = (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
    rotations = torch.stack(rows, dim=1).reshape(-1, 3, 3)
    return rotations @ torch.diag_embed(scales**2) @ rotations.transpose(1, 2)


def _project(camera_means: Tensor, covariances: Tensor, viewmat: Tensor, K: Tensor, width: int,
             height: int) -> tuple[Tensor, Tensor]:
    """[N, 2] centres and [N, 2, 2] covariances in pixels. Source: Kerbl 2023, eq. 5."""
    z = camera_means[:, 2]
    ratios = camera_means[:, :2] / z[:, None]
    focal, center = torch.stack([K[0, 0], K[1, 1]]), torch.stack([K[0, 2], K[1, 2]])
    size = torch.tensor([width, height], dtype=z.dtype)
    margin = FOV_MARGIN * 0.5 * size / focal
    held = torch.maximum(torch.minimum(ratios, (size - center) / focal + margin),
                         -center / focal - margin)
    zero = torch.zeros_like(z)
    jacobian = torch.stack([focal[0] / z, zero, -focal[0] * held[:, 0] / z,
                            zero, focal[1] / z, -focal[1] * held[:, 1] / z], dim=1)
    j_w = jacobian.reshape(-1, 2, 3) @ viewmat[:3, :3]
    flat = j_w @ covariances @ j_w.transpose(1, 2) + LOW_PASS * torch.eye(2, dtype=z.dtype)
    return ratios * focal + center, flat


def _alpha(offset: Tensor, covariance: Tensor, opacity: Tensor) -> Tensor:
    """[H, W] opacity of one Gaussian at offsets [H, W, 2] from its centre."""
    exponent = -0.5 * torch.einsum("hwi,ij,hwj->hw", offset, torch.linalg.inv(covariance), offset)
    alpha = opacity * torch.exp(exponent)
    return torch.where(alpha >= ALPHA_MIN, alpha.clamp(max=ALPHA_MAX), 0.0)
