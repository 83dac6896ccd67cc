"""Count Gaussian-pixel pairs and bytes: what the shares of peak and the GB/s are made of."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray
from raster_naive import NaiveRendered
from raster_naive_tiles import FAINT, HALF, ONE, OPAQUE, STOP, TILE

from part2gs_robotics.render.cpu import Rendered
from part2gs_robotics.render.tiles import TILE_X

FLOP_PER_PAIR = 70  # forward and backward together, as the project's goal counts them
GAUSSIAN_BYTES = 4 * (3 + 4 + 3 + 1 + 3)  # means, quats, scales, opacities, colours
PACKED_BYTES = 4 * 12  # of a projected Gaussian
PARTIAL_BYTES = 4 * 10  # gradients of one Gaussian in one tile
PIXEL_BYTES = 4 * 5  # r, g, b, alpha, z


def evaluated_pairs(rendered: Rendered) -> int:
    """Return the pairs our kernel evaluates: rows x 8 lanes of every pair before its tile stops.

    Lanes beside the ellipse and pixels that have stopped are counted: their arithmetic is done.
    """
    pairs, needed = rendered.saved.pairs, rendered.saved.needed
    listed = np.diff(pairs.tile_first)
    number = np.arange(len(pairs.table)) - np.repeat(pairs.tile_first[:-1], listed)
    table = pairs.table[number < np.repeat(needed, listed)].astype(np.int64)
    return int(TILE_X * (table[:, 3] - table[:, 2]).sum())  # end row - first row


def naive_pairs(rendered: NaiveRendered) -> tuple[int, int]:
    """Return the pairs the yardstick evaluates, and the useful ones, the same for every kernel.

    Evaluated: pixels of a Gaussian's box that have not stopped. Useful: alpha >= 1/255 there.
    """
    s = rendered.saved
    through = np.ones(s.last.shape, np.float32)
    evaluated, useful = _count(s.tile_first, s.ids, s.packed, s.boxes, through)
    return int(evaluated), int(useful)


def tile_pairs(rendered: Rendered) -> int:
    """Return how many Gaussians all tiles list together."""
    return len(rendered.saved.pairs.table)


def bytes_moved(gaussians: int, pixels: int, tile_pairs: int) -> int:
    """Return the bytes that forward and backward have to move, each array once per pass.

    Per Gaussian: parameters read twice, the projected ones written and read twice, gradients (and
    the screen gradient) written. Per pixel: images written and read, their gradients read. Per
    Gaussian of a tile: its index written and read twice, its partial gradients written and read.
    """
    per_gaussian = 2 * GAUSSIAN_BYTES + 3 * PACKED_BYTES + GAUSSIAN_BYTES + 4
    return (gaussians * per_gaussian + pixels * 3 * PIXEL_BYTES
            + tile_pairs * (3 * 4 + 2 * PARTIAL_BYTES))


@njit(cache=True)
def _count(tile_first: NDArray[np.int64], ids: NDArray[np.int32], packed: NDArray[np.float32],
           boxes: NDArray[np.int32], through: NDArray[np.float32]) -> tuple[int, int]:
    tiles_x = (through.shape[1] + TILE - 1) // TILE
    evaluated, useful = 0, 0
    for tile in range(len(tile_first) - 1):
        px, py = tile % tiles_x * TILE, tile // tiles_x * TILE
        for i in ids[tile_first[tile]:tile_first[tile + 1]]:
            for y in range(max(py, boxes[i, 1]), min(py + TILE, boxes[i, 3])):
                dy = packed[i, 1] - np.float32(y) - HALF
                for x in range(max(px, boxes[i, 0]), min(px + TILE, boxes[i, 2])):
                    if through[y, x] >= STOP:
                        evaluated += 1
                        dx = packed[i, 0] - np.float32(x) - HALF
                        power = (-HALF * (packed[i, 2] * dx * dx + packed[i, 4] * dy * dy)
                                 - packed[i, 3] * dx * dy)
                        alpha = min(OPAQUE, packed[i, 5] * math.exp(power))
                        if alpha >= FAINT:
                            useful += 1
                            through[y, x] *= ONE - alpha
    return evaluated, useful
