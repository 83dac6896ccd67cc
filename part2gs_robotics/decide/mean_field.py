"""Mean field of labels on a graph: a node's labels side by side in registers, float32."""

from __future__ import annotations

import numpy as np
from numba import prange
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32
from part2gs_robotics.runtime.fast_math import power8
from part2gs_robotics.runtime.jit import inlined, parallel_kernel
from part2gs_robotics.runtime.simd import LANES, Lane, largest, load, most, splat, store, total

NEVER = 1e3  # cost of the labels that fill up a register; costs are of order 1
LOWEST = -44.0  # exponents below it are as good as it: e^-44 is nothing beside 1 in float32


def wide(count: int, labels: int, fill: float) -> F32:
    """Return [count, width] float32 of one value, width the next multiple of the lanes."""
    return np.full((count, -(-labels // LANES) * LANES), fill, np.float32)


def descend(cost: F32, q: F32, neighbors: NDArray[np.int32], weights: F32, temperature: float,
            sweeps: int) -> F32:
    """Return soft labels after damped steps of every node towards what its neighbours say.

    Args:
        cost: [N, width] of every label, padded by NEVER.
        q: [N, width] soft labels, padded by zeros.
        neighbors: [N, k] nodes.
        weights: [N, k] what it costs to differ from each.
        temperature: how much dearer a label may be by a factor of e.
        sweeps: steps, each of all nodes at once.
    """
    now, other = q.reshape(-1).copy(), np.zeros(q.size, np.float32)
    for _ in range(sweeps):
        _sweep(cost.reshape(-1), now, neighbors, weights, np.float32(1 / temperature), other)
        now, other = other, now
    return now.reshape(q.shape)


@inlined
def _exponential(t: Lane) -> Lane:
    """Return e^t for t <= 0 in every lane, e^LOWEST below that."""
    p = power8(most(t, splat(np.float32(LOWEST))) * np.float32(1 / 64))
    p = p * p
    p = p * p
    return p * p


@parallel_kernel
def _sweep(cost: F32, q: F32, neighbors: NDArray[np.int32], weights: F32, inverse: np.float32,
           out: F32) -> None:
    """Fill out with the labels q after one damped step towards their neighbours'."""
    nodes, ring = neighbors.shape
    width = np.uint64(len(cost) // max(nodes, 1))
    one, half, lanes = np.float32(1), np.float32(0.5), np.uint64(LANES)
    for i in prange(nodes):
        first = np.uint64(i) * width
        top = np.float32(-np.inf)
        for b in range(np.uint64(0), width, lanes):
            against = load(cost, first + b)
            for n in range(ring):
                theirs = load(q, np.uint64(neighbors[i, n]) * width + b)
                against = against + (splat(one) - theirs) * weights[i, n]
            scaled = against * -inverse
            store(out, first + b, scaled)
            top = max(top, largest(scaled))
        likely = np.float32(0)
        for b in range(np.uint64(0), width, lanes):
            share = _exponential(load(out, first + b) - top)
            store(out, first + b, share)
            likely += total(share)
        for b in range(np.uint64(0), width, lanes):
            new = load(out, first + b) * (half / likely) + load(q, first + b) * half
            store(out, first + b, new)
