"""Bend: how the surface of a part was moved, for points beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from part2gs_robotics.model.arrays import F64

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


def covering(pieces: Sequence[F64], points: F64) -> list[F64]:
    """Return corners [C, 3] of convex pieces, each with the points beyond all that are nearest."""
    beyond, nearest = np.full(len(points), np.inf), np.full(len(points), -1)
    for i, corners in enumerate(pieces):
        try:
            planes = np.unique(ConvexHull(corners).equations, axis=0)
        except (QhullError, ValueError):  # thinner than rounding
            continue
        far = (points @ planes[:, :3].T + planes[:, 3]).max(1)
        nearer = far < beyond
        beyond[nearer], nearest[nearer] = far[nearer], i
    return [np.concatenate([corners, points[(nearest == i) & (beyond > 0)]])
            for i, corners in enumerate(pieces)]
