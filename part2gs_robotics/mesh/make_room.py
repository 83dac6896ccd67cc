"""Make room: what moving parts sweep is cut out of the base, exactly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.mesh.place import Place
from part2gs_robotics.mesh.surface import arrays, flaw, vertices_apart
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.kinematics import sweep
from part2gs_robotics.model.se3 import apply, inverses

if TYPE_CHECKING:
    from manifold3d import Manifold

ARC = 8.0  # cells a corner moves between two poses: the arc bulges by 0.1 beyond its chord at most
JUMP = 2.0  # steps: poses farther apart begin another way
FINE = 1e-3  # cells: what a cut leaves behind is tidied by so much
LOOSE = 0.01  # of the volume: what a cut leaves hanging in the air, smaller than that, is dropped


def with_room(base: Manifold, moving: Sequence[Sequence[Manifold]], place: Place,
              voxel: float) -> Manifold:
    """Return the base without what moving parts sweep from state 0 to state 1.

    Args:
        base: closed.
        moving: convex pieces of every moving part, in the world frame at state 0.
        place: joints, and the part that carries each.
        voxel: size of the grid's cells, scene units.
    """
    import manifold3d

    swept: list[Manifold] = []
    for k, pieces in enumerate(moving, 1):
        for ends in _strides(k, pieces, place, voxel):
            swept += [hull for piece in pieces if not (hull := _between(piece, ends)).is_empty()]
    if not swept:
        return base
    cut = base - manifold3d.Manifold.batch_boolean(swept, manifold3d.OpType.Add)
    cut = without_bits(vertices_apart(cut.simplify(FINE * voxel), voxel))
    return cut if flaw(cut) is None else base


def without_bits(solid: Manifold) -> Manifold:
    """Return a solid without loose pieces that are a crumb of it."""
    import manifold3d

    pieces, whole = solid.decompose(), solid.volume()
    kept = [piece for piece in pieces if piece.volume() > LOOSE * whole]
    if len(kept) == len(pieces) or not kept:
        return solid
    return manifold3d.Manifold.compose(kept)


def _strides(part: int, pieces: Sequence[Manifold], place: Place, voxel: float) -> list[F64]:
    """Return pairs of poses [2, 4, 4] of a part in the world, one after the other on its way."""
    points = np.concatenate([np.zeros((0, 3)), *(arrays(piece)[0] for piece in pieces)])
    if not len(points):
        return []
    ends = np.array([points.min(0), points.max(0)])
    pick = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    corners = np.where(pick, ends[1], ends[0])
    poses = np.asarray(inverses(sweep(part, 0, place.joints, place.parents, corners, ARC * voxel)))
    way = np.stack([apply(pose, corners) for pose in poses])
    steps = np.linalg.norm(np.diff(way, axis=0), axis=2).max(1)
    turned = np.abs(poses[:, :3, :3] - poses[0, :3, :3]).max() > 0
    lone = part not in place.parents and place.parents[part - 1] == 0
    if lone and not turned:  # a slide sweeps the hull of its two ends
        return [poses[[0, -1]]]
    return [poses[[i, i + 1]] for i in range(len(steps)) if steps[i] < JUMP * ARC * voxel]


def _between(piece: Manifold, poses: F64) -> Manifold:
    """Return the hull of a convex piece at both ends of a stride."""
    import manifold3d

    points = arrays(piece)[0]
    both = np.concatenate([apply(pose, points) for pose in poses])
    return manifold3d.Manifold.hull_points(np.ascontiguousarray(both))
