"""Solids of boards out of exact distances, for tests of cells, planes and pruning."""

import numpy as np
from skimage.measure import marching_cubes

from part2gs_robotics.boards.board_solid import BoardSolid, board_solid
from part2gs_robotics.boards.cut import Belief
from part2gs_robotics.model.arrays import F64, I64
from part2gs_robotics.model.grid import Grid

VOXEL = 0.02
GRID = Grid(np.array([-0.6, -0.6, -0.6]), VOXEL, (61, 61, 61))
AXES = np.eye(3)


def points() -> F64:
    x, y, z = (GRID.lo[i] + VOXEL * np.arange(n) for i, n in enumerate(GRID.shape))
    return np.stack(np.meshgrid(x, y, z, indexing="ij"), -1)


def box_distance(half: F64, middle: F64 | None = None) -> F64:
    """Return [X, Y, Z] distance to a box, positive inside."""
    away = np.abs(points() - (np.zeros(3) if middle is None else middle)) - half
    outside = np.linalg.norm(np.maximum(away, 0), axis=-1)
    return -(outside + np.minimum(away.max(-1), 0))


def belief_of(distance: F64) -> Belief:
    inside = np.clip(distance / VOXEL, -1, 1).astype(np.float32)
    surface = (np.abs(distance) < 1.2 * VOXEL).astype(np.float32)
    return Belief(GRID, inside, surface, distance < -2 * VOXEL)


def surface_of(distance: F64) -> tuple[F64, I64]:
    vertices, faces, _, _ = marching_cubes(distance, 0.0, spacing=(VOXEL,) * 3)
    vertices, faces = vertices.astype(np.float64) + GRID.lo, faces.astype(np.int64)
    tri = vertices[faces]
    volume = np.einsum("ni,ni->n", tri[:, 0], np.cross(tri[:, 1], tri[:, 2])).sum()
    return vertices, faces if volume > 0 else faces[:, ::-1]


def solid_of(distance: F64) -> BoardSolid:
    return board_solid(belief_of(distance), *surface_of(distance), AXES)


def volume(solid: BoardSolid) -> float:
    return float(solid.whole.volume())
