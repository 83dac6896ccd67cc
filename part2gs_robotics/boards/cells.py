"""Cells: families of planes cut a grid's box into convex cells; voxels stand for their volumes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.boards.cell_kernels import divide, renumber
from part2gs_robotics.boards.planes import Family
from part2gs_robotics.model.arrays import I64
from part2gs_robotics.model.grid import Grid


@dataclass(frozen=True)
class Cells:
    """C convex cells that hold a voxel centre.

    Attributes:
        grid: the voxels.
        families: the planes.
        of_voxel: [X, Y, Z] int32 cell of every voxel.
        digits: [C, F] how many planes of every family a cell lies above.
    """

    grid: Grid
    families: tuple[Family, ...]
    of_voxel: NDArray[np.int32]
    digits: I64

    def __len__(self) -> int:
        """Number of cells."""
        return len(self.digits)

    @property
    def planes(self) -> int:
        """Number of planes."""
        return sum(len(family.offsets) for family in self.families)


def cells_of(grid: Grid, families: tuple[Family, ...]) -> Cells:
    """Return the cells that planes cut a grid's box into, in the order of their digits."""
    axes = [grid.lo[i] + grid.voxel * np.arange(n) for i, n in enumerate(grid.shape)]
    of_voxel, digits = np.zeros(grid.shape, np.int32), np.zeros((1, 0), np.int64)
    for family in families:
        x, y, z = (n * axis for n, axis in zip(family.normal, axes, strict=True))
        base = len(family.offsets) + 1
        held = np.zeros(len(digits) * base, bool)
        divide(x[:, None] + y, z, family.offsets, of_voxel, held)
        used = np.flatnonzero(held)
        # Renumbered at once: codes of all families together would have to be sorted.
        renumber(of_voxel, np.cumsum(held, dtype=np.int32) - np.int32(1))
        digits = np.concatenate([digits[used // base], (used % base)[:, None]], 1)
    return Cells(grid, families, of_voxel, digits)
