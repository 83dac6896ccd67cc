"""Bend: how the surface of a part was moved, for points beside it, there and back.

Convex pieces are cut where a part is flat: on a surface that follows every outline each board would
fall into slivers. So they are cut from the surface moved back, and then go its way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from part2gs_robotics.collision.few_corners import few_cornered
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.solids import hull_of, to_mesh
from part2gs_robotics.model.twin import PartMesh

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
        return points + self._way(self.points, points)

    def undone(self, points: F64) -> F64:
        """Return points [N, 3] beside the surface as it is, moved back."""
        return points - self._way(self.points + self.ways, points)

    def pieces(self, pieces: Sequence[PartMesh], points: F64) -> tuple[PartMesh, ...]:
        """Return convex pieces of the surface as it was, moved with it, that cover its points."""
        moved = covering([self.done(piece.vertices) for piece in pieces], points)
        out = []
        for piece, corners in zip(pieces, moved, strict=True):
            solid = few_cornered(hull_of(corners))
            red, green, blue = (int(c) for c in piece.colors[0])
            out.append(piece if solid.volume() <= 0 else to_mesh(solid, (red, green, blue)))
        return tuple(out)

    def back(self, mesh: PartMesh) -> PartMesh:
        """Return the mesh of the surface as it is, moved back."""
        return replace(mesh, vertices=self.undone(mesh.vertices))

    def _way(self, near: F64, points: F64) -> F64:
        count = min(BLEND, len(near))
        distance, index = cKDTree(near).query(points, k=[*range(1, count + 1)])
        weight = 1.0 / np.maximum(distance, 1e-9)
        return np.asarray(np.einsum("vk,vkc->vc", weight, self.ways[index])
                          / weight.sum(1)[:, None])


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
