"""Kernels of the multi-view stereo: matching cost, and its aggregation along image paths."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel
from part2gs_robotics.runtime.simd import LANES, Lane, least, load, most, store

TRUNCATED = 0.15  # of the colour range: beyond, a view sees something else, however much
SMALL_STEP = 0.008  # of the colour range, for a step to the next depth
BIG_STEP = 0.12  # for any depth step: nearly as much as a view that disagrees
EDGE = 0.05  # colour step at which a big depth step costs a third
STEEP = 6  # depths between neighbours beyond which the hull itself has an edge
UNREACHABLE = 1e6  # far above any sum of costs of at most 2 TRUNCATED each


@inlined
def _inside(values: F32, x: float, y: float, z: float) -> bool:
    i, j, k = int(x + 0.5), int(y + 0.5), int(z + 0.5)
    if x < 0.0 or y < 0.0 or z < 0.0:
        return False
    if i >= values.shape[0] or j >= values.shape[1] or k >= values.shape[2]:
        return False
    return bool(values[i, j, k] > 0.0)


@kernel
def hull_span(values: F32, eye: F64, rays: F64, mask: NDArray[np.bool_], near: float, far: float,
              step: float, first: F32, last: F32) -> None:
    """Fill the first and last depth at which every pixel's ray is inside a grid.

    Args:
        values: [X, Y, Z] positive inside.
        eye: [3] camera centre, voxel units.
        rays: [H, W, 3] per unit of depth, voxel units.
        mask: [H, W] pixels to look at.
        near: least depth to look at.
        far: greatest depth.
        step: between the depths looked at.
        first: [H, W] result, 0 where the ray misses.
        last: [H, W] result, likewise.
    """
    height, width = mask.shape
    count = int((far - near) / step) + 1
    for_each(height, _hull_span_at, (values, eye, rays, mask, near, far, step, first, last, width,
                                     count))


@inlined
def _hull_span_at(i: int, values: F32, eye: F64, rays: F64, mask: NDArray[np.bool_], near: float,
                  far: float, step: float, first: F32, last: F32, width: int, count: int) -> None:
    for j in range(width):
        if not mask[i, j]:
            continue
        dx, dy, dz = rays[i, j, 0], rays[i, j, 1], rays[i, j, 2]
        for n in range(count):
            t = near + n * step
            if _inside(values, eye[0] + t * dx, eye[1] + t * dy, eye[2] + t * dz):
                first[i, j] = t
                break
        if first[i, j] == 0.0:
            continue
        for n in range(count):
            t = far - n * step
            if _inside(values, eye[0] + t * dx, eye[1] + t * dy, eye[2] + t * dz):
                last[i, j] = t
                break


@inlined
def _difference(others: F32, n: int, u: float, v: float, r: float, g: float, b: float) -> float:
    """Return the mean colour difference to image n at a place, TRUNCATED outside of it."""
    if not (u >= 0.0 and v >= 0.0 and u < others.shape[2] - 1 and v < others.shape[1] - 1):
        return TRUNCATED
    i, j = int(v), int(u)
    fv, fu = v - i, u - j
    w00, w01, w10, w11 = (1 - fu) * (1 - fv), fu * (1 - fv), (1 - fu) * fv, fu * fv
    total = 0.0
    for c, mine in ((0, r), (1, g), (2, b)):
        theirs = (w00 * others[n, i, j, c] + w01 * others[n, i, j + 1, c]
                  + w10 * others[n, i + 1, j, c] + w11 * others[n, i + 1, j + 1, c])
        total += abs(theirs - mine)
    return total / 3.0 if total < 3.0 * TRUNCATED else TRUNCATED


@inlined
def _between(first: float, last: float, inverse: F64) -> tuple[int, int]:
    """Return the bins, from one on to before another, of depths between two; none: both alike."""
    low, high = 0, 0
    for k in range(len(inverse)):
        z = 1.0 / inverse[k]
        if first <= z <= last:
            low, high = k if high == 0 else low, k + 1
    return low, high


@inlined
def _look(r: float, g: float, b: float, places: F64, cams: F64, others: F32, n: int, low: int,
          high: int, seen: F32, at: int) -> None:
    """Fill the differences of a colour to image n at places low to high, from `at` on."""
    m00, m01, m02, m03 = cams[n, 0, 0], cams[n, 0, 1], cams[n, 0, 2], cams[n, 0, 3]
    m10, m11, m12, m13 = cams[n, 1, 0], cams[n, 1, 1], cams[n, 1, 2], cams[n, 1, 3]
    m20, m21, m22, m23 = cams[n, 2, 0], cams[n, 2, 1], cams[n, 2, 2], cams[n, 2, 3]
    for k in range(low, high):
        x, y, z = places[0, k], places[1, k], places[2, k]
        w = m20 * x + m21 * y + m22 * z + m23
        u = (m00 * x + m01 * y + m02 * z + m03) / w - 0.5
        v = (m10 * x + m11 * y + m12 * z + m13) / w - 0.5
        seen[at + k] = _difference(others, n, u, v, r, g, b)


@inlined
def _sum(seen: F32, at: np.uint64, size: np.uint64, used: int) -> Lane:
    """Return the sum of `used` rows from a place on, by four sums side by side and the rest."""
    whole, rest = load(seen, at), 1
    if used >= 4:
        one, two = load(seen, at + size), load(seen, at + np.uint64(2) * size)
        three = load(seen, at + np.uint64(3) * size)
        rest = used // 4 * 4
        for n in range(4, rest, 4):
            whole = whole + load(seen, at + np.uint64(n) * size)
            one = one + load(seen, at + np.uint64(n + 1) * size)
            two = two + load(seen, at + np.uint64(n + 2) * size)
            three = three + load(seen, at + np.uint64(n + 3) * size)
        whole = (whole + two) + (one + three)
    for n in range(rest, used):
        whole = whole + load(seen, at + np.uint64(n) * size)
    return whole


@inlined
def _least_first(seen: F32, count: int, size: int, used: int, low: int, high: int) -> None:
    """Put into the first of `count` rows of `size` the sum of the `used` least, least first."""
    for b in range(low // LANES * LANES, high, LANES):
        at = np.uint64(b)
        for one in range(used):
            here = np.uint64(one * size) + at
            x = load(seen, here)
            for two in range(one + 1, count):
                there = np.uint64(two * size) + at
                y = load(seen, there)
                store(seen, there, most(x, y))
                x = least(x, y)
            store(seen, here, x)
        store(seen, at, _sum(seen, at, np.uint64(size), used))


@kernel
def matching_cost(image: F32, first: F32, last: F32, inverse: F64, rays: F64, cams: F64,
                  others: F32, used: int, front: float, cost: F32) -> None:
    """Fill the colour disagreement of every pixel at every depth between first and last.

    Args:
        image: [H, W, 3] of the view.
        first: [H, W] depth at which the ray enters the hull.
        last: [H, W] depth at which it leaves.
        inverse: [D] inverse depths, falling.
        rays: [H, W, 2] camera x and y per unit of depth.
        cams: [N, 3, 4] pixels of the other views from this camera's frame.
        others: [N, H', W', 3] images of the other views.
        used: so many of the best views count; the rest may be blocked.
        front: cost per bin behind the hull, which decides where no colour does.
        cost: [H, W, D] result.
    """
    height, width, bins = cost.shape
    size = (bins + LANES - 1) // LANES * LANES
    for_each(height, _matching_cost_at, (image, first, last, inverse, rays, cams, others, used,
                                         front, cost, width, bins, size))


@inlined
def _matching_cost_at(i: int, image: F32, first: F32, last: F32, inverse: F64, rays: F64, cams: F64,
                      others: F32, used: int, front: float, cost: F32, width: int, bins: int,
                      size: int) -> None:
    seen, places = np.zeros(len(cams) * size, np.float32), np.zeros((3, bins))
    for j in range(width):
        low, high = _between(first[i, j], last[i, j], inverse)
        cost[i, j, :low], cost[i, j, high:] = 2 * TRUNCATED, 2 * TRUNCATED
        if low == high:
            continue
        for k in range(low, high):
            z = 1.0 / inverse[k]
            places[0, k], places[1, k], places[2, k] = rays[i, j, 0] * z, rays[i, j, 1] * z, z
        r, g, b = image[i, j, 0], image[i, j, 1], image[i, j, 2]
        for n in range(len(cams)):
            _look(r, g, b, places, cams, others, n, low, high, seen, n * size)
        _least_first(seen, len(cams), size, used, low, high)
        for k in range(low, high):
            behind = (1.0 / first[i, j] - inverse[k]) / (inverse[0] - inverse[1])
            cost[i, j, k] = seen[k] / used + front * max(behind, 0.0)


@inlined
def _advance(before: F32, cost: F32, big: np.float32, shift: int, least: np.float32, here: F32,
             total: F32) -> None:
    """Go on by one pixel: each bin is reached level, along the hull, by one bin or by any step.

    Args:
        before: [D + 2 STEEP] costs of the pixel before, unreachable at both ends.
        cost: [D] of this pixel.
        big: price of any step.
        shift: bins by which the hull's front moves from pixel to pixel.
        least: of `before`.
        here: [D + 2 STEEP] result.
        total: [D] is added to.
    """
    small, floor = np.float32(SMALL_STEP), least + big
    for k in range(len(cost)):
        p = k + STEEP
        left, right = before[p - 1], before[p + 1]
        side = (left if left < right else right) + small
        best = before[p] if before[p] < floor else floor
        best = side if side < best else best
        along = before[p - shift]
        best = along if along < best else best
        here[p] = cost[k] - least + best
        total[k] += here[p]


@inlined
def _smallest(values: F32) -> np.float32:
    """Return the least of some numbers; Numba's own takes a second to compile."""
    found = values[0]
    for k in range(len(values)):
        found = values[k] if values[k] < found else found
    return found


@inlined
def _walk(line: int, cost: F32, total: F32, image: F32, mask: NDArray[np.bool_], front: F32,
          dy: int, dx: int) -> None:
    """Add the aggregated cost along one path of direction (dy, dx)."""
    height, width, bins = cost.shape
    if line < height:
        if dx == 0:
            return
        y, x = int(line), 0 if dx > 0 else width - 1
    else:
        y, x = 0 if dy > 0 else height - 1, int(line) - height
        if dy == 0 or (dx > 0 and x == 0) or (dx < 0 and x == width - 1):
            return
    # Unreachable bins at both ends, so that a step beyond the depths needs no test in the loop.
    before = np.full(bins + 2 * STEEP, UNREACHABLE, np.float32)
    here = np.full(bins + 2 * STEEP, UNREACHABLE, np.float32)
    start, least = True, np.float32(0.0)
    while y >= 0 and y < height and x >= 0 and x < width:
        if not mask[y, x]:
            start = True
        else:
            if start:
                for k in range(bins):
                    here[STEEP + k] = cost[y, x, k]
                    total[y, x, k] += cost[y, x, k]
            else:
                edge, py, px = 0.0, y - dy, x - dx
                for c in range(3):
                    edge = max(edge, abs(image[y, x, c] - image[py, px, c]))
                big = max(2 * SMALL_STEP, BIG_STEP * np.exp(-edge / EDGE))
                slope = front[y, x] - front[py, px]
                shift = int(slope) if abs(slope) < STEEP else 0
                _advance(before, cost[y, x], np.float32(big), shift, least, here, total[y, x])
            start, least = False, _smallest(here)
            before, here = here, before
        y, x = y + dy, x + dx


@kernel
def aggregate(cost: F32, total: F32, image: F32, mask: NDArray[np.bool_], front: F32, dy: int,
              dx: int) -> None:
    """Add to `total` the cost of the best depth profile along all paths of one direction.

    Args:
        cost: [H, W, D].
        total: [H, W, D], summed over directions.
        image: [H, W, 3]; a colour step makes a depth step cheap.
        mask: [H, W] pixels of the object.
        front: [H, W] bin of the hull's front, whole numbers; following its slope costs nothing.
        dy: direction along rows, -1, 0 or 1.
        dx: direction along columns, likewise.

    Source: semi-global matching (Hirschmüller 2008) with the hull as slope prior (as in
    Scharstein et al. 2017).
    """
    for_each(cost.shape[0] + cost.shape[1], _walk, (cost, total, image, mask, front, dy, dx))
