"""Clouds of points: neighbours where many points coincide, and points far from one another."""

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


def farthest(points: F64, count: int, first: int) -> I64:
    """Return [min(count, N)] indices, each the farthest from those before, none twice.

    Args:
        points: [N, 3] scene units.
        count: at most.
        first: index to start from.
    """
    count = min(count, len(points))
    chosen = np.full(count, first, np.int64)
    gap = np.full(len(points), np.inf)
    for step in range(1, count):
        last = chosen[step - 1]
        gap = np.minimum(gap, ((points - points[last]) ** 2).sum(1))
        gap[last] = -np.inf  # also among coincident points
        chosen[step] = int(gap.argmax())
    return chosen


def outermost(points: F64) -> int:
    """Return the index of the point farthest from the centroid, 0 without any.

    A choice of points that starts there follows rigid motions of the cloud and needs no seed.
    """
    if not len(points):
        return 0
    centred = np.asarray(points, np.float64) - np.mean(points, axis=0, dtype=np.float64)
    return int(np.einsum("ij,ij->i", centred, centred).argmax())
