"""Grids of voxels, and moves between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64


def index_move(to: Grid, to_from_grid: F64, grid: Grid) -> F64:
    """Return [P, 4, 4] moves [P, 4, 4] as maps from voxel indices to voxel indices."""
    index_from_world, world_from_index = np.eye(4) / to.voxel, np.eye(4) * grid.voxel
    index_from_world[:, 3] = (*(-to.lo / to.voxel), 1.0)
    world_from_index[:, 3] = (*grid.lo, 1.0)
    return np.ascontiguousarray(index_from_world @ to_from_grid @ world_from_index)


@dataclass(frozen=True)
class Grid:
    """A box of cubic voxels in the world frame at state 0.

    Attributes:
        lo: [3] centre of voxel (0, 0, 0), scene units.
        voxel: edge length, scene units.
        shape: number of voxels per axis.
    """

    lo: F64
    voxel: float
    shape: tuple[int, int, int]

    @staticmethod
    def around(lo: F64, hi: F64, voxel: float) -> Grid:
        """Return the smallest grid whose voxel centres reach from lo to hi."""
        x, y, z = np.maximum(2, np.ceil((hi - lo) / voxel - 1e-6).astype(int) + 1)
        return Grid(np.asarray(lo, np.float64), voxel, (int(x), int(y), int(z)))

    def window(self, lo: F64, hi: F64) -> Grid:
        """Return the part of this grid that covers the box [lo, hi], on the same voxel centres."""
        first = np.clip(np.floor((lo - self.lo) / self.voxel), 0, np.array(self.shape) - 2)
        last = np.clip(np.ceil((hi - self.lo) / self.voxel), first + 1, np.array(self.shape) - 1)
        x, y, z = (last - first).astype(int) + 1
        return Grid(self.lo + self.voxel * first, self.voxel, (int(x), int(y), int(z)))

    def slices(self, window: Grid) -> tuple[slice, slice, slice]:
        """Return where a window of this grid lies in it."""
        first = np.rint((window.lo - self.lo) / self.voxel).astype(int)
        a, b, c = (slice(int(f), int(f) + n) for f, n in zip(first, window.shape, strict=True))
        return a, b, c

    def centers(self, index: NDArray[np.integer]) -> F64:
        """Return [N, 3] world points of [N, 3] voxel indices."""
        return np.asarray(self.lo + self.voxel * index)
