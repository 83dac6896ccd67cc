"""Landing grids: what a point of one state would meet if it were moved into the other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
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

    @cached_property
    def cells(self) -> NDArray[np.int32]:
        """[X, Y, Z] 2 (nearest + 1) + free: one look into memory tells both."""
        return 2 * (self.nearest + np.int32(1)) + self.free.astype(np.int32)

    @cached_property
    def rows(self) -> F64:
        """[M, 10] point, normal, colour and claim of every surfel, side by side in memory."""
        s = self.surfels
        return np.concatenate([s.points, s.normals, s.colors, self.claimed[:, None]], 1)


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
def _point_cost(moves: F64, h: int, points: F64, normals: F64, colors: F64, q: int, lo: F64,
                inv: float, cells: NDArray[np.int32], rows: F64,
                tau2: float) -> tuple[float, int, float]:
    """Return (cost, index of the surfel met or -1, cost of meeting nothing): point q, motion h.

    Numbers and no views of rows: both threads would count the references to the same array.
    """
    x, y, z = points[q, 0], points[q, 1], points[q, 2]
    px = moves[h, 0, 0] * x + moves[h, 0, 1] * y + moves[h, 0, 2] * z + moves[h, 0, 3]
    py = moves[h, 1, 0] * x + moves[h, 1, 1] * y + moves[h, 1, 2] * z + moves[h, 1, 3]
    pz = moves[h, 2, 0] * x + moves[h, 2, 1] * y + moves[h, 2, 2] * z + moves[h, 2, 3]
    i = int(np.floor((px - lo[0]) * inv))
    j = int(np.floor((py - lo[1]) * inv))
    k = int(np.floor((pz - lo[2]) * inv))
    nx, ny, nz = cells.shape
    if i < 0 or j < 0 or k < 0 or i >= nx or j >= ny or k >= nz:
        return FREE_COST, -1, FREE_COST
    cell = cells[i, j, k]
    miss, m = FREE_COST if cell & 1 else HIDDEN_COST, (cell >> 1) - 1
    if m < 0:
        return miss, -1, miss
    gx, gy, gz = px - rows[m, 0], py - rows[m, 1], pz - rows[m, 2]
    d2 = gx * gx + gy * gy + gz * gz
    if d2 > tau2:
        return miss, -1, miss
    plane = gx * rows[m, 3] + gy * rows[m, 4] + gz * rows[m, 5]
    x, y, z = normals[q, 0], normals[q, 1], normals[q, 2]
    cosine = ((moves[h, 0, 0] * x + moves[h, 0, 1] * y + moves[h, 0, 2] * z) * rows[m, 3]
              + (moves[h, 1, 0] * x + moves[h, 1, 1] * y + moves[h, 1, 2] * z) * rows[m, 4]
              + (moves[h, 2, 0] * x + moves[h, 2, 1] * y + moves[h, 2, 2] * z) * rows[m, 5])
    if cosine < NORMAL_LIMIT:
        return miss, -1, miss
    tint = (abs(colors[q, 0] - rows[m, 6]) + abs(colors[q, 1] - rows[m, 7])
            + abs(colors[q, 2] - rows[m, 8]))
    cost = (plane * plane + TANGENT_SHARE * d2) / tau2 + 0.5 * (1.0 - cosine)
    cost += min(tint / 3.0 / COLOR_SCALE, 1.0) * 0.5 + CLAIMED_COST * rows[m, 9]
    if cost < miss:
        return cost, m, miss
    return miss, -1, miss


@parallel_kernel
def _score(moves: F64, points: F64, normals: F64, colors: F64, lo: F64, inv: float,
           cells: NDArray[np.int32], rows: F64, tau2: float) -> F64:
    out = np.zeros(len(moves))
    for h in numba.prange(len(moves)):
        total = 0.0
        for q in range(len(points)):
            cost, _, _ = _point_cost(moves, h, points, normals, colors, q, lo, inv, cells, rows,
                                     tau2)
            total += cost
        out[h] = total / len(points)
    return out


@parallel_kernel
def _land(moves: F64, points: F64, normals: F64, colors: F64, lo: F64, inv: float,
          cells: NDArray[np.int32], rows: F64, tau2: float) -> tuple[F64, NDArray[np.int64], F64]:
    cost, index, miss = (
        np.zeros(len(points)),
        np.zeros(len(points), np.int64),
        np.zeros(len(points)),
    )
    for q in numba.prange(len(points)):
        cost[q], index[q], miss[q] = _point_cost(moves, 0, points, normals, colors, q, lo, inv,
                                                 cells, rows, tau2)
    return cost, index, miss


def _arguments(source: Surfels, target: Landing, tau: float) -> tuple[Any, ...]:
    return (source.points, source.normals, source.colors, target.lo, 1.0 / target.voxel,
            target.cells, target.rows, tau * tau)


def score_moves(moves: F64, source: Surfels, target: Landing, tau: float) -> F64:
    """Return [M] mean landing cost in 0..1 of a patch under [M, 4, 4] motions.

    A match costs its squared distance in units of tau plus normal and colour disagreement,
    an unobserved place HIDDEN_COST, a place that was seen empty FREE_COST.
    """
    return np.asarray(_score(moves, *_arguments(source, target, tau)))


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
    cost, index, miss = _land(np.asarray(move)[None], *_arguments(source, target, tau))
    return cost, index, miss


def unclaimed(target: Landing) -> Landing:
    """Return the landing with no surfel claimed: for labellings that know the claims themselves."""
    return replace(target, claimed=np.zeros_like(target.claimed))
