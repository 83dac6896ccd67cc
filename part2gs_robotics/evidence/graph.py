"""Surfels of both states as one graph of neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from part2gs_robotics.evidence.surfels import Surfels

NEIGHBORS = 10  # of the surfel graph: a full ring on a surface sampled by voxels
THROUGH = 0.0  # cosine of normals: a way goes round an edge, not through a thin wall


@dataclass(frozen=True)
class Graph:
    """Surfels of both states as one graph: neighbours [N, k] and weights [N, k] within a state."""

    neighbors: NDArray[np.int32]
    weights: NDArray[np.float32]


def build_graph(states: tuple[Surfels, Surfels]) -> Graph:
    """Return the normal-aware nearest-neighbour graph of both states, state 1 after state 0."""
    ids, weights = [], []
    offset = 0
    for s in states:
        count = min(NEIGHBORS + 1, len(s))
        distance, index = cKDTree(s.points).query(s.points, count)
        distance, index = distance[:, 1:], index[:, 1:]
        cosine = (s.normals[index] * s.normals[:, None]).sum(-1)
        reach = np.median(distance[:, -1]) + 1e-12
        weights.append(
            np.exp(-((distance / (1.5 * reach)) ** 2)) * (0.25 + 0.75 * np.clip(cosine, 0, 1))
        )
        ids.append(index + offset)
        offset += len(s)
    # Half the memory of 64-bit numbers: a sweep waits for the neighbours' lines.
    return Graph(np.concatenate(ids).astype(np.int32), np.concatenate(weights).astype(np.float32))


def ways_along(states: tuple[Surfels, Surfels], graph: Graph) -> csr_matrix:
    """Return the distances between neighbouring surfels as a symmetric sparse matrix [N, N]."""
    points = np.concatenate([s.points for s in states])
    rows = np.repeat(np.arange(len(points)), graph.neighbors.shape[1])
    cols = graph.neighbors.ravel()
    gaps = np.linalg.norm(points[rows] - points[cols], axis=1)
    normals = np.concatenate([s.normals for s in states])
    same_side = (normals[rows] * normals[cols]).sum(1) > THROUGH
    one_way = csr_matrix((gaps[same_side], (rows[same_side], cols[same_side])),
                         shape=(len(points), len(points)))
    return one_way.maximum(one_way.T)
