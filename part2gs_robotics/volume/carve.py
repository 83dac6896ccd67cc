"""Carve: take what moving parts sweep out of what stands in their way, on grids."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.model.grid import Grid, index_move
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel
from part2gs_robotics.volume.fuse import TRUNCATION

OUTSIDE = -1.5  # voxels: no surface passes beside a voxel that far outside


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


@kernel
def _carve(values: F32, rival: F32, moves: F64, clearance: float, support: F32,
           rival_support: F32) -> None:
    nx, ny, nz = values.shape
    hx, hy, hz = rival.shape[0] - 1, rival.shape[1] - 1, rival.shape[2] - 1
    judged = support.size > 0
    for_each(nx, _carve_at, (values, rival, moves, clearance, support, rival_support, ny, nz, hx,
                             hy, hz, judged))


@inlined
def _carve_at(x: int, values: F32, rival: F32, moves: F64, clearance: float, support: F32,
              rival_support: F32, ny: int, nz: int, hx: int, hy: int, hz: int,
              judged: bool) -> None:
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
