"""Numba kernel: list the Gaussians of every tile front to back.

A tile is 8 pixels wide, one AVX register of float32, and 32 high: tall, because a Gaussian costs
only the rows it covers, and fewer tiles mean fewer pairs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.render_jit import kernel

Ints = NDArray[np.int32]

TILE_X = 8
TILE_Y = 32


@kernel
def bin_gaussians(order: NDArray[np.int64], visible: NDArray[np.bool_], boxes: Ints,
                  tiles_x: int, tiles_y: int) -> tuple[NDArray[np.int64], Ints, NDArray[np.int64],
                                                       Ints]:
    """List each tile's Gaussians front to back by a counting sort.

    Returns:
        tile_first [tiles + 1] and ids [M]: Gaussians of tile j are ids[tile_first[j]:...[j + 1]].
        first [N + 1] and slots [M]: the places of Gaussian i in ids are slots[first[i]:...].
    """
    first = np.zeros(len(boxes) + 1, np.int64)
    tile_first = np.zeros(tiles_x * tiles_y + 1, np.int64)
    for i in range(len(boxes)):
        count = 0
        if visible[i]:
            for y in range(boxes[i, 1] // TILE_Y, (boxes[i, 3] - 1) // TILE_Y + 1):
                for x in range(boxes[i, 0] // TILE_X, (boxes[i, 2] - 1) // TILE_X + 1):
                    tile_first[y * tiles_x + x + 1] += 1
                    count += 1
        first[i + 1] = first[i] + count
    for j in range(tiles_x * tiles_y):
        tile_first[j + 1] += tile_first[j]
    cursor = tile_first.copy()
    ids: Ints = np.zeros(first[-1], np.int32)
    slots: Ints = np.zeros(first[-1], np.int32)
    for i in order:
        k = first[i]
        if visible[i]:
            for y in range(boxes[i, 1] // TILE_Y, (boxes[i, 3] - 1) // TILE_Y + 1):
                for x in range(boxes[i, 0] // TILE_X, (boxes[i, 2] - 1) // TILE_X + 1):
                    place = cursor[y * tiles_x + x]
                    cursor[y * tiles_x + x] += 1
                    ids[place] = i
                    slots[k] = place
                    k += 1
    return tile_first, ids, first, slots
