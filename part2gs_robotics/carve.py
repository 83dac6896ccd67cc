"""Carve: take what moving parts sweep out of what stands in their way, on grids."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numba
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.fuse import TRUNCATION, Grid
from part2gs_robotics.joints import Joint
from part2gs_robotics.render_jit import kernel, parallel_kernel
from part2gs_robotics.se3 import inverses

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

MOST_POSES = 160  # poses per sweep; more would step less than half a voxel at 192 voxels
OUTSIDE = -1.5  # voxels: no surface passes beside a voxel that far outside
COARSE_POSES = 17  # of a path: enough to measure how long it is
FEWEST_POSES = 21  # the simulator checks measure interpenetration at 21 joint values


@dataclass(frozen=True)
class Solid:
    """One part as a sampled signed distance in the world frame at state 0.

    Attributes:
        grid: where.
        values: [X, Y, Z] float32 signed distance in voxels, positive inside, clipped to TRUNCATION.
    """

    grid: Grid
    values: F32

    @property
    def volume(self) -> float:
        """Volume of the voxels inside, scene units cubed."""
        return float(np.count_nonzero(self.values > 0)) * self.grid.voxel**3

    def corners(self) -> F64:
        """Return [8, 3] corners of the box of voxels inside; of the grid when it is empty."""
        index = np.argwhere(self.values > 0)
        ends = (index.min(0) - 1, index.max(0) + 1) if len(index) else (
            np.zeros(3), np.array(self.grid.shape) - 1.0)
        pick = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
        return np.asarray(self.grid.lo + self.grid.voxel * np.where(pick, ends[1], ends[0]))


def chain(part: int, joints: Sequence[Joint], parents: Sequence[int],
          positions: Sequence[float] | F64) -> F64:
    """Return [4, 4] world_at_q_from_world_at_0 of a part, carried by its parents.

    Args:
        part: 0 = base.
        joints: of parts 1..K.
        parents: parent part of parts 1..K.
        positions: joint positions of parts 1..K.
    """
    return chains(part, joints, parents, np.asarray(positions, np.float64)[None])[0]


def chains(part: int, joints: Sequence[Joint], parents: Sequence[int], positions: F64) -> F64:
    """Return [P, 4, 4] `chain` of [P, K] joint positions."""
    out = np.tile(np.eye(4), (len(positions), 1, 1))
    while part > 0:
        out = joints[part - 1].transforms(positions[:, part - 1]) @ out
        part = parents[part - 1]
    return out


def ancestors(part: int, parents: Sequence[int]) -> list[int]:
    """Return the part and the moving parts that carry it, innermost first."""
    out = []
    while part > 0:
        out.append(part)
        part = parents[part - 1]
    return out


def sweep(part: int, carrier: int, joints: Sequence[Joint], parents: Sequence[int],
          corners: F64, step: float) -> F64:
    """Return [P, 4, 4] part_from_carrier: a point of the carrier's frame in the moving part's.

    Every joint of either chain runs through its range with the others at state 0 and at state 1,
    and all of them together from state 0 to state 1.

    Args:
        part: the part that sweeps.
        carrier: the part that is swept.
        joints: of parts 1..K.
        parents: of parts 1..K.
        corners: [8, 3] box of the sweeping part, to bound how far it moves.
        step: no corner may move further between two poses, scene units.
    """
    values = np.array([j.value for j in joints])
    involved = sorted(set(ancestors(part, parents)) ^ set(ancestors(carrier, parents)))
    paths = [(np.zeros(len(joints)), values)]
    if len(involved) > 1:
        for mover in involved:
            for others in (np.zeros(len(joints)), values):
                start, end = others.copy(), others.copy()
                start[mover - 1], end[mover - 1] = 0.0, values[mover - 1]
                paths.append((start, end))
    poses = []
    for start, end in paths:
        def relative(count: int, a: F64 = start, b: F64 = end) -> F64:
            q = a + np.linspace(0, 1, count)[:, None] * (b - a)
            return np.asarray(inverses(chains(part, joints, parents, q))
                              @ chains(carrier, joints, parents, q))

        poses.append(relative(_pose_count(relative, corners, step)))
    return np.concatenate(poses)


def _pose_count(relative: Callable[[int], F64], corners: F64, step: float) -> int:
    """Return how many poses keep every corner's move below a step."""
    coarse = inverses(relative(COARSE_POSES))
    path = np.einsum("pij,nj->pni", coarse[:, :3, :3], corners) + coarse[:, None, :3, 3]
    longest = float(np.linalg.norm(np.diff(path, axis=0), axis=2).sum(0).max())
    return int(np.clip(np.ceil(longest / step) + 1, FEWEST_POSES, MOST_POSES))


def carve(solid: Solid, rival: Solid, rival_from_solid: F64, clearance: float,
          support: tuple[F32, F32] | None = None) -> Solid:
    """Return the solid without what the rival covers in any of the poses.

    Args:
        solid: what stands in the way.
        rival: what moves.
        rival_from_solid: [P, 4, 4].
        clearance: gap to leave, voxels.
        support: how well each voxel of the solid and of the rival is observed; the solid then
            yields only where the rival is observed better, and nowhere at infinity.
    """
    none = np.zeros((0, 0, 0), np.float32)
    mine, theirs = support if support is not None else (none, none)
    values = solid.values.copy()
    _carve(values, rival.values, index_move(rival.grid, rival_from_solid, solid.grid),
           clearance, mine, theirs)
    return replace(solid, values=values)


def index_move(to: Grid, to_from_grid: F64, grid: Grid) -> F64:
    """Return [P, 4, 4] moves [P, 4, 4] as maps from voxel indices to voxel indices."""
    index_from_world, world_from_index = np.eye(4) / to.voxel, np.eye(4) * grid.voxel
    index_from_world[:, 3] = (*(-to.lo / to.voxel), 1.0)
    world_from_index[:, 3] = (*grid.lo, 1.0)
    return np.ascontiguousarray(index_from_world @ to_from_grid @ world_from_index)


@kernel
def _sample(values: F32, x: float, y: float, z: float) -> float:
    """Return the trilinear value at a point inside the grid."""
    nx, ny, nz = values.shape
    i, j, k = min(int(x), nx - 2), min(int(y), ny - 2), min(int(z), nz - 2)
    fx, fy, fz = x - i, y - j, z - k
    near = ((values[i, j, k] * (1 - fx) + values[i + 1, j, k] * fx) * (1 - fy)
            + (values[i, j + 1, k] * (1 - fx) + values[i + 1, j + 1, k] * fx) * fy)
    far = ((values[i, j, k + 1] * (1 - fx) + values[i + 1, j, k + 1] * fx) * (1 - fy)
           + (values[i, j + 1, k + 1] * (1 - fx) + values[i + 1, j + 1, k + 1] * fx) * fy)
    return near * (1 - fz) + far * fz


@parallel_kernel
def _carve(values: F32, rival: F32, moves: F64, clearance: float, support: F32,
           rival_support: F32) -> None:
    nx, ny, nz = values.shape
    hx, hy, hz = rival.shape[0] - 1, rival.shape[1] - 1, rival.shape[2] - 1
    judged = support.size > 0
    for x in numba.prange(nx):
        for y in range(ny):
            for z in range(nz):
                value = values[x, y, z]
                if judged and support[x, y, z] == np.inf:
                    continue
                for p in range(len(moves)):
                    if value <= OUTSIDE:
                        break
                    m = moves[p]
                    u = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]
                    v = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]
                    w = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
                    if not (u >= 0.0 and v >= 0.0 and w >= 0.0 and u <= hx and v <= hy and w <= hz):
                        continue
                    if judged and _sample(rival_support, u, v, w) <= support[x, y, z]:
                        continue
                    value = min(value, -_sample(rival, u, v, w) - clearance)
                values[x, y, z] = max(value, np.float32(-TRUNCATION))
