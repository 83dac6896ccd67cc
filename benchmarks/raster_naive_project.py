"""The yardstick's projection: Gaussians to ellipses on the screen, and the gradient of that.

Written plainly from Kerbl 2023 (eqs. 5 and 6), one Gaussian at a time, nothing shared with the
product's kernels: covariance C = J W R S S R^T W^T J^T + 0.3 I, its inverse the conic (A, B, C).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

LOW_PASS = 0.3  # pixels^2, 3DGS
FOV_MARGIN = 0.3  # of tan(fov / 2) outside the image where the Jacobian is frozen, 3DGS
ALPHA_MIN = 1 / 255  # 3DGS
NEAR = 0.01  # scene units, gsplat
PACKED = 10  # mx, my, A, B, C, opacity, r, g, b, z
GRADS = 10  # of the same ten numbers, per tile in which a Gaussian is listed


@njit(fastmath=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(fastmath=True)
def _combine(s, a, t, b):
    """Return s a + t b."""
    return (s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2])


@njit(fastmath=True)
def _times(a, b):
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


@njit(fastmath=True)
def _row(array, i):
    return (np.float64(array[i, 0]), np.float64(array[i, 1]), np.float64(array[i, 2]))


@njit(fastmath=True)
def _unit(quats, i):
    """Return the normalised quaternion and the inverse of its norm."""
    w, x, y, z = (np.float64(quats[i, 0]), np.float64(quats[i, 1]), np.float64(quats[i, 2]),
                  np.float64(quats[i, 3]))
    inv = 1 / math.sqrt(w * w + x * x + y * y + z * z)
    return w * inv, x * inv, y * inv, z * inv, inv


@njit(fastmath=True)
def _rotation(w, x, y, z):
    """Return the columns of a unit quaternion's matrix."""
    return ((1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
            (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
            (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)))


@njit(fastmath=True)
def _camera_point(view, p):
    return (_dot(_row(view, 0), p) + view[0, 3], _dot(_row(view, 1), p) + view[1, 3],
            _dot(_row(view, 2), p) + view[2, 3])


@njit(fastmath=True)
def _held(view, lens, t):
    """Return the rows of J W and the ratios x/z, y/z held near the image."""
    rx = max(lens[4], min(t[0] / t[2], lens[5]))
    ry = max(lens[6], min(t[1] / t[2], lens[7]))
    jx, jy = lens[0] / t[2], lens[1] / t[2]
    w0, w1, w2 = _row(view, 0), _row(view, 1), _row(view, 2)
    return _combine(jx, w0, -jx * rx, w2), _combine(jy, w1, -jy * ry, w2), rx, ry


@njit(parallel=True, fastmath=True, cache=True)
def project(means, quats, scales, opacities, colors, view, lens, width, height, packed, boxes):
    """Fill packed [N, 10] and the pixels of each Gaussian [N, 4]: x0, y0, x1, y1, zero if unseen.

    lens: fx, fy, cx, cy, min x/z, max x/z, min y/z, max y/z.
    """
    for i in prange(len(means)):
        t = _camera_point(view, _row(means, i))
        packed[i, 9] = t[2]
        if t[2] <= NEAR or opacities[i] <= ALPHA_MIN:
            continue
        w, x, y, z, _ = _unit(quats, i)
        c0, c1, c2 = _rotation(w, x, y, z)
        u0, u1, _, _ = _held(view, lens, t)
        s = _row(scales, i)
        m0 = _times((_dot(u0, c0), _dot(u0, c1), _dot(u0, c2)), s)
        m1 = _times((_dot(u1, c0), _dot(u1, c1), _dot(u1, c2)), s)
        a, b, c = _dot(m0, m0) + LOW_PASS, _dot(m0, m1), _dot(m1, m1) + LOW_PASS
        det = a * c - b * b
        mx, my = lens[0] * t[0] / t[2] + lens[2], lens[1] * t[1] / t[2] + lens[3]
        packed[i, 0], packed[i, 1] = mx, my
        packed[i, 2], packed[i, 3], packed[i, 4] = c / det, -b / det, a / det
        packed[i, 5] = opacities[i]
        for k in range(3):
            packed[i, 6 + k] = colors[i, k]
        # Pixels whose centres, at + 0.5, lie in the box of the ellipse where alpha falls to 1/255;
        # 0.01 px covers rounding. The square of 3 sigma of 3DGS is larger.
        level = 2 * math.log(opacities[i] / ALPHA_MIN)
        ex, ey = math.sqrt(level * a), math.sqrt(level * c)
        x0, x1 = max(math.ceil(mx - ex - 0.51), 0), min(math.floor(mx + ex - 0.49) + 1, width)
        y0, y1 = max(math.ceil(my - ey - 0.51), 0), min(math.floor(my + ey - 0.49) + 1, height)
        if x0 < x1 and y0 < y1:
            boxes[i, 0], boxes[i, 1], boxes[i, 2], boxes[i, 3] = x0, y0, x1, y1


@njit(fastmath=True)
def _covariance_gradient(g, A, B, C):
    """Return dL/dC = -K G K of the conic's gradient, G symmetric: 3 entries."""
    p, q = A * g[2] + 0.5 * B * g[3], 0.5 * A * g[3] + B * g[4]
    r, s = B * g[2] + 0.5 * C * g[3], 0.5 * B * g[3] + C * g[4]
    return -(p * A + q * B), -(p * B + q * C), -(r * B + s * C)


@njit(fastmath=True)
def _quat_gradient(w, x, y, z, a, b, c):
    """Return the unit quaternion's gradient from those of the rotation's columns a, b, c."""
    return (2 * (z * (a[1] - b[0]) + y * (c[0] - a[2]) + x * (b[2] - c[1])),
            2 * (y * (a[1] + b[0]) + z * (a[2] + c[0]) + w * (b[2] - c[1])
                 - 2 * x * (b[1] + c[2])),
            2 * (x * (a[1] + b[0]) + z * (b[2] + c[1]) + w * (c[0] - a[2])
                 - 2 * y * (a[0] + c[2])),
            2 * (x * (a[2] + c[0]) + y * (b[2] + c[1]) + w * (a[1] - b[0])
                 - 2 * z * (a[0] + b[1])))


@njit(fastmath=True)
def _point_gradient(t, rx, ry, lens, view, g, du0, du1):
    """Return the gradient by the camera-space position."""
    w2 = _row(view, 2)
    dj00, dj02 = _dot(du0, _row(view, 0)), _dot(du0, w2)
    dj11, dj12 = _dot(du1, _row(view, 1)), _dot(du1, w2)
    fx, fy, z = lens[0], lens[1], t[2]
    dx, dy = g[0] * fx / z, g[1] * fy / z
    dz = g[9] - (g[0] * fx * t[0] + g[1] * fy * t[1]) / (z * z)
    dz += (fx * (rx * dj02 - dj00) + fy * (ry * dj12 - dj11)) / (z * z)
    if lens[4] < t[0] / z < lens[5]:
        dx -= fx / (z * z) * dj02
        dz += fx * t[0] / (z * z * z) * dj02
    if lens[6] < t[1] / z < lens[7]:
        dy -= fy / (z * z) * dj12
        dz += fy * t[1] / (z * z * z) * dj12
    return dx, dy, dz


@njit(fastmath=True)
def _backward_one(i, g, means, quats, scales, view, lens, packed, d_means, d_quats, d_scales):
    t = _camera_point(view, _row(means, i))
    w, x, y, z, inv = _unit(quats, i)
    c0, c1, c2 = _rotation(w, x, y, z)
    u0, u1, rx, ry = _held(view, lens, t)
    s = _row(scales, i)
    v0 = (_dot(u0, c0), _dot(u0, c1), _dot(u0, c2))
    v1 = (_dot(u1, c0), _dot(u1, c1), _dot(u1, c2))
    da, db, dc = _covariance_gradient(g, packed[i, 2], packed[i, 3], packed[i, 4])
    m0, m1 = _times(v0, s), _times(v1, s)
    dm0, dm1 = _combine(2 * da, m0, 2 * db, m1), _combine(2 * db, m0, 2 * dc, m1)
    for k in range(3):
        d_scales[i, k] = dm0[k] * v0[k] + dm1[k] * v1[k]
    dv0, dv1 = _times(dm0, s), _times(dm1, s)
    dw, dx, dy, dz = _quat_gradient(
        w, x, y, z, _combine(dv0[0], u0, dv1[0], u1), _combine(dv0[1], u0, dv1[1], u1),
        _combine(dv0[2], u0, dv1[2], u1))
    along = dw * w + dx * x + dy * y + dz * z
    d_quats[i, 0], d_quats[i, 1] = (dw - along * w) * inv, (dx - along * x) * inv
    d_quats[i, 2], d_quats[i, 3] = (dy - along * y) * inv, (dz - along * z) * inv
    du0 = _combine(1.0, _combine(dv0[0], c0, dv0[1], c1), dv0[2], c2)
    du1 = _combine(1.0, _combine(dv1[0], c0, dv1[1], c1), dv1[2], c2)
    dt = _point_gradient(t, rx, ry, lens, view, g, du0, du1)
    for k in range(3):
        d_means[i, k] = view[0, k] * dt[0] + view[1, k] * dt[1] + view[2, k] * dt[2]


@njit(parallel=True, fastmath=True, cache=True)
def project_backward(means, quats, scales, view, lens, packed, first, slots, partial, d_means,
                     d_quats, d_scales, d_opacities, d_colors, d_screen):
    """Sum each Gaussian's rows of partial [M, 10] and carry them to its parameters."""
    for i in prange(len(means)):
        if first[i + 1] == first[i]:
            continue
        g = np.zeros(GRADS)
        for k in range(first[i], first[i + 1]):
            for j in range(GRADS):
                g[j] += partial[slots[k], j]
        d_opacities[i] = g[5]
        for k in range(3):
            d_colors[i, k] = g[6 + k]
        d_screen[i] = math.sqrt(g[0] * g[0] + g[1] * g[1])
        _backward_one(i, g, means, quats, scales, view, lens, packed, d_means, d_quats, d_scales)
