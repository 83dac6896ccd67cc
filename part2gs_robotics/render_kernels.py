"""Numba kernels: blend each tile's Gaussians front to back, and the gradient of that.

The rows of a tile that a Gaussian covers are one contiguous range and one flat loop. All state of a
tile lies in planes of a single array, so that the compiler needs no aliasing tests and emits SIMD
code; every decision in a loop is a select. The exponent t comes divided by 8: alpha = exp(t)^8.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import prange, types
from numba.extending import overload
from numpy.typing import NDArray

from part2gs_robotics.render_bins import TILE_X, TILE_Y, Ints
from part2gs_robotics.render_jit import inlined, kernel, parallel_kernel
from part2gs_robotics.render_project import ALPHA_MAX, ALPHA_MIN, EXP_SCALE, Floats

PIXELS = TILE_X * TILE_Y
# Planes of one tile, in the precision of the image; typed as the precision that is a float.
Tile = NDArray[np.float64]

STOP = 1e-4  # transmittance below which a pixel takes no more (3DGS)
CHECK_EVERY = 16  # Gaussians between two tests whether a whole tile is opaque
T_MIN = math.log(ALPHA_MIN) / EXP_SCALE
T_MAX = math.log(ALPHA_MAX) / EXP_SCALE
T_FLOOR = -0.75  # below T_MIN: where the fast exponential ends

# Planes of a tile: transmittance, weight of the last Gaussian, pixel x and y, then
# forward r, g, b, z, median z; backward S, gradients of r, g, b, z, and the rest of G.
FORWARD_PLANES = 9
BACKWARD_PLANES = 10
# Unsigned indices: signed ones can be negative, and testing for that would cost the SIMD code.
P1, X, Y, P4, P5, P6, P7, P8, P9 = (np.uint64(n * PIXELS) for n in range(1, 10))


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
        return p * p  # type: ignore[return-value]  # float would widen it to float64

    return fast


@inlined
def _blend(s: Tile, g: Floats, i: int, mx: float, my: float, first: np.uint64, last: np.uint64
           ) -> None:
    """Blend Gaussian i, centred at (mx, my) in the tile, into the pixels first to last."""
    f = s.dtype.type
    zero, floor, t_min, stop, half = f(0), f(T_FLOOR), f(T_MIN), f(STOP), f(0.5)
    a, b, c, log_opacity, top = g[i, 2], g[i, 3], g[i, 4], g[i, 5], g[i, 6]
    red, green, blue, z = g[i, 7], g[i, 8], g[i, 9], g[i, 10]
    for k in range(first, last):
        dx, dy = s[X + k] - mx, s[Y + k] - my
        t = min(dx * (a * dx + b * dy) + (c * dy * dy + log_opacity), top)
        through = s[k]
        alpha = _exp8(max(t, floor))
        alpha = alpha if t >= t_min else zero
        alpha = alpha if through >= stop else zero
        w = alpha * through
        s[k] = through - w
        s[P1 + k] = w
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
        s[2 * PIXELS + k] = k % TILE_X
        s[3 * PIXELS + k] = k // TILE_X


@inlined
def _root(g: Floats, i: int, x: float, level: float) -> float:
    """Root of the discriminant of the ellipse's equation in y at column x."""
    f = g.dtype.type
    b, rest = g[i, 3] * x, g[i, 2] * x * x + level
    return math.sqrt(max(b * b - f(4) * g[i, 4] * rest, f(0)))


@inlined
def _covered(g: Floats, boxes: Ints, i: int, px: int, py: int) -> tuple[np.uint64, np.uint64]:
    """Pixels of the tile in the rows where the ellipse of Gaussian i meets the tile's columns.

    The highest point of the ellipse over the columns is above the column nearest to the top's, the
    lowest one below the column nearest to the bottom's, which lies opposite.
    """
    # Whole arrays and an index, never a view: its reference count is an atomic that threads share.
    f = g.dtype.type
    left = f(px) + f(0.5) - g[i, 0]
    right = left + f(TILE_X - 1)
    x_high, x_low = max(left, min(g[i, 11], right)), max(left, min(-g[i, 11], right))
    inv, level = f(-0.5) / g[i, 4], g[i, 5] - f(T_MIN)
    high = _root(g, i, x_high, level) * inv + g[i, 3] * x_high * inv
    low = g[i, 3] * x_low * inv - _root(g, i, x_low, level) * inv
    # 0.01 px covers rounding; the box bounds what rounding could do to needles.
    y0 = max(math.ceil(g[i, 1] + low - f(0.51)), f(boxes[i, 1])) - f(py)
    y1 = min(math.floor(g[i, 1] + high + f(0.51)), f(boxes[i, 3])) - f(py)
    first = int(max(y0, f(0)))
    return np.uint64(first * TILE_X), np.uint64(max(int(min(y1, f(TILE_Y))), first) * TILE_X)


@kernel
def _forward_tile(ids: Ints, packed: Floats, boxes: Ints, extra: Floats, px: int, py: int,
                  s: Tile, channels: Floats) -> int:
    """Blend a tile's Gaussians into its planes; return how many were needed."""
    left, top = s.dtype.type(px + 0.5), s.dtype.type(py + 0.5)
    for n in range(len(ids)):
        if n % CHECK_EVERY == 0 and n > 0 and _opaque(s):
            return n
        i = ids[n]
        first, last = _covered(packed, boxes, i, px, py)
        _blend(s, packed, i, packed[i, 0] - left, packed[i, 1] - top, first, last)
        for j in range(extra.shape[1]):
            value = extra[i, j]
            for k in range(first, last):
                channels[j, k] += s[P1 + k] * value
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
                                     extra, px, py, s, channels)  # type: ignore[arg-type]
        for y in range(py, min(py + TILE_Y, height)):
            for x in range(px, min(px + TILE_X, width)):
                k = (y - py) * TILE_X + x - px
                for c in range(3):
                    image[y, x, c] = s[(4 + c) * PIXELS + k] + s[k] * background[c]
                image[y, x, 3] = one - s[k]
                image[y, x, 4] = s[7 * PIXELS + k]
                if s[k] < half:
                    image[y, x, 5] = s[8 * PIXELS + k]
                for c in range(extra.shape[1]):
                    extra_image[y, x, c] = channels[c, k]


@inlined
def _gradient(s: Tile, g: Floats, i: int, mx: float, my: float, first: np.uint64,
              last: np.uint64, partial: Floats, n: int) -> None:
    """Sum the gradients of Gaussian i over the pixels first to last into row n of partial.

    With w_i = alpha_i T_i, L is linear: L = sum w_i G_i + T_end B. S holds what is still to come,
    so dL/dalpha_i = T_i G_i - S_i / (1 - alpha_i), front to back without a stored list.
    """
    f = s.dtype.type
    zero, one, floor, t_min, t_max, stop = f(0), f(1), f(T_FLOOR), f(T_MIN), f(T_MAX), f(STOP)
    a, b, c, log_opacity, top = g[i, 2], g[i, 3], g[i, 4], g[i, 5], g[i, 6]
    red, green, blue, z = g[i, 7], g[i, 8], g[i, 9], g[i, 10]
    r0 = r1 = r2 = r3 = r4 = r5 = r6 = r7 = r8 = r9 = zero
    for k in range(first, last):
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
        s[P1 + k] = w
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
    partial[n, 0], partial[n, 1], partial[n, 2], partial[n, 3], partial[n, 4] = r0, r1, r2, r3, r4
    partial[n, 5], partial[n, 6], partial[n, 7], partial[n, 8], partial[n, 9] = r5, r6, r7, r8, r9


@kernel
def _backward_tile(ids: Ints, packed: Floats, boxes: Ints, extra: Floats, px: int, py: int,
                   s: Tile, channels: Floats, partial: Floats) -> None:
    """Fill one row of gradients per Gaussian of the tile."""
    left, top = s.dtype.type(px + 0.5), s.dtype.type(py + 0.5)
    plain = s[9 * PIXELS:].copy()
    for n in range(len(ids)):
        i = ids[n]
        first, last = _covered(packed, boxes, i, px, py)
        if extra.shape[1] > 0:
            for k in range(first, last):
                s[P9 + k] = plain[k]
            for j in range(extra.shape[1]):
                value = extra[i, j]
                for k in range(first, last):
                    s[P9 + k] += channels[j, k] * value
        _gradient(s, packed, i, packed[i, 0] - left, packed[i, 1] - top, first, last, partial, n)
        for j in range(extra.shape[1]):
            total = s.dtype.type(0)
            for k in range(first, last):
                total += s[P1 + k] * channels[j, k]
            partial[n, 10 + j] = total


@inlined
def _load_pixel(s: Floats, k: int, pixel: Floats, gradient: Floats) -> None:
    """Set a pixel's planes before the first Gaussian."""
    s[4 * PIXELS + k] = (gradient[0] * pixel[0] + gradient[1] * pixel[1] + gradient[2] * pixel[2]
                 + gradient[3] * pixel[3] + gradient[4] * pixel[4])
    s[5 * PIXELS + k] = gradient[0]
    s[6 * PIXELS + k] = gradient[1]
    s[7 * PIXELS + k] = gradient[2]
    s[8 * PIXELS + k] = gradient[4]
    s[9 * PIXELS + k] = gradient[3]


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
                        s[4 * PIXELS + k] += d_extra_image[y, x, c] * extra_image[y, x, c]
            _backward_tile(ids[start:end], packed, boxes, extra, px, py, s, channels,  # type: ignore[arg-type]
                           partial[start:end])
