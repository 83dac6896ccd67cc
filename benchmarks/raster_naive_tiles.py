"""The yardstick's tile kernels: every Gaussian of a tile over the pixels of its box, one by one."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

TILE = 16  # pixels, 3DGS
ZERO, ONE, HALF = np.float32(0), np.float32(1), np.float32(0.5)
OPAQUE = np.float32(0.99)  # largest alpha, 3DGS
FAINT = np.float32(1 / 255)  # smallest alpha, 3DGS
FAR = np.float32(-5.55)  # below log(1/255), so invisible: math.exp need not be called
STOP = np.float32(1e-4)  # transmittance below which a pixel takes no more, 3DGS


@njit(inline="always")
def _falloff(packed, i, dx, dy):
    """Return the Gaussian at an offset, 0 where no opacity would make it visible."""
    power = (-HALF * (packed[i, 2] * dx * dx + packed[i, 4] * dy * dy)
             - packed[i, 3] * dx * dy)
    return math.exp(power) if power > FAR else ZERO


@njit(inline="always")
def _blend(i, n, packed, boxes, px, py, right, bottom, image, last):
    """Blend Gaussian i, number n of its tile; return how many pixels it stopped."""
    stopped = 0
    for y in range(max(py, boxes[i, 1]), min(bottom, boxes[i, 3])):
        dy = packed[i, 1] - np.float32(y) - HALF
        for x in range(max(px, boxes[i, 0]), min(right, boxes[i, 2])):
            through = image[y, x, 3]
            if through < STOP:
                continue
            full = _falloff(packed, i, packed[i, 0] - np.float32(x) - HALF, dy)
            alpha = min(OPAQUE, packed[i, 5] * full)
            if alpha < FAINT:
                continue
            weight = alpha * through
            for c in range(3):
                image[y, x, c] += weight * packed[i, 6 + c]
            image[y, x, 4] += weight * packed[i, 9]
            image[y, x, 3] = through - weight
            last[y, x] = n + 1
            if through - weight < STOP:
                stopped += 1
    return stopped


@njit(fastmath=True)
def _forward_tile(start, end, ids, packed, boxes, background, px, py, image, last):
    right, bottom = min(px + TILE, image.shape[1]), min(py + TILE, image.shape[0])
    for y in range(py, bottom):
        for x in range(px, right):
            image[y, x, 3] = ONE
    alive = (right - px) * (bottom - py)
    for n in range(end - start):
        alive -= _blend(ids[start + n], n, packed, boxes, px, py, right, bottom, image, last)
        if alive == 0:
            break
    for y in range(py, bottom):
        for x in range(px, right):
            for c in range(3):
                image[y, x, c] += image[y, x, 3] * background[c]


@njit(parallel=True, fastmath=True, cache=True)
def forward(tile_first, ids, packed, boxes, background, image, last):
    """Fill image [H, W, 5] (r, g, b, transmittance, z) and last [H, W], which ends each list."""
    tiles_x = (image.shape[1] + TILE - 1) // TILE
    for tile in prange(len(tile_first) - 1):
        _forward_tile(tile_first[tile], tile_first[tile + 1], ids, packed, boxes, background,
                      tile % tiles_x * TILE, tile // tiles_x * TILE, image, last)


@njit(inline="always")
def _gradient(i, n, packed, boxes, px, py, right, bottom, last, d, through, behind, row):
    """Fill a row with the gradients of Gaussian i, number n of its tile, going back to front.

    With `behind` the part of L that lies behind it, dL/dalpha = T G - behind / (1 - alpha), and T
    in front of it follows from T behind it by a division.
    """
    g0 = g1 = g2 = g3 = g4 = g5 = g6 = g7 = g8 = g9 = ZERO
    for y in range(max(py, boxes[i, 1]), min(bottom, boxes[i, 3])):
        dy = packed[i, 1] - np.float32(y) - HALF
        for x in range(max(px, boxes[i, 0]), min(right, boxes[i, 2])):
            if n >= last[y, x]:
                continue
            dx = packed[i, 0] - np.float32(x) - HALF
            full = _falloff(packed, i, dx, dy)
            alpha = min(OPAQUE, packed[i, 5] * full)
            if alpha < FAINT:
                continue
            t = through[y - py, x - px] / (ONE - alpha)
            weight = alpha * t
            value = (d[y, x, 0] * packed[i, 6] + d[y, x, 1] * packed[i, 7]
                     + d[y, x, 2] * packed[i, 8] + d[y, x, 4] * packed[i, 9])
            by_alpha = t * value - behind[y - py, x - px] / (ONE - alpha)
            through[y - py, x - px] = t
            behind[y - py, x - px] += weight * value
            g6 += weight * d[y, x, 0]
            g7 += weight * d[y, x, 1]
            g8 += weight * d[y, x, 2]
            g9 += weight * d[y, x, 4]
            if packed[i, 5] * full < OPAQUE:  # a clamped alpha does not move with its ellipse
                v = by_alpha * alpha
                g0 -= v * (packed[i, 2] * dx + packed[i, 3] * dy)
                g1 -= v * (packed[i, 4] * dy + packed[i, 3] * dx)
                g2 -= HALF * v * dx * dx
                g3 -= v * dx * dy
                g4 -= HALF * v * dy * dy
                g5 += by_alpha * full
    row[0], row[1], row[2], row[3], row[4] = g0, g1, g2, g3, g4
    row[5], row[6], row[7], row[8], row[9] = g5, g6, g7, g8, g9


@njit(fastmath=True)
def _backward_tile(start, ids, packed, boxes, background, px, py, image, last, d, partial):
    right, bottom = min(px + TILE, image.shape[1]), min(py + TILE, image.shape[0])
    through = np.zeros((TILE, TILE), np.float32)
    behind = np.zeros((TILE, TILE), np.float32)
    count = 0
    for y in range(py, bottom):
        for x in range(px, right):
            end = image[y, x, 3]
            through[y - py, x - px] = end
            behind[y - py, x - px] = end * (
                d[y, x, 0] * background[0] + d[y, x, 1] * background[1]
                + d[y, x, 2] * background[2] - d[y, x, 3])
            count = max(count, last[y, x])
    for n in range(count - 1, -1, -1):
        _gradient(ids[start + n], n, packed, boxes, px, py, right, bottom, last, d, through,
                  behind, partial[start + n])


@njit(parallel=True, fastmath=True, cache=True)
def backward(tile_first, ids, packed, boxes, background, image, last, d_image, partial):
    """Fill partial [M, 10], one row per Gaussian listed in a tile: the packed numbers' gradients.

    d_image [H, W, 5]: r, g, b, alpha, z.
    """
    tiles_x = (image.shape[1] + TILE - 1) // TILE
    for tile in prange(len(tile_first) - 1):
        _backward_tile(tile_first[tile], ids, packed, boxes, background, tile % tiles_x * TILE,
                       tile // tiles_x * TILE, image, last, d_image, partial)
