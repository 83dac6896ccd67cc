"""Numba kernels of depth smoothness: second differences along rows, then along columns."""

from __future__ import annotations

import numpy as np
from numba import get_thread_id
from numpy.typing import NDArray

from part2gs_robotics.runtime.fast_math import log_above_one, power8
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel
from part2gs_robotics.runtime.simd import LANES, Lane, load, most, splat, store, total, where_ge

Floats = NDArray[np.floating]

SPANS = (1, 2, 4, 8, 16)  # pixels: short ones calm noise, long ones carry the outline in
EDGE = 0.08  # of the colour range, summed along a span: there a bend costs a third
END = 5 * EDGE  # e^-5: a bend across that much edge counts for nothing
GAP = 1.0  # edge between two pixels one of which has no depth: above END
DEAD = 0.012  # of the colour range per pixel: three grey levels of noise are no edge
SOFT = 0.02  # of the diagonal: beyond, a bend is more likely a real jump and pulls less
SOLID = 0.5  # rendered alpha from which a pixel has a depth
COVERED = 0.98  # photo's alpha from which a pixel shows the object alone
PAD = max(SPANS)  # pixels without depth around the box
STRIP = 2 * LANES  # columns that one job takes: its bends of all rows stay in cache


@inlined
def _step(photo: NDArray[np.generic], y: int, x: int, v: int, u: int, range_of: float) -> float:
    """Edge between two pixels of the photo: the largest change of a channel, above the noise."""
    largest = 0.0
    for c in range(3):
        largest = max(largest, abs(float(photo[y, x, c]) - float(photo[v, u, c])))
    return max(largest / range_of - DEAD, 0.0)


@inlined
def _pull(before: Lane, here: Lane, after: Lane, edge: Lane, size: Lane, s: Floats,
          ) -> tuple[Lane, Lane]:
    """Return one span's losses and their slopes by the second difference."""
    f = s.dtype.type
    zero, one = splat(f(0)), splat(f(1))
    weight = where_ge(splat(f(END)), edge, power8(edge * f(-0.125 / EDGE)) * f(SOFT), zero)
    bend = (before - here - here + after) * size
    bent = one + most(bend, zero - bend)
    sign = where_ge(zero, bend, where_ge(bend, zero, zero, zero - one), one)
    return weight * log_above_one(bent), weight * sign * size / bent


@inlined
def _bends(inverse: Floats, size: Floats, at: int, edges: Floats, pulls: Floats, place: int,
           step: int, span: int) -> Lane:
    """Fill eight pulls of one span, `step` numbers apart in inverse; return their losses.

    inverse and size are read at `at`, edges and pulls at `place`; in edges a span is as far as in
    pulls, span * edge_step, which is 1 along rows and STRIP along columns.
    """
    edge_step = 1 if step == 1 else STRIP
    edge = (load(edges, np.uint64(place + span * edge_step))
            - load(edges, np.uint64(place - span * edge_step)))
    loss, pull = _pull(load(inverse, np.uint64(at - span * step)), load(inverse, np.uint64(at)),
                       load(inverse, np.uint64(at + span * step)), edge,
                       load(size, np.uint64(at)), edges)
    store(pulls, np.uint64(place), pull)
    return loss


@inlined
def _spread(pulls: Floats, place: int, reach: int) -> Lane:
    """Gradient that the pulls around a place give it: +1, -2, +1."""
    here = load(pulls, np.uint64(place))
    return (load(pulls, np.uint64(place - reach)) - here - here
            + load(pulls, np.uint64(place + reach)))


@inlined
def _fill_row(depth: Floats, alpha: Floats, photo: NDArray[np.generic], mask: Floats, v: int,
              x0: int, width: int, diagonal: float, range_of: float, inverse: Floats, size: Floats,
              edges: Floats) -> None:
    """Set a row's inverse depth, what turns a bend into diagonals, and running edges."""
    inverse[:], size[:] = 0, 0
    edges[:PAD] = -GAP
    running = 0.0
    for x in range(width):
        u = x0 + x
        solid = mask[v, u] > COVERED and alpha[v, u] > SOLID and depth[v, u] > 0
        if solid:
            d = depth[v, u] / alpha[v, u]
            inverse[PAD + x], size[PAD + x] = 1 / d, d * d / (diagonal * SOFT)
        if x > 0:
            gap = not solid or inverse[PAD + x - 1] == 0
            running += GAP if gap else _step(photo, v, u, v, u - 1, range_of)
        edges[PAD + x] = running
    edges[PAD + width:] = running + GAP


@kernel
def along_rows(depth: Floats, alpha: Floats, photo: NDArray[np.generic], mask: Floats, y0: int,
               x0: int, width: int, diagonal: float, range_of: float, inverse: Floats,
               size: Floats, grad: Floats, scratch: Floats, losses: Floats) -> None:
    """Fill inverse depths, sizes, and the gradient by inverse depth of bends along rows."""
    height, stride = inverse.shape
    for_each(height, _along_rows_at, (depth, alpha, photo, mask, y0, x0, width, diagonal, range_of,
                                      inverse, size, grad, scratch, losses, stride))


@inlined
def _along_rows_at(y: int, depth: Floats, alpha: Floats, photo: NDArray[np.generic], mask: Floats,
                   y0: int, x0: int, width: int, diagonal: float, range_of: float, inverse: Floats,
                   size: Floats, grad: Floats, scratch: Floats, losses: Floats,
                   stride: int) -> None:
    s = scratch[get_thread_id()]
    edges, pulls = s[:stride], s[stride:2 * stride]
    _fill_row(depth, alpha, photo, mask, y0 + y, x0, width, diagonal, range_of, inverse[y],
              size[y], edges)
    grad[y, :], pulls[:] = 0, 0
    loss = splat(s.dtype.type(0))
    for span in SPANS:
        for x in range(PAD, stride - PAD, LANES):
            loss = loss + _bends(inverse[y], size[y], x, edges, pulls, x, 1, span)
        for x in range(PAD, stride - PAD, LANES):
            store(grad[y], np.uint64(x), load(grad[y], np.uint64(x)) + _spread(pulls, x, span))
    losses[y] = total(loss)


@inlined
def _fill_column(photo: NDArray[np.generic], inverse: Floats, y0: int, u: int, x: int, k: int,
                 inside: bool, range_of: float, edges: Floats) -> None:
    """Set the running edges of column k of a strip."""
    height, running = len(inverse), 0.0
    for y in range(PAD):
        edges[y * STRIP + k] = -GAP
    for y in range(height):
        if y > 0 and inside:
            gap = inverse[y, x] == 0 or inverse[y - 1, x] == 0
            running += GAP if gap else _step(photo, y0 + y, u, y0 + y - 1, u, range_of)
        edges[(PAD + y) * STRIP + k] = running
    for y in range(PAD + height, 2 * PAD + height):
        edges[y * STRIP + k] = running + GAP


@inlined
def _write(depth: Floats, alpha: Floats, y0: int, x0: int, width: int, left: int, scale: float,
           inverse: Floats, grad: Floats, by_depth: Floats, by_alpha: Floats) -> None:
    """Carry a strip's gradient by inverse depth, alpha / depth, to both."""
    for y in range(len(inverse)):
        for x in range(left, min(left + STRIP, width)):
            if inverse[y, PAD + x] > 0:
                v, u = y0 + y, x0 + x
                slope = scale * grad[y, PAD + x] / depth[v, u]
                by_alpha[v, u], by_depth[v, u] = slope, -slope * alpha[v, u] / depth[v, u]


@kernel
def along_columns(depth: Floats, alpha: Floats, photo: NDArray[np.generic], y0: int, x0: int,
                  width: int, range_of: float, scale: float, inverse: Floats, size: Floats,
                  grad: Floats, scratch: Floats, by_depth: Floats, by_alpha: Floats,
                  losses: Floats) -> None:
    """Add the gradient of bends along columns, then write both images of gradients."""
    height, stride = inverse.shape
    whole, sizes, grads = inverse.reshape(-1), size.reshape(-1), grad.reshape(-1)
    length = (height + 2 * PAD) * STRIP
    for_each((stride - 2 * PAD) // STRIP, _along_columns_at, (depth, alpha, photo, y0, x0, width,
                                                              range_of, scale, inverse, grad,
                                                              scratch, by_depth, by_alpha, losses,
                                                              height, stride, whole, sizes, grads,
                                                              length))


@inlined
def _along_columns_at(strip: int, depth: Floats, alpha: Floats, photo: NDArray[np.generic], y0: int,
                      x0: int, width: int, range_of: float, scale: float, inverse: Floats,
                      grad: Floats, scratch: Floats, by_depth: Floats, by_alpha: Floats,
                      losses: Floats, height: int, stride: int, whole: Floats, sizes: Floats,
                      grads: Floats, length: int) -> None:
    s = scratch[get_thread_id()]
    edges, pulls, left = s[:length], s[length:2 * length], strip * STRIP
    for k in range(STRIP):
        x = left + k
        _fill_column(photo, inverse, y0, x0 + x, PAD + x, k, x < width, range_of, edges)
    loss = splat(s.dtype.type(0))
    for span in SPANS:
        pulls[:] = 0  # the first and last `span` rows have none
        for y in range(span, height - span):
            for k in range(0, STRIP, LANES):
                loss = loss + _bends(whole, sizes, y * stride + PAD + left + k, edges, pulls,
                                     (PAD + y) * STRIP + k, stride, span)
        for y in range(height):
            for k in range(0, STRIP, LANES):
                at = np.uint64(y * stride + PAD + left + k)
                store(grads, at, load(grads, at)
                      + _spread(pulls, (PAD + y) * STRIP + k, span * STRIP))
    losses[height + strip] = total(loss)
    _write(depth, alpha, y0, x0, width, left, scale, inverse, grad, by_depth, by_alpha)
