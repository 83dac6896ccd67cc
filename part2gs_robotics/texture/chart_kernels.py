"""Kernels of the charts: growing them over neighbours, and covering texels by faces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32, F64, I64
from part2gs_robotics.runtime.jit import inlined, kernel

INSIDE = 1e-3  # of a face's height: a texel that deep inside two faces is covered twice
EDGE = -1e-9  # of a face's height: a texel on the edge of two faces belongs to either


@kernel
def grow(normals: F64, areas: F64, beside: I64, order: I64, taken: NDArray[np.bool_], chart: I64,
         flat: float, steepest: float) -> F64:
    """Fill `chart` with groups of connected faces that turn towards one direction.

    Args:
        normals: [F, 3] unit, zero for faces without area; these join whatever is beside them.
        areas: [F] any unit.
        beside: [F, 3] neighbours, -1 = none.
        order: [F] in which faces may start a chart.
        taken: [F] faces left alone.
        chart: [F] result, -1 before; stays so where taken.
        flat: least cosine between the first face and those that tell the direction.
        steepest: least cosine between the direction and a face of the chart.

    Returns:
        [C, 3] unit direction of every chart.
    """
    count, total = 0, len(order)
    ways = np.zeros((total, 3))
    stack, mark = np.zeros(3 * total + 1, np.int64), np.full(total, -1, np.int64)
    for first in order:
        if taken[first] or chart[first] >= 0:
            continue
        dx, dy, dz = normals[first, 0], normals[first, 1], normals[first, 2]
        for told in range(2):  # what is flat tells the direction; then all that faces it
            least = flat if told == 0 else steepest
            mx, my, mz, top = 0.0, 0.0, 0.0, 1
            stack[0] = first
            mark[first] = 2 * count + told
            while top > 0:
                top -= 1
                face = stack[top]
                mx += areas[face] * normals[face, 0]  # a sum of arrays takes seconds to compile
                my += areas[face] * normals[face, 1]
                mz += areas[face] * normals[face, 2]
                if told == 1:
                    chart[face] = count
                for side in range(3):
                    other = beside[face, side]
                    if other < 0 or taken[other] or chart[other] >= 0:
                        continue
                    if mark[other] == 2 * count + told:
                        continue
                    x, y, z = normals[other, 0], normals[other, 1], normals[other, 2]
                    none = x == 0.0 and y == 0.0 and z == 0.0
                    if none or x * dx + y * dy + z * dz >= least:
                        mark[other] = 2 * count + told
                        stack[top] = other
                        top += 1
            if told == 0:
                dx, dy, dz = _unit(mx, my, mz)
        ways[count, 0], ways[count, 1], ways[count, 2] = dx, dy, dz
        count += 1
    return ways[:count]


@inlined
def _unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a vector of length 1, upwards where it had none."""
    length = np.sqrt(x * x + y * y + z * z)
    if length > 0.0:
        return x / length, y / length, z / length
    return 0.0, 0.0, 1.0


@inlined
def _depth_inside(face: F64, x: float, y: float) -> tuple[float, float, float]:
    """Return the barycentric coordinates of a point, -1 each where the face has no area."""
    ax, ay, bx, by, cx, cy = face[0, 0], face[0, 1], face[1, 0], face[1, 1], face[2, 0], face[2, 1]
    double = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if double == 0.0:
        return -1.0, -1.0, -1.0
    u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / double
    v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / double
    return u, v, 1.0 - u - v


@inlined
def _texels(a: float, b: float, c: float, count: int) -> tuple[int, int]:
    """Return the range of rows or columns of texels that a face's corners span."""
    return max(int(min(a, b, c)), 0), min(int(max(a, b, c)) + 1, count)


@kernel
def overlapping(flat: F64, size: I64) -> NDArray[np.bool_]:
    """Return [n] which faces of a chart cover a texel that an earlier face covers as well.

    Args:
        flat: [n, 3, 2] corners in texels.
        size: [2] columns and rows of texels.
    """
    count = len(flat)
    out = np.zeros(count, np.bool_)
    inside = np.zeros((size[1], size[0]), np.float32)
    for f in range(count):
        face = flat[f]
        left, right = _texels(face[0, 0], face[1, 0], face[2, 0], size[0])
        low, high = _texels(face[0, 1], face[1, 1], face[2, 1], size[1])
        for told in range(2):  # look, then take
            for j in range(low, high):
                for i in range(left, right):
                    u, v, w = _depth_inside(face, i + 0.5, j + 0.5)
                    deep = min(u, v, w)
                    if told == 0 and deep > INSIDE and inside[j, i] > INSIDE:
                        out[f] = True
                    if told == 1 and deep > inside[j, i]:
                        inside[j, i] = deep
            if out[f]:
                break
    return out


@kernel
def cover(placed: F64, owner: NDArray[np.int32], weights: F32) -> None:
    """Fill the face of every texel and its place in it.

    Args:
        placed: [F, 3, 2] corners in texels of the atlas.
        owner: [H, W] result, -1 before and where there is no face.
        weights: [H, W, 3] barycentric coordinates, result.
    """
    height, width = owner.shape
    for f in range(len(placed)):
        face = placed[f]
        left, right = _texels(face[0, 0], face[1, 0], face[2, 0], width)
        low, high = _texels(face[0, 1], face[1, 1], face[2, 1], height)
        for j in range(low, high):
            for i in range(left, right):
                u, v, w = _depth_inside(face, i + 0.5, j + 0.5)
                if owner[j, i] < 0 and min(u, v, w) >= EDGE:
                    owner[j, i] = f
                    weights[j, i, 0], weights[j, i, 1], weights[j, i, 2] = u, v, w
