"""Numba kernels: sort Gaussians into tiles, blend each tile front to back, and its gradient.

A tile is 16 x 16 pixels, kept as 32 blocks of 8 pixels in a row (one AVX register). All state of a
block lies in one array row, so that the compiler needs no aliasing tests and emits SIMD code; every
decision inside a block is a select. The exponent t arrives divided by 8: alpha = exp(t)^8.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import prange, types
from numba.extending import overload
from numpy.typing import NDArray

from part2gs_robotics.render_jit import inlined, kernel, parallel_kernel
from part2gs_robotics.render_project import ALPHA_MAX, ALPHA_MIN, EXP_SCALE, Floats

Ints = NDArray[np.int32]

TILE = 16
LANES = 8
BLOCKS = TILE * TILE // LANES
STOP = 1e-4  # transmittance below which a pixel takes no more (3DGS)
CHECK_EVERY = 16  # Gaussians between two tests whether a whole tile is opaque
T_MIN = math.log(ALPHA_MIN) / EXP_SCALE
T_CLAMP = math.log(ALPHA_MAX) / EXP_SCALE

# Fields of a block, in units of LANES. Forward: transmittance, r, g, b, z, median depth, weight.
FORWARD_FIELDS = 7
# Backward: transmittance, S, gradients of r, g, b, z, the rest of G, weight.
BACKWARD_FIELDS = 8
SUMS = 7  # column sums of a tile: v, v dy, v dy^2, w dr, w dg, w db, w dz


def _exp8(t: float) -> float:
    """Return exp(8 t) for t in [-0.75, 0]."""
    return math.exp(8 * t)


@overload(_exp8)
def _exp8_for(t: float) -> Callable[[float], float]:
    """Pick the exponential of a type: exact in float64, 5 multiply-adds and 3 squarings else."""
    if t == types.float64:
        def exact(t: float) -> float:
            return math.exp(8 * t)

        return exact
    # Minimax fit of exp(t) on [-ln(255) / 8, 0]: relative error of exp(8 t) below 2e-6 in float32.
    c0, c1, c2, c3, c4, c5 = (np.float32(c) for c in (
        0.99999993, 0.99999289, 0.49988697, 0.16599301, 0.03980619, 0.00586747))

    def fast(t: float) -> float:
        p = c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5))))
        p *= p
        p *= p
        return p * p

    return fast


@kernel
def bin_gaussians(order: NDArray[np.int64], visible: NDArray[np.bool_], boxes: Ints,
                  tiles_x: int, tiles_y: int) -> tuple[NDArray[np.int64], NDArray[np.int64], Ints,
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
            for y in range(boxes[i, 1] // TILE, (boxes[i, 3] - 1) // TILE + 1):
                for x in range(boxes[i, 0] // TILE, (boxes[i, 2] - 1) // TILE + 1):
                    tile_first[y * tiles_x + x + 1] += 1
                    count += 1
        first[i + 1] = first[i] + count
    for j in range(tiles_x * tiles_y):
        tile_first[j + 1] += tile_first[j]
    cursor = tile_first.copy()
    ids = np.zeros(first[-1], np.int32)
    slots = np.zeros(first[-1], np.int32)
    for i in order:
        k = first[i]
        if visible[i]:
            for y in range(boxes[i, 1] // TILE, (boxes[i, 3] - 1) // TILE + 1):
                for x in range(boxes[i, 0] // TILE, (boxes[i, 2] - 1) // TILE + 1):
                    place = cursor[y * tiles_x + x]
                    cursor[y * tiles_x + x] += 1
                    ids[place] = i
                    slots[k] = place
                    k += 1
    return tile_first, ids, first, slots


@inlined
def _tile_box(box: Ints, px: int, py: int) -> tuple[int, int, int, int]:
    """Rows and 8-pixel half rows of the tile at (px, py) that the Gaussian's box covers."""
    return (max(box[1] - py, 0), min(box[3] - py, TILE),
            max(box[0] - px, 0) // LANES, (min(box[2] - px, TILE) - 1) // LANES + 1)


@inlined
def _blend_block(s: Floats, g: Floats, dx0: float, dy: float) -> None:
    """Blend one Gaussian into the 8 pixels of a block."""
    f = s.dtype.type
    zero, t_min, stop, half = f(0), f(T_MIN), f(STOP), f(0.5)
    a, b, c, top = g[2], g[3] * dy, g[4] * dy * dy + g[5], g[6]
    red, green, blue, z = g[7], g[8], g[9], g[10]
    for x in range(LANES):
        dx = f(x) + dx0
        t = min(dx * (a * dx + b) + c, top)
        through = s[x]
        alpha = _exp8(max(t, f(-0.75)))
        alpha = alpha if t >= t_min else zero
        alpha = alpha if through >= stop else zero
        w = alpha * through
        left = through - w
        s[x] = left
        s[LANES + x] += w * red
        s[2 * LANES + x] += w * green
        s[3 * LANES + x] += w * blue
        s[4 * LANES + x] += w * z
        median = s[5 * LANES + x]
        median = z if through >= half and w > zero else median
        s[5 * LANES + x] = median
        s[6 * LANES + x] = w


@inlined
def _opaque(state: Floats) -> bool:
    """Whether every pixel of the tile has stopped."""
    largest = state.dtype.type(0)
    for k in range(BLOCKS):
        for x in range(LANES):
            largest = max(largest, state[k, x])
    return bool(largest < state.dtype.type(STOP))


@kernel
def _forward_tile(ids: Ints, packed: Floats, boxes: Ints, extra: Floats, px: int, py: int,
                  state: Floats, channels: Floats) -> int:
    """Blend a tile's Gaussians into its state; return how many were needed."""
    f = state.dtype.type
    for k in range(len(ids)):
        if k % CHECK_EVERY == 0 and k > 0 and _opaque(state):
            return k
        i = ids[k]
        g = packed[i]
        y0, y1, h0, h1 = _tile_box(boxes[i], px, py)
        for y in range(y0, y1):
            dy = f(py + y) + f(0.5) - g[1]
            for h in range(h0, h1):
                block = 2 * y + h
                _blend_block(state[block], g, f(px + LANES * h) + f(0.5) - g[0], dy)
                for j in range(extra.shape[1]):
                    for x in range(LANES):
                        channels[block, j * LANES + x] += (state[block, 6 * LANES + x]
                                                           * extra[i, j])
    return len(ids)


@parallel_kernel
def forward(tile_order: NDArray[np.int64], tile_first: NDArray[np.int64], ids: Ints,
            packed: Floats, boxes: Ints, extra: Floats, background: Floats, image: Floats,
            extra_image: Floats, needed: Ints) -> None:
    """Render all tiles into image [H, W, 6] (r, g, b, alpha, z, median z) and [H, W, C]."""
    height, width = image.shape[:2]
    tiles_x = (width + TILE - 1) // TILE
    one, half = image.dtype.type(1), image.dtype.type(0.5)
    for j in prange(len(tile_order)):
        tile = tile_order[j]
        px, py = (tile % tiles_x) * TILE, (tile // tiles_x) * TILE
        state = np.zeros((BLOCKS, FORWARD_FIELDS * LANES), image.dtype)
        channels = np.zeros((BLOCKS, extra.shape[1] * LANES), image.dtype)
        state[:, :LANES] = one
        needed[tile] = _forward_tile(ids[tile_first[tile]:tile_first[tile + 1]], packed, boxes,
                                     extra, px, py, state, channels)
        for y in range(py, min(py + TILE, height)):
            for x in range(px, min(px + TILE, width)):
                s = state[2 * (y - py) + (x - px) // LANES]
                lane = (x - px) % LANES
                for c in range(3):
                    image[y, x, c] = s[(1 + c) * LANES + lane] + s[lane] * background[c]
                image[y, x, 3] = one - s[lane]
                image[y, x, 4] = s[4 * LANES + lane]
                if s[lane] < half:
                    image[y, x, 5] = s[5 * LANES + lane]
                for c in range(extra.shape[1]):
                    extra_image[y, x, c] = channels[2 * (y - py) + (x - px) // LANES,
                                                    c * LANES + lane]


@inlined
def _gradient_block(s: Floats, sums: Floats, g: Floats, dx0: float, dy: float) -> None:
    """Add one block's share of a Gaussian's gradient to the column sums.

    With w_i = alpha_i T_i, L is linear: L = sum w_i G_i + T_end B. S holds what is still to come, so
    dL/dalpha_i = T_i G_i - S_i / (1 - alpha_i), front to back without a stored list.
    """
    f = s.dtype.type
    zero, one, t_min, t_max, stop = f(0), f(1), f(T_MIN), f(T_CLAMP), f(STOP)
    a, b, c, top = g[2], g[3] * dy, g[4] * dy * dy + g[5], g[6]
    red, green, blue, z = g[7], g[8], g[9], g[10]
    for x in range(LANES):
        dx = f(x) + dx0
        raw = dx * (a * dx + b) + c
        t = min(raw, top)
        through = s[x]
        alpha = _exp8(max(t, f(-0.75)))
        alpha = alpha if t >= t_min else zero
        alpha = alpha if through >= stop else zero
        w = alpha * through
        here = w * (s[2 * LANES + x] * red + s[3 * LANES + x] * green + s[4 * LANES + x] * blue
                    + s[5 * LANES + x] * z + s[6 * LANES + x])
        rest = s[LANES + x] - here
        s[x] = through - w
        s[LANES + x] = rest
        v = here - rest * alpha / (one - alpha)
        v = v if raw < t_max else zero
        sums[x] += v
        sums[2 * LANES + x] += v * dy
        sums[4 * LANES + x] += v * dy * dy
        sums[6 * LANES + x] += w * s[2 * LANES + x]
        sums[8 * LANES + x] += w * s[3 * LANES + x]
        sums[10 * LANES + x] += w * s[4 * LANES + x]
        sums[12 * LANES + x] += w * s[5 * LANES + x]
        s[7 * LANES + x] = w


@inlined
def _reduce(sums: Floats, dx0: float, row: Floats) -> None:
    """Turn column sums into the moments of one (Gaussian, tile) row and clear them."""
    f = sums.dtype.type
    row[:] = f(0)
    for x in range(TILE):
        dx = f(x) + dx0
        v, vy = sums[x], sums[TILE + x]
        row[0] += v
        row[1] += v * dx
        row[2] += vy
        row[3] += v * dx * dx
        row[4] += vy * dx
        row[5] += sums[2 * TILE + x]
        row[6] += sums[3 * TILE + x]
        row[7] += sums[4 * TILE + x]
        row[8] += sums[5 * TILE + x]
        row[9] += sums[6 * TILE + x]
    sums[:] = f(0)


@kernel
def _backward_tile(ids: Ints, packed: Floats, boxes: Ints, extra: Floats, px: int, py: int,
                   state: Floats, channels: Floats, partial: Floats) -> None:
    """Fill one row of gradients per Gaussian of the tile."""
    f = state.dtype.type
    sums = np.zeros(SUMS * TILE, state.dtype)
    rest = np.zeros(LANES, state.dtype)
    for k in range(len(ids)):
        i = ids[k]
        g = packed[i]
        y0, y1, h0, h1 = _tile_box(boxes[i], px, py)
        dx0 = f(px) + f(0.5) - g[0]
        channel_sums = np.zeros(extra.shape[1], state.dtype)
        for y in range(y0, y1):
            dy = f(py + y) + f(0.5) - g[1]
            for h in range(h0, h1):
                block = 2 * y + h
                s = state[block]
                if extra.shape[1] > 0:
                    rest[:] = s[6 * LANES:7 * LANES]
                    for j in range(extra.shape[1]):
                        for x in range(LANES):
                            s[6 * LANES + x] += channels[block, j * LANES + x] * extra[i, j]
                _gradient_block(s, sums[h * LANES:], g, f(LANES * h) + dx0, dy)
                if extra.shape[1] > 0:
                    s[6 * LANES:7 * LANES] = rest
                    for j in range(extra.shape[1]):
                        for x in range(LANES):
                            channel_sums[j] += s[7 * LANES + x] * channels[block, j * LANES + x]
        _reduce(sums, dx0, partial[k])
        for j in range(extra.shape[1]):
            partial[k, 10 + j] = channel_sums[j]


@inlined
def _load_pixel(s: Floats, lane: int, pixel: Floats, gradient: Floats) -> None:
    """Set a pixel's state before the first Gaussian."""
    s[lane] = s.dtype.type(1)
    s[2 * LANES + lane] = gradient[0]
    s[3 * LANES + lane] = gradient[1]
    s[4 * LANES + lane] = gradient[2]
    s[5 * LANES + lane] = gradient[4]
    s[6 * LANES + lane] = gradient[3]
    s[LANES + lane] = (gradient[0] * pixel[0] + gradient[1] * pixel[1] + gradient[2] * pixel[2]
                       + gradient[3] * pixel[3] + gradient[4] * pixel[4])


@parallel_kernel
def backward(tile_order: NDArray[np.int64], tile_first: NDArray[np.int64], ids: Ints,
             needed: Ints, packed: Floats, boxes: Ints, extra: Floats, image: Floats,
             extra_image: Floats, d_image: Floats, d_extra_image: Floats, partial: Floats) -> None:
    """Fill partial [M, 10 + C] from the gradients of the image.

    d_image [H, W, 5]: r, g, b, alpha, z. Rows past a tile's needed count stay as they are (zero).
    """
    height, width = image.shape[:2]
    tiles_x = (width + TILE - 1) // TILE
    for j in prange(len(tile_order)):
        tile = tile_order[j]
        start = tile_first[tile]
        end = start + needed[tile]
        if end > start:
            px, py = (tile % tiles_x) * TILE, (tile // tiles_x) * TILE
            state = np.zeros((BLOCKS, BACKWARD_FIELDS * LANES), image.dtype)
            channels = np.zeros((BLOCKS, extra.shape[1] * LANES), image.dtype)
            for y in range(py, min(py + TILE, height)):
                for x in range(px, min(px + TILE, width)):
                    _load_pixel(state[2 * (y - py) + (x - px) // LANES], (x - px) % LANES,
                                image[y, x], d_image[y, x])
                    for c in range(extra.shape[1]):
                        block, lane = 2 * (y - py) + (x - px) // LANES, (x - px) % LANES
                        channels[block, c * LANES + lane] = d_extra_image[y, x, c]
                        state[block, LANES + lane] += d_extra_image[y, x, c] * extra_image[y, x, c]
            _backward_tile(ids[start:end], packed, boxes, extra, px, py, state, channels,
                           partial[start:end])
