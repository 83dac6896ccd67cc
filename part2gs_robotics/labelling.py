"""Labelling of surfels: which motion carries each, and which motions are needed at all."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from part2gs_robotics import se3
from part2gs_robotics.landing import FREE_COST, Landing, land
from part2gs_robotics.render_jit import parallel_kernel
from part2gs_robotics.surfels import Surfels

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
NEIGHBORS = 10  # of the surfel graph: a full ring on a surface sampled by voxels
SMOOTHNESS = 0.12  # per neighbour: ten neighbours outvote a neutral surfel, not a clear one
NEUTRAL_COST = (
    0.3  # landing unobserved: a part is proven by contradictions it removes, not by what it hides
)
FOREIGN_COST = 0.35  # a surfel met that another motion carries: two surfaces cannot both become it
TEMPERATURES = (0.3, 0.2, 0.12, 0.07, 0.04)  # annealing of the mean field; costs are in 0..1
SWEEPS = 4  # per temperature


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


@parallel_kernel
def _sweep(cost: F32, q: F32, neighbors: NDArray[np.int32], weights: F32, temperature: np.float32,
           out: F32) -> None:
    """Fill out [N, L] with the labels q after one damped step towards their neighbours'."""
    labels, one, half = cost.shape[1], np.float32(1), np.float32(0.5)
    for i in numba.prange(len(cost)):
        for k in range(labels):
            out[i, k] = cost[i, k]
        for n in range(neighbors.shape[1]):
            w, j = weights[i, n], neighbors[i, n]
            for k in range(labels):
                out[i, k] += w * (one - q[j, k])
        low = out[i, 0]
        for k in range(1, labels):
            low = min(low, out[i, k])
        total = np.float32(0)
        for k in range(labels):
            out[i, k] = np.exp((low - out[i, k]) / temperature)
            total += out[i, k]
        for k in range(labels):
            out[i, k] = half * (out[i, k] / total + q[i, k])


@parallel_kernel
def _costs(match: F64, target: NDArray[np.int64], miss: F64, far: F64,
           q: NDArray[np.floating], out: F64) -> None:
    """Fill out [N, L]: what the surfel met costs, at most a miss; far from its part, more."""
    for i in numba.prange(len(match)):
        for k in range(match.shape[1]):
            j, none = target[i, k], miss[i, k]
            met = match[i, k] + FOREIGN_COST * (1.0 - q[j, k]) if j >= 0 else none
            out[i, k] = (min(met, max(none, FOREIGN_COST)) if j >= 0 else none) + far[i, k]


@dataclass(frozen=True)
class Unary:
    """Landing of every surfel of both states under L motions (column 0 = static).

    Attributes:
        match: [N, L] cost of the surfel met.  target: [N, L] that surfel's row, -1 = none met.
        miss: [N, L] cost of meeting nothing there (free or hidden).
        far: [N, L] cost of being far from what is proven to have the label.
    """

    match: F64
    target: NDArray[np.int64]
    miss: F64
    far: F64 | float = 0.0

    def cost(self, q: NDArray[np.floating]) -> F64:
        """Return [N, L] costs given soft labels: a surface carried by another part is no match."""
        out = np.zeros_like(self.match)
        far = np.ascontiguousarray(np.broadcast_to(np.asarray(self.far, np.float64), out.shape))
        _costs(self.match, self.target, self.miss, far, np.ascontiguousarray(q), out)
        return out


def unary_costs(
    moves: list[F64], states: tuple[Surfels, Surfels], lands: tuple[Landing, Landing], tau: float
) -> Unary:
    """Return how every surfel lands in the other state under every motion."""
    n0 = len(states[0])
    columns: list[tuple[F64, NDArray[np.int64], F64]] = []
    for move in moves:
        zero, one = (
            land(move, states[0], lands[1], tau),
            land(se3.inverse(move), states[1], lands[0], tau),
        )
        target = np.concatenate([np.where(zero[1] >= 0, zero[1] + n0, -1), one[1]])
        columns.append(
            (np.concatenate([zero[0], one[0]]), target, np.concatenate([zero[2], one[2]]))
        )
    miss = np.stack([c[2] for c in columns], 1)
    return Unary(
        np.stack([c[0] for c in columns], 1),
        np.stack([c[1] for c in columns], 1),
        np.where(miss == FREE_COST, miss, NEUTRAL_COST),
    )


def label(unary: Unary, graph: Graph, rough: bool = False) -> tuple[NDArray[np.int64], float]:
    """Return hard labels [N] and their energy by annealed mean field.

    Args:
        unary: landing of every surfel under every motion.
        graph: neighbours.
        rough: one sweep per temperature: enough to tell good sets of motions from bad ones.
    """
    free = np.where(unary.target >= 0, unary.match, unary.miss)
    q = np.exp(-free / TEMPERATURES[0])
    q /= q.sum(1, keepdims=True)
    q = q.astype(np.float32)
    other, weights = np.zeros_like(q), np.float32(SMOOTHNESS) * graph.weights
    for temperature in TEMPERATURES:
        cost = unary.cost(q).astype(np.float32)
        for _ in range(1 if rough else SWEEPS):
            _sweep(cost, q, graph.neighbors, weights, np.float32(temperature), other)
            q, other = other, q
    hard = q.argmax(1)
    exact = unary.cost(np.eye(q.shape[1])[hard])
    differ = hard[graph.neighbors] != hard[:, None]
    energy = exact[np.arange(len(hard)), hard].sum() + SMOOTHNESS * (graph.weights * differ).sum()
    return hard, float(energy)
