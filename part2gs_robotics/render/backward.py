"""Numba kernel: the gradient of blending, tile by tile, front to back as the blending itself.

With w_i = alpha_i T_i the loss is linear in them: L = sum w_i G_i + T_end B. S holds what is still
to come, so dL/dalpha_i = T_i G_i - S_i / (1 - alpha_i), without a stored list of weights.
"""

from __future__ import annotations

import numpy as np
from numba import get_thread_id

from part2gs_robotics.render.ellipses import Floats
from part2gs_robotics.render.forward import AHEAD, STOP, T_MAX, T_MIN
from part2gs_robotics.render.project import PACKED
from part2gs_robotics.render.tiles import TILE_X, TILE_Y, Ints, Longs, dealt
from part2gs_robotics.runtime.fast_math import power8
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel
from part2gs_robotics.runtime.simd import (
    LANES,
    Lane,
    least,
    load,
    prefetch,
    prefetch_to_write,
    splat,
    store,
    total,
    totals,
    where_ge,
)

# Planes of a row: transmittance, S, gradients by r, g, b, z and the rest of G, weight, plain rest.
STRIDE = np.uint64(9 * LANES)
TO_COME, RED, GREEN, BLUE, DEPTH, REST, WEIGHT, PLAIN = (np.uint64(n * LANES) for n in range(1, 9))
BACKWARD_SIZE = int(STRIDE) * TILE_Y


@inlined
def _gradient(s: Floats, g: Floats, i: int, dx: Lane, dy: Lane, first: np.uint64, last: np.uint64,
              partial: Floats, at: np.uint64) -> None:
    """Sum the gradients of Gaussian i over rows of a tile into partial, from place `at` on."""
    f = s.dtype.type
    one, t_min, t_max, stop = f(1), splat(f(T_MIN)), splat(f(T_MAX)), splat(f(STOP))
    zero = splat(f(0))
    flat, slope = dx * dx * g[i, 2] + g[i, 5], dx * g[i, 3]
    bend, top = splat(g[i, 4]), splat(g[i, 6])
    red, green, blue, z = splat(g[i, 7]), splat(g[i, 8]), splat(g[i, 9]), splat(g[i, 10])
    v0 = v1 = v2 = c0 = c1 = c2 = c3 = zero
    for k in range(first * STRIDE, last * STRIDE, STRIDE):
        raw = flat + dy * (slope + dy * bend)
        t = least(raw, top)
        through = load(s, k)
        alpha = where_ge(through, stop, where_ge(t, t_min, power8(t), zero), zero)
        w = alpha * through
        g_red, g_green, g_blue = load(s, k + RED), load(s, k + GREEN), load(s, k + BLUE)
        g_z = load(s, k + DEPTH)
        here = w * (load(s, k + REST) + g_red * red + g_green * green + g_blue * blue + g_z * z)
        rest = load(s, k + TO_COME) - here
        store(s, k, through - w)
        store(s, k + TO_COME, rest)
        store(s, k + WEIGHT, w)
        v = where_ge(raw, t_max, zero, here - rest * alpha / (one - alpha))
        v0 = v0 + v
        v1 = v1 + v * dy
        v2 = v2 + v * dy * dy
        c0 = c0 + w * g_red
        c1 = c1 + w * g_green
        c2 = c2 + w * g_blue
        c3 = c3 + w * g_z
        dy = dy + one
    store(partial, at, totals(v0, v0 * dx, v1, v0 * dx * dx, v1 * dx, v2, c0, c1))
    partial[at + np.uint64(8)], partial[at + np.uint64(9)] = total(c2), total(c3)


@inlined
def _add_channels(s: Floats, channels: Floats, extra: Floats, i: int, first: np.uint64,
                  last: np.uint64) -> None:
    """Set the rest of G to its plain part and what Gaussian i's extra channels add."""
    for row in range(first, last):
        rest = load(s, row * STRIDE + PLAIN)
        for j in range(extra.shape[1]):
            rest = rest + load(channels, np.uint64((j * TILE_Y + row) * LANES)) * extra[i, j]
        store(s, row * STRIDE + REST, rest)


@inlined
def _gradient_tile(pairs: Ints, start: int, end: int, packed: Floats,
                   extra: Floats, px: int, py: int, ramp: Floats, s: Floats, channels: Floats,
                   partial: Floats, width: int) -> None:
    """Fill one row of gradients per Gaussian of the tile."""
    f = s.dtype.type
    x, y = load(ramp, np.uint64(0)) + f(px + 0.5), f(py + 0.5)
    flat = packed.reshape(-1)
    for n in range(start, end):
        i, first, last = pairs[n, 0], np.uint64(pairs[n, 2]), np.uint64(pairs[n, 3])
        ahead = min(n + AHEAD, end - 1)
        prefetch(flat, np.uint64(pairs[ahead, 0] * PACKED))
        prefetch_to_write(partial, np.uint64(pairs[ahead, 1] * width))
        at = np.uint64(pairs[n, 1]) * np.uint64(width)
        if extra.shape[1] > 0:
            _add_channels(s, channels, extra, i, first, last)
        dy = splat(y + f(first) - packed[i, 1])
        _gradient(s, packed, i, x - packed[i, 0], dy, first, last, partial, at)
        for j in range(extra.shape[1]):
            sums = splat(f(0))
            for row in range(first, last):
                sums = sums + (load(s, row * STRIDE + WEIGHT)
                               * load(channels, np.uint64((j * TILE_Y + row) * LANES)))
            partial[at + np.uint64(10 + j)] = total(sums)


@inlined
def _load_tile(s: Floats, channels: Floats, px: int, py: int, color: Floats, alpha: Floats,
               depth: Floats, extra_image: Floats, d_color: Floats, d_alpha: Floats,
               d_depth: Floats, d_extra: Floats) -> None:
    """Set a tile's planes before its first Gaussian; gradients of size zero count as zero."""
    height, width = alpha.shape
    for y in range(py, min(py + TILE_Y, height)):
        for x in range(px, min(px + TILE_X, width)):
            k = (y - py) * int(STRIDE) + x - px
            to_come = s.dtype.type(0)
            if d_color.size > 0:
                for c in range(3):
                    s[k + (2 + c) * LANES] = d_color[y, x, c]
                    to_come += d_color[y, x, c] * color[y, x, c]
            if d_depth.size > 0:
                s[k + 5 * LANES] = d_depth[y, x]
                to_come += d_depth[y, x] * depth[y, x]
            if d_alpha.size > 0:
                s[k + 6 * LANES] = s[k + 8 * LANES] = d_alpha[y, x]
                to_come += d_alpha[y, x] * alpha[y, x]
            if d_extra.size > 0:
                for c in range(extra_image.shape[2]):
                    channels[(c * TILE_Y + y - py) * LANES + x - px] = d_extra[y, x, c]
                    to_come += d_extra[y, x, c] * extra_image[y, x, c]
            s[k + LANES] = to_come


@kernel
def backward(shares: Longs, tile_first: Longs, pairs: Ints, needed: Ints,
             packed: Floats, extra: Floats, ramp: Floats, scratch: Floats, color: Floats,
             alpha: Floats, depth: Floats, extra_image: Floats, d_color: Floats, d_alpha: Floats,
             d_depth: Floats, d_extra: Floats, partial: Floats) -> None:
    """Fill partial [M, 10 + C] from the gradients of the images.

    Rows: moments of v (1, dx, dy, dx dx, dx dy, dy dy), then r, g, b, z and extra channels.
    """
    tiles_x = (alpha.shape[1] + TILE_X - 1) // TILE_X
    flat, width = partial.reshape(-1), partial.shape[1]
    for_each(len(shares) - 1, _backward_at, (shares, tile_first, pairs, needed, packed, extra, ramp,
                                             scratch, color, alpha, depth, extra_image, d_color,
                                             d_alpha, d_depth, d_extra, tiles_x, flat, width))


@inlined
def _backward_at(j: int, shares: Longs, tile_first: Longs, pairs: Ints, needed: Ints,
                 packed: Floats, extra: Floats, ramp: Floats, scratch: Floats, color: Floats,
                 alpha: Floats, depth: Floats, extra_image: Floats, d_color: Floats,
                 d_alpha: Floats, d_depth: Floats, d_extra: Floats, tiles_x: int, flat: Floats,
                 width: int) -> None:
    thread = get_thread_id()
    s, channels = scratch[thread, :BACKWARD_SIZE], scratch[thread, BACKWARD_SIZE:]
    piece = dealt(j, len(shares) - 1)
    for tile in range(shares[piece], shares[piece + 1]):
        start, end = tile_first[tile], tile_first[tile] + needed[tile]
        for n in range(end, tile_first[tile + 1]):
            for c in range(width):
                flat[pairs[n, 1] * width + c] = 0
        if end > start:
            px, py = (tile % tiles_x) * TILE_X, (tile // tiles_x) * TILE_Y
            for y in range(TILE_Y):
                for c in range(int(STRIDE)):
                    s[y * int(STRIDE) + c] = 1 if c < LANES else 0
            channels[:] = 0
            _load_tile(s, channels, px, py, color, alpha, depth, extra_image, d_color, d_alpha,
                       d_depth, d_extra)
            _gradient_tile(pairs, start, end, packed, extra, px, py, ramp, s,
                           channels, flat, width)
