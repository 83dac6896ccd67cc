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
from numpy.typing import ArrayLike, DTypeLike, NDArray

from part2gs_robotics.model.gaussians import Splats
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.render.backward import BACKWARD_SIZE, backward
from part2gs_robotics.render.backward_projection import CARRY_SIZE, GRADS, carry_back
from part2gs_robotics.render.ellipses import Floats
from part2gs_robotics.render.forward import FORWARD_SIZE, forward, median_depth
from part2gs_robotics.render.project import FOV_MARGIN, PACKED, PROJECT_SIZE, project
from part2gs_robotics.render.rendered import Gradients, Kept, Near, Rendered
from part2gs_robotics.render.tiles import (
    PAIR,
    PIECES,
    RAMP,
    SPANS_SIZE,
    TILE_X,
    TILE_Y,
    add_up,
    ask_near,
    depth_keys,
    list_pairs,
    place_pairs,
    set_cursors,
    share_out,
)
from part2gs_robotics.runtime.buffers import Workspace
from part2gs_robotics.runtime.simd import LANES

NEAR = 0.01  # internal units, 1/400 of a camera's distance: nearer, Jacobians mean nothing (gsplat)
TILE = TILE_Y * LANES


@dataclass(frozen=True)
class Pairs:
    """Every (tile, Gaussian) pair, tile by tile and front to back within one.

    Attributes:
        tile_first: [tiles + 1] pairs of tile j are tile_first[j] to tile_first[j + 1].
        table: [M, 4] Gaussian, place among the pairs ordered by Gaussian, first row of the tile
            that the pair covers, and the row after the last.
        first: [N + 1] pairs of Gaussian i have the places first[i] to first[i + 1].
        shares: tiles cut into pieces of about equal work.
    """

    tile_first: NDArray[np.int64]
    table: NDArray[np.int32]
    first: NDArray[np.int64]
    shares: NDArray[np.int64]


@dataclass(frozen=True)
class Saved:
    """What the backward pass needs of the forward pass."""

    means: Floats
    quats: Floats
    scales: Floats
    opacities: Floats
    channels: Floats
    view: Floats
    lens: Floats
    packed: Floats
    pairs: Pairs
    needed: NDArray[np.int32]
    workspace: Workspace
    gradients: Workspace | None
    generation: int
    size: tuple[int, int]

    def median_depth(self) -> Floats:
        """Return the image [H, W] of Rendered.median_depth."""
        _standing(self)
        image = np.zeros(self.size, self.packed.dtype)
        median_depth(self.pairs.shares, self.pairs.tile_first, self.pairs.table, self.needed,
                     self.packed, _ramp(self.workspace, image.dtype), image)
        return image


def render(splats: Splats, camera: Camera, *, extra: Floats | None = None,
           background: ArrayLike | None = None, workspace: Workspace | None = None,
           near: Near | None = None) -> Rendered:
    """Render Gaussians into one pinhole camera.

    Args:
        splats: N Gaussians; the dtype of their means, float32 or float64, is used throughout.
        camera: pinhole.
        extra: [N, C] further channels to blend.
        background: [3] colour behind everything; black without.
        workspace: buffers to use again. The images and gradients are then valid until the next
            rendering with it only; nothing is allocated once they have grown.
        near: what of the image is asked for, None = all; tiles farther off stay empty.

    Returns:
        The images. A Gaussian with a value that is not finite is left out.
    """
    double = np.asarray(splats.means).dtype == np.float64
    dtype: np.dtype[np.floating] = np.dtype(np.float64) if double else np.dtype(np.float32)
    n, work = len(splats), workspace or Workspace()
    work.generation += 1
    means, quats, scales, opacities, colors = (
        _array(a, dtype) for a in (splats.means, splats.quats, splats.scales, splats.opacities,
                                   splats.colors))
    channels = np.zeros((n, 0), dtype) if extra is None else _array(extra, dtype)
    behind = np.zeros(3, dtype) if background is None else _array(background, dtype)
    width, height = camera.width, camera.height
    view = np.ascontiguousarray(camera.viewmat, np.float64)
    lens = _lens(np.asarray(camera.K, np.float64), width, height)
    packed, boxes = work.take("packed", (n, PACKED), dtype), work.take("boxes", (n, 4), np.int32)
    visible = work.take("visible", (n,), np.bool_)
    project(means, quats, scales, opacities, colors, channels, view, lens, width, height,
            _scratch(work, PROJECT_SIZE, np.float64), packed, boxes, visible)
    asked = work.take("asked", (-(-height // TILE_Y), -(-width // TILE_X)), np.bool_)
    asked[:] = True
    if near is not None:
        ask_near(near.own, near.reach, boxes, visible, asked)
    pairs = _pairs(packed, boxes, visible, asked, work)
    needed = work.take("needed", (len(pairs.tile_first) - 1,), np.int32)
    color, extra_image = (work.take(name, (height, width, c), dtype)
                          for name, c in (("color", 3), ("extra", channels.shape[1])))
    alpha, depth = (work.take(name, (height, width), dtype) for name in ("alpha", "depth"))
    forward(pairs.shares, pairs.tile_first, pairs.table, packed, channels, behind,
            _ramp(work, dtype), _scratch(work, FORWARD_SIZE + channels.shape[1] * TILE, dtype),
            color, alpha, depth, extra_image, needed)
    saved = Saved(means, quats, scales, opacities, channels, view, lens, packed, pairs, needed,
                  work, workspace, work.generation, (height, width))
    return Rendered(color, alpha, depth, extra_image, visible, saved)


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

    Raises:
        RuntimeError: the workspace has been used for another rendering since.
        TypeError: another device drew it.
    """
    s = _standing(rendered.saved)
    dtype, n, work, width = rendered.alpha.dtype, len(s.means), s.workspace, s.channels.shape[1]
    partial = work.take("partial", (len(s.pairs.table), GRADS + width), dtype)
    d_color, d_alpha, d_depth, d_extra = (
        np.zeros((0,) * image.ndim, dtype) if gradient is None else _array(gradient, dtype)
        for image, gradient in ((rendered.color, d_color), (rendered.alpha, d_alpha),
                                (rendered.depth, d_depth), (rendered.extra, d_extra)))
    backward(s.pairs.shares, s.pairs.tile_first, s.pairs.table, s.needed, s.packed, s.channels,
             _ramp(work, dtype), _scratch(work, BACKWARD_SIZE + width * TILE, dtype),
             rendered.color, rendered.alpha, rendered.depth, rendered.extra, d_color, d_alpha,
             d_depth, d_extra, partial)
    out = s.gradients or Workspace()
    g = Gradients(
        means=out.take("d_means", (n, 3), dtype), quats=out.take("d_quats", (n, 4), dtype),
        scales=out.take("d_scales", (n, 3), dtype), colors=out.take("d_colors", (n, 3), dtype),
        opacities=out.take("d_opacities", (n,), dtype),
        extra=out.take("d_extra", (n, width), dtype),
        means2d_abs=out.take("d_screen", (n,), dtype), visible=rendered.visible)
    carry_back(s.means, s.quats, s.scales, s.opacities, s.view, s.lens, s.pairs.first, partial,
               _scratch(work, CARRY_SIZE, np.float64), g.means, g.quats, g.scales, g.opacities,
               g.colors, g.extra, g.means2d_abs)
    return g


def _pairs(packed: Floats, boxes: NDArray[np.int32], visible: NDArray[np.bool_],
           asked: NDArray[np.bool_], work: Workspace) -> Pairs:
    """List the Gaussians of every tile that is asked for."""
    n, threads, dtype = len(packed), numba.get_num_threads(), packed.dtype
    order, seen = _front_to_back(packed, visible, work), int(np.count_nonzero(visible))
    chunks = np.linspace(0, n, threads + 1).astype(np.int64)
    spans = work.take("spans", (threads, SPANS_SIZE), dtype)
    spans[:, RAMP:RAMP + LANES] = np.arange(LANES)
    histogram = work.take("histogram", (threads, asked.size), np.int32)
    first, counts = work.take("first", (n + 1,), np.int64), np.zeros(threads, np.int64)
    first[0] = 0
    while True:
        listed = work.take("listed", (threads, work.room, PAIR), np.int32)
        list_pairs(order, seen, packed, boxes, asked, chunks, spans, listed, counts, histogram,
                   first)
        if counts.max() <= work.room:
            break
        work.room = int(1.25 * counts.max())  # as Workspace.take grows
    add_up(first)
    tile_first = work.take("tile_first", (asked.size + 1,), np.int64)
    set_cursors(histogram, tile_first)
    table = work.take("pairs", (int(first[-1]), PAIR), np.int32)
    place_pairs(listed, counts, histogram, first, table)
    shares = work.take("shares", (threads * PIECES + 1,), np.int64)
    share_out(tile_first, shares)
    return Pairs(tile_first, table, first, shares)


def _front_to_back(packed: Floats, visible: NDArray[np.bool_], work: Workspace,
                   ) -> NDArray[np.int64]:
    """Indices by increasing depth, ties by index, those out of sight last."""
    if packed.dtype != np.float32:
        return np.argsort(np.where(visible, packed[:, 10], np.inf), kind="stable")
    keys = work.take("keys", (len(packed),), np.uint64)
    depth_keys(packed, visible, keys)
    keys.sort()
    np.bitwise_and(keys, np.uint64(0xFFFFFFFF), out=keys)
    return keys.view(np.int64)


def _standing(saved: Kept) -> Saved:
    """Return our saved state, if its arrays have not been used again."""
    if not isinstance(saved, Saved):
        raise TypeError(f"this rendering holds {type(saved).__name__}. Expected one of the CPU; "
                        "go back through dispatch.render_backward, which asks the right device.")
    if saved.generation != saved.workspace.generation:
        raise RuntimeError(f"this rendering is number {saved.generation} of its workspace, which "
                           f"has drawn {saved.workspace.generation}. Expected the latest; give "
                           "renderings that live side by side a workspace each.")
    return saved


def _array(values: ArrayLike, dtype: DTypeLike) -> Floats:
    """Return a C-contiguous array of the dtype, the same one where it is already."""
    return np.ascontiguousarray(values, dtype=dtype)


def _scratch(work: Workspace, size: int, dtype: DTypeLike) -> Floats:
    """Return a row of planes for every thread."""
    return work.take("scratch", (numba.get_num_threads(), size), dtype)


def _ramp(work: Workspace, dtype: DTypeLike) -> Floats:
    """Return the numbers 0 to 7."""
    ramp = work.take("ramp", (LANES,), dtype)
    ramp[:] = np.arange(LANES)
    return ramp


def _lens(K: Floats, width: int, height: int) -> Floats:
    """Pack intrinsics, the limits of the Jacobian's direction, and the near plane."""
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    mx, my = FOV_MARGIN * 0.5 * width / fx, FOV_MARGIN * 0.5 * height / fy
    return np.array([fx, fy, cx, cy, -cx / fx - mx, (width - cx) / fx + mx,
                     -cy / fy - my, (height - cy) / fy + my, NEAR])
