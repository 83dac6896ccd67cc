"""Few corners: a convex solid within another one that engines are quick with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.points import farthest
from part2gs_robotics.model.solids import arrays, corners_of, hull_of

if TYPE_CHECKING:
    from manifold3d import Manifold

MOST_CORNERS = 64  # of a piece; of 386 pieces of 11 twins 16 had more and lose 0.2 % at most
FIRST_CORNERS = 8  # as far apart as can be: a solid to measure the others' distance from


def few_cornered(solid: Manifold) -> Manifold:
    """Return a convex solid, or the one within it of so few of its corners that engines are quick.

    Corners are taken one by one, each the one that lies farthest outside of those before.
    """
    points = corners_of(solid)
    if len(points) <= MOST_CORNERS:
        return solid
    chosen = farthest(points, FIRST_CORNERS, 0).tolist()
    while len(chosen) < MOST_CORNERS:
        corners, normals = corners_and_normals(hull_of(points[chosen]))
        if not len(normals):
            return solid
        outside = (points @ normals.T - (corners @ normals.T).max(0)).max(1)
        outside[chosen] = -np.inf
        chosen.append(int(outside.argmax()))
    return hull_of(points[chosen])


def corners_and_normals(solid: Manifold) -> tuple[F64, F64]:
    """Return [V, 3] corners and [N, 3] distinct face normals of a convex solid."""
    vertices, faces = arrays(solid)
    tri = vertices[faces]
    cross = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    normals = cross[length[:, 0] > 0] / length[length[:, 0] > 0]
    return vertices, np.unique(normals.round(6), axis=0)
