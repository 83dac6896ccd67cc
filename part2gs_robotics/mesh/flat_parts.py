"""Flat parts: walls laid flat on every part of an object, unless parts meet by it on their ways."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.mesh.flat_walls import NOWHERE, with_flat_walls
from part2gs_robotics.mesh.place import Place
from part2gs_robotics.mesh.surface import arrays
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.grid import Grid
from part2gs_robotics.model.kinematics import sweep
from part2gs_robotics.model.se3 import inverse
from part2gs_robotics.model.solids import thickness

if TYPE_CHECKING:
    from manifold3d import Manifold

CONTACT = 3e-4  # of the size: overlap as thick in the mean; checks allow 2e-3 at its deepest
SPACING = 0.01  # of the size between points of an overlap; walls are found from a little farther
EVERY = 4  # of the fewest poses of a sweep, of which it has 21: what meets does so for a stretch


def flat_surfaces(surfaces: list[Manifold], place: Place, grid: Grid) -> list[Manifold]:
    """Return the surfaces of all parts with flat walls.

    The grid carved every part out of the others' ways; a wall laid flat may reach into one again by
    a fraction of a cell. Then the walls that meet stay noisy, those of the part that moves first,
    and the whole part where that does not help. Parts that met before are let alone.

    Args:
        surfaces: closed, base first.
        place: joints, and the part that carries each.
        grid: that the surfaces came from.
    """
    size = float(np.linalg.norm(np.array(grid.shape) * grid.voxel))
    flat = [with_flat_walls(surface, grid.voxel, size) for surface in surfaces]
    kept = [NOWHERE for _ in surfaces]
    for part in range(1, len(surfaces)):
        for other in range(part):
            poses = [pose for pose in _poses(part, other, place, grid)
                     if not len(_meeting(surfaces[part], surfaces[other], pose, size)[0])]
            for rough, whole in ((part, False), (other, False), (part, True), (other, True)):
                met = [_meeting(flat[part], flat[other], pose, size) for pose in poses]
                points = np.concatenate([NOWHERE, *(m[int(rough == other)] for m in met)])
                if not len(points):
                    break
                kept[rough] = np.concatenate([kept[rough], points])
                flat[rough] = surfaces[rough] if whole else with_flat_walls(
                    surfaces[rough], grid.voxel, size, kept[rough])
    return flat


def _poses(part: int, other: int, place: Place, grid: Grid) -> list[F64]:
    """Return poses [4, 4] of a part in another's frame, along the ways of both."""
    ends = np.array([grid.lo, grid.lo + grid.voxel * (np.array(grid.shape) - 1.0)])
    pick = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    corners = np.where(pick, ends[1], ends[0])
    poses = sweep(part, other, place.joints, place.parents, corners, np.inf)
    return [inverse(pose) for pose in poses[::EVERY]]


def _meeting(part: Manifold, other: Manifold, other_from_part: F64, size: float) -> tuple[F64, F64]:
    """Return points where two solids overlap, in the frames of both; none where they just touch."""
    overlap = part.transform(other_from_part[:3]) ^ other
    if thickness(overlap) <= CONTACT * size:
        return NOWHERE, NOWHERE
    points, _ = arrays(overlap.refine_to_length(SPACING * size))
    back = inverse(other_from_part)
    return points @ back[:3, :3].T + back[:3, 3], points
