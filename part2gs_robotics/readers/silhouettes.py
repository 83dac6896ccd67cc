"""Silhouettes of one state, shrunk, and the coarse cells of space that they leave."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import SceneError
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.scene import StateViews

MASK_ON = 128  # alpha above half counts as object, as in the hull
GRID = 40  # cells per axis: 64,000 points decide alignment to 2.5 % of the object
BOX_GRID = 24  # cells per axis while the box is looked for
MASK_SIDE = 160  # masks are shrunk to this: one of its pixels is below one cell of the grid
CLEAR = 2.5  # cells outside a mask: nearer ones may belong to what touches it

Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Silhouettes:
    """Shrunk outlines of the views that show the object.

    Attributes:
        views: [V] which views of the state they are; the others show no object.
        away: per view, [h, w] distance in shrunk pixels to the mask, 0 on it.
        cameras: [V, 3, 4] float32 projections into the shrunk images.
        focal: [V] shrunk pixels.
        eyes, rays: [V, 3] camera centres and unit rays through the middle of the masks.
        spans: [V] half the diagonal of the mask, as a tangent.
    """

    views: NDArray[np.int64]
    away: tuple[NDArray[np.float32], ...]
    cameras: NDArray[np.float32]
    focal: F64
    eyes: F64
    rays: F64
    spans: F64

    @property
    def whole(self) -> Bools:
        """[V] which masks keep clear of the border of their image."""
        borders = (np.concatenate([a[0], a[-1], a[:, 0], a[:, -1]]) for a in self.away)
        return np.array([bool(border.all()) for border in borders])

    def select(self, keep: Bools) -> Silhouettes:
        """Return the outlines where keep [V] is true."""
        away = tuple(one for one, kept in zip(self.away, keep, strict=True) if kept)
        return Silhouettes(self.views[keep], away, self.cameras[keep], self.focal[keep],
                           self.eyes[keep], self.rays[keep], self.spans[keep])


def silhouettes(state: StateViews) -> Silhouettes:
    """Return the outlines of all views whose mask is not empty."""
    scale = min(1.0, MASK_SIDE / max(state.width, state.height))
    size = (max(1, round(state.width * scale)), max(1, round(state.height * scale)))
    zoom = np.diag([size[0] / state.width, size[1] / state.height, 1.0])
    away, middles, corners, used = [], [], [], []
    for view, alpha in enumerate(state.alphas):
        small = cv2.resize(alpha, size, interpolation=cv2.INTER_AREA) >= MASK_ON
        if not small.any():
            continue
        away.append(np.asarray(cv2.distanceTransform((~small).astype(np.uint8), cv2.DIST_L2, 3),
                               np.float32))
        rows, columns = np.nonzero(small)
        middles.append([(columns.min() + columns.max() + 1) / 2,
                        (rows.min() + rows.max() + 1) / 2, 1.0])
        corners.append(np.hypot(np.ptp(rows) + 1, np.ptp(columns) + 1) / 2)
        used.append(view)
    Ks, viewmats = zoom @ state.Ks[used], state.viewmats[used]
    rotations = viewmats[:, :3, :3].swapaxes(1, 2)  # world_from_camera
    rays = (rotations @ np.linalg.solve(Ks, np.array(middles)[..., None]))[..., 0]
    eyes = -(rotations @ viewmats[:, :3, 3:])[..., 0]
    return Silhouettes(np.array(used), tuple(away), np.asarray(Ks @ viewmats[:, :3], np.float32),
                       Ks[:, 0, 0], eyes, rays / np.linalg.norm(rays, axis=1, keepdims=True),
                       corners / Ks[:, 0, 0])


def object_box(outline: Silhouettes, where: str) -> tuple[F64, F64]:
    """Return corners of a box around the object, from silhouettes alone.

    The centre is the point nearest to the middle rays of all masks; the first cube is wider than
    the widest silhouette and shrinks to the carved cells.

    Raises:
        SceneError: the silhouettes meet nowhere.
    """
    low, high = _first_cube(outline)
    for _ in range(2):  # the second round sharpens a first cube several times too large
        points, cell = grid_points(low, high, BOX_GRID)
        kept = points[touching(outline, points, cell)]
        if not len(kept):
            raise SceneError(
                f"{where}: silhouettes and cameras contradict each other, no point of space is "
                f"inside the masks of {len(outline.away)} views. Expected camera-to-world matrices "
                "with OpenGL axes and masks of one still object; check both.")
        low, high = kept.min(0) - cell, kept.max(0) + cell
    return low, high


def _first_cube(outline: Silhouettes) -> tuple[F64, F64]:
    across = np.eye(3) - outline.rays[:, :, None] * outline.rays[:, None, :]
    # a millionth of a ray's weight: only parallel rays notice it
    system = across.sum(0) + 1e-6 * np.eye(3)
    centre = np.linalg.solve(system, (across @ outline.eyes[..., None]).sum(0)[:, 0])
    reach = np.abs(((centre - outline.eyes) * outline.rays).sum(1))
    half = 1.5 * float((reach * outline.spans).max())
    return centre - half, centre + half


def grid_points(low: F64, high: F64, side: int) -> tuple[NDArray[np.float32], float]:
    """Return [side**3, 3] cell centres of the box and the longest cell edge."""
    axes = [lo + (np.arange(side) + 0.5) * (hi - lo) / side
            for lo, hi in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return points.astype(np.float32), float((high - low).max() / side)


def touching(outline: Silhouettes, points: NDArray[np.float32], cell: float,
             forgiven: int | None = None) -> Bools:
    """Return which cells may touch the object: in no view further than a cell from its mask.

    So many dissenting views are forgiven, one per ten if None; half of the views must see the cell.
    """
    against, seen = (np.zeros(len(points), np.int32) for _ in range(2))
    for away, camera, focal in zip(outline.away, outline.cameras, outline.focal, strict=True):
        at, row, column, depth = _pixels(camera, points, away.shape)
        # half the diagonal of a cell is 0.87 edges
        against[at] += away[row, column] > 0.87 * cell * focal / depth
        seen[at] += 1
    views = len(outline.away)
    few = views // 10 if forgiven is None else forgiven
    return np.asarray((against <= few) & (seen > views // 2))


def unexplained(outline: Silhouettes, kept: NDArray[np.float32], cell: float) -> F64:
    """Return per view the share of its mask that no kept cell projects onto."""
    covers = _covers(outline, kept, cell, 1.0)
    return np.array([1.0 - float(cover[away == 0].mean())
                     for (cover, _), away in zip(covers, outline.away, strict=True)])


def unmasked(outline: Silhouettes, kept: NDArray[np.float32], cell: float) -> F64:
    """Return per view what kept cells cover far outside its mask, as a share of the mask."""
    covers = _covers(outline, kept, cell, 0.5)
    return np.array([np.count_nonzero(cover & (away > CLEAR * size)) / np.count_nonzero(away == 0)
                     for (cover, size), away in zip(covers, outline.away, strict=True)])


def _covers(outline: Silhouettes, kept: NDArray[np.float32], cell: float, reach: float,
            ) -> Iterator[tuple[Bools, float]]:
    """Yield per view [h, w] where kept cells project to, `reach` cells around, and a cell in px."""
    for away, camera, focal in zip(outline.away, outline.cameras, outline.focal, strict=True):
        at, row, column, depth = _pixels(camera, kept, away.shape)
        covered = np.zeros(away.shape, np.uint8)
        covered[row, column] = 1
        size = float(cell * focal / np.median(depth)) if len(at) else 0.0
        brush = np.ones((2 * min(int(np.ceil(reach * size)), MASK_SIDE) + 1,) * 2, np.uint8)
        yield np.asarray(cv2.dilate(covered, brush)) > 0, size


def _pixels(
    camera: NDArray[np.float32], points: NDArray[np.float32], shape: tuple[int, ...],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
    """Return index, row, column and depth of the points inside the image."""
    u, v, depth = camera[:, :3] @ points.T + camera[:, 3:]
    front = depth > 1e-9  # behind or in the camera plane there is no pixel
    depth = np.where(front, depth, 1.0)
    u, v = u / depth, v / depth
    at = np.flatnonzero(front & (u >= 0) & (v >= 0) & (u < shape[1]) & (v < shape[0]))
    return at, v[at].astype(np.int64), u[at].astype(np.int64), depth[at].astype(np.float32)
