"""See-through: where a twin lets photos look through it though they show a surface there.

A fitted depth may be too noisy for a cell to be inside by it alone: a floor without texture, a pane
that bulges. But every pixel of the mask must end on something; the cells along its ray, those near
the fitted depth first, share what stopping it is worth, and the cheapest of them are filled.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.boards.board_solid import BoardSolid
from part2gs_robotics.evidence.depth_maps import DepthMaps
from part2gs_robotics.model.arrays import F32, F64, I64, Mask
from part2gs_robotics.model.grid import Grid
from part2gs_robotics.model.se3 import apply, inverse
from part2gs_robotics.model.solids import arrays
from part2gs_robotics.render.mesh_depths import NEAR, draw_depths
from part2gs_robotics.volume.part_maps import PartMaps
from part2gs_robotics.volume.place import Place

if TYPE_CHECKING:
    from manifold3d import Manifold

BEYOND = 5.0  # cells behind the fitted depth: nearer is its noise
REACH = 8.0  # cells before and behind it where the surface may be
LIKELY = 3.0  # cells: deviation of fitted depths on surfaces without texture
WORTH = 1.0  # belief that stopping the ray of a face of a cell is worth, in every photo
RIM = 1  # pixels at outlines and rims of holes: there the twin may be off by as much
SOLID = 128  # of 255: more of the pixel is the object than not
TORN = 1e-3  # of a state's masks, within rims: a tenth of what silhouettes of twins are off


def unstopped(boards: Sequence[BoardSolid], place: Place,
              maps: Sequence[PartMaps]) -> list[F64]:
    """Return per part [X, Y, Z] what voxels are worth to rays that the twin does not stop.

    Args:
        boards: of all parts.
        place: of the parts in both states.
        maps: depth and part of every pixel, per state.
    """
    worth = [np.zeros(board.cells.grid.shape) for board in boards]
    voxel, meshes = boards[0].cells.grid.voxel, [arrays(board.whole) for board in boards]
    for s in (0, 1):
        poses = [place.state1_from_0[k] if s else np.eye(4) for k in range(place.count)]
        depths = drawn(meshes, poses, maps[s].maps, voxel)
        for view in range(len(maps[s].maps)):
            for k, board in enumerate(boards):
                holes = _holes(maps[s], depths[view], view, k, BEYOND * voxel)
                if holes.any():
                    points, share = _samples(maps[s], view, holes, voxel)
                    _give(worth[k], board, apply(inverse(poses[k]), points), share)
    return worth


def missed(boards: Sequence[BoardSolid], place: Place, maps: Sequence[PartMaps]) -> list[F64]:
    """Return per part [X, Y, Z] faces of cells that rays want stopped and that stop at nothing.

    Args:
        boards: of all parts.
        place: of the parts in both states.
        maps: depth and part of every pixel, per state.
    """
    grids = [board.cells.grid for board in boards]
    wanted = [np.zeros(grid.shape) for grid in grids]
    voxel, meshes = grids[0].voxel, [arrays(board.whole) for board in boards]
    for s in (0, 1):
        poses = [place.state1_from_0[k] if s else np.eye(4) for k in range(place.count)]
        depths = drawn(meshes, poses, maps[s].maps, voxel)
        for view in range(len(maps[s].maps)):
            for k, grid in enumerate(grids):
                holes = _holes(maps[s], depths[view], view, k, np.inf)
                if holes.any():
                    points, share = _samples(maps[s], view, holes, voxel)
                    index, inside = _voxels(grid, apply(inverse(poses[k]), points))
                    np.add.at(wanted[k], tuple(index.T), share.ravel()[inside])
    return wanted


def torn(before: Sequence[Manifold], after: Sequence[Manifold], place: Place,
         maps: Sequence[PartMaps], voxel: float) -> bool:
    """Say whether photos would look through what one set of surfaces stops and another does not.

    Depths may be wrong, masks are not: what they show ends on something.

    Args:
        before: closed, per part, world frame at state 0.
        after: the same parts.
        place: of the parts in both states.
        maps: depth and part of every pixel, per state.
        voxel: size of the grid's cells, scene units.
    """
    for s in (0, 1):
        poses = [place.state1_from_0[k] if s else np.eye(4) for k in range(place.count)]
        solid = maps[s].maps.alphas >= SOLID
        through = solid & np.isinf(drawn([arrays(one) for one in after], poses, maps[s].maps,
                                         voxel))
        if _tears(through, solid):  # or nothing could be, whatever was before
            old = drawn([arrays(one) for one in before], poses, maps[s].maps, voxel)
            if _tears(through & np.isfinite(old), solid):
                return True
    return False


def _tears(through: Mask, solid: Mask) -> bool:
    """Say whether pixels [V, H, W] that look through are more than rims of what is solid."""
    return bool(through.sum() > TORN * solid.sum() or any(_within(one).any() for one in through))


def _voxels(grid: Grid, points: F64) -> tuple[I64, Mask]:
    """Return indices of the voxels that points lie in, and [N] which lie in any."""
    index = np.rint((points - grid.lo) / grid.voxel).astype(int)
    inside = np.asarray(((index >= 0) & (index < np.array(grid.shape))).all(1), bool)
    return index[inside], inside


def drawn(meshes: Sequence[tuple[F64, I64]], poses: Sequence[F64], maps: DepthMaps,
          voxel: float) -> F32:
    """Return [V, H, W] depth of posed meshes in every view, infinite beside them."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    corners = np.concatenate([apply(pose, vertices)
                              for pose, (vertices, _) in zip(poses, meshes, strict=True)])
    triangles = np.concatenate([faces + start
                                for (_, faces), start in zip(meshes, starts[:-1], strict=True)])
    depths = np.full(maps.depths.shape, np.inf, np.float32)
    draw_depths(corners.astype(np.float32), triangles, maps.Ks, maps.viewmats, NEAR * voxel, depths)
    return depths


def _holes(maps: PartMaps, drawn: F32, view: int, part: int, beyond: float) -> Mask:
    """Return [H, W] pixels of a part whose rays go on behind its fitted surface."""
    fitted = maps.maps.depths[view]
    through = (fitted > 0) & (np.isinf(drawn) if np.isinf(beyond) else drawn > fitted + beyond)
    return np.asarray(_within(through) & (maps.labels[view] == part))


def _within(mask: Mask) -> Mask:
    """Return a mask [H, W] without its rim; what is beyond the image counts as outside."""
    import cv2

    if not mask.any():
        return mask
    square = np.ones((2 * RIM + 1,) * 2, np.uint8)
    return np.asarray(cv2.erode(mask.astype(np.uint8), square, borderType=cv2.BORDER_CONSTANT,
                                borderValue=0) > 0)


def _samples(maps: PartMaps, view: int, holes: Mask, voxel: float) -> tuple[F64, F64]:
    """Return points [N, S, 3] along the rays of pixels, and what each is worth [N, S]."""
    rows, columns = np.nonzero(holes)
    depth = maps.maps.depths[view][rows, columns].astype(float)
    K, world_from_camera = maps.maps.Ks[view], inverse(maps.maps.viewmats[view])
    ray = np.stack([(columns + 0.5 - K[0, 2]) / K[0, 0], (rows + 0.5 - K[1, 2]) / K[1, 1],
                    np.ones(len(rows))], 1)
    steps = np.arange(-REACH, REACH + 1.0)
    along = depth[:, None] + voxel * steps / np.linalg.norm(ray, axis=1)[:, None]
    points = apply(world_from_camera, (along[:, :, None] * ray[:, None]).reshape(-1, 3))
    footprint = (depth / K[0, 0] / voxel) ** 2  # of a pixel, in faces of cells
    share = np.exp(-0.5 * (steps / LIKELY) ** 2)
    return points, (WORTH * footprint)[:, None] * (share / share.sum())


def _give(worth: F64, board: BoardSolid, points: F64, share: F64) -> None:
    """Add what samples are worth to the voxels that they lie in, as far as none sees them free."""
    index, inside = _voxels(board.cells.grid, points)
    x, y, z = index.T
    unseen = 1.0 + np.minimum(board.belief.inside[x, y, z], 0.0)
    np.add.at(worth, (x, y, z), share.ravel()[inside] * unseen)
