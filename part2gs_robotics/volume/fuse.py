"""Fuse: depth maps of both states -> signed distance and part votes on a grid of one part's frame.

Truncated signed distances (Curless and Levoy) with three changes: the depth difference is turned
into a point-to-plane distance, surfaces of other parts bound a part but never fill it, and both
states are summed in the part's own frame, state 1 through the part's motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.model.grid import Grid
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel
from part2gs_robotics.volume.part_maps import PartMaps

BLOCK = 4  # voxels per block and axis that one look into a coarse map may decide for one view
TRUNCATION = 3.0  # voxels: wider eats thin walls, narrower loses the noise of rendered depth
FAR = 1.34  # truncations of depth difference beyond which no plane distance is asked for
FEW_VIEWS = np.float32(3)  # fewer may all look from one side: no share is known then
FREE_AHEAD = 1.5  # voxels: 3 pulls faces in by a third of a voxel, 0.5 lets depth noise tear them
SURE = 12  # views that see a whole block free, with room to spare, end the discussion
GRAZING = 0.15  # cosine, 81 degrees: beyond, one pixel of error moves the surface by 7 pixels
CLEAR = 1.5  # voxels before a surface, beyond its noise: such a view sees the point free
NARROW = 0.3  # cosine: pixels of steeper surfaces would hide all that lies before them
SUMS = 11  # what _add_voxel counts


@dataclass(frozen=True)
class Fused:
    """Evidence about one part on a grid, summed over both states, each [X, Y, Z] float32.

    Attributes:
        grid: where.
        distance: weighted mean signed distance, scene units, positive inside, clipped to the
            truncation; 0 where weight is 0.
        weight: weight of that mean; 0 = no view sees this part's surface or free space here.
        own: weight of views that see this part's surface within the truncation.
        other: the same for other parts' surfaces that this point lies behind.
        hidden: views in which any part hides the point, deeper than the truncation.
        enclosed: of the views that cannot see the point, the share that this part's own surface
            stops; the larger one of the two states.
        background: views in which the point lies on background.
        clear: views that see well past the point, these among them.
        behind: weight of views whose first surface is this part's, and the point right behind it.
        behind_other: the same for other parts' surfaces.
    """

    grid: Grid
    distance: F32
    weight: F32
    own: F32
    other: F32
    hidden: F32
    enclosed: F32
    background: F32
    clear: F32
    behind: F32
    behind_other: F32


def fuse(grid: Grid, part: int, states: Sequence[tuple[PartMaps, F64]],
         truncation: float) -> Fused:
    """Sum the evidence of all states about one part.

    Args:
        grid: voxels in the world frame at state 0.
        part: index of the part; other labels bound it.
        states: per state, its maps and the [4, 4] world_at_state_from_world_at_0 of the part.
        truncation: scene units.
    """
    sums = np.zeros((SUMS, *grid.shape), np.float32)
    hidden, enclosed = np.zeros_like(sums[0]), np.zeros_like(sums[0])
    for maps, world_from_grid in states:
        projections = maps.maps.projections @ world_from_grid
        radius = _block_radius(grid, projections)
        nearest, farthest = _windows(maps.maps.coded_depths, radius)
        sums[4:6] = 0
        _fuse(grid.lo, grid.voxel, projections, maps.maps.coded_depths, maps.labels, maps.facing,
              nearest, farthest, part, truncation, sums)
        blocked = sums[4] + sums[5]
        enclosed = np.maximum(enclosed, sums[4] / np.maximum(blocked, FEW_VIEWS))
        hidden += blocked
    distance, weight = _mean_distance(sums[0], sums[1], sums[6], truncation, grid.voxel)
    # Copies: a row would keep all others in memory.
    own, other, background, behind, beside = (sums[n].copy() for n in (2, 3, 7, 9, 10))
    return Fused(grid, distance, weight, own, other, hidden, enclosed, background,
                 sums[6] + sums[8], behind, beside)


def _mean_distance(total: F32, near: F32, free: F32, truncation: float,
                   voxel: float) -> tuple[F32, F32]:
    """Return the mean signed distance, positive inside, and its weight.

    A view that looks far past a point knows its sign, not its distance: counted with the
    truncation, such views would pull every surface inwards by a third of a voxel.
    """
    weight = near + free
    mean = np.divide(total, near, out=np.full_like(near, truncation), where=near > 0)
    ahead = np.maximum(mean, np.float32(FREE_AHEAD * voxel))
    distance = np.divide(total + free * ahead, weight, out=np.zeros_like(near), where=weight > 0)
    return -distance, weight


def _block_radius(grid: Grid, projections: F64) -> int:
    """Return how many pixels a block reaches from its centre, in the view nearest to the grid."""
    corners = np.array([[i, j, k, 1] for i in (0, 1) for j in (0, 1) for k in (0, 1)], float)
    corners[:, :3] = grid.lo + corners[:, :3] * (np.array(grid.shape) - 1) * grid.voxel
    depth = np.maximum(np.einsum("vi,ni->vn", projections[:, 2], corners), grid.voxel).min(1)
    focal = np.linalg.norm(projections[:, :2, :3], axis=2).max(1)  # >= f: a safe upper bound
    reach = 0.5 * (BLOCK - 1) * np.sqrt(3.0) * grid.voxel
    return int(np.ceil((focal * reach / depth).max())) + 1


def _windows(coded: F32, radius: int) -> tuple[F32, F32]:
    """Return per pixel the least and greatest depth in a square window; unknown blocks both."""
    import cv2

    kernel_ = np.ones((2 * min(radius, 64) + 1,) * 2, np.uint8)
    unknown = np.isnan(coded)
    low = np.where(unknown, np.float32(0), coded)
    high = np.where(unknown, np.float32(np.inf), coded)
    nearest = np.stack([cv2.erode(d, kernel_, borderType=cv2.BORDER_REPLICATE) for d in low])
    farthest = np.stack([cv2.dilate(d, kernel_, borderType=cv2.BORDER_REPLICATE) for d in high])
    return nearest, farthest


@inlined
def _add_distance(signed: float, slope: float, own: bool, trunc: float, voxel: float,
                  sums: F32) -> None:
    """Add a distance from the surface that a view sees, positive in front of it."""
    if signed < -trunc:
        sums[4 if own else 5] += 1.0
        return
    # Behind the surface the weight falls to 0: another side of a thin wall knows better there.
    weight = slope * slope * min(1.0, (signed + trunc) / (0.5 * trunc))
    if own or signed > 0.0:
        sums[0] += weight * min(signed, trunc)
        sums[1] += weight
    if own and signed < trunc:
        sums[2] += weight
    elif not own and signed < 0.5 * voxel:
        sums[3] += weight


@inlined
def _add_voxel(p: F64, m: F64, depth: F32, labels: NDArray[np.uint8], facing: F32, part: int,
               trunc: float, voxel: float, sums: F32, x: int, y: int, z: int) -> None:
    """Add what one view says about one voxel centre p."""
    height, width = depth.shape
    w = m[2, 0] * p[0] + m[2, 1] * p[1] + m[2, 2] * p[2] + m[2, 3]
    if not w > 0.0:
        return
    u = (m[0, 0] * p[0] + m[0, 1] * p[1] + m[0, 2] * p[2] + m[0, 3]) / w - 0.5
    v = (m[1, 0] * p[0] + m[1, 1] * p[1] + m[1, 2] * p[2] + m[1, 3]) / w - 0.5
    if not (u >= 0.0 and v >= 0.0 and u < width - 1 and v < height - 1):
        return
    i, j = int(v), int(u)
    a, b, c, d = depth[i, j], depth[i, j + 1], depth[i + 1, j], depth[i + 1, j + 1]
    low, high = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
    if a != a or b != b or c != c or d != d:
        return
    if low > w + FAR * trunc or (low > w + trunc and high == np.inf):
        sums[6, x, y, z] += 1.0  # free: every pixel looks past it
        if low == np.inf:
            sums[7, x, y, z] += 1.0
        return
    near_i, near_j = i + (1 if v - i > 0.5 else 0), j + (1 if u - j > 0.5 else 0)
    own, slope = labels[near_i, near_j] == part, facing[near_i, near_j]
    if high < w - FAR * trunc:
        sums[4 if own else 5, x, y, z] += 1.0
        return
    if low > w + CLEAR * voxel / max(slope, NARROW):
        sums[8, x, y, z] += 1.0
    elif high < w:
        sums[9 if own else 10, x, y, z] += slope
    if high - low > 2.0 * voxel / max(slope, GRAZING) or slope < GRAZING:
        return  # an edge or a grazing surface: its distance is unknown
    fu, fv = u - j, v - i
    seen = (a * (1 - fu) + b * fu) * (1 - fv) + (c * (1 - fu) + d * fu) * fv
    _add_distance((seen - w) * slope, slope, own, trunc, voxel, sums[:, x, y, z])


@inlined
def _block_view(p: F64, m: F64, nearest: F32, farthest: F32, labels: NDArray[np.uint8], part: int,
                trunc: float, reach: float) -> int:
    """Return 4 hidden by the part, 5 by another, 6 free, 7 background, -1 ask voxel by voxel."""
    height, width = nearest.shape
    w = m[2, 0] * p[0] + m[2, 1] * p[1] + m[2, 2] * p[2] + m[2, 3]
    if not w > reach:
        return -1
    u = (m[0, 0] * p[0] + m[0, 1] * p[1] + m[0, 2] * p[2] + m[0, 3]) / w
    v = (m[1, 0] * p[0] + m[1, 1] * p[1] + m[1, 2] * p[2] + m[1, 3]) / w
    if not (u >= 0.0 and v >= 0.0 and u < width and v < height):
        return -1
    i, j = int(v), int(u)
    if nearest[i, j] > w + reach + FAR * trunc:
        return 7 if nearest[i, j] == np.inf else 6
    if farthest[i, j] < w - reach - FAR * trunc:
        return 4 if labels[i, j] == part else 5
    return -1


@kernel
def _fuse(lo: F64, voxel: float, projections: F64, depths: F32, labels: NDArray[np.uint8],
          facing: F32, nearest: F32, farthest: F32, part: int, trunc: float, sums: F32) -> None:
    _, nx, ny, nz = sums.shape
    by, bz = (ny + BLOCK - 1) // BLOCK, (nz + BLOCK - 1) // BLOCK
    blocks = ((nx + BLOCK - 1) // BLOCK) * by * bz
    half, reach = 0.5 * (BLOCK - 1), 0.5 * (BLOCK - 1) * np.sqrt(3.0) * voxel
    for_each(blocks, _fuse_at, (lo, voxel, projections, depths, labels, facing, nearest, farthest,
                                part, trunc, sums, nx, ny, nz, by, bz, half, reach))


@inlined
def _fuse_at(n: int, lo: F64, voxel: float, projections: F64, depths: F32,
             labels: NDArray[np.uint8], facing: F32, nearest: F32, farthest: F32, part: int,
             trunc: float, sums: F32, nx: int, ny: int, nz: int, by: int, bz: int, half: float,
             reach: float) -> None:
    x0, y0, z0 = n // (by * bz) * BLOCK, n // bz % by * BLOCK, n % bz * BLOCK
    x1, y1, z1 = min(x0 + BLOCK, nx), min(y0 + BLOCK, ny), min(z0 + BLOCK, nz)
    center = np.array([lo[0] + voxel * (x0 + half), lo[1] + voxel * (y0 + half),
                       lo[2] + voxel * (z0 + half)])
    p, count = np.zeros(3), np.zeros(8)
    for v in range(len(projections)):
        m = projections[v]
        verdict = _block_view(center, m, nearest[v], farthest[v], labels[v], part, trunc, reach)
        if verdict >= 0:
            count[verdict] += 1.0
            if verdict == 7:
                count[6] += 1.0
            if count[6] >= SURE:
                break
            continue
        depth, label, slope = depths[v], labels[v], facing[v]  # views cost more than a voxel
        for x in range(x0, x1):
            p[0] = lo[0] + voxel * x
            for y in range(y0, y1):
                p[1] = lo[1] + voxel * y
                for z in range(z0, z1):
                    p[2] = lo[2] + voxel * z
                    _add_voxel(p, m, depth, label, slope, part, trunc, voxel, sums, x, y, z)
    for c in range(4, 8):
        if count[c] > 0.0:
            more = np.float32(count[c])
            for x in range(x0, x1):  # a sum of slices takes seconds to compile
                for y in range(y0, y1):
                    for z in range(z0, z1):
                        sums[c, x, y, z] += more
