"""Eight Gaussians side by side: the algebra that projecting them and going back share.

Source: EWA splatting (Zwicker 2001) as in 3D Gaussian Splatting (Kerbl 2023, eq. 5): the 2-D
covariance is J W Sigma W^T J^T + 0.3 I. With M = J W R S it is M M^T + 0.3 I, and its determinant
is |M0 x M1|^2 + 0.3 tr(M M^T) + 0.09: a sum of positive terms, exact for needle shapes too.
Numbers are float64 whatever the arrays hold: float32 would lose needles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.runtime.jit import inlined
from part2gs_robotics.runtime.simd import LANES, Lane, gather, least, most, root, splat, store

Floats = NDArray[np.floating]
Vec = tuple[Lane, Lane, Lane]

LOW_PASS = 0.3  # pixels^2 added to the 2-D covariance (3DGS)


@inlined
def dot(a: Vec, b: Vec) -> Lane:
    """Return the inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a: Vec, b: Vec) -> Vec:
    """Return the vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inlined
def mul(a: Vec, b: Vec) -> Vec:
    """Return the products of the components."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


@inlined
def mix(s: Lane, a: Vec, t: Lane, b: Vec) -> Vec:
    """Return s a + t b."""
    return (s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2])


@inlined
def view_row(view: Floats, i: int) -> tuple[float, float, float]:
    """Return a row of the rotation of camera_from_world."""
    return (view[i, 0], view[i, 1], view[i, 2])


@inlined
def rows_of(array: Floats, i: int, n: int) -> Vec:
    """Columns of eight rows of an [n, 3] array."""
    flat, row, last, width = array.reshape(-1), np.uint64(i), np.uint64(n - 1), np.uint64(3)
    return (gather(flat, row, last, width, np.uint64(0)),
            gather(flat, row, last, width, np.uint64(1)),
            gather(flat, row, last, width, np.uint64(2)))


@inlined
def unit(quats: Floats, i: int, n: int) -> tuple[Lane, Lane, Lane, Lane, Lane]:
    """Return normalised quaternions and the inverse of their norm (infinite for zero)."""
    flat, row, last, width = quats.reshape(-1), np.uint64(i), np.uint64(n - 1), np.uint64(4)
    w = gather(flat, row, last, width, np.uint64(0))
    x = gather(flat, row, last, width, np.uint64(1))
    y = gather(flat, row, last, width, np.uint64(2))
    z = gather(flat, row, last, width, np.uint64(3))
    inv = 1.0 / root(w * w + x * x + y * y + z * z)
    return w * inv, x * inv, y * inv, z * inv, inv


@inlined
def columns(w: Lane, x: Lane, y: Lane, z: Lane) -> tuple[Vec, Vec, Vec]:
    """Columns of the rotation matrix of a unit quaternion."""
    c0 = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y))
    c1 = (2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x))
    c2 = (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
    return c0, c1, c2


@inlined
def clamp(value: Lane, low: float, high: float) -> Lane:
    """Return the nearest value in [low, high]."""
    return most(least(value, splat(high)), splat(low))


@inlined
def to_camera(view: Floats, p: Vec) -> Vec:
    """Return world points in the frame of the camera."""
    return (dot(p, view_row(view, 0)) + view[0, 3], dot(p, view_row(view, 1)) + view[1, 3],
            dot(p, view_row(view, 2)) + view[2, 3])


@inlined
def jacobian_rows(view: Floats, camera: Floats, t: Vec) -> tuple[Vec, Vec, Lane, Lane]:
    """Rows of J W and the clamped ratios x/z, y/z. Source: 3DGS eq. 5."""
    inv_z = 1.0 / t[2]
    rx = clamp(t[0] * inv_z, camera[4], camera[5])
    ry = clamp(t[1] * inv_z, camera[6], camera[7])
    jx, jy = inv_z * camera[0], inv_z * camera[1]
    zero = splat(0.0)
    return (mix(jx, view_row(view, 0), zero - jx * rx, view_row(view, 2)),
            mix(jy, view_row(view, 1), zero - jy * ry, view_row(view, 2)), rx, ry)


@inlined
def covariance(m0: Vec, m1: Vec) -> tuple[Lane, Lane, Lane, Lane]:
    """Return the 2-D covariance's entries a, b, c and its determinant."""
    n = cross(m0, m1)
    a, b, c = dot(m0, m0) + LOW_PASS, dot(m0, m1), dot(m1, m1) + LOW_PASS
    return a, b, c, dot(n, n) + LOW_PASS * (a + c - LOW_PASS)


@inlined
def put(s: Floats, column: int, value: Lane) -> None:
    """Write eight numbers to a column of a block's results."""
    store(s, np.uint64(column * LANES), value)
