"""The yardstick of benchmarks/raster.py: a plain Numba tile rasteriser, forward and backward.

What one writes first, with care but without tricks: 16 x 16 tiles, the box of each ellipse, argsort
by depth, a counting sort into tiles, scalar loops with math.exp, one row of gradients per listed
Gaussian, summed per Gaussian. float32, fastmath, parallel over tiles. Its images and gradients are
those of part2gs_robotics.render.cpu up to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from raster_naive_project import FOV_MARGIN, GRADS, PACKED, project, project_backward
from raster_naive_tiles import TILE, backward, forward

from part2gs_robotics.model.gaussians import Splats
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.render.cpu import Gradients

F32 = NDArray[np.float32]
GRADIENT_SHAPES = ((3,), (4,), (3,), (), (3,), (0,), ())  # in the order of Gradients


@dataclass(frozen=True)
class NaiveSaved:
    """What the backward pass needs of the forward pass."""

    means: F32
    quats: F32
    scales: F32
    view: NDArray[np.float64]
    lens: NDArray[np.float64]
    packed: F32
    boxes: NDArray[np.int32]
    tile_first: NDArray[np.int64]
    ids: NDArray[np.int32]
    first: NDArray[np.int64]
    slots: NDArray[np.int32]
    background: F32
    image: F32
    last: NDArray[np.int32]


@dataclass(frozen=True)
class NaiveRendered:
    """Images as in render.cpu.Rendered, those that a fit uses."""

    color: F32
    alpha: F32
    depth: F32
    extra: F32
    visible: NDArray[np.bool_]
    saved: NaiveSaved


def render(splats: Splats, camera: Camera, *, background: ArrayLike | None = None,
           **_: object) -> NaiveRendered:
    """Render float32 Gaussians with the arguments of render.cpu.render, without extra channels."""
    width, height, view = camera.width, camera.height, np.array(camera.viewmat, np.float64)
    lens = _lens(np.asarray(camera.K, np.float64), width, height)
    means, quats, scales = (np.ascontiguousarray(a, np.float32)
                            for a in (splats.means, splats.quats, splats.scales))
    opacities, colors = splats.opacities, splats.colors
    behind = np.zeros(3, np.float32) if background is None else np.asarray(background, np.float32)
    packed, boxes = np.zeros((len(means), PACKED), np.float32), np.zeros((len(means), 4), np.int32)
    project(means, quats, scales, opacities, colors, view, lens, width, height, packed, boxes)
    order = np.argsort(packed[:, 9])
    tile_first, ids, first, slots = _bin(order, boxes, -(-width // TILE), -(-height // TILE))
    image = np.zeros((height, width, 5), np.float32)  # r, g, b, transmittance, z
    last = np.zeros((height, width), np.int32)  # Gaussians of the tile up to the last one blended
    forward(tile_first, ids, packed, boxes, behind, image, last)
    saved = NaiveSaved(means, quats, scales, view, lens, packed, boxes, tile_first, ids, first,
                       slots, behind, image, last)
    return NaiveRendered(image[..., :3], np.float32(1) - image[..., 3], image[..., 4],
                         np.zeros((height, width, 0), np.float32), np.diff(first) > 0, saved)


def render_backward(rendered: NaiveRendered, d_color: F32 | None, d_alpha: F32 | None = None,
                    d_depth: F32 | None = None, d_extra: F32 | None = None, **_: object
                    ) -> Gradients:
    """Return the gradients of a loss with the arguments of render.cpu.render_backward."""
    s = rendered.saved
    d_image = np.zeros((*s.image.shape[:2], 5), np.float32)
    for part, gradient in ((slice(0, 3), d_color), (3, d_alpha), (4, d_depth)):
        if gradient is not None:
            d_image[..., part] = gradient
    partial = np.zeros((len(s.ids), GRADS), np.float32)
    backward(s.tile_first, s.ids, s.packed, s.boxes, s.background, s.image, s.last, d_image,
             partial)
    g = Gradients(*(np.zeros((len(s.means), *shape), np.float32) for shape in GRADIENT_SHAPES),
                  rendered.visible)
    project_backward(s.means, s.quats, s.scales, s.view, s.lens, s.packed, s.first, s.slots,
                     partial, g.means, g.quats, g.scales, g.opacities, g.colors, g.means2d_abs)
    return g


def _lens(K: NDArray[np.float64], width: int, height: int) -> NDArray[np.float64]:
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    mx, my = FOV_MARGIN * 0.5 * width / fx, FOV_MARGIN * 0.5 * height / fy
    return np.array([fx, fy, cx, cy, -cx / fx - mx, (width - cx) / fx + mx,
                     -cy / fy - my, (height - cy) / fy + my])


@njit(cache=True)
def _bin(order, boxes, tiles_x, tiles_y):
    """List each tile's Gaussians front to back; slots say where each Gaussian is listed."""
    tile_first = np.zeros(tiles_x * tiles_y + 1, np.int64)
    first = np.zeros(len(boxes) + 1, np.int64)
    for i in range(len(boxes)):
        first[i + 1] = first[i]
        for ty in range(boxes[i, 1] // TILE, (boxes[i, 3] - 1) // TILE + 1):
            for tx in range(boxes[i, 0] // TILE, (boxes[i, 2] - 1) // TILE + 1):
                tile_first[ty * tiles_x + tx + 1] += 1
                first[i + 1] += 1
    tile_first = np.cumsum(tile_first)
    cursor = tile_first.copy()
    ids, slots = np.zeros(first[-1], np.int32), np.zeros(first[-1], np.int32)
    for i in order:
        k = first[i]
        for ty in range(boxes[i, 1] // TILE, (boxes[i, 3] - 1) // TILE + 1):
            for tx in range(boxes[i, 0] // TILE, (boxes[i, 2] - 1) // TILE + 1):
                place = cursor[ty * tiles_x + tx]
                cursor[ty * tiles_x + tx] += 1
                ids[place] = i
                slots[k] = place
                k += 1
    return tile_first, ids, first, slots
