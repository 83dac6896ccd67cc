"""Flat parts: walls laid flat on every part of an object, unless parts meet by it on their ways."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.mesh.flat_walls import with_flat_walls
from part2gs_robotics.mesh.place import Place
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.grid import Grid
from part2gs_robotics.model.kinematics import sweep
from part2gs_robotics.model.se3 import inverse
from part2gs_robotics.model.solids import thickness

if TYPE_CHECKING:
    from manifold3d import Manifold

CONTACT = 3e-4  # of the size: overlap as thick in the mean; checks allow 2e-3 at its deepest
EVERY = 4  # of the fewest poses of a sweep, of which it has 21: what meets does so for a stretch


def flat_surfaces(surfaces: list[Manifold], place: Place, grid: Grid) -> list[Manifold]:
    """Return the surfaces of all parts with flat walls.

    The grid carved every part out of the others' ways; a wall laid flat may reach into one again by
    a fraction of a cell. Then the part that moves keeps its noisy surface, and the other one too if
    that does not help. Parts that met before, such as a drawer behind a door, are let alone.

    Args:
        surfaces: closed, base first.
        place: joints, and the part that carries each.
        grid: that the surfaces came from.
    """
    size = float(np.linalg.norm(np.array(grid.shape) * grid.voxel))
    flat = [with_flat_walls(surface, grid.voxel, size) for surface in surfaces]
    for part in range(1, len(surfaces)):
        for other in range(part):
            poses = _poses(part, other, place, grid)
            poses = [p for p in poses if not _meet(surfaces[part], surfaces[other], p, size)]
            for rough in (part, other):
                if not any(_meet(flat[part], flat[other], pose, size) for pose in poses):
                    break
                flat[rough] = surfaces[rough]
    return flat


def _poses(part: int, other: int, place: Place, grid: Grid) -> list[F64]:
    """Return poses [4, 4] of a part in another's frame, along the ways of both."""
    ends = np.array([grid.lo, grid.lo + grid.voxel * (np.array(grid.shape) - 1.0)])
    pick = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    corners = np.where(pick, ends[1], ends[0])
    poses = sweep(part, other, place.joints, place.parents, corners, np.inf)
    return [inverse(pose) for pose in poses[::EVERY]]


def _meet(part: Manifold, other: Manifold, other_from_part: F64, size: float) -> bool:
    return thickness(part.transform(other_from_part[:3]) ^ other) > CONTACT * size
