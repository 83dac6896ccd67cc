"""Nearest neighbours that stay fast where many points coincide."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from part2gs_robotics.model.arrays import F64, I64


def tree_of(points: NDArray[np.floating], copies: int = 1) -> tuple[cKDTree, I64]:
    """Return a tree over at most `copies` points of every place, and their indices.

    A k-d tree cannot split coincident points: n of them cost n distances a query, 43 s for 1e5
    queries of 1e5. The distances to the k nearest stay true for k <= copies.

    Args:
        points: [N, 3] scene units.
        copies: of one place that are kept, the first ones.
    """
    points = np.asarray(points, np.float64).reshape(-1, 3)
    order = np.lexsort(points.T)
    new = np.ones(len(points), bool)
    new[1:] = (np.diff(points[order], axis=0) != 0).any(1)
    first = np.flatnonzero(new)
    rank = np.arange(len(points)) - np.repeat(first, np.diff(first, append=len(points)))
    kept = np.sort(order[rank < copies])
    return cKDTree(points[kept]), kept


def farthest(points: F64, count: int, rng: np.random.Generator) -> list[int]:
    """Return indices of up to `count` points that spread over the set."""
    index = [int(rng.integers(len(points)))]
    gap = np.full(len(points), np.inf)
    for _ in range(min(count, len(points)) - 1):
        gap = np.minimum(gap, ((points - points[index[-1]]) ** 2).sum(1))
        index.append(int(gap.argmax()))
    return index


def farthest_point_sample(points: F64, count: int) -> I64:
    """Return [min(count, N)] indices, each the farthest from those before.

    Starts at the point farthest from the centroid, so the choice follows rigid motions of the
    cloud and needs no seed. O(N count).
    """
    count = min(count, len(points))
    if count <= 0:
        return np.zeros(0, np.int64)
    centred = np.asarray(points, np.float64) - np.mean(points, axis=0, dtype=np.float64)
    squared = np.einsum("ij,ij->i", centred, centred)
    chosen = np.zeros(count, np.int64)
    chosen[0] = int(np.argmax(squared))
    nearest = np.full(len(points), np.inf)
    for step in range(1, count):
        last = chosen[step - 1]
        distance = squared + squared[last] - 2.0 * (centred @ centred[last])
        np.minimum(nearest, distance, out=nearest)
        nearest[last] = -np.inf  # never twice, even among coincident points
        chosen[step] = int(np.argmax(nearest))
    return chosen
