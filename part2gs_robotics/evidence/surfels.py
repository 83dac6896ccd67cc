"""Oriented, coloured surface points of one state, fused from its depth maps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.evidence.depth_maps import DepthMaps
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint

NORMAL_STEP = 2  # pixels: rendered depth has pixel-scale noise, two pixels average it
FILL = 1.25  # cells per sample: a cell of one pixel is missed by a view that looks askew
FLOATER = 25  # surfels: what moves as one has thousands, and less of it in a state is no part
MAX_SLOPE = 6.0  # depth change per pixel footprint; steeper = silhouette edge or grazing view


@dataclass(frozen=True)
class Surfels:
    """N surface elements in the world frame of one state.

    Attributes:
        points: [N, 3] scene units.  normals: [N, 3] unit, towards the cameras.
        colors: [N, 3] in [0, 1].  views: [N] number of views that agree on the point.
    """

    points: F64
    normals: F64
    colors: F64
    views: NDArray[np.int64]

    def __len__(self) -> int:
        """Number of surfels."""
        return len(self.points)

    def select(self, index: NDArray[np.bool_] | NDArray[np.int64] | slice) -> Surfels:
        """Return the surfels picked by a mask, by indices or by a slice."""
        return Surfels(
            self.points[index], self.normals[index], self.colors[index], self.views[index]
        )


def sampling(maps: DepthMaps, voxel: float) -> tuple[float, int]:
    """Return the cell size and the pixel stride with which every cell seen gets a sample.

    Args:
        maps: depth maps of one state.
        voxel: cell size wanted, scene units; coarse images get a larger one.
    """
    focal = np.broadcast_to(maps.Ks[:, 0, 0, None, None], maps.depths.shape)
    seen = maps.depths > 0
    pixel = float(np.median(maps.depths[seen] / focal[seen])) if seen.any() else 0.0
    stride = 2 if 2 * FILL * pixel <= voxel else 1
    return max(voxel, stride * FILL * pixel), stride


def fuse_surfels(
    maps: DepthMaps, images: NDArray[np.uint8], voxel: float, *, min_views: int = 3, stride: int = 2
) -> Surfels:
    """Return one averaged surfel per voxel and facing direction, seen by several views.

    Args:
        maps: depth maps of one state.
        images: [V, H, W, 3] uint8 RGB of the same views.
        voxel: cell size in scene units.
        min_views: fewer views agreeing on a cell drop it (floaters are seen by one or two).
        stride: every stride-th pixel is used.
    """
    rows = [_view_samples(maps, images, v, stride) for v in range(len(maps.depths))]
    points, normals, colors = (np.concatenate([r[i] for r in rows]) for i in range(3))
    if not len(points):
        return Surfels(points, normals, colors, np.zeros(0, np.int64))
    view = np.concatenate([np.full(len(r[0]), v) for v, r in enumerate(rows)])
    # Facing direction in the key keeps the two sides of a thin door apart.
    dominant = np.abs(normals).argmax(1)
    side = 2 * dominant + (np.take_along_axis(normals, dominant[:, None], 1)[:, 0] > 0)
    cell = np.floor(points / voxel).astype(np.int64)
    cell -= cell.min(0)
    span = cell.max(0) + 1
    key = ((cell[:, 0] * span[1] + cell[:, 1]) * span[2] + cell[:, 2]) * 6 + side
    _, inverse, count = np.unique(key, return_inverse=True, return_counts=True)
    pairs = np.unique(inverse.astype(np.int64) * len(maps.depths) + view) // len(maps.depths)
    views = np.bincount(pairs, minlength=len(count))

    def mean(values: F64) -> F64:
        return np.stack([np.bincount(inverse, values[:, i]) for i in range(3)], 1) / count[:, None]

    keep = views >= min_views
    normal = mean(normals)[keep]
    normal /= np.maximum(
        np.linalg.norm(normal, axis=1, keepdims=True), 1e-9
    )  # opposite normals cancel
    return Surfels(mean(points)[keep], normal, mean(colors)[keep], views[keep])


def _view_samples(
    maps: DepthMaps, images: NDArray[np.uint8], v: int, stride: int
) -> tuple[F64, F64, F64]:
    depth = maps.depths[v].astype(np.float64)
    height, width = depth.shape
    s = NORMAL_STEP
    rows, cols = np.mgrid[s : height - s : stride, s : width - s : stride]
    fx, fy = maps.Ks[v][0, 0], maps.Ks[v][1, 1]

    def unproject(r: NDArray[np.int64], c: NDArray[np.int64]) -> F64:
        z = depth[r, c]
        return np.stack(
            [(c + 0.5 - maps.Ks[v][0, 2]) / fx * z, (r + 0.5 - maps.Ks[v][1, 2]) / fy * z, z], -1
        )

    across = unproject(rows, cols + s) - unproject(rows, cols - s)
    down = unproject(rows + s, cols) - unproject(rows - s, cols)
    middle = unproject(rows, cols)
    z = middle[..., 2]
    limit = MAX_SLOPE * 2 * s * z / fx
    ok = (z > 0) & (np.abs(across[..., 2]) < limit) & (np.abs(down[..., 2]) < limit)
    for r, c in ((rows, cols + s), (rows, cols - s), (rows + s, cols), (rows - s, cols)):
        ok &= depth[r, c] > 0
    normal = np.cross(down, across)[ok]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    points = middle[ok]
    normal *= -np.sign(
        (normal * points).sum(1, keepdims=True) + 1e-12
    )  # towards the camera at the origin
    rot, trans = maps.viewmats[v][:3, :3], maps.viewmats[v][:3, 3]
    return (points - trans) @ rot, normal @ rot, images[v][rows[ok], cols[ok]] / 255.0


def at_home(h: Joint, own: tuple[Surfels, Surfels]) -> F64:
    """Return [n, 3] points of a part's surfels of both states, where they are in state 0."""
    zero, one = own
    return np.concatenate([zero.points, se3.apply(se3.inverse(h.move), one.points)])


def apart(one: Joint, two: Joint, own: tuple[Surfels, Surfels]) -> float:
    """Return how far apart two motions carry a part's surfels on average, scene units.

    Args:
        one: a motion.
        two: another one, that of the surfels.
        own: the part's surfels of both states; infinitely far without any.
    """
    points = at_home(two, own)
    gaps = np.linalg.norm(se3.apply(one.move, points) - se3.apply(two.move, points), axis=1)
    return float(gaps.mean()) if len(points) else float("inf")
