"""Numba kernel: carry screen-space gradients back to Gaussians, eight at a time."""

from __future__ import annotations

import numpy as np
from numba import get_thread_id
from numpy.typing import NDArray

from part2gs_robotics.render.ellipses import (
    Floats,
    Vec,
    columns,
    covariance,
    dot,
    jacobian_rows,
    mix,
    mul,
    put,
    rows_of,
    to_camera,
    unit,
    view_row,
)
from part2gs_robotics.render.project import BLOCKS
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel
from part2gs_robotics.runtime.simd import LANES, Lane, gather, root, splat, where_ge

GRADS = 10  # per intersection: moments of v (1, dx, dy, dx dx, dx dy, dy dy), r, g, b, z
SUMS = 16  # numbers between the summed gradients of two Gaussians of a block
RESULTS = LANES * SUMS  # where a block's results begin: means, quats, scales, norm on screen
CARRY_SIZE = RESULTS + 11 * LANES  # 3 + 4 + 3 + 1 rows of results


@inlined
def _sum_of(s: Floats, column: int) -> Lane:
    """One column of the summed gradients of a block."""
    return gather(s, np.uint64(0), np.uint64(LANES - 1), np.uint64(SUMS), np.uint64(column))


@inlined
def _ellipse_gradient(m0: Vec, m1: Vec, s: Floats) -> tuple[Lane, Lane, Lane, Lane, Lane]:
    """Gradients of the centre (2) and of the 2-D covariance (3) from the moments of v.

    v = dL/d(exponent) and the exponent is -0.5 d^T C^-1 d, so dL/dmean = C^-1 sum(v d) and
    dL/dC = 0.5 C^-1 sum(v d d^T) C^-1.
    """
    a, b, c, det = covariance(m0, m1)
    inv = 1.0 / det
    ka, kb, kc = c * inv, splat(0.0) - b * inv, a * inv
    gx, gy, gxx, gxy, gyy = (_sum_of(s, 1), _sum_of(s, 2), _sum_of(s, 3), _sum_of(s, 4),
                             _sum_of(s, 5))
    p, q, r, t = (ka * gxx + kb * gxy, ka * gxy + kb * gyy, kb * gxx + kc * gxy,
                  kb * gxy + kc * gyy)
    return (ka * gx + kb * gy, kb * gx + kc * gy,
            0.5 * (p * ka + q * kb), p * kb + q * kc, 0.5 * (r * kb + t * kc))


@inlined
def _quat_gradient(w: Lane, x: Lane, y: Lane, z: Lane, g0: Vec, g1: Vec, g2: Vec,
                   ) -> tuple[Lane, Lane, Lane, Lane]:
    """Gradient of the unit quaternion from the gradients of the rotation's columns."""
    dw = 2.0 * (z * (g0[1] - g1[0]) + y * (g2[0] - g0[2]) + x * (g1[2] - g2[1]))
    dx = 2.0 * (y * (g1[0] + g0[1]) + z * (g2[0] + g0[2]) + w * (g1[2] - g2[1])
                - 2.0 * x * (g1[1] + g2[2]))
    dy = 2.0 * (x * (g1[0] + g0[1]) + z * (g2[1] + g1[2]) + w * (g2[0] - g0[2])
                - 2.0 * y * (g0[0] + g2[2]))
    dz = 2.0 * (x * (g2[0] + g0[2]) + y * (g2[1] + g1[2]) + w * (g0[1] - g1[0])
                - 2.0 * z * (g0[0] + g1[1]))
    return dw, dx, dy, dz


@inlined
def _between(q: Lane, low: float, high: float, value: Lane) -> Lane:
    """Return value where low < q < high, else zero."""
    zero = splat(0.0)
    return where_ge(splat(low), q, zero, where_ge(q, splat(high), zero, value))


@inlined
def _camera_gradient(t: Vec, rx: Lane, ry: Lane, camera: Floats, view: Floats, du0: Vec,
                     du1: Vec, dmx: Lane, dmy: Lane, dz: Lane) -> Vec:
    """Gradient of the camera-space position."""
    inv_z = 1.0 / t[2]
    jx, jy = camera[0] * inv_z, camera[1] * inv_z
    w2 = view_row(view, 2)
    dj00, dj02 = dot(du0, view_row(view, 0)), dot(du0, w2)
    dj11, dj12 = dot(du1, view_row(view, 1)), dot(du1, w2)
    dz = dz + inv_z * (jx * (rx * dj02 - dj00) + jy * (ry * dj12 - dj11))
    # A clamped ratio is a constant: only the mean's own projection still moves with x or y.
    drx, dry = jx * t[2] * dmx, jy * t[2] * dmy
    qx, qy = t[0] * inv_z, t[1] * inv_z
    drx = drx - _between(qx, camera[4], camera[5], jx * dj02)
    dry = dry - _between(qy, camera[6], camera[7], jy * dj12)
    return (drx * inv_z, dry * inv_z, dz - inv_z * (drx * qx + dry * qy))


@inlined
def _carry_block(i: int, n: int, means: Floats, quats: Floats, scales: Floats, view: Floats,
                 camera: Floats, s: Floats) -> None:
    """Turn the summed gradients of Gaussians i to i + 7 in s into those of their parameters."""
    t = to_camera(view, rows_of(means, i, n))
    w, x, y, z, inv = unit(quats, i, n)
    c0, c1, c2 = columns(w, x, y, z)
    u0, u1, rx, ry = jacobian_rows(view, camera, t)
    scale = rows_of(scales, i, n)
    v0, v1 = (dot(u0, c0), dot(u0, c1), dot(u0, c2)), (dot(u1, c0), dot(u1, c1), dot(u1, c2))
    m0, m1 = mul(v0, scale), mul(v1, scale)
    dmx, dmy, da, db, dc = _ellipse_gradient(m0, m1, s)
    dm0, dm1 = mix(2.0 * da, m0, db, m1), mix(db, m0, 2.0 * dc, m1)
    dv0, dv1 = mul(dm0, scale), mul(dm1, scale)
    du0 = mix(splat(1.0), mix(dv0[0], c0, dv0[1], c1), dv0[2], c2)
    du1 = mix(splat(1.0), mix(dv1[0], c0, dv1[1], c1), dv1[2], c2)
    dt = _camera_gradient(t, rx, ry, camera, view, du0, du1, dmx, dmy, _sum_of(s, 9))
    dq = _quat_gradient(w, x, y, z, mix(dv0[0], u0, dv1[0], u1), mix(dv0[1], u0, dv1[1], u1),
                        mix(dv0[2], u0, dv1[2], u1))
    along = dq[0] * w + dq[1] * x + dq[2] * y + dq[3] * z
    _put_vec(s, 0, mix(splat(1.0), mix(dt[0], view_row(view, 0), dt[1], view_row(view, 1)), dt[2],
                       view_row(view, 2)))
    _put_result(s, 3, (dq[0] - along * w) * inv)
    _put_vec(s, 4, ((dq[1] - along * x) * inv, (dq[2] - along * y) * inv,
                    (dq[3] - along * z) * inv))
    _put_vec(s, 7, (dm0[0] * v0[0] + dm1[0] * v1[0], dm0[1] * v0[1] + dm1[1] * v1[1],
                    dm0[2] * v0[2] + dm1[2] * v1[2]))
    _put_result(s, 10, root(dmx * dmx + dmy * dmy))


@inlined
def _put_result(s: Floats, column: int, value: Lane) -> None:
    put(s, RESULTS // LANES + column, value)


@inlined
def _put_vec(s: Floats, column: int, value: Vec) -> None:
    _put_result(s, column, value[0])
    _put_result(s, column + 1, value[1])
    _put_result(s, column + 2, value[2])


@inlined
def _add_up(i: int, j: int, first: NDArray[np.int64], partial: Floats, d_extra: Floats, s: Floats,
            ) -> None:
    """Sum the rows of partial that belong to Gaussian i, in their order, into place j of s."""
    for c in range(SUMS):
        s[j * SUMS + c] = 0.0
    d_extra[i, :] = 0
    for k in range(first[i], first[i + 1]):
        for c in range(GRADS):
            s[j * SUMS + c] += partial[k, c]
        for c in range(d_extra.shape[1]):
            d_extra[i, c] += partial[k, GRADS + c]


@inlined
def _unpack(i: int, j: int, seen: bool, s: Floats, opacities: Floats, d_means: Floats,
            d_quats: Floats, d_scales: Floats, d_opacities: Floats, d_colors: Floats,
            d_screen: Floats) -> None:
    """Copy what lane j of a block holds to Gaussian i; zero where it is out of sight."""
    r = RESULTS + j
    for c in range(3):
        d_means[i, c] = s[r + c * LANES] if seen else 0.0
        d_scales[i, c] = s[r + (7 + c) * LANES] if seen else 0.0
        d_colors[i, c] = s[j * SUMS + 6 + c]
    for c in range(4):
        d_quats[i, c] = s[r + (3 + c) * LANES] if seen else 0.0
    d_opacities[i] = s[j * SUMS] / opacities[i] if seen else 0.0
    d_screen[i] = s[r + 10 * LANES] if seen else 0.0


@kernel
def carry_back(means: Floats, quats: Floats, scales: Floats, opacities: Floats, view: Floats,
               camera: Floats, first: NDArray[np.int64], partial: Floats, scratch: Floats,
               d_means: Floats, d_quats: Floats, d_scales: Floats, d_opacities: Floats,
               d_colors: Floats, d_extra: Floats, d_screen: Floats) -> None:
    """Sum each Gaussian's per-tile gradients in a fixed order, then carry them to its inputs.

    Rows first[i] to first[i + 1] of partial [M, 10 + C] are those of Gaussian i. scratch: float64,
    a row for every thread.
    """
    n, share = len(means), BLOCKS * LANES
    for_each((n + share - 1) // share, _carry_back_at, (means, quats, scales, opacities, view,
                                                        camera, first, partial, scratch, d_means,
                                                        d_quats, d_scales, d_opacities, d_colors,
                                                        d_extra, d_screen, n, share))


@inlined
def _carry_back_at(part: int, means: Floats, quats: Floats, scales: Floats, opacities: Floats,
                   view: Floats, camera: Floats, first: NDArray[np.int64], partial: Floats,
                   scratch: Floats, d_means: Floats, d_quats: Floats, d_scales: Floats,
                   d_opacities: Floats, d_colors: Floats, d_extra: Floats, d_screen: Floats,
                   n: int, share: int) -> None:
    s = scratch[get_thread_id()]
    for i in range(part * share, min((part + 1) * share, n), LANES):
        count = min(LANES, n - i)
        for j in range(count):
            _add_up(i + j, j, first, partial, d_extra, s)
        if first[i + count] > first[i]:
            _carry_block(i, n, means, quats, scales, view, camera, s)
        for j in range(count):
            _unpack(i + j, j, first[i + j + 1] > first[i + j], s, opacities, d_means, d_quats,
                    d_scales, d_opacities, d_colors, d_screen)
