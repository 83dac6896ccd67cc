"""Our CPU Gaussian rasteriser: 3DGS (EWA) images and their gradients, in Numba.

Semantics of 3D Gaussian Splatting (Kerbl 2023): low-pass 0.3 px^2, alpha clamped at 0.99 and
dropped below 1/255, a pixel is finished once its transmittance is below 1e-4. The arrays' dtype
picks the arithmetic: float32 for speed, float64 for tests. The result does not depend on the number
of threads.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from part2gs_robotics import render_kernels as kernels
from part2gs_robotics.render_bins import TILE_X, TILE_Y, bin_gaussians
from part2gs_robotics.render_project import (
    FOV_MARGIN,
    GRADS,
    PACKED,
    Floats,
    project,
    project_backward,
)

NEAR = 0.01  # scene units: in front of this z a Gaussian's Jacobian is meaningless (gsplat's value)


@dataclass(frozen=True)
class Saved:
    """What the backward pass needs of the forward pass."""

    means: Floats
    quats: Floats
    scales: Floats
    opacities: Floats
    extra: Floats
    view: Floats
    camera: Floats
    packed: Floats
    boxes: NDArray[np.int32]
    tile_order: NDArray[np.int64]
    tile_first: NDArray[np.int64]
    ids: NDArray[np.int32]
    first: NDArray[np.int64]
    slots: NDArray[np.int32]
    needed: NDArray[np.int32]
    image: Floats
    extra_image: Floats


@dataclass(frozen=True)
class Rendered:
    """An image and what its gradient needs.

    Attributes:
        color: [H, W, 3], background included.
        alpha: [H, W] in [0, 1].
        depth: [H, W] sum of w_i z_i in scene units, not divided by alpha.
        extra: [H, W, C] blended extra channels, C = 0 without any.
        median_depth: [H, W] z of the Gaussian at which the transmittance falls below 0.5; 0 where
            alpha < 0.5. Has no gradient.
        visible: [N] whether the Gaussian's ellipse touches the image.
        saved: state for render_backward.
    """

    color: Floats
    alpha: Floats
    depth: Floats
    extra: Floats
    median_depth: Floats
    visible: NDArray[np.bool_]
    saved: Saved

    @property
    def num_visible(self) -> int:
        """Number of Gaussians whose ellipse touches the image."""
        return int(np.count_nonzero(self.visible))


@dataclass(frozen=True)
class Gradients:
    """Gradients of a scalar loss with respect to the inputs of render.

    Attributes:
        means: [N, 3].
        quats: [N, 4], orthogonal to quats (they are normalised inside).
        scales: [N, 3].
        opacities: [N].
        colors: [N, 3].
        extra: [N, C].
        means2d_abs: [N] norm of the gradient with respect to the projected centre, per pixel.
            Times max(W, H) / 2 it compares with 3DGS's densification threshold 0.0002.
        visible: [N] whether the Gaussian's ellipse touches the image.
    """

    means: Floats
    quats: Floats
    scales: Floats
    opacities: Floats
    colors: Floats
    extra: Floats
    means2d_abs: Floats
    visible: NDArray[np.bool_]


def render(means: Floats, quats: Floats, scales: Floats, opacities: Floats, colors: Floats,
           viewmat: ArrayLike, K: ArrayLike, width: int, height: int, *,
           extra: Floats | None = None, background: ArrayLike | None = None) -> Rendered:
    """Render Gaussians into one pinhole camera.

    Args:
        means: [N, 3] world frame, scene units; their dtype (float32 or float64) is used throughout.
        quats: [N, 4] wxyz of any length; normalised inside.
        scales: [N, 3] standard deviations, scene units.
        opacities: [N] in [0, 1].
        colors: [N, 3].
        viewmat: [4, 4] camera_from_world, OpenCV axes.
        K: [3, 3] pixels, no skew, pixel centres at +0.5.
        width: pixels.
        height: pixels.
        extra: [N, C] further channels to blend.
        background: [3] colour behind everything; black without.

    Returns:
        The images. A Gaussian with a value that is not finite is left out.
    """
    double = np.asarray(means).dtype == np.float64
    dtype: np.dtype[np.floating] = np.dtype(np.float64) if double else np.dtype(np.float32)
    n = len(means)
    means, quats, scales, opacities, colors = (
        _array(a, dtype) for a in (means, quats, scales, opacities, colors))
    extras = np.zeros((n, 0), dtype) if extra is None else _array(extra, dtype)
    behind = np.zeros(3, dtype) if background is None else _array(background, dtype)
    view = np.ascontiguousarray(viewmat, np.float64)
    camera = _camera(np.asarray(K, np.float64), width, height)
    packed, boxes = np.zeros((n, PACKED), dtype), np.zeros((n, 4), np.int32)
    visible = np.zeros(n, np.bool_)
    project(means, quats, scales, opacities, colors, extras, view, camera, width, height, packed,
            boxes, visible)
    tiles_x, tiles_y = -(-width // TILE_X), -(-height // TILE_Y)
    tile_first, ids, first, slots = bin_gaussians(
        _front_to_back(packed[:, 10]), visible, boxes, tiles_x, tiles_y)
    tile_order = _shared_out(np.diff(tile_first))
    image = np.zeros((height, width, 6), dtype)
    extra_image = np.zeros((height, width, extras.shape[1]), dtype)
    needed = np.zeros(tiles_x * tiles_y, np.int32)
    kernels.forward(tile_order, tile_first, ids, packed, boxes, extras, behind, image, extra_image,
                    needed)
    saved = Saved(means, quats, scales, opacities, extras, view, camera, packed, boxes, tile_order,
                  tile_first, ids, first, slots, needed, image, extra_image)
    return Rendered(image[..., :3], image[..., 3], image[..., 4], extra_image, image[..., 5],
                    visible, saved)


def render_backward(rendered: Rendered, d_color: Floats | None, d_alpha: Floats | None = None,
                    d_depth: Floats | None = None, d_extra: Floats | None = None) -> Gradients:
    """Return the gradients of a loss from those of its images.

    Args:
        rendered: what render returned.
        d_color: [H, W, 3] dL/dcolor; None where the loss does not use an image, here and below.
        d_alpha: [H, W].
        d_depth: [H, W].
        d_extra: [H, W, C].

    Returns:
        Gradients in the dtype of the rendering; zero for Gaussians out of sight.
    """
    s = rendered.saved
    dtype, n = s.image.dtype, len(s.means)
    d_image = np.zeros((*s.image.shape[:2], 5), dtype)
    for part, gradient in ((slice(0, 3), d_color), (3, d_alpha), (4, d_depth)):
        if gradient is not None:
            d_image[..., part] = gradient
    d_channels = np.zeros_like(s.extra_image) if d_extra is None else _array(d_extra, dtype)
    partial = np.zeros((len(s.ids), GRADS + s.extra.shape[1]), dtype)
    kernels.backward(s.tile_order, s.tile_first, s.ids, s.needed, s.packed, s.boxes, s.extra,
                     s.image, s.extra_image, d_image, d_channels, partial)
    g = Gradients(np.zeros((n, 3), dtype), np.zeros((n, 4), dtype), np.zeros((n, 3), dtype),
                  np.zeros(n, dtype), np.zeros((n, 3), dtype), np.zeros_like(s.extra),
                  np.zeros(n, dtype), rendered.visible)
    project_backward(s.means, s.quats, s.scales, s.opacities, s.view, s.camera, s.first, s.slots,
                     partial, g.means, g.quats, g.scales, g.opacities, g.colors, g.extra,
                     g.means2d_abs)
    return g


def _array(values: ArrayLike, dtype: np.dtype[np.floating]) -> Floats:
    """Return a C-contiguous array of the dtype, the same one where it is already."""
    return np.ascontiguousarray(values, dtype=dtype)


def _camera(K: Floats, width: int, height: int) -> Floats:
    """Pack intrinsics, the limits of the Jacobian's direction, and the near plane."""
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    mx, my = FOV_MARGIN * 0.5 * width / fx, FOV_MARGIN * 0.5 * height / fy
    return np.array([fx, fy, cx, cy, -cx / fx - mx, (width - cx) / fx + mx,
                     -cy / fy - my, (height - cy) / fy + my, NEAR])


def _front_to_back(depth: Floats) -> NDArray[np.int64]:
    """Indices by increasing depth, ties by index."""
    if depth.dtype != np.float32:
        return np.argsort(depth, kind="stable")
    # Positive float32 sort like their bits; sorting unique integers is faster than a stable sort.
    keys = depth.astype(np.float32).view(np.uint32).astype(np.uint64) << np.uint64(32)
    keys |= np.arange(len(depth), dtype=np.uint64)
    keys.sort()
    return (keys & np.uint64(0xFFFFFFFF)).astype(np.int64)


def _shared_out(work: NDArray[np.int64]) -> NDArray[np.int64]:
    """Order tiles so that equal contiguous shares of them hold about equal work."""
    order, threads = np.argsort(-work, kind="stable"), numba.get_num_threads()
    return np.concatenate([order[t::threads] for t in range(threads)])
