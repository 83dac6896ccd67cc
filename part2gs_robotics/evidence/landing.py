"""Landing grids: what a point of one state would meet if it were moved into the other."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from part2gs_robotics.evidence.depth_maps import MIN_VIEWS, DepthMaps, look_past
from part2gs_robotics.evidence.light import brightness
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel

FREE_COST = 1.0  # contradiction: the other state saw nothing there
HIDDEN_COST = 0.45  # neutral: nobody looked there; must not be cheaper than a fair match
UNEXPLAINED = 0.5  # landing cost: just above a place nobody saw, halfway to one seen empty
MATCHED = 0.25  # landing cost: a fair match, well below an unobserved place
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
        behind: [X, Y, Z, 4] float32 what photos show through a free voxel, see `look_past`.
        shades: [8] of the light in those photos, see `light.Light`; colours of surfels lack it.
    """

    surfels: Surfels
    lo: F64
    voxel: float
    nearest: NDArray[np.int32]
    free: NDArray[np.bool_]
    claimed: F64
    reach: float
    behind: NDArray[np.float32]
    shades: F64 = field(default_factory=lambda: np.zeros(8))

    @cached_property
    def cells(self) -> NDArray[np.int32]:
        """[X, Y, Z] 2 (nearest + 1) + free: one look into memory tells both."""
        return 2 * (self.nearest + np.int32(1)) + self.free.astype(np.int32)

    @cached_property
    def rows(self) -> F64:
        """[M, 10] point, normal, colour and claim of every surfel, side by side in memory."""
        s = self.surfels
        return np.concatenate([s.points, s.normals, s.colors, self.claimed[:, None]], 1)


def build_landing(surfels: Surfels, claimed: F64, maps: DepthMaps, box: tuple[F64, F64],
                  voxel: float, reach: float) -> Landing:
    """Return the landing grid of one state over a box, see `Landing`.

    Args:
        surfels: surface of the state.
        claimed: [M] 1 where the other state saw the surfel in its old place.
        maps: depth maps of the state.
        box: corners of the grid.
        voxel: cell size, scene units.
        reach: farthest surfel of a cell, scene units.
    """
    lo, hi = box
    shape = np.ceil((hi - lo) / voxel).astype(int)
    axes = [lo[i] + (np.arange(shape[i]) + 0.5) * voxel for i in range(3)]
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    seen, behind = look_past(centres, maps, voxel)
    free = (seen.free >= MIN_VIEWS) & (seen.free > seen.surface)
    index = np.full(len(centres), -1, np.int32)
    distance, found = cKDTree(surfels.points).query(centres, distance_upper_bound=reach, workers=-1)
    hit = np.isfinite(distance)
    index[hit] = found[hit]
    return Landing(surfels, lo, voxel, index.reshape(shape), free.reshape(shape), claimed, reach,
                   behind.reshape(*shape, 4))


@inlined
def _cell(px: float, py: float, pz: float, lo: F64, inv: float, cells: NDArray[np.int32]) -> int:
    """Return the cell of a place; beyond the grid, that of an empty one."""
    x, y, z = (px - lo[0]) * inv, (py - lo[1]) * inv, (pz - lo[2]) * inv
    inside = x >= 0.0 and y >= 0.0 and z >= 0.0
    if not inside or x >= cells.shape[0] or y >= cells.shape[1] or z >= cells.shape[2]:
        return 1
    return int(cells[int(x), int(y), int(z)])


@inlined
def _contradicted(px: float, py: float, pz: float, lo: F64, inv: float,
                  behind: NDArray[np.float32], shown: F64, q: int) -> float:
    """Return how surely photos see past point q, that would show so, 0..1: 1 beyond the grid.

    Depth alone may be wrong: a fit paints what shines through a pane onto the pane, or behind it.
    """
    x, y, z = (px - lo[0]) * inv, (py - lo[1]) * inv, (pz - lo[2]) * inv
    inside = x >= 0.0 and y >= 0.0 and z >= 0.0
    if not inside or x >= behind.shape[0] or y >= behind.shape[1] or z >= behind.shape[2]:
        return 1.0
    a, b, c = int(x), int(y), int(z)
    tint = (abs(shown[q, 0] - behind[a, b, c, 0]) + abs(shown[q, 1] - behind[a, b, c, 1])
            + abs(shown[q, 2] - behind[a, b, c, 2]))
    share = behind[a, b, c, 3]
    return float(share + (1.0 - share) * min(tint / 3.0 / COLOR_SCALE, 1.0))


@inlined
def _match(px: float, py: float, pz: float, nx: float, ny: float, nz: float, colors: F64, q: int,
           m: int, rows: F64, tau2: float) -> float:
    """Return the cost of moved point q where it meets surfel m; above every miss if it does not.

    Numbers and no views of rows: both threads would count the references to the same array.
    """
    gx, gy, gz = px - rows[m, 0], py - rows[m, 1], pz - rows[m, 2]
    d2 = gx * gx + gy * gy + gz * gz
    cosine = nx * rows[m, 3] + ny * rows[m, 4] + nz * rows[m, 5]
    if d2 > tau2 or cosine < NORMAL_LIMIT:
        return 2.0 * FREE_COST
    plane = gx * rows[m, 3] + gy * rows[m, 4] + gz * rows[m, 5]
    tint = (abs(colors[q, 0] - rows[m, 6]) + abs(colors[q, 1] - rows[m, 7])
            + abs(colors[q, 2] - rows[m, 8]))
    cost = (plane * plane + TANGENT_SHARE * d2) / tau2 + 0.5 * (1.0 - cosine)
    return float(cost + min(tint / 3.0 / COLOR_SCALE, 1.0) * 0.5 + CLAIMED_COST * rows[m, 9])


@kernel
def _score(moves: F64, points: F64, normals: F64, colors: F64, lo: F64, inv: float,
           cells: NDArray[np.int32], rows: F64, tau2: float) -> F64:
    out = np.zeros(len(moves))
    for_each(len(moves), _score_at, (moves, points, normals, colors, lo, inv, cells, rows, tau2,
                                     out))
    return out


@inlined
def _score_at(h: int, moves: F64, points: F64, normals: F64, colors: F64, lo: F64, inv: float,
              cells: NDArray[np.int32], rows: F64, tau2: float, out: F64) -> None:
    # Held in registers; neither views nor tuples, which cost three times as much here.
    a, b, c, u = moves[h, 0, 0], moves[h, 0, 1], moves[h, 0, 2], moves[h, 0, 3]
    d, e, f, v = moves[h, 1, 0], moves[h, 1, 1], moves[h, 1, 2], moves[h, 1, 3]
    g, k, m, w = moves[h, 2, 0], moves[h, 2, 1], moves[h, 2, 2], moves[h, 2, 3]
    total = 0.0
    for q in range(len(points)):
        x, y, z = points[q, 0], points[q, 1], points[q, 2]
        px, py, pz = a * x + b * y + c * z, d * x + e * y + f * z, g * x + k * y + m * z
        cell = _cell(px + u, py + v, pz + w, lo, inv, cells)
        cost = FREE_COST if cell & 1 else HIDDEN_COST
        if cell > 1:
            x, y, z = normals[q, 0], normals[q, 1], normals[q, 2]
            nx, ny, nz = a * x + b * y + c * z, d * x + e * y + f * z, g * x + k * y + m * z
            cost = min(cost, _match(px + u, py + v, pz + w, nx, ny, nz, colors, q,
                                    (cell >> 1) - 1, rows, tau2))
        total += cost
    out[h] = total / len(points)


@kernel
def _score_turns(shifts: F64, points: F64, normals: F64, colors: F64, lo: F64, inv: float,
                 cells: NDArray[np.int32], rows: F64, tau2: float) -> F64:
    """Return [P, A] mean costs: [A, N, 3] points turned already, then shifted by [A, P, 3]."""
    out = np.zeros((shifts.shape[1], shifts.shape[0]))
    for_each(shifts.shape[0], _score_turns_at, (shifts, points, normals, colors, lo, inv, cells,
                                                rows, tau2, out))
    return out


@inlined
def _score_turns_at(a: int, shifts: F64, points: F64, normals: F64, colors: F64, lo: F64,
                    inv: float, cells: NDArray[np.int32], rows: F64, tau2: float,
                    out: F64) -> None:
    for p in range(shifts.shape[1]):
        total = 0.0
        for q in range(points.shape[1]):
            px = points[a, q, 0] + shifts[a, p, 0]
            py = points[a, q, 1] + shifts[a, p, 1]
            pz = points[a, q, 2] + shifts[a, p, 2]
            cell = _cell(px, py, pz, lo, inv, cells)
            cost = FREE_COST if cell & 1 else HIDDEN_COST
            if cell > 1:
                cost = min(cost, _match(px, py, pz, normals[a, q, 0], normals[a, q, 1],
                                        normals[a, q, 2], colors, q, (cell >> 1) - 1, rows,
                                        tau2))
            total += cost
        out[p, a] = total / points.shape[1]


@kernel
def _land(points: F64, normals: F64, colors: F64, shown: F64, behind: NDArray[np.float32], lo: F64,
          inv: float, cells: NDArray[np.int32], rows: F64, tau2: float,
          ) -> tuple[F64, NDArray[np.int64], F64]:
    """Return cost, surfel met or -1 and cost of meeting nothing of every point, moved already."""
    count = len(points)
    cost, index, miss = np.zeros(count), np.full(count, -1), np.zeros(count)
    for_each(count, _land_at, (points, normals, colors, shown, behind, lo, inv, cells, rows, tau2,
                               cost, index, miss))
    return cost, index, miss


@inlined
def _land_at(q: int, points: F64, normals: F64, colors: F64, shown: F64,
             behind: NDArray[np.float32], lo: F64, inv: float, cells: NDArray[np.int32], rows: F64,
             tau2: float, cost: F64, index: NDArray[np.int64], miss: F64) -> None:
    px, py, pz = points[q, 0], points[q, 1], points[q, 2]
    cell = _cell(px, py, pz, lo, inv, cells)
    miss[q] = HIDDEN_COST
    if cell & 1:
        miss[q] += (FREE_COST - HIDDEN_COST) * _contradicted(px, py, pz, lo, inv, behind,
                                                             shown, q)
    cost[q] = miss[q]
    if cell > 1:
        met = _match(px, py, pz, normals[q, 0], normals[q, 1], normals[q, 2], colors, q,
                     (cell >> 1) - 1, rows, tau2)
        if met < miss[q]:
            cost[q], index[q] = met, (cell >> 1) - 1


def _grid(target: Landing, tau: float) -> tuple[Any, ...]:
    return target.lo, 1.0 / target.voxel, target.cells, target.rows, tau * tau


def score_moves(moves: F64, source: Surfels, target: Landing, tau: float) -> F64:
    """Return [M] mean landing cost in 0..1 of a patch under [M, 3 or 4, 4] motions.

    A match costs its squared distance in units of tau plus normal and colour disagreement,
    an unobserved place HIDDEN_COST, a place that was seen empty FREE_COST.
    """
    return np.asarray(_score(moves, source.points, source.normals, source.colors,
                             *_grid(target, tau)))


def score_turns(rots: F64, shifts: F64, source: Surfels, target: Landing, tau: float) -> F64:
    """Return [P * A] what `score_moves` says of the promising motions, infinity for the others.

    A quarter of the points tells most motions from good ones; only the best are scored with all.
    Of a small body all points do.
    The points must be in random order.

    Args:
        rots: [A, 3, 3] rotations.
        shifts: [P, A, 3] that follow them; motion p * A + a is shifts[p, a] after rots[a].
        source: patch.
        target: grid of the other state.
        tau: matching distance.
    """
    share = len(source) // 4
    few = source.select(np.arange(share if share >= FIRST_POINTS else len(source)))
    rough = _score_turns(np.ascontiguousarray(shifts.swapaxes(0, 1)), few.points @ rots.mT,
                         few.normals @ rots.mT, few.colors, *_grid(target, tau)).ravel()
    left = max(int(PROMISING * len(rough)), min(FEWEST_LEFT, len(rough)))
    best = np.argpartition(rough, left - 1)[:left]
    out = np.full(len(rough), np.inf)
    pivots, angles = np.divmod(best, len(rots))
    moves = np.concatenate([rots[angles], shifts[pivots, angles][..., None]], 2)
    out[best] = score_moves(moves, source, target, tau)
    return out


def land(
    move: F64, source: Surfels, target: Landing, tau: float
) -> tuple[F64, NDArray[np.int64], F64]:
    """Return per-point landing cost [N], met surfel [N] (-1 = none) and cost of no match [N].

    A place that depth alone calls empty, where photos show behind it what the point would look like
    in the light there, is as good as unobserved.
    """
    normals = source.normals @ move[:3, :3].T
    shown = source.colors * brightness(target.shades, normals)[:, None]
    cost, index, miss = _land(se3.apply(move, source.points), normals, source.colors, shown,
                              target.behind, *_grid(target, tau))
    return cost, index, miss


def unclaimed(target: Landing) -> Landing:
    """Return the landing with no surfel claimed: for labellings that know the claims themselves."""
    return replace(target, claimed=np.zeros_like(target.claimed))
