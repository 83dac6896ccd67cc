"""One view's share of the equations that align joints to the images."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.align_pixels import CHANNELS, CHUNKS, slopes, sums
from part2gs_robotics.align_system import System
from part2gs_robotics.rendered import Rendered
from part2gs_robotics.small_views import SmallViews

F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
ALPHA_GAIN = 0.6  # silhouettes beside colours: no shading error, but mask edges of half a pixel
MIN_OWN = 0.35  # share of a pixel a part must have to speak for it
OCCLUSION = (
    0.01  # of the diagonal: something this much nearer moves the edge, not the part behind it
)


def add_view(
    systems: list[System], rates: list[F64], out: Rendered, small: SmallViews, v: int, diag: float,
    blur: float, robust: float,
) -> None:
    """Add one view to the systems of all parts.

    Args:
        systems: of parts 1..K, added to.
        rates: of every part, [P, 4, 4] velocity of a point per unit of each parameter.
        out: the moved Gaussians drawn in this view; extra channels are shares of parts 0..K.
        small: photos of the state.
        v: the view.
        diag: diagonal of the object in scene units.
        blur: of both images, pixels.
        robust: colour difference at which a pixel counts a quarter.
    """

    def soft(image: F32) -> F32:
        return cv2.GaussianBlur(image, (0, 0), blur)

    color, alpha, share = out.color, out.alpha, out.extra
    drawn = soft(cv2.merge([color, ALPHA_GAIN * alpha]))
    photo = soft(cv2.merge([small.colors[v], ALPHA_GAIN * small.alphas[v]]))
    across = 0.5 * (np.roll(drawn, -1, 1) - np.roll(drawn, 1, 1))
    down = 0.5 * (np.roll(drawn, -1, 0) - np.roll(drawn, 1, 0))
    z = np.where(alpha > 0.05, out.depth / np.maximum(alpha, 0.05), 0.0).astype(np.float32)
    cover = soft(alpha)
    for k, system in enumerate(systems):
        own = soft(np.ascontiguousarray(share[..., k + 1])) / np.maximum(cover, 0.02)
        pixels = (own > MIN_OWN) & (cover > 0.1) & ~_hidden_edge(z, share[..., k + 1], diag)
        pixels[:2] = pixels[-2:] = pixels[:, :2] = pixels[:, -2:] = False
        part_z = _spread_depth(z, share[..., k + 1])
        pixels &= part_z > 0
        if pixels.sum() > 20:
            slopes_of = part_z, (across, down), photo - drawn, own.astype(np.float32)
            _add_pixels(system, rates[k], np.nonzero(pixels), *slopes_of, small, v, robust)


def _spread_depth(z: F32, own: F32) -> F32:
    """Depth of the part, carried a few pixels over its rim where the blurred edge lies."""
    inside = np.where((own > 0.5) & (z > 0), z, 0).astype(np.float32)
    weight = (inside > 0).astype(np.float32)
    return cv2.blur(inside, (7, 7)) / np.maximum(cv2.blur(weight, (7, 7)), 1e-6)


def _hidden_edge(z: F32, own: F32, diag: float) -> NDArray[np.bool_]:
    other = np.where((z > 0) & (own < 0.5), z, np.float32(1e9)).astype(np.float32)
    nearest_other = cv2.erode(other, np.ones((5, 5), np.uint8))
    return np.asarray((own >= 0.2) & (nearest_other < z - OCCLUSION * diag))


def _add_pixels(
    system: System,
    rates: F64,
    index: tuple[NDArray[np.intp], ...],
    z: F32,
    gradients: tuple[F32, F32],
    difference: F32,
    own: F32,
    small: SmallViews,
    v: int,
    robust: float,
) -> None:
    rows, cols = index
    jac = np.zeros((len(rows), CHANNELS, len(rates)))
    slopes(rows, cols, z, *gradients, own, rates, small.Ks[v], small.viewmats[v], jac)
    residual = difference[index].astype(np.float64)
    # Light is fixed in the world: a turned face changes brightness as a whole, which is no motion.
    residual[:, :3] -= np.median(residual[:, :3], 0)
    jac[:, :3] -= jac[:, :3].mean(0)
    if system.patches is not None:
        camera = small.Ks[v], small.viewmats[v]
        system.patches.add(rows, cols, z, gradients, own, rates, camera, residual, robust)
    h, g = np.zeros((CHUNKS, *system.h.shape)), np.zeros((CHUNKS, *system.g.shape))
    error, count = np.zeros(CHUNKS), np.zeros(CHUNKS)
    sums(jac, residual, robust, h, g, error, count)
    system.h += h.sum(0)
    system.g += g.sum(0)
    system.error += float(error.sum())
    system.count += float(count.sum())
