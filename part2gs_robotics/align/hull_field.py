"""How far points lie inside or outside the visual hull of one state, finer than its cells."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.scene import StateViews

CELLS = 64  # along the longest side: 1.6 % of it, between which distances are linear
FAR = 0.12  # of the box's diagonal outside: further ones tell nothing more, and cost time
MASK_SIDE = 400  # px: a pixel is then a quarter of a cell, and a state takes a second
MASK_ON = 128  # alpha above half counts as object, as in the hull

F32 = NDArray[np.float32]


@dataclass(frozen=True)
class HullField:
    """Signed distances to the hull on a grid.

    Attributes:
        inside: [X, Y, Z] distance in scene units, positive inside.
        low: [3] place of the first grid point.
        cell: edge between grid points, scene units.
    """

    inside: F32
    low: F64
    cell: float

    def at(self, points: F64) -> tuple[F64, F64]:
        """Return distances [N] at points [N, 3], linear between grid points, and their slope.

        Beyond the grid both are those of its border.
        """
        place = np.clip((points - self.low) / self.cell, 0, np.array(self.inside.shape) - 1.001)
        first = place.astype(np.int64)
        part = place - first
        a, b, c = first.T
        corners = [self.inside[a + i, b + j, c + k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
        cube = np.stack(corners, -1).astype(float).reshape(-1, 2, 2, 2)
        x, y, z = (np.stack([1 - part[:, k], part[:, k]], -1) for k in range(3))
        step = np.array([-1.0, 1.0])
        value = np.einsum("nijk,ni,nj,nk->n", cube, x, y, z)
        slope = np.stack([np.einsum("nijk,i,nj,nk->n", cube, step, y, z),
                          np.einsum("nijk,ni,j,nk->n", cube, x, step, z),
                          np.einsum("nijk,ni,nj,k->n", cube, x, y, step)], -1)
        return value, slope / self.cell

    def surface(self) -> F64:
        """Return points [N, 3] of the hull's surface: where edges of the grid pass through it."""
        out = []
        for axis in range(3):
            near = np.moveaxis(self.inside, axis, 0)
            a, b = near[:-1], near[1:]
            at = np.argwhere((a > 0) != (b > 0))
            one, two = a[tuple(at.T)], b[tuple(at.T)]
            place = at.astype(float)
            place[:, 0] += one / (one - two)
            order = [1, 2]
            order.insert(axis, 0)
            out.append(place[:, order])
        return np.asarray(self.low + self.cell * np.concatenate(out))


def hull_field(state: StateViews, low: F64, high: F64) -> HullField:
    """Return the field of one state in a box.

    A view says of a point how far it is from the outline, at the point's depth; the view that says
    least counts. Near the hull that is the distance to its surface. A view in whose picture a point
    does not lie says nothing.

    Args:
        state: photos with masks.
        low: [3] corner of the box.
        high: [3] the opposite corner.
    """
    cell = float((high - low).max()) / CELLS
    shape = np.ceil((high - low) / cell).astype(int) + 1
    axes = [low[k] + cell * np.arange(shape[k]) for k in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3).astype(np.float32)
    least = np.full(len(points), np.inf, np.float32)
    floor = -FAR * float(np.linalg.norm(high - low))
    left = np.arange(len(points))
    for alpha, K, view in zip(state.alphas, state.Ks, state.viewmats, strict=True):
        seen, told = _told(alpha, K, view, points[left])
        least[left[seen]] = np.minimum(least[left[seen]], told)
        left = left[least[left] > floor]
    least[~np.isfinite(least)] = -cell  # seen by no photo: outside, as in the hull
    return HullField(np.maximum(least, np.float32(floor)).reshape(shape), low, cell)


def _told(alpha: NDArray[np.uint8], K: F64, view: F64, points: F32,
          ) -> tuple[NDArray[np.int64], F32]:
    """Return which points a photo shows, and how far inside its outline each is, scene units."""
    height, width = alpha.shape
    scale = min(1.0, MASK_SIDE / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    mask = (cv2.resize(alpha, size, interpolation=cv2.INTER_AREA) >= MASK_ON).astype(np.uint8)
    within, away = (cv2.distanceTransform(m, cv2.DIST_L2, 5) for m in (mask, 1 - mask))
    lens = np.diag([size[0] / width, size[1] / height, 1.0]) @ K
    camera = np.asarray(lens @ view[:3], np.float32)
    local = points @ camera[:, :3].T + camera[:, 3]
    depth = local[:, 2]
    pixels = local[:, :2] / np.where(depth > 1e-9, depth, 1.0)[:, None] - np.float32(0.5)
    inner = np.all((pixels >= 0) & (pixels <= np.array(size) - 1), axis=1)
    at = np.flatnonzero(inner & (depth > 0))
    tangent = np.asarray((within - away) / lens[0, 0], np.float32)
    inner_pixels = np.asarray(pixels[at], np.float32)
    return at, np.asarray(_bilinear(tangent, inner_pixels) * depth[at], np.float32)


def _bilinear(picture: F32, pixels: F32) -> F32:
    """Return a picture's values [N] between its pixels, all of them inside of it."""
    first = np.minimum(pixels.astype(np.int32), np.array(picture.shape[::-1], np.int32) - 2)
    (x, y), (u, v) = first.T, (pixels - first).T
    top = picture[y, x] * (1 - u) + picture[y, x + 1] * u
    low = picture[y + 1, x] * (1 - u) + picture[y + 1, x + 1] * u
    return np.asarray(top * (1 - v) + low * v)


def edge_views(state: StateViews, points: F64, near: float) -> NDArray[np.int64]:
    """Return [N] in how many photos of a state a point lies on the outline, or nearly.

    Args:
        state: photos with masks.
        points: [N, 3] on the hull's surface.
        near: what counts as on it, scene units.
    """
    count = np.zeros(len(points), np.int64)
    places = points.astype(np.float32)
    for alpha, K, view in zip(state.alphas, state.Ks, state.viewmats, strict=True):
        seen, told = _told(alpha, K, view, places)
        count[seen] += np.abs(told) < near
    return count
