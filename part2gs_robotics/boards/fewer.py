"""Fewer: planes that explain next to nothing go, and the steps and flakes that they cut with them.

A plane is worth what photos say of the cells that it alone parts into inside and outside. The noise
of depths, a bulge of a cell over some patch, pays a little for any plane; a wall pays much more.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from part2gs_robotics.boards.cells import Cells
from part2gs_robotics.boards.planes import Family
from part2gs_robotics.model.arrays import F64, Mask


def without_idle(cells: Cells, inside: Mask, gain: F64, price: float) -> tuple[Family, ...]:
    """Return the families without planes that are worth less than a price.

    Of planes side by side the least worth goes alone: what its cells join may need the next.

    Args:
        cells: of all planes.
        inside: [C] their labels.
        gain: [C] what photos say for a cell, in voxels of full belief.
        price: what a plane must be worth, in the same.
    """
    kept = []
    for family, worth in zip(cells.families, _worths(cells, inside, gain), strict=True):
        around = np.pad(worth, 1, constant_values=np.inf)
        least = (worth <= around[:-2]) & (worth < around[2:])
        left = family.offsets[~(least & (worth < price))]
        if len(left):
            kept.append(Family(family.normal, left))
    return tuple(kept)


def _worths(cells: Cells, inside: Mask, gain: F64) -> Sequence[F64]:
    """Return per family [P] what is lost, at most, if the cells on both sides of a plane are one.

    One of two that a plane parts takes the other's label, whichever loses less.
    """
    bases = np.array([len(family.offsets) + 1 for family in cells.families])
    found = []
    for axis, base in enumerate(bases):
        others = np.delete(cells.digits, axis, 1).T
        code = np.ravel_multi_index(tuple(others), np.delete(bases, axis).tolist()) \
            if len(others) else np.zeros(len(cells), np.int64)
        own = cells.digits[:, axis]
        order = np.lexsort((own, code))
        low, high = order[:-1], order[1:]
        parted = (code[low] == code[high]) & (own[high] == own[low] + 1) \
            & (inside[low] != inside[high])
        low, high = low[parted], high[parted]
        full, empty = np.where(inside[low], low, high), np.where(inside[low], high, low)
        lost = np.minimum(np.maximum(gain[full], 0.0), np.maximum(-gain[empty], 0.0))
        found.append(np.bincount(own[low], lost, base - 1).astype(np.float64))
    return found
