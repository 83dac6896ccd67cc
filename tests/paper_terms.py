"""Terms of Part2GS as printed that tests compare the product with: eq. 4, and grid distances."""

from __future__ import annotations

import torch
from torch import Tensor

from part2gs_robotics.paper.losses import SignedDistance


def part_log_probs(
    embeddings: Tensor, weight: Tensor, bias: Tensor, temperature: float = 1.0
) -> Tensor:
    """Return [N, K+1] log F(G_i) = log softmax((W rho_i + b) / temperature).

    Args:
        embeddings: [N, d] rho; d = K+1 with W = 1 and b = 0 makes them plain logits.
        weight: [K+1, d] W.
        bias: [K+1] b.
        temperature: > 0; 1 = as printed, towards 0 = hard.

    Source: Part2GS eq. 4.
    """
    return torch.log_softmax((embeddings @ weight.T + bias) / temperature, -1)


def part_kl_loss(log_probs: Tensor, neighbors: Tensor, floor: float = 1e-6) -> Tensor:
    """Return L_part = mean_i KL(F(G_i) || mean_{j in N(i)} F(G_j)), a scalar.

    Alone it is least when one part holds everything: it needs evidence beside it.

    Args:
        log_probs: [N, K+1] of `part_log_probs`.
        neighbors: [N, k] of `part_neighbors`; k = 0 gives 0.
        floor: added to the neighbourhood's mean, so that a part absent there costs at most
            -log(floor) instead of infinity.

    Source: Part2GS eq. 4.
    """
    if neighbors.numel() == 0:
        return log_probs.sum() * 0.0
    probs = log_probs.exp()
    around = probs[neighbors].mean(1)
    return (probs * (log_probs - (around + floor).log())).sum(-1).mean()


def grid_signed_distance(grid: Tensor, origin: Tensor, voxel: float) -> SignedDistance:
    """Return the trilinear signed distance of a [X, Y, Z] grid, constant beyond its border.

    Args:
        grid: [X, Y, Z] distances in scene units, negative inside; each side >= 2.
        origin: [3] world position of node (0, 0, 0).
        voxel: node spacing, scene units.
    """
    last = torch.tensor(grid.shape, dtype=grid.dtype) - 1.0

    def distance(points: Tensor) -> Tensor:
        place = torch.minimum(((points - origin) / voxel).clamp_min(0.0), last)
        low = torch.minimum(place.detach().floor(), last - 1.0)
        x, y, z = (place - low).unbind(-1)
        i, j, k = low.long().unbind(-1)
        plane = [
            (1 - z) * ((1 - y) * grid[i + a, j, k] + y * grid[i + a, j + 1, k])
            + z * ((1 - y) * grid[i + a, j, k + 1] + y * grid[i + a, j + 1, k + 1])
            for a in (0, 1)
        ]
        return (1 - x) * plane[0] + x * plane[1]

    return distance
