"""Part identity of every Gaussian: embedding -> softmax, and the KL neighbourhood term."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64, I64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.points import tree_of
from part2gs_robotics.model.se3 import rotation_from_quats

CANDIDATES = 3  # candidates per kept neighbour; 3 k of a surface still lie within two spacings
HARD_FROM = 2 / 3  # identities are hard in the last third (method 6.5)
START_TEMPERATURE, END_TEMPERATURE = 1.0, 0.1  # as ArtGS anneals its slots


def part_temperature(step: int, num_steps: int) -> float:
    """Return the softmax temperature: a half cosine from 1 to 0.1 over the soft two thirds."""
    done = min(step / max(HARD_FROM * num_steps, 1.0), 1.0)
    swing = 0.5 * (1.0 + float(np.cos(np.pi * done)))
    return END_TEMPERATURE + (START_TEMPERATURE - END_TEMPERATURE) * swing


def is_hard(step: int, num_steps: int) -> bool:
    """Return whether identities are hard at this step (last third)."""
    return step >= HARD_FROM * num_steps


def part_neighbors(
    means: NDArray[np.floating],
    k: int = 8,
    normals: NDArray[np.floating] | None = None,
    colors: NDArray[np.floating] | None = None,
    normal_weight: float = 4.0,
    color_weight: float = 4.0,
) -> I64:
    """Return [N, min(k, N-1)] neighbours in space, preferring like normals and colours.

    Picks the k least of (d / d_k)^2 + normal_weight (1 - (n.n')^2) + color_weight |c - c'|^2
    among the 3 k nearest, d_k = distance of the k-th: at weight 4 a right angle counts as much
    as twice the distance, so a door's neighbours lie on the door before its frame's side.

    Args:
        means: [N, 3] scene units.
        k: number of neighbours.
        normals: [N, 3] unit, sign free.
        colors: [N, 3] in 0..1.
        normal_weight: 0 = blind to normals.
        color_weight: 0 = blind to colours.
    """
    count = min(k, len(means) - 1)
    if count <= 0:
        return np.zeros((len(means), 0), np.int64)
    distance, index = _candidates(
        np.asarray(means, np.float64), min(CANDIDATES * k, len(means) - 1)
    )
    # Where k coincide, the others are far: 1e-12 is no distance, and its square no overflow.
    reach = np.maximum(distance[:, count - 1 : count], 1e-12 * distance[:, -1:])
    reach = np.maximum(reach, np.finfo(np.float64).tiny)
    cost = (distance / reach) ** 2
    if normals is not None:
        cosine = np.einsum("nc,nkc->nk", normals, normals[index])
        cost += normal_weight * (1.0 - cosine**2)
    if colors is not None:
        cost += color_weight * np.square(colors[:, None] - colors[index]).sum(-1)
    best = np.argsort(cost, axis=1, kind="stable")[:, :count]
    return np.take_along_axis(index, best, 1)


def gaussian_normals(gaussians: Gaussians) -> F64:
    """Return [N, 3] unit axes of least extent; the surface normal of a flat Gaussian, sign free."""
    rotations = rotation_from_quats(gaussians.quats.astype(np.float64))
    thin = gaussians.log_scales.argmin(1)
    return np.asarray(rotations[np.arange(len(gaussians)), :, thin], np.float64)


def _candidates(means: F64, count: int) -> tuple[F64, I64]:
    """Return distances and indices [N, count] of the nearest others, nearest first."""
    tree, kept = tree_of(means, count + 1)
    distance, index = tree.query(means, k=count + 1)
    index = kept[index]
    own = index == np.arange(len(means))[:, None]
    # among many coincident points a point may miss itself: then drop its farthest candidate
    own[~own.any(1), -1] = True
    shape = (len(means), count)
    return distance[~own].reshape(shape), index[~own].reshape(shape).astype(np.int64)
