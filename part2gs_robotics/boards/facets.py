"""Facets: triangles as points with normals and areas, and the directions that they face."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix

from part2gs_robotics.model.arrays import F64, I64

SMOOTHINGS = 3  # rings of faces over which normals are averaged: a grid's noise is one cell long
SEEDS = 512  # directions of a half sphere: 5 degrees apart
ROUNDS = 4  # of taking the mean of the normals around a direction; two do for a wall


@dataclass(frozen=True)
class Facets:
    """Triangles of a surface: [F, 3] centres, unit normals, [F] areas."""

    centers: F64
    normals: F64
    areas: F64


def smooth_facets(vertices: F64, faces: I64) -> Facets:
    """Return all faces, normals averaged over the rings around each, weighed by area."""
    tri = vertices[faces]
    normals = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    areas = 0.5 * np.linalg.norm(normals, axis=1)
    one, two = neighbours(faces)
    ring = coo_matrix((np.ones(2 * len(one)), (np.r_[one, two], np.r_[two, one])),
                      (len(faces),) * 2).tocsr()
    for _ in range(SMOOTHINGS):
        normals = normals + ring @ normals
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return Facets(tri.mean(1), np.asarray(normals / np.maximum(length, 1e-300)), areas)


def neighbours(faces: I64) -> tuple[I64, I64]:
    """Return the pairs of faces that share an edge of a closed mesh."""
    _, sides = paired(faces)
    return sides[:, 0], sides[:, 1]


def paired(faces: I64) -> tuple[I64, I64]:
    """Return the edges [E, 2] of a closed mesh, as vertices and as the two faces of each."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    order = np.lexsort(edges.T)
    edges, face = edges[order], np.tile(np.arange(len(faces)), 3)[order]
    same = (np.diff(edges, axis=0) == 0).all(1)
    return edges[:-1][same], np.stack([face[:-1][same], face[1:][same]], 1)


def half_sphere() -> F64:
    """Return [SEEDS, 3] evenly spread directions of a half sphere (golden spiral)."""
    i = np.arange(SEEDS) + 0.5
    z = i / SEEDS
    phi = i * np.pi * (1 + 5**0.5)
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], 1)


def settled(seed: F64, normals: F64, weights: F64, within: float) -> F64:
    """Return the mean direction, sign-free, of the normals around a seed.

    Args:
        seed: [3] unit.
        normals: [N, 3] unit.
        weights: [N].
        within: cosine of the angle to the direction within which a normal counts.
    """
    direction = seed
    for _ in range(ROUNDS):
        along = normals @ direction
        near = np.abs(along) > within
        mean = (np.sign(along[near]) * weights[near]) @ normals[near]
        direction = mean / max(float(np.linalg.norm(mean)), 1e-300)
    return np.asarray(direction)


def middle_of(values: F64, weights: F64) -> float:
    """Return the weighted median of values."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])
