"""One view's share of the equations that align joints to the images."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.joints.pixels import CHANNELS, CHUNKS, Pixels, sums
from part2gs_robotics.joints.solver import System
from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.model.small_views import Photo
from part2gs_robotics.render.rendered import Rendered

ALPHA_GAIN = 0.6  # silhouettes beside colours: no shading error, but mask edges of half a pixel
MIN_OWN = 0.35  # share of a pixel a part must have to speak for it
OCCLUSION = (
    0.01  # of the diagonal: something this much nearer moves the edge, not the part behind it
)
RIM = 3  # pixels that a part's depth is carried over its rim, where the blurred edge lies
BLURRED = 4.0  # deviations that a blur reaches, in OpenCV as well


@dataclass(frozen=True)
class _Window:
    """One part's share of a view: all that its pixels ask for, and no more.

    Attributes:
        color: [h, w, 3].  alpha, depth, share: [h, w].  photo: [h, w, 3] and mask [h, w].
        K: [3, 3] of the window.  view: [4, 4] camera_from_world.
        edges: rows and columns that begin and end where the image does.
    """

    color: F32
    alpha: F32
    depth: F32
    share: F32
    photo: F32
    mask: F32
    K: F64
    view: F64
    edges: tuple[bool, bool, bool, bool]


@dataclass(frozen=True)
class Level:
    """One width of an alignment.

    Attributes:
        blur: of both images, pixels: wide catches large errors, narrow decides.
        robust: colour difference at which a pixel counts a quarter.
        steps: at most.
    """

    blur: float
    robust: float
    steps: int


def reach_of(level: Level) -> int:
    """Return the pixels around what a part shows that its equations depend on.

    A blur carries a part over its rim, and another one what is around there to it.
    """
    return 2 * (int(np.ceil(BLURRED * level.blur)) + 1) + 1  # one more for the slope


def add_view(systems: list[System], rates: list[F64], out: Rendered, photo: Photo, diag: float,
             level: Level) -> None:
    """Add one view to the systems of all parts.

    Args:
        systems: of parts 1..K, added to.
        rates: of every part, [P, 4, 4] velocity of a point per unit of each parameter.
        out: the moved Gaussians drawn in this view; extra channels are shares of parts 1..K.
        photo: of the state they are moved into.
        diag: diagonal of the object in scene units.
        level: blur and robustness.
    """
    reach = RIM + int(np.ceil(BLURRED * level.blur)) + 1  # one more for the slope
    for k, system in enumerate(systems):
        window = _window(out, photo, k, reach)
        if window is not None:
            _add_part(system, rates[k], window, diag, level)


def _window(out: Rendered, photo: Photo, part: int, reach: int) -> _Window | None:
    """Return what a part shows of a view and `reach` pixels around it; None if that is nothing."""
    shown = out.extra[..., part] > 0
    rows, cols = np.flatnonzero(shown.any(1)), np.flatnonzero(shown.any(0))
    if not len(rows):
        return None
    height, width = shown.shape
    top, left = max(rows[0] - reach, 0), max(cols[0] - reach, 0)
    bottom, right = min(rows[-1] + 1 + reach, height), min(cols[-1] + 1 + reach, width)
    cut = slice(top, bottom), slice(left, right)
    K = photo.camera.K.copy()
    K[:2, 2] -= left, top
    edges = top == 0, bottom == height, left == 0, right == width
    return _Window(out.color[cut], out.alpha[cut], out.depth[cut],
                   np.ascontiguousarray(out.extra[(*cut, part)]), photo.color[cut],
                   photo.alpha[cut], K, photo.camera.viewmat, edges)


def _add_part(system: System, rates: F64, w: _Window, diag: float, level: Level) -> None:
    def soft(image: F32) -> F32:
        return cv2.GaussianBlur(image, (0, 0), level.blur)

    drawn = soft(cv2.merge([w.color, ALPHA_GAIN * w.alpha]))
    photo = soft(cv2.merge([w.photo, ALPHA_GAIN * w.mask]))
    z = np.where(w.alpha > 0.05, w.depth / np.maximum(w.alpha, 0.05), 0.0).astype(np.float32)
    cover = soft(w.alpha)
    own: F32 = (soft(w.share) / np.maximum(cover, 0.02)).astype(np.float32)
    pixels = (own > MIN_OWN) & (cover > 0.1) & ~_hidden_edge(z, w.share, diag)
    for border, outer in zip((pixels[:2], pixels[-2:], pixels[:, :2], pixels[:, -2:]), w.edges,
                             strict=True):
        border &= not outer
    part_z = _spread_depth(z, w.share)
    pixels &= part_z > 0
    if pixels.sum() > 20:
        rows, cols = np.nonzero(pixels)
        _add_pixels(system, rates, Pixels(rows, cols, part_z, drawn, own, w.K, w.view),
                    photo[rows, cols], level.robust)


def _spread_depth(z: F32, own: F32) -> F32:
    """Depth of the part, carried RIM pixels over its rim where the blurred edge lies."""
    size = (2 * RIM + 1,) * 2
    inside = np.where((own > 0.5) & (z > 0), z, 0).astype(np.float32)
    weight = (inside > 0).astype(np.float32)
    return cv2.blur(inside, size) / np.maximum(cv2.blur(weight, size), 1e-6)


def _hidden_edge(z: F32, own: F32, diag: float) -> NDArray[np.bool_]:
    other = np.where((z > 0) & (own < 0.5), z, np.float32(1e9)).astype(np.float32)
    nearest_other = cv2.erode(other, np.ones((5, 5), np.uint8))
    return np.asarray((own >= 0.2) & (nearest_other < z - OCCLUSION * diag))


def _add_pixels(system: System, rates: F64, pixels: Pixels, seen: F32, robust: float) -> None:
    """Add pixels; seen: [n, 4] what the photo shows there."""
    jac, total = np.zeros((len(pixels), CHANNELS, len(rates))), np.zeros((CHUNKS, 3, len(rates)))
    pixels.slopes(rates, jac, total)
    residual = seen.astype(np.float64) - pixels.drawn[pixels.rows, pixels.cols]
    # Light is fixed in the world: a turned face changes brightness as a whole, which is no motion.
    residual[:, :3] -= np.median(residual[:, :3], 0)
    if system.patches is not None:
        system.patches.add(pixels, rates, residual, robust)
    mean = np.zeros((CHANNELS, len(rates)))
    mean[:3] = total.sum(0) / len(pixels)
    h, g = np.zeros((CHUNKS, *system.h.shape)), np.zeros((CHUNKS, *system.g.shape))
    error, count = np.zeros(CHUNKS), np.zeros(CHUNKS)
    sums(jac, mean, residual, robust, h, g, error, count)
    system.h += h.sum(0)
    system.g += g.sum(0)
    system.error += float(error.sum())
    system.count += float(count.sum())
