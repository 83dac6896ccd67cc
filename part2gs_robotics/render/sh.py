"""View-dependent colour: real spherical harmonics of degree 0 to 3, forward and backward, in Numba.

Colour = max(0, 0.5 + sum_k B_k(d) c_k) with d the unit direction from the camera to the Gaussian.
Source: Kerbl 2023, section 5; signs and order of the basis are those of 3DGS PLY files.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel

Floats = NDArray[np.floating]

C0 = math.sqrt(1 / (4 * math.pi))  # degree 0: 1
C1 = math.sqrt(3 / (4 * math.pi))  # degree 1: y, z, x
C2A = math.sqrt(15 / (4 * math.pi))  # xy, yz, xz; half of it for xx - yy
C2B = math.sqrt(5 / (16 * math.pi))  # 2 zz - xx - yy
C3A = math.sqrt(35 / (32 * math.pi))  # y (3 xx - yy), x (xx - 3 yy)
C3B = math.sqrt(105 / (4 * math.pi))  # xyz; half of it for z (xx - yy)
C3C = math.sqrt(21 / (32 * math.pi))  # y (4 zz - xx - yy), x (4 zz - xx - yy)
C3D = math.sqrt(7 / (16 * math.pi))  # z (2 zz - 3 xx - 3 yy)
CHUNK = 1024  # Gaussians that share one scratch array
FULL = 16  # basis functions up to degree 3


def sh_colors(means: Floats, sh0: Floats, shN: Floats, camera_position: ArrayLike) -> Floats:
    """Return each Gaussian's colour [N, 3] as seen from a camera.

    Args:
        means: [N, 3] world frame, scene units.
        sh0: [N, 3] coefficients of degree 0.
        shN: [N, M, 3] higher degrees, M in {0, 3, 8, 15}.
        camera_position: [3] world frame.
    """
    colors = np.zeros_like(sh0)
    _forward(means, sh0, shN, np.asarray(camera_position, np.float64), colors)
    return colors


def sh_colors_backward(means: Floats, sh0: Floats, shN: Floats, camera_position: ArrayLike,
                       d_colors: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the gradients of sh0 [N, 3], shN [N, M, 3] and means [N, 3].

    Args:
        means: as in sh_colors, like the next three.
        sh0: [N, 3].
        shN: [N, M, 3].
        camera_position: [3].
        d_colors: [N, 3] gradient with respect to sh_colors.
    """
    out = np.zeros_like(sh0), np.zeros_like(shN), np.zeros_like(means)
    _backward(means, sh0, shN, np.asarray(camera_position, np.float64), d_colors, *out)
    return out


def seen_from(gaussians: Gaussians, viewmat: Floats) -> NDArray[np.float32]:
    """Return the colours [N, 3] of Gaussians as seen from a camera_from_world [4, 4]."""
    if gaussians.shN.shape[1] == 0:
        return gaussians.colors
    eye = -viewmat[:3, :3].T @ viewmat[:3, 3]
    return sh_colors(gaussians.means, gaussians.sh0, gaussians.shN, eye).astype(np.float32)


@inlined
def _basis(x: float, y: float, z: float, count: int, b: Floats) -> None:
    """Fill b with the first basis functions at a unit direction."""
    b[0] = C0
    if count > 1:
        b[1], b[2], b[3] = -C1 * y, C1 * z, -C1 * x
    if count > 4:
        b[4], b[5], b[7] = C2A * x * y, -C2A * y * z, -C2A * x * z
        b[6], b[8] = C2B * (2 * z * z - x * x - y * y), 0.5 * C2A * (x * x - y * y)
    if count > 9:
        ring = 4 * z * z - x * x - y * y
        b[9], b[15] = -C3A * y * (3 * x * x - y * y), -C3A * x * (x * x - 3 * y * y)
        b[10], b[14] = C3B * x * y * z, 0.5 * C3B * z * (x * x - y * y)
        b[11], b[13] = -C3C * y * ring, -C3C * x * ring
        b[12] = C3D * z * (2 * z * z - 3 * x * x - 3 * y * y)


@inlined
def _basis_gradient(x: float, y: float, z: float, e: Floats) -> tuple[float, float, float]:
    """Gradient of sum_k e_k B_k with respect to (x, y, z), as polynomials in space."""
    ring = 4 * z * z - x * x - y * y
    gx = (-C1 * e[3] + C2A * (y * e[4] - z * e[7] + x * e[8]) - 2 * C2B * x * e[6]
          - 6 * C3A * x * y * e[9] - 3 * C3A * (x * x - y * y) * e[15]
          + C3B * (y * z * e[10] + x * z * e[14])
          + C3C * (2 * x * y * e[11] + (2 * x * x - ring) * e[13]) - 6 * C3D * x * z * e[12])
    gy = (-C1 * e[1] + C2A * (x * e[4] - z * e[5] - y * e[8]) - 2 * C2B * y * e[6]
          - 3 * C3A * (x * x - y * y) * e[9] + 6 * C3A * x * y * e[15]
          + C3B * (x * z * e[10] - y * z * e[14])
          + C3C * ((2 * y * y - ring) * e[11] + 2 * x * y * e[13]) - 6 * C3D * y * z * e[12])
    gz = (C1 * e[2] - C2A * (y * e[5] + x * e[7]) + 4 * C2B * z * e[6]
          + C3B * (x * y * e[10] + 0.5 * (x * x - y * y) * e[14])
          - 8 * C3C * z * (y * e[11] + x * e[13])
          + 3 * C3D * (2 * z * z - x * x - y * y) * e[12])
    return gx, gy, gz


@inlined
def _direction(means: Floats, i: int, camera: Floats) -> tuple[float, float, float, float]:
    """Unit direction from the camera to a Gaussian and the inverse distance."""
    x, y, z = means[i, 0] - camera[0], means[i, 1] - camera[1], means[i, 2] - camera[2]
    # A Gaussian at the camera's centre has no direction; it is nearer than the near plane anyway.
    inv = 1 / max(math.sqrt(x * x + y * y + z * z), 1e-30)
    return x * inv, y * inv, z * inv, inv


@inlined
def _color(sh0: Floats, shN: Floats, b: Floats, i: int, c: int) -> float:
    value = 0.5 + b[0] * sh0[i, c]
    for k in range(shN.shape[1]):
        value += b[1 + k] * shN[i, k, c]
    return value


@kernel
def _forward(means: Floats, sh0: Floats, shN: Floats, camera: Floats, colors: Floats) -> None:
    for_each((len(means) + CHUNK - 1) // CHUNK, _forward_at, (means, sh0, shN, camera, colors))


@inlined
def _forward_at(chunk: int, means: Floats, sh0: Floats, shN: Floats, camera: Floats,
                colors: Floats) -> None:
    b = np.zeros(FULL, np.float64)
    for i in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(means))):
        x, y, z, _ = _direction(means, i, camera)
        _basis(x, y, z, 1 + shN.shape[1], b)
        for c in range(3):
            colors[i, c] = max(_color(sh0, shN, b, i, c), 0.0)


@kernel
def _backward(means: Floats, sh0: Floats, shN: Floats, camera: Floats, d_colors: Floats,
              d_sh0: Floats, d_shN: Floats, d_means: Floats) -> None:
    for_each((len(means) + CHUNK - 1) // CHUNK, _backward_at, (means, sh0, shN, camera, d_colors,
                                                               d_sh0, d_shN, d_means))


@inlined
def _backward_at(chunk: int, means: Floats, sh0: Floats, shN: Floats, camera: Floats,
                 d_colors: Floats, d_sh0: Floats, d_shN: Floats, d_means: Floats) -> None:
    b, e = np.zeros(FULL, np.float64), np.zeros(FULL, np.float64)
    for i in range(chunk * CHUNK, min((chunk + 1) * CHUNK, len(means))):
        x, y, z, inv = _direction(means, i, camera)
        _basis(x, y, z, 1 + shN.shape[1], b)
        e[:] = 0.0
        for c in range(3):
            if _color(sh0, shN, b, i, c) > 0:
                d_sh0[i, c] = b[0] * d_colors[i, c]
                for k in range(shN.shape[1]):
                    d_shN[i, k, c] = b[1 + k] * d_colors[i, c]
                    e[1 + k] += shN[i, k, c] * d_colors[i, c]
        gx, gy, gz = _basis_gradient(x, y, z, e)
        along = gx * x + gy * y + gz * z
        d_means[i, 0] = (gx - along * x) * inv
        d_means[i, 1] = (gy - along * y) * inv
        d_means[i, 2] = (gz - along * z) * inv
