"""Cell kernels: one pass over a grid's voxels for what cells, their gains and faces ask of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32, F64, I64, Mask
from part2gs_robotics.runtime.jit import inlined, kernel

Ints = NDArray[np.int32]
FIRST = 1 << 12  # slots at first, a power of two: small parts have a thousand pairs of cells
SPREAD = 0x9E3779B97F4A7C15  # 2^64 over the golden ratio: neighbouring keys go far apart
NOBODY = -1  # in the place of a pair


@kernel
def divide(xy: F64, z: F64, offsets: F64, of_voxel: Ints, held: Mask) -> None:
    """Number voxels by their cell and by how many planes of one more family they lie above.

    Args:
        xy: [X, Y] share of a voxel's level along the family's normal.
        z: [Z] the rest of it.
        offsets: [P] levels of the planes, increasing.
        of_voxel: [X, Y, Z] cell, changed to cell * (P + 1) + planes below.
        held: [C * (P + 1)] set where such a number is in use.
    """
    above = 0
    for i in range(of_voxel.shape[0]):
        for j in range(of_voxel.shape[1]):
            for k in range(of_voxel.shape[2]):
                level = xy[i, j] + z[k]
                # Levels change little from voxel to voxel, and so does what lies below them.
                while above < len(offsets) and offsets[above] < level:
                    above += 1
                while above > 0 and offsets[above - 1] >= level:
                    above -= 1
                number = of_voxel[i, j, k] * (len(offsets) + 1) + above
                of_voxel[i, j, k] = number
                held[number] = True


@kernel
def renumber(of_voxel: Ints, number: Ints) -> None:
    """Give voxels another number: [X, Y, Z] old ones, [N] the new one of each."""
    for i in range(of_voxel.shape[0]):
        for j in range(of_voxel.shape[1]):
            for k in range(of_voxel.shape[2]):
                of_voxel[i, j, k] = number[of_voxel[i, j, k]]


@kernel
def gains(of_voxel: Ints, inside: F32, worth: F64, gain: F64) -> None:
    """Add to [C] gains of cells what [X, Y, Z] voxels are believed to be and are worth."""
    for i in range(of_voxel.shape[0]):
        for j in range(of_voxel.shape[1]):
            for k in range(of_voxel.shape[2]):
                gain[of_voxel[i, j, k]] += inside[i, j, k] + worth[i, j, k]


@kernel
def borders(of_voxel: Ints, surface: F32, invented: float, seen: float) -> tuple[I64, I64, F64]:
    """Return pairs of cells [N], [N] that have faces of voxels in common, and the cost of those.

    Args:
        of_voxel: [X, Y, Z] cell.
        surface: [X, Y, Z] 0..1, whether views saw a surface there.
        invented: cost of a face that nobody saw, on top of
        seen: that of one which views saw.
    """
    keys, costs, count = np.full(FIRST, NOBODY, np.int64), np.zeros(FIRST), 0
    for i in range(of_voxel.shape[0]):
        for j in range(of_voxel.shape[1]):
            for k in range(of_voxel.shape[2]):
                one = of_voxel[i, j, k]
                for axis in range(3):
                    x, y, z = i + (axis == 0), j + (axis == 1), k + (axis == 2)
                    if x == of_voxel.shape[0] or y == of_voxel.shape[1] or z == of_voxel.shape[2]:
                        continue
                    two = of_voxel[x, y, z]
                    if two == one:
                        continue
                    slot = _slot(keys, _key(one, two))
                    if keys[slot] == NOBODY:
                        count += 1
                        keys[slot] = _key(one, two)
                    photo = max(surface[i, j, k], surface[x, y, z])
                    costs[slot] += invented * (1.0 - photo) + seen
                    if 2 * count > len(keys):
                        keys, costs = _larger(keys, costs)
    used = np.flatnonzero(keys != NOBODY)
    pairs = keys[used]
    return pairs >> 32, pairs & 0xFFFFFFFF, costs[used]


@inlined
def _key(one: int, two: int) -> np.int64:
    """Return one number for two cells, whichever comes first."""
    return (np.int64(min(one, two)) << 32) | np.int64(max(one, two))


@inlined
def _slot(keys: I64, key: np.int64) -> np.int64:
    """Return where a key is in a table, or would be."""
    slot = np.int64((np.uint64(key) * np.uint64(SPREAD)) >> np.uint64(32)) & (len(keys) - 1)
    while keys[slot] != NOBODY and keys[slot] != key:
        slot = (slot + 1) & (len(keys) - 1)
    return slot


@inlined
def _larger(keys: I64, costs: F64) -> tuple[I64, F64]:
    """Return a table of twice as many slots with the same entries."""
    wide, sums = np.full(2 * len(keys), NOBODY, np.int64), np.zeros(2 * len(keys))
    for old in range(len(keys)):
        if keys[old] != NOBODY:
            slot = _slot(wide, keys[old])
            wide[slot], sums[slot] = keys[old], costs[old]
    return wide, sums
