"""Numba kernels: list the Gaussians of every tile front to back, with the rows they cover.

A tile is 8 pixels wide, one vector of float32, and 32 high: tall, because a Gaussian costs only the
rows it covers, and fewer tiles mean fewer pairs. A counting sort over chunks of the depth order:
the lists do not depend on how many chunks, so on how many threads, there are.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.render.ellipses import Floats
from part2gs_robotics.render.project import PACKED
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel
from part2gs_robotics.runtime.simd import LANES, least, load, most, prefetch, root, splat, store

Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Mask = NDArray[np.bool_]

TILE_X = LANES
TILE_Y = 32  # rows: a Gaussian costs only those it covers, and fewer tiles mean fewer pairs
TILE_COST = 4  # work of a tile's planes and pixels, in pairs (measured: 0.5 us against 0.13 us)
PIECES = 8  # of work for a thread: near tiles share Gaussians in cache, far ones balance the work
AHEAD = 8  # Gaussians between the one listed and the one fetched
RAMP = 16  # offset of the numbers 0, 1, 2 ... in a scratch row, after low and high
SPANS_SIZE = 2 * RAMP  # whole cache lines, or threads would write to one in turn
PAIR = 4  # numbers of a pair: Gaussian, place among the Gaussian's pairs, first and end row


@inlined
def _fetch(packed: Floats, boxes: Ints, i: int) -> None:
    """Ask for the cache lines of Gaussian i: in the order of depth, neighbours lie far apart."""
    prefetch(packed.reshape(-1), np.uint64(i * PACKED))
    prefetch(boxes.reshape(-1), np.uint64(i * 4))


@inlined
def _spans(g: Floats, i: int, column: int, s: Floats) -> None:
    """Write to s the lowest and highest y of Gaussian i's ellipse over eight tile columns.

    The highest point of the ellipse over a column is above the place nearest to the top's, the
    lowest one below the place nearest to the bottom's, which lies opposite. With the covariance
    [[A, B], [B, C]] the ellipse at offset x is y = B / A x +- sqrt(det / A (L - x^2 / A)).
    """
    f = s.dtype.type
    zero, far = splat(f(0)), splat(f(TILE_X - 1))
    left = load(s, np.uint64(RAMP)) * f(TILE_X) + (f(column * TILE_X) + f(0.5) - g[i, 0])
    right = left + far
    top = splat(g[i, 11])
    high, low = most(left, least(top, right)), most(left, least(zero - top, right))
    square, bend = splat(g[i, 13]), splat(g[i, 14])
    up = high * g[i, 12] + root(most(square - high * high * bend, zero))
    down = low * g[i, 12] - root(most(square - low * low * bend, zero))
    # A pixel's centre lies at +0.5; 0.01 px more covers rounding.
    store(s, np.uint64(0), down + (g[i, 1] - f(0.51)))
    store(s, np.uint64(LANES), up + (g[i, 1] + f(0.51)))


@inlined
def _rows(s: Floats, box: Ints, i: int, j: int) -> tuple[int, int]:
    """Rows of the image that Gaussian i covers in the j-th of eight columns; the box bounds them.

    NaN, of needles whose numbers overflow, gives the box.
    """
    f = s.dtype.type
    low, high = f(box[i, 1]), f(box[i, 3])
    first = s[j] if s[j] > low else low
    last = s[LANES + j] if s[LANES + j] < high else high
    return math.ceil(min(first, high)), math.floor(max(last, low))


@kernel
def depth_keys(packed: Floats, visible: NDArray[np.bool_], keys: NDArray[np.uint64]) -> None:
    """Fill keys that sort by depth, then index; positive float32 sort like their bits."""
    for i in range(len(keys)):
        bits = np.float32(packed[i, 10]).view(np.uint32) if visible[i] else np.uint32(0xFFFFFFFF)
        keys[i] = np.uint64(bits) << np.uint64(32) | np.uint64(i)


@kernel
def add_up(first: Longs) -> None:
    """Turn counts, each one place behind its own, into starts."""
    for i in range(1, len(first)):
        first[i] += first[i - 1]


@kernel
def set_cursors(histogram: Ints, tile_first: Longs) -> None:
    """Turn the counts of chunks and tiles into the places where each begins."""
    place = 0
    for tile in range(histogram.shape[1]):
        tile_first[tile] = place
        for chunk in range(histogram.shape[0]):
            count = histogram[chunk, tile]
            histogram[chunk, tile] = place
            place += count
    tile_first[-1] = place


@kernel
def ask_near(own: Mask, reach: int, boxes: Ints, visible: Mask, asked: Mask) -> None:
    """Mark the tiles [rows, columns] within reach of own Gaussians; hide what touches none."""
    rows, columns = asked.shape
    asked[:] = False
    for i in range(len(own)):
        if own[i] and visible[i]:
            for row in range(max(boxes[i, 1] - reach, 0) // TILE_Y,
                             min((boxes[i, 3] - 1 + reach) // TILE_Y + 1, rows)):
                for column in range(max(boxes[i, 0] - reach, 0) // TILE_X,
                                    min((boxes[i, 2] - 1 + reach) // TILE_X + 1, columns)):
                    asked[row, column] = True
    for i in range(len(own)):
        if visible[i]:
            visible[i] = _touches(asked, boxes, i)


@inlined
def _touches(asked: Mask, boxes: Ints, i: int) -> bool:
    """Whether the box of Gaussian i lies in a tile that is asked for."""
    for row in range(boxes[i, 1] // TILE_Y, (boxes[i, 3] - 1) // TILE_Y + 1):
        for column in range(boxes[i, 0] // TILE_X, (boxes[i, 2] - 1) // TILE_X + 1):
            if asked[row, column]:
                return True
    return False


@kernel
def list_pairs(order: Longs, seen: int, packed: Floats, boxes: Ints, asked: Mask, chunks: Longs,
               scratch: Floats, listed: Ints, counts: Longs, histogram: Ints, first: Longs) -> None:
    """List the pairs of every chunk in the order of depth, and count them in three ways.

    listed [chunks, room, 4]: Gaussian, tile, and the rows of the tile it covers, as far as there is
    room; counts [chunks] pairs, whether there was room or not; histogram of chunks and tiles;
    first[i + 1] pairs of Gaussian i. asked [rows, columns]: tiles that are drawn.
    """
    tiles_x = asked.shape[1]
    for_each(len(chunks) - 1, _list_pairs_at, (order, seen, packed, boxes, asked, chunks, scratch,
                                               listed, counts, histogram, first, tiles_x))


@inlined
def _list_pairs_at(chunk: int, order: Longs, seen: int, packed: Floats, boxes: Ints, asked: Mask,
                   chunks: Longs, scratch: Floats, listed: Ints, counts: Longs, histogram: Ints,
                   first: Longs, tiles_x: int) -> None:
    s, place, room = scratch[chunk], 0, listed.shape[1]
    histogram[chunk, :] = 0
    for n in range(chunks[chunk], chunks[chunk + 1]):
        i, before = order[n], place
        _fetch(packed, boxes, order[min(n + AHEAD, len(order) - 1)])
        if n < seen:
            start, end = boxes[i, 0] // TILE_X, (boxes[i, 2] - 1) // TILE_X + 1
            for column in range(start, end):
                j = (column - start) % LANES
                if j == 0:
                    _spans(packed, i, column, s)
                y0, y1 = _rows(s, boxes, i, j)
                for row in range(y0 // TILE_Y, (y1 - 1) // TILE_Y + 1 if y1 > y0 else 0):
                    if asked[row, column]:
                        tile = row * tiles_x + column
                        histogram[chunk, tile] += 1
                        if place < room:
                            listed[chunk, place, 0], listed[chunk, place, 1] = i, tile
                            listed[chunk, place, 2] = max(y0 - row * TILE_Y, 0)
                            listed[chunk, place, 3] = min(y1 - row * TILE_Y, TILE_Y)
                        place += 1
        first[i + 1] = place - before
    counts[chunk] = place


@kernel
def place_pairs(listed: Ints, counts: Longs, cursor: Ints, first: Longs, pairs: Ints) -> None:
    """Write each pair's Gaussian, its place among the Gaussian's pairs, and the rows it covers."""
    for_each(len(counts), _place_pairs_at, (listed, counts, cursor, first, pairs))


@inlined
def _place_pairs_at(chunk: int, listed: Ints, counts: Longs, cursor: Ints, first: Longs,
                    pairs: Ints) -> None:
    last, slot = -1, 0
    for n in range(counts[chunk]):
        i, tile = listed[chunk, n, 0], listed[chunk, n, 1]
        slot = slot + 1 if i == last else first[i]
        last = i
        place = cursor[chunk, tile]
        cursor[chunk, tile] += 1
        pairs[place, 0], pairs[place, 1] = i, slot
        pairs[place, 2], pairs[place, 3] = listed[chunk, n, 2], listed[chunk, n, 3]


@kernel
def share_out(tile_first: Longs, shares: Longs) -> None:
    """Cut the tiles, in their order in the image, into pieces of about equal work."""
    pieces, tile, done = len(shares) - 1, 0, 0
    work = tile_first[-1] + TILE_COST * (len(tile_first) - 1)
    for piece in range(pieces):
        shares[piece] = tile
        while tile < len(tile_first) - 1 and done * pieces < work * (piece + 1):
            done += tile_first[tile + 1] - tile_first[tile] + TILE_COST
            tile += 1
    shares[pieces] = len(tile_first) - 1


@inlined
def dealt(j: int, pieces: int) -> int:
    """Piece of work in place j, so that a thread's places, in a row, hold pieces from all over."""
    per_thread = pieces // PIECES
    return j % PIECES * per_thread + j // PIECES
