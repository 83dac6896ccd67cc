"""Normals of corners: smooth where a surface is round, and sharp at its edges."""

from __future__ import annotations

import numpy as np

from part2gs_robotics.model.arrays import F64, I64

CREASE = np.cos(np.deg2rad(30.0))  # faces farther apart form an edge; Blender's default as well


def corner_normals(vertices: F64, faces: I64) -> F64:
    """Return [F, 3, 3] unit normals of the corners of faces, for shading.

    A corner has the mean by area of the faces around its vertex that look almost as its own does.
    Without them viewers have one normal per vertex, and a flat wall is shaded as if it were bent.

    Args:
        vertices: [V, 3].
        faces: [F, 3] outward.
    """
    tri = vertices[faces]
    areas = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    length = np.linalg.norm(areas, axis=1, keepdims=True)
    own = np.divide(areas, length, out=np.zeros_like(areas), where=length > 0)
    order = np.argsort(faces.ravel(), kind="stable")  # corners, those of one vertex together
    vertex, face = faces.ravel()[order], order // 3
    first = np.searchsorted(vertex, vertex)
    count = np.searchsorted(vertex, vertex, side="right") - first
    corner = np.repeat(np.arange(len(order)), count)
    place = np.arange(len(corner)) - np.repeat(np.cumsum(count) - count, count)
    mine, other = face[corner], face[first[corner] + place]
    alike = (own[mine] * own[other]).sum(1) > CREASE
    sums = np.zeros((len(order), 3))
    np.add.at(sums, corner[alike], areas[other[alike]])
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    unit = np.divide(sums, length, out=np.tile([0.0, 0.0, 1.0], (len(order), 1)), where=length > 0)
    out = np.empty_like(unit)
    out[order] = unit
    return out.reshape(-1, 3, 3)
