"""Concave edges of a solid, and the planes through them that cut it into less concave pieces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from part2gs_robotics.model.arrays import F64, I64

SAME = np.cos(np.deg2rad(2.0))  # normals of faces that are one plane up to rounding and noise
MOST_PLANES = 10  # candidates per piece, by weight; 6 and 4 left more of the hulls empty
FLAT = 1e-3  # sine of an edge's angle: less is rounding


@dataclass(frozen=True)
class Planes:
    """Planes normal.x = level, heaviest first: [P, 3], [P]."""

    normals: F64
    levels: F64


def concave_planes(vertices: F64, faces: I64, near: float) -> Planes:
    """Return the planes of faces beside concave edges.

    A concave edge is no longer one once the solid is cut along the plane of either of its faces.
    Planes weigh by length times sine of the angle of such edges beside them.

    Args:
        vertices: [V, 3].
        faces: [F, 3] of a closed solid, outward.
        near: planes that lie so near to each other at their edges are one, scene units.
    """
    normals, middles, weights = _beside(vertices, faces)
    kept_normals, kept_levels = list[F64](), list[float]()
    while len(weights) and len(kept_levels) < MOST_PLANES:
        best = int(weights.argmax())
        normal, level = normals[best], float(normals[best] @ middles[best])
        same = (np.abs(normals @ normal) > SAME) & (np.abs(middles @ normal - level) < near)
        kept_normals.append(normal)
        kept_levels.append(level)
        normals, middles, weights = normals[~same], middles[~same], weights[~same]
    return Planes(np.array(kept_normals).reshape(-1, 3), np.array(kept_levels))


def _beside(vertices: F64, faces: I64) -> tuple[F64, F64, F64]:
    """Return normal, a point and weight of both faces beside every concave edge."""
    tri = vertices[faces]
    cross = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    unit = np.divide(cross, length, out=np.zeros_like(cross), where=length > 0)
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    order = np.lexsort((edges.max(1), edges.min(1)))  # both faces of an edge follow each other
    first, second = order[0::2], order[1::2]
    start, end = edges[first].T
    one, two = first // 3, second // 3
    opposite = faces[two].sum(1) - start - end
    height = np.einsum("ij,ij->i", vertices[opposite] - vertices[start], unit[one])
    sine = np.linalg.norm(np.cross(unit[one], unit[two]), axis=1)
    weight = sine * np.linalg.norm(vertices[end] - vertices[start], axis=1)
    dent = (height > 0) & (sine > FLAT)
    middle = 0.5 * (vertices[start] + vertices[end])[dent]
    return (np.concatenate([unit[one][dent], unit[two][dent]]),
            np.concatenate([middle, middle]), np.concatenate([weight[dent], weight[dent]]))
