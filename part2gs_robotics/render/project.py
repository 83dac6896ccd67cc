"""Numba kernel: Gaussians to screen-space ellipses and pixel boxes, eight at a time."""

from __future__ import annotations

import math

import numpy as np
from numba import get_thread_id
from numpy.typing import NDArray

from part2gs_robotics.render.ellipses import (
    Floats,
    clamp,
    columns,
    covariance,
    dot,
    jacobian_rows,
    mul,
    put,
    rows_of,
    to_camera,
    unit,
)
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel
from part2gs_robotics.runtime.simd import (
    LANES,
    Lane,
    ceiling,
    floor,
    gather,
    least,
    logarithm,
    most,
    root,
    splat,
    where_ge,
)

# A cache line: mx, my, a, b, c, log-opacity, bound, r, g, b, z, four numbers of the ellipse's rows.
PACKED = 16
FOV_MARGIN = 0.3  # of tan(fov / 2) outside the image where the Jacobian is frozen (3DGS: 1.3 x)
ALPHA_MAX = 0.99  # 3DGS: keeps 1 / (1 - alpha) bounded
ALPHA_MIN = 1.0 / 255.0  # 3DGS: one grey level
EXP_SCALE = 8.0  # exponents are stored divided by 8, see render_forward
BLOCKS = 32  # of eight Gaussians that a thread takes at once
BOX = PACKED  # first of four columns of a block's results after those of packed, then visibility
PROJECT_SIZE = (PACKED + 5) * LANES  # packed, box and visibility


@inlined
def _put_range(s: Floats, column: int, center: Lane, extent: Lane, size: int) -> None:
    """Pixels whose centre lies within extent of center, clipped to the image."""
    # 0.01 px covers the rounding of float32; the kernels test alpha itself.
    put(s, column, clamp(ceiling(center - extent - 0.51), 0.0, float(size)))
    put(s, column + 2, clamp(floor(center + extent - 0.49) + 1.0, 0.0, float(size)))


@inlined
def _project_block(i: int, n: int, means: Floats, quats: Floats, scales: Floats, opacities: Floats,
                   view: Floats, camera: Floats, width: int, height: int, s: Floats) -> None:
    """Write the ellipses and pixel boxes of Gaussians i to i + 7 to s, column by column."""
    opacity = gather(opacities, np.uint64(i), np.uint64(n - 1), np.uint64(1), np.uint64(0))
    t = to_camera(view, rows_of(means, i, n))
    w, x, y, z, inv = unit(quats, i, n)
    c0, c1, c2 = columns(w, x, y, z)
    u0, u1, _, _ = jacobian_rows(view, camera, t)
    scale = rows_of(scales, i, n)
    a, b, c, det = covariance(mul((dot(u0, c0), dot(u0, c1), dot(u0, c2)), scale),
                               mul((dot(u1, c0), dot(u1, c1), dot(u1, c2)), scale))
    mx, my = camera[0] * t[0] / t[2] + camera[2], camera[1] * t[1] / t[2] + camera[3]
    log_opacity = logarithm(most(opacity, splat(ALPHA_MIN)))
    level = (log_opacity - math.log(ALPHA_MIN)) * 2.0
    down, extent_y = -1.0 / (EXP_SCALE * det), root(level * c)
    put(s, 0, mx)
    put(s, 1, my)
    put(s, 2, 0.5 * c * down)
    put(s, 3, splat(0.0) - b * down)
    put(s, 4, 0.5 * a * down)
    put(s, 5, log_opacity / EXP_SCALE)
    put(s, 6, least(log_opacity, splat(math.log(ALPHA_MAX))) / EXP_SCALE)
    put(s, 10, t[2])
    # The ellipse for tiles.py: x of its top, slope B / A, its squared half height at x = 0 and what
    # x^2 takes off that.
    put(s, 11, b / c * extent_y)
    put(s, 12, b / a)
    put(s, 13, det / a * level)
    put(s, 14, det / (a * a))
    _put_range(s, BOX, mx, root(level * a), width)
    _put_range(s, BOX + 1, my, extent_y, height)
    # What is not finite turns its difference with itself, so the sum, into NaN.
    finite = (mx - mx) + (my - my) + (det - det) + (inv - inv) + (opacity - opacity)
    seen = where_ge(finite, splat(0.0), splat(1.0), splat(0.0))
    seen = where_ge(splat(camera[8]), t[2], splat(0.0), seen)
    put(s, BOX + 4, where_ge(splat(ALPHA_MIN), opacity, splat(0.0), seen))


@inlined
def _pack(i: int, j: int, s: Floats, colors: Floats, extra: Floats, packed: Floats,
          boxes: NDArray[np.int32], visible: NDArray[np.bool_]) -> None:
    """Copy what lane j of a block holds to Gaussian i."""
    for k in range(15):
        packed[i, k] = s[k * LANES + j]
    total = 0.0
    for k in range(3):
        packed[i, 7 + k] = colors[i, k]
        total += colors[i, k]
    for k in range(extra.shape[1]):
        total += extra[i, k]
    visible[i] = s[(BOX + 4) * LANES + j] > 0 and math.isfinite(total)
    if visible[i]:
        for k in range(4):
            boxes[i, k] = int(s[(BOX + k) * LANES + j])
        visible[i] = boxes[i, 2] > boxes[i, 0] and boxes[i, 3] > boxes[i, 1]


@kernel
def project(means: Floats, quats: Floats, scales: Floats, opacities: Floats, colors: Floats,
            extra: Floats, view: Floats, camera: Floats, width: int, height: int, scratch: Floats,
            packed: Floats, boxes: NDArray[np.int32], visible: NDArray[np.bool_]) -> None:
    """Fill packed [N, 16], pixel boxes [N, 4] (x0, y0, x1, y1) and the visible mask [N].

    camera: fx, fy, cx, cy, min x/z, max x/z, min y/z, max y/z, near. scratch: float64, a row for
    every thread.
    """
    n, share = len(means), BLOCKS * LANES
    for_each((n + share - 1) // share, _project_at, (means, quats, scales, opacities, colors, extra,
                                                     view, camera, width, height, scratch, packed,
                                                     boxes, visible, n, share))


@inlined
def _project_at(part: int, means: Floats, quats: Floats, scales: Floats, opacities: Floats,
                colors: Floats, extra: Floats, view: Floats, camera: Floats, width: int,
                height: int, scratch: Floats, packed: Floats, boxes: NDArray[np.int32],
                visible: NDArray[np.bool_], n: int, share: int) -> None:
    s = scratch[get_thread_id()]
    for i in range(part * share, min((part + 1) * share, n), LANES):
        _project_block(i, n, means, quats, scales, opacities, view, camera, width, height, s)
        for j in range(min(LANES, n - i)):
            _pack(i + j, j, s, colors, extra, packed, boxes, visible)
