"""Numba kernels: sort Gaussians into tiles, blend each tile front to back, and its gradient.

A tile is 8 pixels wide, one AVX register of float32, and 32 high: the rows a Gaussian covers are one
contiguous range, whatever its size, and one flat loop. All state of a tile lies in planes of a single
array, so that the compiler needs no aliasing tests and emits SIMD code; every decision in a loop is
a select. The exponent t arrives divided by 8: alpha = exp(t)^8.
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

TILE_X = 8
TILE_Y = 32
PIXELS = TILE_X * TILE_Y
STOP = 1e-4  # transmittance below which a pixel takes no more (3DGS)
CHECK_EVERY = 16  # Gaussians between two tests whether a whole tile is opaque
T_MIN = math.log(ALPHA_MIN) / EXP_SCALE
T_MAX = math.log(ALPHA_MAX) / EXP_SCALE
T_FLOOR = -0.75  # below T_MIN: where the fast exponential ends

# Planes of a tile: transmittance, weight of the last Gaussian, pixel x and y, then
# forward r, g, b, z, median z; backward S, gradients of r, g, b, z, and the rest of G.
FORWARD_PLANES = 9
BACKWARD_PLANES = 10
X, Y = 2 * PIXELS, 3 * PIXELS
P4, P5, P6, P7, P8, P9 = (n * PIXELS for n in range(4, 10))


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
            for y in range(boxes[i, 1] // TILE_Y, (boxes[i, 3] - 1) // TILE_Y + 1):
                for x in range(boxes[i, 0] // TILE_X, (boxes[i, 2] - 1) // TILE_X + 1):
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
            for y in range(boxes[i, 1] // TILE_Y, (boxes[i, 3] - 1) // TILE_Y + 1):
                for x in range(boxes[i, 0] // TILE_X, (boxes[i, 2] - 1) // TILE_X + 1):
                    place = cursor[y * tiles_x + x]
                    cursor[y * tiles_x + x] += 1
                    ids[place] = i
                    slots[k] = place
                    k += 1
    return tile_first, ids, first, slots


@inlined
def _blend(s: Floats, g: Floats, mx: float, my: float, count: int) -> None:
    """Blend one Gaussian, centred at (mx, my) in the tile, into the first pixels of s."""
    f = s.dtype.type
    zero, floor, t_min, stop, half = f(0), f(T_FLOOR), f(T_MIN), f(STOP), f(0.5)
    a, b, c, log_opacity, top = g[2], g[3], g[4], g[5], g[6]
    red, green, blue, z = g[7], g[8], g[9], g[10]
    for k in range(count):
        dx, dy = s[X + k] - mx, s[Y + k] - my
        t = min(dx * (a * dx + b * dy) + (c * dy * dy + log_opacity), top)
        through = s[k]
        alpha = _exp8(max(t, floor))
        alpha = alpha if t >= t_min else zero
        alpha = alpha if through >= stop else zero
        w = alpha * through
        s[k] = through - w
        s[PIXELS + k] = w
        s[P4 + k] += w * red
        s[P5 + k] += w * green
        s[P6 + k] += w * blue
        s[P7 + k] += w * z
        median = s[P8 + k]
        here = z if w > zero else median
        s[P8 + k] = here if through >= half else median


@inlined
def _opaque(s: Floats) -> bool:
    """Whether every pixel of the tile has stopped."""
    largest = s.dtype.type(0)
    for k in range(PIXELS):
        largest = max(largest, s[k])
    return bool(largest < s.dtype.type(STOP))


@inlined
def _place(s: Floats) -> None:
    """Set the pixel coordinates of a tile's planes and full transmittance."""
    for k in range(PIXELS):
        s[k] = 1
        s[X + k] = k % TILE_X
        s[Y + k] = k // TILE_X


@inlined
def _covered(box: Ints, py: int) -> tuple[int, int]:
    """Pixels of the tile in the rows that the Gaussian's box covers."""
    return max(box[1] - py, 0) * TILE_X, min(box[3] - py, TILE_Y) * TILE_X


@kernel
def _forward_tile(ids: Ints, packed: Floats, boxes: Ints, extra: Floats, px: int, py: int,
                  s: Floats, channels: Floats) -> int:
    """Blend a tile's Gaussians into its planes; return how many were needed."""
    left, top = s.dtype.type(px + 0.5), s.dtype.type(py + 0.5)
    for n in range(len(ids)):
        if n % CHECK_EVERY == 0 and n > 0 and _opaque(s):
            return n
        i = ids[n]
        first, last = _covered(boxes[i], py)
        _blend(s[first:], packed[i], packed[i, 0] - left, packed[i, 1] - top, last - first)
        for j in range(extra.shape[1]):
            value = extra[i, j]
            for k in range(first, last):
                channels[j, k] += s[PIXELS + k] * value
    return len(ids)


@parallel_kernel
def forward(tile_order: NDArray[np.int64], tile_first: NDArray[np.int64], ids: Ints,
            packed: Floats, boxes: Ints, extra: Floats, background: Floats, image: Floats,
            extra_image: Floats, needed: Ints) -> None:
    """Render all tiles into image [H, W, 6] (r, g, b, alpha, z, median z) and [H, W, C]."""
    height, width = image.shape[:2]
    tiles_x = (width + TILE_X - 1) // TILE_X
    one, half = image.dtype.type(1), image.dtype.type(0.5)
    for j in prange(len(tile_order)):
        tile = tile_order[j]
        px, py = (tile % tiles_x) * TILE_X, (tile // tiles_x) * TILE_Y
        s = np.zeros(FORWARD_PLANES * PIXELS, image.dtype)
        channels = np.zeros((extra.shape[1], PIXELS), image.dtype)
        _place(s)
        needed[tile] = _forward_tile(ids[tile_first[tile]:tile_first[tile + 1]], packed, boxes,
                                     extra, px, py, s, channels)
        for y in range(py, min(py + TILE_Y, height)):
            for x in range(px, min(px + TILE_X, width)):
                k = (y - py) * TILE_X + x - px
                for c in range(3):
                    image[y, x, c] = s[P4 + c * PIXELS + k] + s[k] * background[c]
                image[y, x, 3] = one - s[k]
                image[y, x, 4] = s[P7 + k]
                if s[k] < half:
                    image[y, x, 5] = s[P8 + k]
                for c in range(extra.shape[1]):
                    extra_image[y, x, c] = channels[c, k]


@inlined
def _gradient(s: Floats, g: Floats, mx: float, my: float, count: int, row: Floats
              ) -> None:
    """Sum one Gaussian's gradients over the first pixels of s into row.

    With w_i = alpha_i T_i, L is linear: L = sum w_i G_i + T_end B. S holds what is still to come, so
    dL/dalpha_i = T_i G_i - S_i / (1 - alpha_i), front to back without a stored list.
    """
    f = s.dtype.type
    zero, one, floor, t_min, t_max, stop = f(0), f(1), f(T_FLOOR), f(T_MIN), f(T_MAX), f(STOP)
    a, b, c, log_opacity, top = g[2], g[3], g[4], g[5], g[6]
    red, green, blue, z = g[7], g[8], g[9], g[10]
    r0 = r1 = r2 = r3 = r4 = r5 = r6 = r7 = r8 = r9 = zero
    for k in range(count):
        dx, dy = s[X + k] - mx, s[Y + k] - my
        raw = dx * (a * dx + b * dy) + (c * dy * dy + log_opacity)
        t = min(raw, top)
        through = s[k]
        alpha = _exp8(max(t, floor))
        alpha = alpha if t >= t_min else zero
        alpha = alpha if through >= stop else zero
        w = alpha * through
        here = w * (s[P5 + k] * red + s[P6 + k] * green + s[P7 + k] * blue + s[P8 + k] * z
                    + s[P9 + k])
        rest = s[P4 + k] - here
        s[k] = through - w
        s[P4 + k] = rest
        s[PIXELS + k] = w
        v = here - rest * alpha / (one - alpha)
        v = v if raw < t_max else zero
        vx, vy = v * dx, v * dy
        r0 += v
        r1 += vx
        r2 += vy
        r3 += vx * dx
        r4 += vx * dy
        r5 += vy * dy
        r6 += w * s[P5 + k]
        r7 += w * s[P6 + k]
        r8 += w * s[P7 + k]
        r9 += w * s[P8 + k]
    row[0], row[1], row[2], row[3], row[4] = r0, r1, r2, r3, r4
    row[5], row[6], row[7], row[8], row[9] = r5, r6, r7, r8, r9


@kernel
def _backward_tile(ids: Ints, packed: Floats, boxes: Ints, extra: Floats, px: int, py: int,
                   s: Floats, channels: Floats, partial: Floats) -> None:
    """Fill one row of gradients per Gaussian of the tile."""
    left, top = s.dtype.type(px + 0.5), s.dtype.type(py + 0.5)
    plain = s[P9:].copy()
    for n in range(len(ids)):
        i = ids[n]
        first, last = _covered(boxes[i], py)
        if extra.shape[1] > 0:
            s[P9 + first:P9 + last] = plain[first:last]
            for j in range(extra.shape[1]):
                value = extra[i, j]
                for k in range(first, last):
                    s[P9 + k] += channels[j, k] * value
        _gradient(s[first:], packed[i], packed[i, 0] - left, packed[i, 1] - top, last - first, partial[n])
        for j in range(extra.shape[1]):
            total = s.dtype.type(0)
            for k in range(first, last):
                total += s[PIXELS + k] * channels[j, k]
            partial[n, 10 + j] = total


@inlined
def _load_pixel(s: Floats, k: int, pixel: Floats, gradient: Floats) -> None:
    """Set a pixel's planes before the first Gaussian."""
    s[P4 + k] = (gradient[0] * pixel[0] + gradient[1] * pixel[1] + gradient[2] * pixel[2]
                 + gradient[3] * pixel[3] + gradient[4] * pixel[4])
    s[P5 + k] = gradient[0]
    s[P6 + k] = gradient[1]
    s[P7 + k] = gradient[2]
    s[P8 + k] = gradient[4]
    s[P9 + k] = gradient[3]


@parallel_kernel
def backward(tile_order: NDArray[np.int64], tile_first: NDArray[np.int64], ids: Ints,
             needed: Ints, packed: Floats, boxes: Ints, extra: Floats, image: Floats,
             extra_image: Floats, d_image: Floats, d_extra_image: Floats, partial: Floats) -> None:
    """Fill partial [M, 10 + C] from the gradients of the image.

    d_image [H, W, 5]: r, g, b, alpha, z. Rows past a tile's needed count stay as they are (zero).
    """
    height, width = image.shape[:2]
    tiles_x = (width + TILE_X - 1) // TILE_X
    for j in prange(len(tile_order)):
        tile = tile_order[j]
        start = tile_first[tile]
        end = start + needed[tile]
        if end > start:
            px, py = (tile % tiles_x) * TILE_X, (tile // tiles_x) * TILE_Y
            s = np.zeros(BACKWARD_PLANES * PIXELS, image.dtype)
            channels = np.zeros((extra.shape[1], PIXELS), image.dtype)
            _place(s)
            for y in range(py, min(py + TILE_Y, height)):
                for x in range(px, min(px + TILE_X, width)):
                    k = (y - py) * TILE_X + x - px
                    _load_pixel(s, k, image[y, x], d_image[y, x])
                    for c in range(extra.shape[1]):
                        channels[c, k] = d_extra_image[y, x, c]
                        s[P4 + k] += d_extra_image[y, x, c] * extra_image[y, x, c]
            _backward_tile(ids[start:end], packed, boxes, extra, px, py, s, channels,
                           partial[start:end])
