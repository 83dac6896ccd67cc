"""What may hide behind a visual hull: lids over hollows, and candidate points inside them.

Silhouettes cannot see into an open drawer or oven; the hull closes it with a lid whose points show
each camera another colour. Points inside the hull that are looked at through lids, and on whose
colour those views agree, are where the real surface may be.
Source: the consistency test of voxel colouring (Seitz and Dyer 1999), visibility through lids only.
"""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.hull import Hull
from part2gs_robotics.render_jit import kernel, parallel_kernel
from part2gs_robotics.scene import StateViews

F32 = NDArray[np.float32]
Floats = NDArray[np.floating]
F64 = NDArray[np.float64]

TOLERANCE = 2.0 / 255  # grey levels: rounding and mild shading
NOISE_FACTOR = 4.0  # times the hull's median spread: exposure noise makes no lids
MIN_VIEWS = 3  # fewer views through lids cannot agree on anything
STRIDE = 3  # sight lines are marched on every third voxel: only the side they leave by matters
CANDIDATES = 8  # random points tried per point wanted
TRIM = 0.25  # share of the views left out per point: an inner wall may hide it from them


def find_lids(spread: F32) -> NDArray[np.bool_]:
    """Return which hull points contradict themselves.

    Args:
        spread: [N] colour spread of each point over its views, NaN = unseen.
    """
    limit = max(TOLERANCE, NOISE_FACTOR * float(np.nanmedian(np.append(spread, 0.0))))
    return np.nan_to_num(spread, nan=0.0) > limit


def hollow_points(hull: Hull, state: StateViews, surface: F64, lids: NDArray[np.bool_],
                  count: int, seed: int) -> tuple[F64, F32]:
    """Return at most `count` points inside the hull on which the views through lids agree.

    Args:
        hull: bounds the search.
        state: the images; held-out views are not used.
        surface: [N, 3] hull points.
        lids: [N] which of them are lids.
        count: points wanted.
        seed: of the random candidates.

    Returns:
        points [M, 3] and their colours [M, 3].
    """
    if not lids.any():
        return np.zeros((0, 3)), np.zeros((0, 3), np.float32)
    rng = np.random.default_rng(seed)
    inside = np.argwhere(hull.values > hull.voxel)
    pick = inside[rng.integers(0, len(inside), CANDIDATES * count)]
    points = hull.lo + hull.voxel * (pick + rng.random(pick.shape) - 0.5)
    use = np.flatnonzero(~state.held_out & hull.views_used)
    cams = (state.Ks @ state.viewmats[:, :3])[use]
    eyes = -np.einsum("vji,vj->vi", state.viewmats[use, :3, :3], state.viewmats[use, :3, 3])
    colors = np.zeros((len(points), 3), np.float32)
    spread = np.full(len(points), np.inf, np.float32)
    every = (slice(None, None, STRIDE),) * 3
    _through(hull.occupancy[every], _lid_voxels(hull, surface, lids)[every], hull.lo,
             STRIDE * hull.voxel, points, cams, eyes, state.images[use],
             state.alphas[use], colors, spread)
    keep = np.sort(rng.permutation(np.flatnonzero(spread < TOLERANCE))[:count])
    return points[keep], colors[keep]


def _lid_voxels(hull: Hull, surface: F64, lids: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return voxels near the surface most of whose surface points are lids."""
    from scipy.ndimage import uniform_filter

    index = np.clip(np.round((surface - hull.lo) / hull.voxel).astype(int), 0,
                    np.array(hull.values.shape) - 1)
    votes = np.zeros(hull.values.shape, np.float32)
    np.add.at(votes, tuple(index.T), np.where(lids, 1.0, -1.0).astype(np.float32))
    return np.asarray(uniform_filter(votes, 7) > 1e-6)


@kernel
def _leaves_by_lid(inside: NDArray[np.bool_], lid: NDArray[np.bool_], i: int, j: int, k: int,
                   dx: float, dy: float, dz: float) -> bool:
    """March in voxel units to where the hull ends for good; True when that is a lid."""
    nx, ny, nz = inside.shape
    last = False
    t = 1.0
    while True:
        x, y, z = i + t * dx, j + t * dy, k + t * dz
        if x < -0.5 or y < -0.5 or z < -0.5 or x > nx - 0.51 or y > ny - 0.51 or z > nz - 0.51:
            return last
        a, b, c = int(x + 0.5), int(y + 0.5), int(z + 0.5)
        if inside[a, b, c]:
            last = lid[a, b, c]
        t += 0.8


@parallel_kernel
def _through(inside: NDArray[np.bool_], lid: NDArray[np.bool_], lo: Floats, voxel: float,
             points: Floats, cams: Floats, eyes: Floats, images: NDArray[np.uint8],
             alphas: NDArray[np.uint8], colors: Floats, spread: Floats) -> None:
    views, height, width = alphas.shape
    for n in nb.prange(len(points)):
        found = np.zeros((views, 3), np.float32)
        count = 0
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        for v in range(views):
            dx, dy, dz = eyes[v, 0] - x, eyes[v, 1] - y, eyes[v, 2] - z
            far = np.sqrt(dx * dx + dy * dy + dz * dz)
            c = cams[v]
            w = c[2, 0] * x + c[2, 1] * y + c[2, 2] * z + c[2, 3]
            if w <= 0:
                continue
            col = int(np.floor((c[0, 0] * x + c[0, 1] * y + c[0, 2] * z + c[0, 3]) / w))
            row = int(np.floor((c[1, 0] * x + c[1, 1] * y + c[1, 2] * z + c[1, 3]) / w))
            if col < 0 or row < 0 or col >= width or row >= height or alphas[v, row, col] < 128:
                continue
            if not _leaves_by_lid(inside, lid, (x - lo[0]) / voxel, (y - lo[1]) / voxel,
                                  (z - lo[2]) / voxel, dx / far, dy / far, dz / far):
                continue
            for q in range(3):
                found[count, q] = images[v, row, col, q]
            count += 1
        if count < MIN_VIEWS:
            continue
        off = np.zeros(count, np.float32)
        for q in range(3):
            middle = np.median(found[:count, q])
            colors[n, q] = middle / np.float32(255)
            off += np.abs(found[:count, q] - middle)
        off.sort()
        spread[n] = off[:max(MIN_VIEWS, int(count * (1 - TRIM)))].mean() / 765.0
