"""Numba kernels: Gaussians to screen-space ellipses, forward and backward.

Source: EWA splatting (Zwicker 2001) as in 3D Gaussian Splatting (Kerbl 2023, eq. 5): the 2-D
covariance is J W Sigma W^T J^T + 0.3 I. With M = J W R S it is M M^T + 0.3 I, and its determinant
is |M0 x M1|^2 + 0.3 tr(M M^T) + 0.09: a sum of positive terms, exact for needle shapes too.
Scalars are float64 whatever the arrays hold: it costs nothing here.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange
from numpy.typing import NDArray

from part2gs_robotics.render_jit import inlined, parallel_kernel

Floats = NDArray[np.floating]
Vec = tuple[float, float, float]

PACKED = 12  # mx, my, a, b, c, log-opacity, upper bound, r, g, b, z, x of the ellipse's top
GRADS = 10  # per intersection: moments of v (1, dx, dy, dx dx, dx dy, dy dy), r, g, b, z
LOW_PASS = 0.3  # pixels^2 added to the 2-D covariance (3DGS)
FOV_MARGIN = 0.3  # of tan(fov / 2) outside the image where the Jacobian is frozen (3DGS: 1.3 x)
ALPHA_MAX = 0.99  # 3DGS: keeps 1 / (1 - alpha) bounded
ALPHA_MIN = 1.0 / 255.0  # 3DGS: one grey level
EXP_SCALE = 8.0  # exponents are stored divided by 8, see render_kernels


@inlined
def _dot(a: Vec, b: Vec) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _cross(a: Vec, b: Vec) -> Vec:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inlined
def _mul(a: Vec, b: Vec) -> Vec:
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


@inlined
def _mix(s: float, a: Vec, t: float, b: Vec) -> Vec:
    return (s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2])


@inlined
def _row(array: Floats, i: int) -> Vec:
    return (np.float64(array[i, 0]), np.float64(array[i, 1]), np.float64(array[i, 2]))


@inlined
def _unit(quats: Floats, i: int) -> tuple[float, float, float, float, float]:
    """Return the normalised quaternion and the inverse of its norm (infinite for a zero one)."""
    w, (x, y, z) = np.float64(quats[i, 0]), _row(quats[:, 1:], i)
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    inv = 1 / norm if norm > 0 else math.inf
    return w * inv, x * inv, y * inv, z * inv, inv


@inlined
def _columns(w: float, x: float, y: float, z: float) -> tuple[Vec, Vec, Vec]:
    """Columns of the rotation matrix of a unit quaternion."""
    c0 = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    c1 = (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x))
    c2 = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    return c0, c1, c2


@inlined
def _quat_gradient(w: float, x: float, y: float, z: float, g0: Vec, g1: Vec, g2: Vec
                   ) -> tuple[float, float, float, float]:
    """Gradient of the unit quaternion from the gradients of the rotation's columns."""
    dw = 2 * (z * (g0[1] - g1[0]) + y * (g2[0] - g0[2]) + x * (g1[2] - g2[1]))
    dx = 2 * (y * (g1[0] + g0[1]) + z * (g2[0] + g0[2]) + w * (g1[2] - g2[1])
              - 2 * x * (g1[1] + g2[2]))
    dy = 2 * (x * (g1[0] + g0[1]) + z * (g2[1] + g1[2]) + w * (g2[0] - g0[2])
              - 2 * y * (g0[0] + g2[2]))
    dz = 2 * (x * (g2[0] + g0[2]) + y * (g2[1] + g1[2]) + w * (g0[1] - g1[0])
              - 2 * z * (g0[0] + g1[1]))
    return dw, dx, dy, dz


@inlined
def _clamp(value: float, low: float, high: float) -> float:
    return max(low, min(value, high))


@inlined
def _to_camera(view: Floats, p: Vec) -> Vec:
    return (_dot(_row(view, 0), p) + view[0, 3], _dot(_row(view, 1), p) + view[1, 3],
            _dot(_row(view, 2), p) + view[2, 3])


@inlined
def _jacobian_rows(view: Floats, camera: Floats, t: Vec) -> tuple[Vec, Vec, float, float]:
    """Rows of J W and the clamped ratios x/z, y/z. Source: 3DGS eq. 5."""
    inv_z = 1 / t[2]
    rx = _clamp(t[0] * inv_z, camera[4], camera[5])
    ry = _clamp(t[1] * inv_z, camera[6], camera[7])
    jx = camera[0] * inv_z
    jy = camera[1] * inv_z
    return (_mix(jx, _row(view, 0), -jx * rx, _row(view, 2)),
            _mix(jy, _row(view, 1), -jy * ry, _row(view, 2)), rx, ry)


@inlined
def _pixel_range(center: float, extent: float, size: int) -> tuple[int, int]:
    """Pixels whose centre lies within extent of center, clipped to the image."""
    # 0.01 px covers the rounding of float32; the kernels test alpha itself.
    low = _clamp(math.ceil(center - extent - 0.51), 0.0, float(size))
    high = _clamp(math.floor(center + extent - 0.49) + 1, 0.0, float(size))
    return int(low), int(high)


@inlined
def _project_one(i: int, means: Floats, quats: Floats, scales: Floats, opacity: float,
                 view: Floats, camera: Floats, width: int, height: int, packed: Floats,
                 box: NDArray[np.int32]) -> bool:
    """Write one Gaussian's ellipse and pixel box; False if it cannot be seen."""
    t = _to_camera(view, _row(means, i))
    w, x, y, z, inv = _unit(quats, i)
    # Written so that any NaN makes it False.
    if not (t[2] > camera[8] and opacity > ALPHA_MIN and math.isfinite(inv)):
        return False
    c0, c1, c2 = _columns(w, x, y, z)
    u0, u1, _, _ = _jacobian_rows(view, camera, t)
    s = _row(scales, i)
    m0 = _mul((_dot(u0, c0), _dot(u0, c1), _dot(u0, c2)), s)
    m1 = _mul((_dot(u1, c0), _dot(u1, c1), _dot(u1, c2)), s)
    n = _cross(m0, m1)
    a, b, c = _dot(m0, m0) + LOW_PASS, _dot(m0, m1), _dot(m1, m1) + LOW_PASS
    det = _dot(n, n) + LOW_PASS * (a + c - LOW_PASS)
    mx = camera[0] * t[0] / t[2] + camera[2]
    my = camera[1] * t[1] / t[2] + camera[3]
    if not (math.isfinite(mx) and math.isfinite(my) and math.isfinite(det)):
        return False
    log_opacity = math.log(opacity)
    level = 2 * (log_opacity - math.log(ALPHA_MIN))
    extent_y = math.sqrt(level * c)
    box[0], box[2] = _pixel_range(mx, math.sqrt(level * a), width)
    box[1], box[3] = _pixel_range(my, extent_y, height)
    scale = -1 / (EXP_SCALE * det)
    packed[0], packed[1], packed[10] = mx, my, t[2]
    packed[2], packed[3], packed[4] = 0.5 * c * scale, -b * scale, 0.5 * a * scale
    packed[5], packed[11] = log_opacity / EXP_SCALE, b / c * extent_y
    packed[6] = min(packed[5], math.log(ALPHA_MAX) / EXP_SCALE)
    return bool(box[2] > box[0] and box[3] > box[1])


@parallel_kernel
def project(means: Floats, quats: Floats, scales: Floats, opacities: Floats, colors: Floats,
            extra: Floats, view: Floats, camera: Floats, width: int, height: int, packed: Floats,
            boxes: NDArray[np.int32], visible: NDArray[np.bool_]) -> None:
    """Fill packed [N, 12], pixel boxes [N, 4] (x0, y0, x1, y1) and the visible mask [N].

    camera: fx, fy, cx, cy, min x/z, max x/z, min y/z, max y/z, near.
    """
    for i in prange(len(means)):
        seen = _project_one(i, means, quats, scales, opacities[i], view, camera, width, height,
                            packed[i], boxes[i])
        total = 0.0
        for k in range(3):
            packed[i, 7 + k] = colors[i, k]
            total += colors[i, k]
        for k in range(extra.shape[1]):
            total += extra[i, k]
        visible[i] = seen and math.isfinite(total)


@inlined
def _ellipse_gradient(m0: Vec, m1: Vec, g: Floats) -> tuple[float, float, float, float, float]:
    """Gradients of the centre (2) and of the 2-D covariance (3) from the moments of v.

    v = dL/d(exponent) and the exponent is -0.5 d^T C^-1 d, so dL/dmean = C^-1 sum(v d) and
    dL/dC = 0.5 C^-1 sum(v d d^T) C^-1.
    """
    n = _cross(m0, m1)
    a, b, c = _dot(m0, m0) + LOW_PASS, _dot(m0, m1), _dot(m1, m1) + LOW_PASS
    inv = 1 / (_dot(n, n) + LOW_PASS * (a + c - LOW_PASS))
    ka, kb, kc = c * inv, -b * inv, a * inv
    p, q, r, s = (ka * g[3] + kb * g[4], ka * g[4] + kb * g[5],
                  kb * g[3] + kc * g[4], kb * g[4] + kc * g[5])
    return (ka * g[1] + kb * g[2], kb * g[1] + kc * g[2],
            0.5 * (p * ka + q * kb), p * kb + q * kc, 0.5 * (r * kb + s * kc))


@inlined
def _camera_gradient(t: Vec, rx: float, ry: float, camera: Floats, view: Floats, du0: Vec,
                     du1: Vec, dmx: float, dmy: float, dz: float) -> Vec:
    """Gradient of the camera-space position."""
    inv_z = 1 / t[2]
    jx, jy = camera[0] * inv_z, camera[1] * inv_z
    w2 = _row(view, 2)
    dj00, dj02 = _dot(du0, _row(view, 0)), _dot(du0, w2)
    dj11, dj12 = _dot(du1, _row(view, 1)), _dot(du1, w2)
    dz += inv_z * (jx * (rx * dj02 - dj00) + jy * (ry * dj12 - dj11))
    # A clamped ratio is a constant: only the mean's own projection still moves with x or y.
    drx, dry = jx * t[2] * dmx, jy * t[2] * dmy
    qx, qy = t[0] * inv_z, t[1] * inv_z
    if camera[4] < qx < camera[5]:
        drx -= jx * dj02
    if camera[6] < qy < camera[7]:
        dry -= jy * dj12
    return (drx * inv_z, dry * inv_z, dz - inv_z * (drx * qx + dry * qy))


@inlined
def _backward_one(i: int, means: Floats, quats: Floats, scales: Floats, view: Floats,
                  camera: Floats, g: Floats, d_means: Floats, d_quats: Floats, d_scales: Floats,
                  d_screen: Floats) -> None:
    """Carry one Gaussian's summed screen gradients g [10] back to its parameters."""
    t = _to_camera(view, _row(means, i))
    w, x, y, z, inv = _unit(quats, i)
    c0, c1, c2 = _columns(w, x, y, z)
    u0, u1, rx, ry = _jacobian_rows(view, camera, t)
    s = _row(scales, i)
    v0, v1 = (_dot(u0, c0), _dot(u0, c1), _dot(u0, c2)), (_dot(u1, c0), _dot(u1, c1), _dot(u1, c2))
    m0, m1 = _mul(v0, s), _mul(v1, s)
    dmx, dmy, da, db, dc = _ellipse_gradient(m0, m1, g)
    dm0, dm1 = _mix(2 * da, m0, db, m1), _mix(db, m0, 2 * dc, m1)
    for k in range(3):
        d_scales[i, k] = dm0[k] * v0[k] + dm1[k] * v1[k]
    dv0, dv1 = _mul(dm0, s), _mul(dm1, s)
    dq = _quat_gradient(w, x, y, z, _mix(dv0[0], u0, dv1[0], u1), _mix(dv0[1], u0, dv1[1], u1),
                        _mix(dv0[2], u0, dv1[2], u1))
    along = dq[0] * w + dq[1] * x + dq[2] * y + dq[3] * z
    d_quats[i, 0], d_quats[i, 1] = (dq[0] - along * w) * inv, (dq[1] - along * x) * inv
    d_quats[i, 2], d_quats[i, 3] = (dq[2] - along * y) * inv, (dq[3] - along * z) * inv
    du0 = _mix(1.0, _mix(dv0[0], c0, dv0[1], c1), dv0[2], c2)
    du1 = _mix(1.0, _mix(dv1[0], c0, dv1[1], c1), dv1[2], c2)
    dt = _camera_gradient(t, rx, ry, camera, view, du0, du1, dmx, dmy, g[9])
    for k in range(3):
        d_means[i, k] = view[0, k] * dt[0] + view[1, k] * dt[1] + view[2, k] * dt[2]
    d_screen[i] = math.sqrt(dmx * dmx + dmy * dmy)


@parallel_kernel
def project_backward(means: Floats, quats: Floats, scales: Floats, opacities: Floats,
                     view: Floats, camera: Floats, first: NDArray[np.int64],
                     slots: NDArray[np.int32], partial: Floats, d_means: Floats,
                     d_quats: Floats, d_scales: Floats, d_opacities: Floats, d_colors: Floats,
                     d_extra: Floats, d_screen: Floats) -> None:
    """Sum each Gaussian's per-tile gradients in a fixed order, then carry them to its inputs.

    partial [M, 10 + C] holds one row per (Gaussian, tile); slots[first[i]:first[i + 1]] are the
    rows of Gaussian i. The sum is left in the first of them.
    """
    for i in prange(len(means)):
        if first[i + 1] > first[i]:
            g = partial[slots[first[i]]]
            for k in range(first[i] + 1, first[i + 1]):
                for j in range(partial.shape[1]):
                    g[j] += partial[slots[k], j]
            d_opacities[i] = g[0] / opacities[i]
            for j in range(3):
                d_colors[i, j] = g[6 + j]
            for j in range(d_extra.shape[1]):
                d_extra[i, j] = g[10 + j]
            _backward_one(i, means, quats, scales, view, camera, g, d_means, d_quats, d_scales,
                          d_screen)
