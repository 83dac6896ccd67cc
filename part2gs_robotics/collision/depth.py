"""Depth: how deep two solids stick into each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.model.arrays import F64

if TYPE_CHECKING:
    from manifold3d import Manifold

SAMPLES = 192  # points of the overlap whose depth is measured
FEW = 400  # triangles that are all compared with every point
NEAREST = 32  # of more triangles, only those with the nearest centres: never less than the truth


def depth(both: Manifold) -> float:
    """Return how deep two solids stick into each other, units.

    The surface of the intersection belongs partly to either solid. The depth is the largest
    distance from a point of one side to the other side: the thickness of a sheet, the height of a
    bump, the way a corner has to be pushed back. For deep overlaps an upper bound, as only the
    other surface inside the overlap is looked at.
    """
    raw = both.to_mesh64()
    vertices, faces = np.array(raw.vert_properties[:, :3]), np.array(raw.tri_verts)
    bounds = np.array(raw.run_index, np.int64) // 3
    owners = np.repeat(np.array(raw.run_original_id, np.int64), np.diff(bounds))
    sides = [vertices[faces[owners == o]] for o in np.unique(owners)]
    if len(sides) != 2:
        return 2 * float(both.volume()) / float(both.surface_area())  # one solid holds the other
    return max(_farthest(sides[0], sides[1]), _farthest(sides[1], sides[0]))


def _farthest(tri: F64, other: F64) -> float:
    """Return the largest distance from sampled points of some triangles to other triangles."""
    from scipy.spatial import cKDTree

    points = _samples(tri)
    if len(other) <= FEW:
        return float(point_triangle_distance(points[:, None], other[None]).min(1).max())
    near = cKDTree(other.mean(1)).query(points, NEAREST)[1]
    return float(point_triangle_distance(points[:, None], other[near]).min(1).max())


def _samples(tri: F64) -> F64:
    """Return corners and area-weighted inner points of triangles, the same every time."""
    corners = np.unique(tri.reshape(-1, 3), axis=0)
    rng = np.random.default_rng(0)
    if len(corners) > SAMPLES:
        corners = corners[rng.choice(len(corners), SAMPLES, replace=False)]
    area = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1)
    if not area.sum() > 0:
        return corners
    chosen = tri[rng.choice(len(tri), SAMPLES, p=area / area.sum())]
    weights = rng.dirichlet(np.ones(3), SAMPLES)
    return np.concatenate([corners, np.einsum("nk,nki->ni", weights, chosen)])


def point_triangle_distance(points: F64, tri: F64) -> F64:
    """Return [...] distances from points [..., 3] to triangles [..., 3, 3], broadcasting."""
    corner = [tri[..., k, :] for k in range(3)]
    normal = np.cross(corner[1] - corner[0], corner[2] - corner[0])
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = normal / np.maximum(length, 1e-300)
    best: F64 = np.array(np.inf)
    inside = length[..., 0] > 0
    for k in range(3):
        offset, edge = points - corner[k], corner[(k + 1) % 3] - corner[k]
        along = (offset * edge).sum(-1) / np.maximum((edge * edge).sum(-1), 1e-300)
        gap = offset - np.clip(along, 0, 1)[..., None] * edge
        best = np.minimum(best, np.sqrt((gap * gap).sum(-1)))
        inside = inside & ((offset * np.cross(normal, edge)).sum(-1) >= 0)
    height = np.abs(((points - corner[0]) * normal).sum(-1))
    return np.where(inside, np.minimum(best, height), best)
