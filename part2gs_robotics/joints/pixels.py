"""Numba kernels: the normal equations of one part's joint from the pixels of one view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel

Floats = NDArray[np.floating]

CHANNELS = 4  # r, g, b and alpha
CHUNKS = 16  # of pixels, summed one by one and then in order: the same for any number of threads


@dataclass(frozen=True)
class Pixels:
    """Pixels of one view that speak for a part, and the picture they lie in.

    Attributes:
        rows, cols: [n] of the pixels.
        depth: [h, w] of the part.  drawn: [h, w, 4].  own: [h, w] the part's share of a pixel.
        K: [3, 3] of the picture.  view: [4, 4] camera_from_world.
    """

    rows: NDArray[np.intp]
    cols: NDArray[np.intp]
    depth: Floats
    drawn: Floats
    own: Floats
    K: F64
    view: F64

    def __len__(self) -> int:
        """Return the number of pixels."""
        return len(self.rows)

    def slopes(self, rates: F64, jac: F64, total: F64) -> None:
        """Fill jac and add to total, see the kernel `slopes`."""
        slopes(self.rows, self.cols, self.depth, self.drawn, self.own, rates, self.K, self.view,
               jac, total)


@kernel
def slopes(rows: NDArray[np.int64], cols: NDArray[np.int64], z: Floats, drawn: Floats, own: Floats,
           rates: F64, K: F64, view: F64, jac: F64, total: F64) -> None:
    """Fill jac [n, 4, P]: change of a drawn pixel per unit of each of the joint's parameters.

    drawn [h, w, 4]: the picture; no pixel asked for lies at its edge. rates [P, 4, 4]: velocity of
    a point in the world. The picture moves with the part: what was at u - du comes to u. total
    [CHUNKS, 3, P]: added to, the sums of the colours' slopes.
    """
    size = (len(rows) + CHUNKS - 1) // CHUNKS
    for_each(CHUNKS, _slopes_at, (rows, cols, z, drawn, own, rates, K, view, jac, total, size))


@inlined
def _slopes_at(chunk: int, rows: NDArray[np.int64], cols: NDArray[np.int64], z: Floats,
               drawn: Floats, own: Floats, rates: F64, K: F64, view: F64, jac: F64, total: F64,
               size: int) -> None:
    for n in range(chunk * size, min((chunk + 1) * size, len(rows))):
        y, x = rows[n], cols[n]
        depth = max(np.float64(z[y, x]), 1e-6)
        # Positions relative to the depth: a, b, 1 in the camera.
        a, b = (x + 0.5 - K[0, 2]) / K[0, 0], (y + 0.5 - K[1, 2]) / K[1, 1]
        px, py, pz = a * depth - view[0, 3], b * depth - view[1, 3], depth - view[2, 3]
        wx = px * view[0, 0] + py * view[1, 0] + pz * view[2, 0]
        wy = px * view[0, 1] + py * view[1, 1] + pz * view[2, 1]
        wz = px * view[0, 2] + py * view[1, 2] + pz * view[2, 2]
        for p in range(len(rates)):
            r = rates[p]
            vx = r[0, 0] * wx + r[0, 1] * wy + r[0, 2] * wz + r[0, 3]
            vy = r[1, 0] * wx + r[1, 1] * wy + r[1, 2] * wz + r[1, 3]
            vz = r[2, 0] * wx + r[2, 1] * wy + r[2, 2] * wz + r[2, 3]
            cx = view[0, 0] * vx + view[0, 1] * vy + view[0, 2] * vz
            cy = view[1, 0] * vx + view[1, 1] * vy + view[1, 2] * vz
            cz = view[2, 0] * vx + view[2, 1] * vy + view[2, 2] * vz
            du, dv = K[0, 0] * (cx - a * cz) / depth, K[1, 1] * (cy - b * cz) / depth
            for c in range(CHANNELS):
                across = drawn[y, x + 1, c] - drawn[y, x - 1, c]
                down = drawn[y + 1, x, c] - drawn[y - 1, x, c]
                jac[n, c, p] = -0.5 * (across * du + down * dv) * own[y, x]
                if c < 3:
                    total[chunk, c, p] += jac[n, c, p]


@kernel
def sums(jac: F64, mean: F64, residual: F64, robust: float, h: F64, g: F64, error: F64,
         count: F64) -> None:
    """Fill one share of J^T W J [P, P], J^T W r [P], r^T W r and sum W for every chunk.

    J is jac [n, 4, P] less its mean [4, P].
    """
    size = (len(jac) + CHUNKS - 1) // CHUNKS
    for_each(CHUNKS, _sums_at, (jac, mean, residual, robust, h, g, error, count, size))


@inlined
def _sums_at(chunk: int, jac: F64, mean: F64, residual: F64, robust: float, h: F64, g: F64,
             error: F64, count: F64, size: int) -> None:
    for n in range(chunk * size, min((chunk + 1) * size, len(jac))):
        for c in range(CHANNELS):
            r = residual[n, c]
            ratio = r / robust
            w = (1.0 / (1.0 + ratio * ratio)) ** 2
            error[chunk] += w * r * r
            count[chunk] += w
            for p in range(jac.shape[2]):
                scaled = w * (jac[n, c, p] - mean[c, p])
                g[chunk, p] += scaled * r
                for q in range(jac.shape[2]):
                    h[chunk, p, q] += scaled * (jac[n, c, q] - mean[c, q])


@kernel
def patch_sums(jac: F64, residual: F64, robust: float, patch: NDArray[np.int64], g: F64, bread: F64,
               noise: F64, pull: F64) -> None:
    """Add every pixel to its patch of surface, for the standard deviations.

    jac [n, 4, P + 3]: slopes along P parameters and along three shifts of the surface. Added to, by
    patch: g [m, P] = sum psi J; bread [m, P, P] = sum psi' J J^T; noise [m, P, P] =
    sum psi^2 J J^T; pull [m, P, 3] = sum psi' J S^T, change of g per shift of the patch.
    """
    count = g.shape[1]
    for n in range(len(jac)):
        m = patch[n]
        for c in range(CHANNELS):
            u = (residual[n, c] / robust) ** 2
            psi = residual[n, c] / (1.0 + u) ** 2
            slope = (1.0 - 3.0 * u) / (1.0 + u) ** 3
            for p in range(count):
                j = jac[n, c, p]
                g[m, p] += psi * j
                for q in range(count):
                    bread[m, p, q] += slope * j * jac[n, c, q]
                    noise[m, p, q] += psi * psi * j * jac[n, c, q]
                for q in range(3):
                    pull[m, p, q] += slope * j * jac[n, c, count + q]
