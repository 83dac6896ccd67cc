"""Points on a visual hull: even sampling, normals, and the colour the views agree on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.fit.hull import Hull
from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel

Floats = NDArray[np.floating]

FACING = 0.2  # cosine: a surface seen flatter than ~78 degrees gives smeared colours
CLEAR = 1.5  # voxels: a sight line starts this far off the surface, beyond the grid's own noise


def surface_points(hull: Hull, count: int, seed: int = 0) -> tuple[F64, F64]:
    """Return about `count` evenly spread points of the hull surface and outward normals.

    Returns:
        points [N, 3] and unit normals [N, 3], world frame.
    """
    from skimage.measure import marching_cubes

    grid = np.pad(hull.values, 1, constant_values=-hull.voxel)
    vertices, faces, _, _ = marching_cubes(grid, 0.0)
    corners = vertices[faces].astype(float)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    rng = np.random.default_rng(seed)
    # Equal steps along the running area: faces come in grid order, so points do not clump.
    ticks = (np.arange(count) + rng.random()) / count * area.sum()
    pick = np.minimum(np.searchsorted(np.cumsum(area), ticks), len(faces) - 1)
    uv = rng.random((count, 2))
    uv = np.where(uv.sum(1, keepdims=True) > 1, 1 - uv, uv)
    a, b, c = corners[pick, 0], corners[pick, 1], corners[pick, 2]
    points = hull.lo + (a + uv[:, :1] * (b - a) + uv[:, 1:] * (c - a) - 1) * hull.voxel
    return points, surface_normals(hull, points)


def surface_normals(hull: Hull, points: F64) -> F64:
    """Return outward unit normals [N, 3]: minus the gradient of the signed distance."""
    step = 1.5 * hull.voxel  # wide enough to smooth single-voxel steps, below most edges
    normals = np.zeros_like(points)
    for axis in range(3):
        move = np.zeros(3)
        move[axis] = step
        normals[:, axis] = hull.sample(points - move) - hull.sample(points + move)
    norm = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(norm > 0, normals / np.maximum(norm, 1e-30), [0.0, 0.0, 1.0])


def point_colors(hull: Hull, state: StateViews, points: F64, normals: F64,
                 views: NDArray[np.bool_] | None = None) -> tuple[F32, F32]:
    """Return the median colour of each point over the views that face and see it.

    Args:
        hull: blocks the sight lines.
        state: the images.
        points: [N, 3] world frame.
        normals: [N, 3] outward, unit.
        views: [V] which views may be used; None = all but the held-out ones.

    Returns:
        colors [N, 3] in [0, 1] (grey where unseen) and spread [N]: the mean absolute deviation
        from the median, NaN where fewer than two views see the point.
    """
    use = np.flatnonzero(~state.held_out if views is None else views)
    cams = (state.Ks @ state.viewmats[:, :3])[use]
    eyes = -np.einsum("vji,vj->vi", state.viewmats[use, :3, :3], state.viewmats[use, :3, 3])
    colors = np.full((len(points), 3), 0.5, np.float32)
    spread = np.full(len(points), np.nan, np.float32)
    _colors(hull.values, hull.lo, hull.voxel, np.ascontiguousarray(points, np.float64),
            np.ascontiguousarray(normals, np.float64), cams, eyes, state.images[use],
            state.alphas[use], colors, spread)
    return colors, spread


@inlined
def _blocked(values: Floats, lo: Floats, voxel: float, x: float, y: float, z: float, dx: float,
             dy: float, dz: float) -> bool:
    """March from a point along a unit direction; True when the hull is met again."""
    nx, ny, nz = values.shape
    t = CLEAR * voxel
    while True:
        i = int((x + t * dx - lo[0]) / voxel + 0.5)
        j = int((y + t * dy - lo[1]) / voxel + 0.5)
        k = int((z + t * dz - lo[2]) / voxel + 0.5)
        if i < 0 or j < 0 or k < 0 or i >= nx or j >= ny or k >= nz:
            return False
        d = values[i, j, k]
        if d > 0.25 * voxel:  # a quarter voxel forgives lines that graze the start's own surface
            return True
        t += max(-d, 0.7 * voxel)


@inlined
def _median(values: Floats, count: int) -> float:
    """Return the median of the first values, sorted in place; Numba's takes a second to compile."""
    for one in range(1, count):
        value, slot = values[one], one
        while slot > 0 and values[slot - 1] > value:
            values[slot] = values[slot - 1]
            slot -= 1
        values[slot] = value
    return 0.5 * (values[(count - 1) // 2] + values[count // 2])


@kernel
def _colors(values: Floats, lo: Floats, voxel: float, points: Floats, normals: Floats,
            cams: Floats, eyes: Floats, images: NDArray[np.uint8], alphas: NDArray[np.uint8],
            colors: Floats, spread: Floats) -> None:
    views, height, width = alphas.shape
    for_each(len(points), _colors_at, (values, lo, voxel, points, normals, cams, eyes, images,
                                       alphas, colors, spread, views, height, width))


@inlined
def _colors_at(n: int, values: Floats, lo: Floats, voxel: float, points: Floats, normals: Floats,
               cams: Floats, eyes: Floats, images: NDArray[np.uint8], alphas: NDArray[np.uint8],
               colors: Floats, spread: Floats, views: int, height: int, width: int) -> None:
    found = np.zeros((views, 3), np.float32)
    count = 0
    x, y, z = points[n, 0], points[n, 1], points[n, 2]
    for v in range(views):
        dx, dy, dz = eyes[v, 0] - x, eyes[v, 1] - y, eyes[v, 2] - z
        far = np.sqrt(dx * dx + dy * dy + dz * dz)
        dx, dy, dz = dx / far, dy / far, dz / far
        if dx * normals[n, 0] + dy * normals[n, 1] + dz * normals[n, 2] < FACING:
            continue
        c = cams[v]
        w = c[2, 0] * x + c[2, 1] * y + c[2, 2] * z + c[2, 3]
        if w <= 0:
            continue
        col = int(np.floor((c[0, 0] * x + c[0, 1] * y + c[0, 2] * z + c[0, 3]) / w))
        row = int(np.floor((c[1, 0] * x + c[1, 1] * y + c[1, 2] * z + c[1, 3]) / w))
        if col < 0 or row < 0 or col >= width or row >= height:
            continue
        if alphas[v, row, col] < 128 or _blocked(values, lo, voxel, x, y, z, dx, dy, dz):
            continue
        for k in range(3):
            found[count, k] = images[v, row, col, k]
        count += 1
    if count == 0:
        return
    total = 0.0
    for k in range(3):
        middle = _median(found[:, k], count)
        colors[n, k] = middle / 255.0
        for one in range(count):
            total += abs(found[one, k] - middle) / (255.0 * count)
    if count >= 2:
        spread[n] = total / 3.0
