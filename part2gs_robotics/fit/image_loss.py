"""Image losses with analytic gradients: L1 + D-SSIM of two images, in Numba."""

from __future__ import annotations

import math

import numpy as np
from numba import get_num_threads, get_thread_id
from numpy.typing import NDArray

from part2gs_robotics.runtime.buffers import Workspace
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel
from part2gs_robotics.runtime.simd import LANES, Lane, load, splat, store, total

Floats = NDArray[np.floating]
Box = tuple[slice, slice]

RADIUS, SIGMA = 5, 1.5  # 11 pixels across (Wang et al. 2004), as in 3DGS
C1, C2 = 0.01**2, 0.03**2  # for a colour range of 1
_WEIGHTS = [math.exp(-k * k / (2 * SIGMA**2)) for k in range(RADIUS + 1)]  # from the middle out
_SUM = _WEIGHTS[0] + 2 * sum(_WEIGHTS[1:])  # both sides of the middle: weights sum to 1
W0, W1, W2, W3, W4, W5 = (w / _SUM for w in _WEIGHTS)
PAD = LANES  # zeros before and after a row: more than RADIUS
MAPS, BY = 5, 3  # x, y, xx, yy, xy; derivatives of SSIM by the blurred x, xx, xy


def photometric(image: NDArray[np.floating], target: NDArray[np.floating],
                dssim_weight: float = 0.2, box: Box | None = None,
                workspace: Workspace | None = None) -> tuple[float, NDArray[np.floating]]:
    """Return (1 - w) L1 + w (1 - SSIM) of two images, and its gradient by the first.

    Args:
        image: [H, W, C] float32 or float64 in [0, 1].
        target: like image, constant.
        dssim_weight: w; 0.2 in 3DGS.
        box: rows and columns outside of which both are one constant; None = whole images. The
            window sees zeros outside of the box.
        workspace: buffers to use again; the gradient is then valid until the next call with it.

    Returns:
        The loss (mean over pixels and channels of the whole image) and its gradient [H, W, C].
    """
    work, dtype = workspace or Workspace(), image.dtype
    y0, y1, _ = (box or (slice(None), slice(None)))[0].indices(image.shape[0])
    x0, x1, _ = (box or (slice(None), slice(None)))[1].indices(image.shape[1])
    height, width, channels = y1 - y0, x1 - x0, image.shape[2]
    stride = -(-width // LANES) * LANES
    plane = (height + 2 * RADIUS) * stride
    blurred = work.take("ssim_blurred", (channels, MAPS, plane), dtype)
    by = work.take("ssim_by", (channels, BY, plane), dtype)
    rows = work.take("ssim_rows", (get_num_threads(), MAPS * (stride + 2 * PAD)), dtype)
    inside = work.take("ssim_inside", (stride,), dtype)
    sums = work.take("ssim_sums", (2, channels * height), np.float64)
    grad = work.take("ssim_grad", image.shape, dtype)
    inside[:width], inside[width:] = 1, 0
    grad[:], rows[:] = 0, 0
    weights = (1 - dssim_weight) / image.size, dssim_weight / image.size
    _blur_rows(image, target, y0, x0, height, width, rows, blurred)
    _compare(height, stride, inside, rows, blurred, by, sums[0])
    _combine(image, target, y0, x0, height, width, weights[0], weights[1], rows, by, grad, sums[1])
    similar = channels * height * width - float(sums[0].sum())
    return weights[0] * float(sums[1].sum()) + weights[1] * similar, grad


def psnr(image: NDArray[np.floating], target: NDArray[np.floating]) -> float:
    """Return the peak signal-to-noise ratio in dB of two images in [0, 1]."""
    error = float(np.mean((np.asarray(image, np.float64) - target) ** 2))
    return float(-10 * np.log10(max(error, 1e-12)))


@inlined
def _blur(values: Floats, at: np.uint64, step: np.uint64) -> Lane:
    """Weighted sum of eleven vectors `step` numbers apart, the middle one at a place."""
    f, two, three = values.dtype.type, np.uint64(2) * step, np.uint64(3) * step
    four, five = np.uint64(4) * step, np.uint64(5) * step
    return (load(values, at) * f(W0)
            + (load(values, at - step) + load(values, at + step)) * f(W1)
            + (load(values, at - two) + load(values, at + two)) * f(W2)
            + (load(values, at - three) + load(values, at + three)) * f(W3)
            + (load(values, at - four) + load(values, at + four)) * f(W4)
            + (load(values, at - five) + load(values, at + five)) * f(W5))


@inlined
def _clear_border(plane: Floats, y: int, height: int, stride: int) -> None:
    """Zero the rows above and below a plane, when at its first or last row."""
    if y == 0:
        plane[:RADIUS * stride] = 0
    if y == height - 1:
        plane[(RADIUS + height) * stride:] = 0


@inlined
def _blur_row(row: Floats, planes: Floats, y: int, height: int, stride: int, size: int) -> None:
    """Blur all maps of a row, `size` numbers each, into row y of their planes."""
    for m in range(len(planes)):
        _clear_border(planes[m], y, height, stride)
        for x in range(0, stride, LANES):
            store(planes[m], np.uint64((RADIUS + y) * stride + x),
                  _blur(row, np.uint64(m * size + PAD + x), np.uint64(1)))


@kernel
def _blur_rows(image: Floats, target: Floats, y0: int, x0: int, height: int, width: int,
               rows: Floats, blurred: Floats) -> None:
    """Blur x, y, xx, yy, xy along rows into planes [C, 5, (RADIUS + H + RADIUS) * stride]."""
    size = rows.shape[1] // MAPS
    stride = size - 2 * PAD
    for_each(image.shape[2] * height, _blur_rows_at, (image, target, y0, x0, height, width, rows,
                                                      blurred, size, stride))


@inlined
def _blur_rows_at(job: int, image: Floats, target: Floats, y0: int, x0: int, height: int,
                  width: int, rows: Floats, blurred: Floats, size: int, stride: int) -> None:
    c, y = job // height, job % height
    row = rows[get_thread_id()]
    for x in range(width):
        a, b = image[y0 + y, x0 + x, c], target[y0 + y, x0 + x, c]
        at = PAD + x
        row[at], row[at + size] = a, b
        row[at + 2 * size], row[at + 3 * size], row[at + 4 * size] = a * a, b * b, a * b
    _blur_row(row, blurred[c], y, height, stride, size)


@inlined
def _similarity(mx: Lane, my: Lane, xx: Lane, yy: Lane, xy: Lane, c1: Lane, c2: Lane, one: Lane,
               ) -> tuple[Lane, Lane, Lane, Lane]:
    """Return SSIM and its derivatives by the blurred x, x^2 and x y."""
    two, both, squares = one + one, mx * my, mx * mx + my * my
    top1, top2 = two * both + c1, two * (xy - both) + c2
    low1, low2 = squares + c1, xx + yy - squares + c2
    inv = one / (low1 * low2)
    s = top1 * top2 * inv
    by_xx = one - one - s / low2
    ratio = s / low1 + by_xx
    return s, two * (my * (top2 - top1) * inv - mx * ratio), by_xx, two * top1 * inv


@kernel
def _compare(height: int, stride: int, inside: Floats, rows: Floats, blurred: Floats, by: Floats,
             sums: Floats) -> None:
    """Blur the planes along columns; sum SSIM per row; blur its derivatives along rows."""
    step, size = np.uint64(stride), stride + 2 * PAD
    for_each(len(blurred) * height, _compare_at, (height, stride, inside, rows, blurred, by, sums,
                                                  step, size))


@inlined
def _compare_at(job: int, height: int, stride: int, inside: Floats, rows: Floats, blurred: Floats,
                by: Floats, sums: Floats, step: np.uint64, size: int) -> None:
    f = inside.dtype.type
    c, y = job // height, job % height
    row, found = rows[get_thread_id()], splat(f(0))
    for x in range(0, stride, LANES):
        at, to = np.uint64((RADIUS + y) * stride + x), np.uint64(PAD + x)
        s, by_mean, by_xx, by_xy = _similarity(
            _blur(blurred[c, 0], at, step), _blur(blurred[c, 1], at, step),
            _blur(blurred[c, 2], at, step), _blur(blurred[c, 3], at, step),
            _blur(blurred[c, 4], at, step), splat(f(C1)), splat(f(C2)), splat(f(1)))
        here = load(inside, np.uint64(x))
        found = found + s * here
        store(row, to, by_mean * here)
        store(row, to + np.uint64(size), by_xx * here)
        store(row, to + np.uint64(2 * size), by_xy * here)
    sums[job] = total(found)
    _blur_row(row, by[c], y, height, stride, size)


@kernel
def _combine(image: Floats, target: Floats, y0: int, x0: int, height: int, width: int, w_l1: float,
             w_ssim: float, rows: Floats, by: Floats, grad: Floats, sums: Floats) -> None:
    """Blur the derivatives along columns, fill the gradient, and sum |x - y| per row."""
    size = rows.shape[1] // MAPS
    stride = size - 2 * PAD
    for_each(image.shape[2] * height, _combine_at, (image, target, y0, x0, height, width, w_l1,
                                                    w_ssim, rows, by, grad, sums, size, stride))


@inlined
def _combine_at(job: int, image: Floats, target: Floats, y0: int, x0: int, height: int, width: int,
                w_l1: float, w_ssim: float, rows: Floats, by: Floats, grad: Floats, sums: Floats,
                size: int, stride: int) -> None:
    c, y = job // height, job % height
    row, found, step = rows[get_thread_id()], 0.0, np.uint64(stride)
    for m in range(BY):
        for x in range(0, stride, LANES):
            store(row, np.uint64(m * size + x),
                  _blur(by[c, m], np.uint64((RADIUS + y) * stride + x), step))
    for x in range(width):
        a, b = image[y0 + y, x0 + x, c], target[y0 + y, x0 + x, c]
        found += abs(a - b)
        sign = 1.0 if a > b else (-1.0 if a < b else 0.0)
        by_x = row[x] + 2 * a * row[size + x] + b * row[2 * size + x]
        grad[y0 + y, x0 + x, c] = w_l1 * sign - w_ssim * by_x
    sums[job] = found
