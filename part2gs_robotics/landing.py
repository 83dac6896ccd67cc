"""Landing grids: what a point of one state would meet if it were moved into the other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from part2gs_robotics.evidence import DepthMaps, observe
from part2gs_robotics.render_jit import inlined, parallel_kernel
from part2gs_robotics.surfels import Surfels

F64 = NDArray[np.float64]
MIN_FREE_VIEWS = 3  # one or two views past a point may be floaters or mask errors
FREE_COST = 1.0  # contradiction: the other state saw nothing there
HIDDEN_COST = 0.45  # neutral: nobody looked there; must not be cheaper than a fair match
CLAIMED_COST = (
    0.25  # the surface met stayed where it is: it cannot be the image of a moved point as well
)
TANGENT_SHARE = 0.25  # of the squared distance along the surface: sampling noise, not misfit
NORMAL_LIMIT = 0.5  # cos 60 deg: the other side of a thin door, or another face
FIRST_POINTS = 12  # of a patch: fewer cannot tell its face from another
PROMISING = 0.1  # of the motions are scored with all points: nearly all of the best are in it
FEWEST_LEFT = 100  # motions: short lists are scored in full
COLOR_SCALE = 0.35  # light fixed in the world changes a turned face by up to about a third


@dataclass(frozen=True)
class Landing:
    """One state as a target: nearest surfel and free / hidden label of every voxel.

    Attributes:
        surfels: surface of the state.
        lo: [3] corner of the grid.  voxel: cell size.
        nearest: [X, Y, Z] int32 index of the nearest surfel, -1 beyond the reach.
        free: [X, Y, Z] bool, observed empty.
        claimed: [M] float, 1 where the other state saw the surfel in its old place.
        reach: scene units.
    """

    surfels: Surfels
    lo: F64
    voxel: float
    nearest: NDArray[np.int32]
    free: NDArray[np.bool_]
    claimed: F64
    reach: float


def build_landing(
    surfels: Surfels, claimed: F64, maps: DepthMaps, lo: F64, hi: F64, voxel: float, reach: float
) -> Landing:
    """Return the landing grid of one state over the box lo..hi."""
    shape = np.ceil((hi - lo) / voxel).astype(int)
    axes = [lo[i] + (np.arange(shape[i]) + 0.5) * voxel for i in range(3)]
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    seen = observe(centres, maps, voxel)
    free = (seen.free >= MIN_FREE_VIEWS) & (seen.free > seen.surface)
    index = np.full(len(centres), -1, np.int32)
    distance, found = cKDTree(surfels.points).query(centres, distance_upper_bound=reach, workers=-1)
    hit = np.isfinite(distance)
    index[hit] = found[hit]
    return Landing(surfels, lo, voxel, index.reshape(shape), free.reshape(shape), claimed, reach)


@inlined
def _point_cost(p: F64, n: F64, c: F64, lo: F64, inv: float, nearest: NDArray[np.integer],
                free: NDArray[np.generic], points: F64, normals: F64, colors: F64,
                claimed: NDArray[np.generic], tau2: float) -> tuple[float, int, float]:
    """Return (cost, index of the surfel met or -1, cost of meeting nothing) of one moved point."""
    i, j, k = (
        int(np.floor((p[0] - lo[0]) * inv)),
        int(np.floor((p[1] - lo[1]) * inv)),
        int(np.floor((p[2] - lo[2]) * inv)),
    )
    if (
        i < 0
        or j < 0
        or k < 0
        or i >= nearest.shape[0]
        or j >= nearest.shape[1]
        or k >= nearest.shape[2]
    ):
        return FREE_COST, -1, FREE_COST
    miss = FREE_COST if free[i, j, k] else HIDDEN_COST
    m = nearest[i, j, k]
    if m < 0:
        return miss, -1, miss
    d2 = 0.0
    cosine = 0.0
    tint = 0.0
    plane = 0.0
    for a in range(3):
        gap = p[a] - points[m, a]
        d2 += gap * gap
        plane += gap * normals[m, a]
        cosine += n[a] * normals[m, a]
        tint += abs(c[a] - colors[m, a])
    if cosine < NORMAL_LIMIT or d2 > tau2:
        return miss, -1, miss
    cost = (plane * plane + TANGENT_SHARE * d2) / tau2 + 0.5 * (1.0 - cosine)
    cost += min(tint / 3.0 / COLOR_SCALE, 1.0) * 0.5 + CLAIMED_COST * claimed[m]
    if cost < miss:
        return cost, m, miss
    return miss, -1, miss


@parallel_kernel
def _score(moves: F64, points: F64, normals: F64, colors: F64, lo: F64, inv: float,
           nearest: NDArray[np.integer], free: NDArray[np.generic], tp: F64, tn: F64, tc: F64,
           tk: NDArray[np.generic], tau2: float) -> F64:
    out = np.zeros(len(moves))
    for h in numba.prange(len(moves)):
        m = moves[h]
        total = 0.0
        p, n = np.zeros(3), np.zeros(3)
        for q in range(len(points)):
            for a in range(3):
                p[a] = (
                    m[a, 0] * points[q, 0]
                    + m[a, 1] * points[q, 1]
                    + m[a, 2] * points[q, 2]
                    + m[a, 3]
                )
                n[a] = m[a, 0] * normals[q, 0] + m[a, 1] * normals[q, 1] + m[a, 2] * normals[q, 2]
            cost, _, _ = _point_cost(p, n, colors[q], lo, inv, nearest, free, tp, tn, tc, tk, tau2)
            total += cost
        out[h] = total / len(points)
    return out


@parallel_kernel
def _land(m: F64, points: F64, normals: F64, colors: F64, lo: F64, inv: float,
          nearest: NDArray[np.integer], free: NDArray[np.generic], tp: F64, tn: F64, tc: F64,
          tk: NDArray[np.generic], tau2: float) -> tuple[F64, NDArray[np.int64], F64]:
    cost, index, miss = (
        np.zeros(len(points)),
        np.zeros(len(points), np.int64),
        np.zeros(len(points)),
    )
    for q in numba.prange(len(points)):
        p, n = np.zeros(3), np.zeros(3)
        for a in range(3):
            p[a] = (
                m[a, 0] * points[q, 0] + m[a, 1] * points[q, 1] + m[a, 2] * points[q, 2] + m[a, 3]
            )
            n[a] = m[a, 0] * normals[q, 0] + m[a, 1] * normals[q, 1] + m[a, 2] * normals[q, 2]
        cost[q], index[q], miss[q] = _point_cost(
            p, n, colors[q], lo, inv, nearest, free, tp, tn, tc, tk, tau2
        )
    return cost, index, miss


def _arguments(target: Landing, tau: float) -> tuple[Any, ...]:
    s = target.surfels
    return (
        target.lo,
        1.0 / target.voxel,
        target.nearest,
        target.free,
        s.points,
        s.normals,
        s.colors,
        target.claimed,
        tau * tau,
    )


def score_moves(moves: F64, source: Surfels, target: Landing, tau: float) -> F64:
    """Return [M] mean landing cost in 0..1 of a patch under [M, 4, 4] motions.

    A match costs its squared distance in units of tau plus normal and colour disagreement,
    an unobserved place HIDDEN_COST, a place that was seen empty FREE_COST.
    """
    return np.asarray(
        _score(moves, source.points, source.normals, source.colors, *_arguments(target, tau))
    )


def score_best(moves: F64, source: Surfels, target: Landing, tau: float) -> F64:
    """Return [M] what `score_moves` says of the promising motions, infinity for the others.

    A quarter of the points tells most motions from good ones; only the best are scored with all.
    The points must be in random order.
    """
    few = source.select(np.arange(max(FIRST_POINTS, len(source) // 4)).clip(max=len(source) - 1))
    rough = score_moves(moves, few, target, tau)
    left = max(int(PROMISING * len(moves)), min(FEWEST_LEFT, len(moves)))
    best = np.argpartition(rough, left - 1)[:left]
    out = np.full(len(moves), np.inf)
    out[best] = score_moves(moves[best], source, target, tau)
    return out


def land(
    move: F64, source: Surfels, target: Landing, tau: float
) -> tuple[F64, NDArray[np.int64], F64]:
    """Return per-point landing cost [N], met surfel [N] (-1 = none) and cost of no match [N]."""
    cost, index, miss = _land(
        move, source.points, source.normals, source.colors, *_arguments(target, tau)
    )
    return cost, index, miss


def unclaimed(target: Landing) -> Landing:
    """Return the landing with no surfel claimed: for labellings that know the claims themselves."""
    return replace(target, claimed=np.zeros_like(target.claimed))
