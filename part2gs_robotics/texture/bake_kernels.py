"""Kernels of the baking: samples of every texel from photos, and one colour of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32, F64, I64
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel

STEEPEST = 0.1  # cosine of 84 degrees: a photo that grazes more shows a smear
SHARE = 0.004  # of the size: depth by which twin and twin's own depth image may differ


@inlined
def _slot(weights: F32, colors: F32, weight: float) -> int:
    """Make room for a weight among those in descending order; return its place."""
    slot = len(weights) - 1
    while slot > 0 and weights[slot - 1] < weight:
        weights[slot] = weights[slot - 1]
        for k in range(3):
            colors[slot, k] = colors[slot - 1, k]
        slot -= 1
    weights[slot] = weight
    return slot


@inlined
def _look(image: NDArray[np.uint8], x: float, y: float, color: F32) -> None:
    """Fill the colour of an image at a place, between the four pixels around."""
    i, j = int(x - 0.5), int(y - 0.5)
    u, w = x - 0.5 - i, y - 0.5 - j
    for k in range(3):
        upper = (1.0 - u) * image[j, i, k] + u * image[j, i + 1, k]
        lower = (1.0 - u) * image[j + 1, i, k] + u * image[j + 1, i + 1, k]
        color[k] = (1.0 - w) * upper + w * lower


@kernel
def gather(points: F32, normals: F32, place: F64, K: F64, images: NDArray[np.uint8], trust: F32,
           depths: F32, size: float, power: float, weights: F32, colors: F32) -> None:
    """Put the best samples of every texel from some photos among those it has.

    Args:
        points: [T, 3] of the part at state 0.
        normals: [T, 3] unit.
        place: [V, 3, 4] camera from the part at state 0.
        K: [V, 3, 3] pixels.
        images: [V, H, W, 3].
        trust: [V, H, W] 0..1.
        depths: [V, H, W] of the posed twin.
        size: of the twin.
        power: of the cosine between normal and ray.
        weights: [T, B] best first, 0 = none; changed.
        colors: [T, B, 3] 0..255; changed.
    """
    views, height, width = depths.shape
    most = weights.shape[1]
    for_each(len(points), _gather_at, (points, normals, place, K, images, trust, depths, size,
                                       power, weights, colors, views, height, width, most))


@inlined
def _gather_at(t: int, points: F32, normals: F32, place: F64, K: F64, images: NDArray[np.uint8],
               trust: F32, depths: F32, size: float, power: float, weights: F32, colors: F32,
               views: int, height: int, width: int, most: int) -> None:
    x, y, z = points[t, 0], points[t, 1], points[t, 2]
    nx, ny, nz = normals[t, 0], normals[t, 1], normals[t, 2]
    for v in range(views):
        m = place[v]
        c = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
        if c <= 0.0:
            continue
        a = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]
        b = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]
        na = m[0, 0] * nx + m[0, 1] * ny + m[0, 2] * nz
        nb = m[1, 0] * nx + m[1, 1] * ny + m[1, 2] * nz
        nc = m[2, 0] * nx + m[2, 1] * ny + m[2, 2] * nz
        squared = a * a + b * b + c * c
        cosine = -(na * a + nb * b + nc * c) / np.sqrt(squared)
        if cosine < STEEPEST:
            continue
        fx, fy = K[v, 0, 0], K[v, 1, 1]
        px, py = fx * a / c + K[v, 0, 2], fy * b / c + K[v, 1, 2]
        if not (px >= 1.0 and py >= 1.0 and px < width - 1.0 and py < height - 1.0):
            continue
        i, j = int(px), int(py)
        sure = trust[v, j, i]
        slope = c / fx * np.sqrt(1.0 - min(cosine * cosine, 1.0)) / cosine
        if sure <= 0.0 or c > depths[v, j, i] + SHARE * size + slope:
            continue
        weight = sure * cosine**power * size * size / squared
        if weight > weights[t, most - 1]:
            slot = _slot(weights[t], colors[t], weight)
            _look(images[v], px, py, colors[t, slot])


@kernel
def blend(weights: F32, colors: F32, spread: float, rounds: int, out: F32) -> None:
    """Fill the colour that most of a texel's samples agree on.

    From the weighted median of every channel, means whose weights fall with the distance from the
    last one: a shadow or what shone through a gap is outvoted.

    Args:
        weights: [T, B], 0 = no sample.
        colors: [T, B, 3] 0..255.
        spread: 0..255, distance of samples that count a quarter.
        rounds: of reweighting.
        out: [T, 3] result; untouched where there is no sample.
    """
    most = weights.shape[1]
    scale = 1.0 / spread**2
    for_each(len(weights), _blend_at, (weights, colors, rounds, out, most, scale))


@inlined
def _sort(values: F32, order: I64) -> None:
    """Fill the places of values, in rising order; Numba's own takes two seconds to compile."""
    for one in range(len(values)):
        slot = one
        while slot > 0 and values[order[slot - 1]] > values[one]:
            order[slot] = order[slot - 1]
            slot -= 1
        order[slot] = one


@inlined
def _blend_at(t: int, weights: F32, colors: F32, rounds: int, out: F32, most: int,
              scale: float) -> None:
    total = 0.0
    for one in range(most):
        total += weights[t, one]
    if total <= 0.0:
        return
    middle, order = np.zeros(3), np.zeros(most, np.int64)
    for k in range(3):
        _sort(colors[t, :, k], order)
        run = 0.0
        for place in order:
            run += weights[t, place]
            middle[k] = colors[t, place, k]
            if run >= 0.5 * total:
                break
    for _ in range(rounds):
        mean, whole = np.zeros(3), 0.0
        for one in range(most):
            off = 0.0
            for k in range(3):
                off += (colors[t, one, k] - middle[k]) ** 2
            trusted = weights[t, one] / (1.0 + scale * off) ** 2
            whole += trusted
            for k in range(3):
                mean[k] += trusted * colors[t, one, k]
        for k in range(3):
            middle[k] = mean[k] / whole
    for k in range(3):
        out[t, k] = middle[k]
