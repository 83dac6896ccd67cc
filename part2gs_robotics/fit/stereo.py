"""Stereo: depth maps of one state from its photos, inside its visual hull.

Silhouettes cannot see into an open drawer; colours can. Every pixel's depth lies between the front
and the back of the hull along its ray. Where several depths look right, the profile that needs
fewest jumps wins, then the one nearest to the hull.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.config import StereoConfig
from part2gs_robotics.evidence.depth_maps import SOLID_ALPHA, DepthMaps
from part2gs_robotics.fit.hull import Hull
from part2gs_robotics.fit.stereo_kernels import aggregate, hull_span, matching_cost
from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.model.small_views import SmallViews, neighbors, small_views, spread
from part2gs_robotics.runtime.side_by_side import side_by_side

COMPARED = 64  # photos per state that depth maps are compared with; more see nothing new
BINS = 96  # depths from the hull's nearest to farthest point: a pixel of parallax at 110 pixels
USED = 0.75  # share of them that counts: the others may be blocked
FRONT = 5e-5  # of the colour range per depth: less than any colour difference, decides ties only
MARCH = 0.7  # voxels per step along a ray: no wall of the hull is jumped
# The eight paths to a pixel (Hirschmüller 2008): rows and columns of a step.
DIRECTIONS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))


def stereo_depths(state: StateViews, hull: Hull, config: StereoConfig | None = None,
                  ) -> tuple[DepthMaps, SmallViews]:
    """Return first-surface depth maps of the training views, and the small photos they belong to.

    Args:
        state: photos; held-out views are not used.
        hull: bounds every depth.
        config: how many views, and how large the object is in them; None = the standard preset.

    Returns:
        Depth maps (0 = unknown) and the views, both at that size.
    """
    config = config or StereoConfig()
    views = _compared(state, config.stereo_views, config.stereo_side)
    solid = np.maximum(views.alphas, 1e-3)[..., None]
    images = np.ascontiguousarray(views.colors / solid, np.float32)
    near = neighbors(views.viewmats, 0.5 * (hull.lo + hull.hi))
    chosen = spread(views.viewmats, config.stereo_views)
    depths = side_by_side([partial(_depth, views, images, v, near[v], hull)
                           for v in chosen])
    own = views.select(chosen)
    return DepthMaps(np.stack(depths), own.alphas, own.Ks, own.viewmats), own


def mapped(state: StateViews, count: int, wanted: int) -> SmallViews:
    """Return the views that get a depth map, of another size.

    Args:
        state: photos.
        count: of maps, at most.
        wanted: pixels of the object's longer side.
    """
    views = _compared(state, count, wanted)
    return views.select(spread(views.viewmats, count))


def _compared(state: StateViews, count: int, wanted: int) -> SmallViews:
    """Return the views that so many depth maps are compared with."""
    return small_views(state, max(count, COMPARED), _side(state, wanted))


def _side(state: StateViews, wanted: int) -> int:
    """Return the longest image side at which the object is `wanted` pixels large."""
    sizes: list[int] = []
    for alpha in state.alphas:
        rows, cols = np.flatnonzero(alpha.any(1)), np.flatnonzero(alpha.any(0))
        if len(rows):
            sizes.append(max(int(np.ptp(rows)), int(np.ptp(cols))) + 1)
    longest = max(state.width, state.height)
    return max(16, round(longest * min(1.0, wanted / float(np.median(sizes or [longest])))))


def _depth(views: SmallViews, images: F32, v: int, near: NDArray[np.int64], hull: Hull) -> F32:
    """Return [H, W] depth of one view, 0 where the hull is missed."""
    mask = views.alphas[v] > SOLID_ALPHA
    out = np.zeros(mask.shape, np.float32)
    if not mask.any() or not len(near):
        return out
    rows, cols = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    box = (slice(int(rows[0]), int(rows[-1]) + 1), slice(int(cols[0]), int(cols[-1]) + 1))
    world_from_camera = np.linalg.inv(views.viewmats[v])
    rays = _rays(views.Ks[v], mask.shape)[box]
    first, last = _span(hull, world_from_camera, rays, np.ascontiguousarray(mask[box]))
    inside = first > 0
    if not inside.any():
        return out
    inverse = np.linspace(1 / first[inside].min(), 1 / last[inside].max(), BINS)
    image = np.ascontiguousarray(images[v][box])
    cams = np.ascontiguousarray(views.Ks[near] @ (views.viewmats[near] @ world_from_camera)[:, :3])
    cost = np.zeros((*inside.shape, BINS), np.float32)
    used = max(1, round(USED * len(near)))
    matching_cost(image, first - np.float32(hull.voxel), last + np.float32(hull.voxel), inverse,
                  rays, cams, images[near], used, FRONT, cost)
    step = inverse[0] - inverse[1]
    front = np.rint((inverse[0] - 1 / np.where(inside, first, 1.0)) / step).astype(np.float32)
    total = np.zeros_like(cost)
    for dy, dx in DIRECTIONS:
        aggregate(cost, total, image, inside, front, dy, dx)
    out[box] = np.where(inside, 1 / _minimum(total, inverse), 0.0)
    return out


def _rays(intrinsics: F64, shape: tuple[int, ...]) -> F64:
    """Return [H, W, 2] camera x and y per unit of depth."""
    rows, cols = np.mgrid[0:shape[0], 0:shape[1]] + 0.5
    return np.stack([(cols - intrinsics[0, 2]) / intrinsics[0, 0],
                     (rows - intrinsics[1, 2]) / intrinsics[1, 1]], -1)


def _span(hull: Hull, world_from_camera: F64, rays: F64,
          mask: NDArray[np.bool_]) -> tuple[F32, F32]:
    """Return [H, W] depths of the hull's front and back, 0 where it is missed."""
    first, last = np.zeros(mask.shape, np.float32), np.zeros(mask.shape, np.float32)
    eye = (world_from_camera[:3, 3] - hull.lo) / hull.voxel
    ahead = np.concatenate([rays, np.ones((*mask.shape, 1))], -1)
    ahead = ahead @ world_from_camera[:3, :3].T / hull.voxel
    middle = 0.5 * (hull.lo + hull.hi) - world_from_camera[:3, 3]
    depth = float(middle @ world_from_camera[:3, 2])
    radius = 0.5 * float(np.linalg.norm(hull.hi - hull.lo))
    step = MARCH * hull.voxel
    hull_span(hull.values, eye, ahead, mask, max(depth - radius, step), depth + radius, step, first,
              last)
    return first, last


def _minimum(total: F32, inverse: F64) -> F64:
    """Return [H, W] inverse depth of the least cost, by the parabola through three bins."""
    best = np.clip(total.argmin(-1), 1, len(inverse) - 2)
    below, here, above = (np.take_along_axis(total, (best + s)[..., None], -1)[..., 0]
                          for s in (-1, 0, 1))
    bend = np.maximum(below - 2 * here + above, 1e-9)
    shift = np.clip(0.5 * (below - above) / bend, -1.0, 1.0)
    return np.asarray(inverse[best] + shift * (inverse[1] - inverse[0]))
