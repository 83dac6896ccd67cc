"""Bend: how the surface of a part was moved, for points beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from part2gs_robotics.model.arrays import F64, I64

BLEND = 4  # nearest vertices whose way a point goes, by the inverse of their distance


@dataclass(frozen=True)
class Bend:
    """How a surface moved.

    Attributes:
        points: [V, 3] of the surface before.
        ways: [V, 3] how each moved.
    """

    points: F64
    ways: F64

    def done(self, points: F64) -> F64:
        """Return points [N, 3] beside the surface as it was, moved with it."""
        count = min(BLEND, len(self.points))
        distance, index = cKDTree(self.points).query(points, k=[*range(1, count + 1)])
        weight = 1.0 / np.maximum(distance, 1e-9)
        way = np.einsum("vk,vkc->vc", weight, self.ways[index]) / weight.sum(1)[:, None]
        return np.asarray(points + way)


def beyond(pieces: Sequence[F64], points: F64) -> tuple[F64, I64]:
    """Return how far points [N, 3] are beyond convex pieces, negative inside, and of which least.

    Args:
        pieces: corners [C, 3] of each; what is thinner than rounding has no inside.
        points: [N, 3].
    """
    far, nearest = np.full(len(points), np.inf), np.full(len(points), -1)
    for i, corners in enumerate(pieces):
        if not len(planes := planes_of(corners)):
            continue
        own = (points @ planes[:, :3].T + planes[:, 3]).max(1)
        nearer = own < far
        far[nearer], nearest[nearer] = own[nearer], i
    return far, nearest


def planes_of(corners: F64) -> F64:
    """Return [P, 4] outward planes (normal, -level) of a convex piece, none if it is flat."""
    try:
        return np.unique(ConvexHull(corners).equations, axis=0)
    except (QhullError, ValueError):
        return np.zeros((0, 4))


def covering(pieces: Sequence[F64], points: F64) -> list[F64]:
    """Return corners [C, 3] of convex pieces, each with the points beyond all that are nearest."""
    far, nearest = beyond(pieces, points)
    return [np.concatenate([corners, points[(nearest == i) & (far > 0)]])
            for i, corners in enumerate(pieces)]
