"""Numba kernel: blend each tile's Gaussians front to back.

All state of a tile lies in rows of planes of eight pixels, each row contiguous, so that a step of
the inner loop touches neighbouring cache lines only; every decision in it is a select. The exponent
t comes divided by 8: alpha = exp(t)^8.
"""

from __future__ import annotations

import math

import numpy as np
from numba import get_thread_id

from part2gs_robotics.render.ellipses import Floats
from part2gs_robotics.render.project import ALPHA_MAX, ALPHA_MIN, EXP_SCALE, PACKED
from part2gs_robotics.render.tiles import TILE_X, TILE_Y, Ints, Longs, dealt
from part2gs_robotics.runtime.fast_math import power8
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel
from part2gs_robotics.runtime.simd import (
    LANES,
    Lane,
    largest,
    least,
    load,
    most,
    prefetch,
    splat,
    store,
    where_ge,
)

STOP = 1e-4  # transmittance below which a pixel takes no more (3DGS)
AHEAD = 4  # Gaussians between the one blended and the one fetched: its line is in another cache
CHECK_EVERY = 16  # Gaussians between two tests whether a whole tile is opaque
T_MIN = math.log(ALPHA_MIN) / EXP_SCALE
T_MAX = math.log(ALPHA_MAX) / EXP_SCALE

# Planes of a row: transmittance, r, g, b, z, weight of the last Gaussian.
STRIDE = np.uint64(6 * LANES)
RED, GREEN, BLUE, DEPTH, WEIGHT = (np.uint64(n * LANES) for n in range(1, 6))
FORWARD_SIZE = int(STRIDE) * TILE_Y


@inlined
def _blend(s: Floats, g: Floats, i: int, dx: Lane, dy: Lane, first: np.uint64, last: np.uint64,
           ) -> None:
    """Blend Gaussian i into rows of a tile; (dx, dy) leads from its centre to the first of them."""
    f = s.dtype.type
    one, zero, t_min, stop = f(1), splat(f(0)), splat(f(T_MIN)), splat(f(STOP))
    flat, slope = dx * dx * g[i, 2] + g[i, 5], dx * g[i, 3]
    bend, top = splat(g[i, 4]), splat(g[i, 6])
    red, green, blue, z = splat(g[i, 7]), splat(g[i, 8]), splat(g[i, 9]), splat(g[i, 10])
    for k in range(first * STRIDE, last * STRIDE, STRIDE):
        t = least(flat + dy * (slope + dy * bend), top)
        dy = dy + one
        through = load(s, k)
        alpha = where_ge(through, stop, where_ge(t, t_min, power8(t), zero), zero)
        w = alpha * through
        store(s, k, through - w)
        store(s, k + RED, load(s, k + RED) + w * red)
        store(s, k + GREEN, load(s, k + GREEN) + w * green)
        store(s, k + BLUE, load(s, k + BLUE) + w * blue)
        store(s, k + DEPTH, load(s, k + DEPTH) + w * z)
        store(s, k + WEIGHT, w)


@inlined
def opaque(s: Floats, stride: np.uint64) -> bool:
    """Whether every pixel of the tile has stopped."""
    through = load(s, np.uint64(0))
    for k in range(stride, stride * np.uint64(TILE_Y), stride):
        through = most(through, load(s, k))
    return bool(largest(through) < s.dtype.type(STOP))


@inlined
def clear(s: Floats, stride: np.uint64) -> None:
    """Set full transmittance, and zero in all other planes."""
    for y in range(TILE_Y):
        for x in range(int(stride)):
            s[y * int(stride) + x] = 1 if x < LANES else 0


@inlined
def _blend_tile(pairs: Ints, start: int, end: int, packed: Floats, extra: Floats, px: int,
                py: int, ramp: Floats, s: Floats, channels: Floats) -> int:
    """Blend a tile's Gaussians into its planes; return how many were needed."""
    f = s.dtype.type
    x, y = load(ramp, np.uint64(0)) + f(px + 0.5), f(py + 0.5)
    flat = packed.reshape(-1)
    for n in range(start, end):
        if (n - start) % CHECK_EVERY == 0 and n > start and opaque(s, STRIDE):
            return n - start
        i, first, last = pairs[n, 0], np.uint64(pairs[n, 2]), np.uint64(pairs[n, 3])
        ahead = min(n + AHEAD, end - 1)
        prefetch(flat, np.uint64(pairs[ahead, 0] * PACKED))
        dy = splat(y + f(first) - packed[i, 1])
        _blend(s, packed, i, x - packed[i, 0], dy, first, last)
        for j in range(extra.shape[1]):
            if extra[i, j] != 0:  # most Gaussians are of one part
                for row in range(first, last):
                    k, to = row * STRIDE + WEIGHT, np.uint64(j * TILE_Y + row) * np.uint64(LANES)
                    store(channels, to, load(channels, to) + load(s, k) * extra[i, j])
    return end - start


@inlined
def _write(s: Floats, channels: Floats, px: int, py: int, background: Floats, color: Floats,
           alpha: Floats, depth: Floats, extra_image: Floats) -> None:
    """Copy a tile's planes to the images."""
    height, width = alpha.shape
    for y in range(py, min(py + TILE_Y, height)):
        row = (y - py) * int(STRIDE)
        for x in range(px, min(px + TILE_X, width)):
            k = row + x - px
            for c in range(3):
                color[y, x, c] = s[k + (1 + c) * LANES] + s[k] * background[c]
            alpha[y, x] = s.dtype.type(1) - s[k]
            depth[y, x] = s[k + 4 * LANES]
            for c in range(extra_image.shape[2]):
                extra_image[y, x, c] = channels[(c * TILE_Y + y - py) * LANES + x - px]


@kernel
def forward(shares: Longs, tile_first: Longs, pairs: Ints, packed: Floats, extra: Floats,
            background: Floats, ramp: Floats, scratch: Floats, color: Floats, alpha: Floats,
            depth: Floats, extra_image: Floats, needed: Ints) -> None:
    """Render all tiles; shares[j] to shares[j + 1] are one piece of work."""
    tiles_x = (alpha.shape[1] + TILE_X - 1) // TILE_X
    for_each(len(shares) - 1, _forward_at, (shares, tile_first, pairs, packed, extra, background,
                                            ramp, scratch, color, alpha, depth, extra_image, needed,
                                            tiles_x))


@inlined
def _forward_at(j: int, shares: Longs, tile_first: Longs, pairs: Ints, packed: Floats,
                extra: Floats, background: Floats, ramp: Floats, scratch: Floats, color: Floats,
                alpha: Floats, depth: Floats, extra_image: Floats, needed: Ints,
                tiles_x: int) -> None:
    thread = get_thread_id()
    s, channels = scratch[thread, :FORWARD_SIZE], scratch[thread, FORWARD_SIZE:]
    piece = dealt(j, len(shares) - 1)
    for tile in range(shares[piece], shares[piece + 1]):
        px, py = (tile % tiles_x) * TILE_X, (tile // tiles_x) * TILE_Y
        clear(s, STRIDE)
        channels[:] = 0
        needed[tile] = _blend_tile(pairs, tile_first[tile], tile_first[tile + 1], packed,
                                   extra, px, py, ramp, s, channels)
        _write(s, channels, px, py, background, color, alpha, depth, extra_image)


@inlined
def _find_median(s: Floats, g: Floats, i: int, dx: Lane, dy: Lane, first: np.uint64,
                 last: np.uint64) -> None:
    """Blend as _blend does; note z of the one Gaussian that takes a pixel below one half."""
    f = s.dtype.type
    one, zero, t_min, half = f(1), splat(f(0)), splat(f(T_MIN)), splat(f(0.5))
    flat, slope = dx * dx * g[i, 2] + g[i, 5], dx * g[i, 3]
    bend, top = splat(g[i, 4]), splat(g[i, 6])
    z = splat(g[i, 10])
    for k in range(first * STRIDE, last * STRIDE, STRIDE):
        t = least(flat + dy * (slope + dy * bend), top)
        dy = dy + one
        through = load(s, k)
        rest = through - where_ge(t, t_min, power8(t), zero) * through
        store(s, k, rest)
        here = where_ge(through, half, where_ge(rest, half, zero, z), zero)
        store(s, k + DEPTH, load(s, k + DEPTH) + here)


@kernel
def median_depth(shares: Longs, tile_first: Longs, pairs: Ints, needed: Ints,
                 packed: Floats, ramp: Floats, image: Floats) -> None:
    """Fill image with the z at which the transmittance falls below one half, zero where never."""
    height, width = image.shape
    tiles_x = (width + TILE_X - 1) // TILE_X
    for_each(len(shares) - 1, _median_depth_at, (shares, tile_first, pairs, needed, packed, ramp,
                                                 image, height, width, tiles_x))


@inlined
def _median_depth_at(piece: int, shares: Longs, tile_first: Longs, pairs: Ints, needed: Ints,
                     packed: Floats, ramp: Floats, image: Floats, height: int, width: int,
                     tiles_x: int) -> None:
    s = np.zeros(FORWARD_SIZE, image.dtype)
    for tile in range(shares[piece], shares[piece + 1]):
        px, py = (tile % tiles_x) * TILE_X, (tile // tiles_x) * TILE_Y
        x, y = load(ramp, np.uint64(0)) + image.dtype.type(px + 0.5), image.dtype.type(py + 0.5)
        clear(s, STRIDE)
        for n in range(tile_first[tile], tile_first[tile] + needed[tile]):
            i, first, last = pairs[n, 0], np.uint64(pairs[n, 2]), np.uint64(pairs[n, 3])
            dy = splat(y + image.dtype.type(first) - packed[i, 1])
            _find_median(s, packed, i, x - packed[i, 0], dy, first, last)
        for row in range(py, min(py + TILE_Y, height)):
            for column in range(px, min(px + TILE_X, width)):
                image[row, column] = s[(row - py) * int(STRIDE) + column - px + 4 * LANES]
