"""Part maps: first-surface depth of one state with the part seen in every pixel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.evidence.depth_maps import SOLID_ALPHA, DepthMaps
from part2gs_robotics.model.arrays import F32
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel

NO_PART = 255  # label of a pixel without a part


@dataclass(frozen=True)
class PartMaps:
    """Depth maps of one state with the part seen in every pixel.

    Attributes:
        maps: first-surface depth.
        labels: [V, H, W] uint8 part index of the first surface, NO_PART where there is none.
    """

    maps: DepthMaps
    labels: NDArray[np.uint8]

    @cached_property
    def facing(self) -> F32:
        """[V, H, W] plane distance per unit of depth difference, 0 where no plane is known."""
        out = np.zeros(self.maps.depths.shape, np.float32)
        _facing(self.maps.depths, np.ascontiguousarray(self.maps.Ks, np.float64), out)
        return out


def render_part_maps(gaussians: Gaussians, part_probs: F32, state: StateViews) -> PartMaps:
    """Return depth and part of the first surface in every view of a state that was trained on.

    Depth images of the scene are used where there are some, else the median depth of the
    Gaussians; the part is the most likely one of the blended part identities.

    Args:
        gaussians: of this state.
        part_probs: [N, K+1], column 0 = base.
        state: the views; held-out ones are left out, their masks judge the result.
    """
    from part2gs_robotics.render.dispatch import render

    used = np.flatnonzero(~state.held_out)
    depths = np.zeros((len(used), *state.alphas.shape[1:]), np.float32)
    labels = np.full(depths.shape, NO_PART, np.uint8)
    splats = gaussians.splats
    for row, v in enumerate(used):
        seen = render(splats, state.camera(int(v)), extra=part_probs)
        solid = (seen.alpha > SOLID_ALPHA) & (state.alphas[v] > SOLID_ALPHA * 255)
        depth = seen.median_depth if state.depths is None else state.depths[v]
        depths[row] = np.where(solid, depth, 0.0)
        labels[row] = np.where(solid & (depth > 0), seen.extra.argmax(-1), NO_PART)
    return PartMaps(DepthMaps(depths, state.alphas[used], state.Ks[used], state.viewmats[used]),
                    labels)


@inlined
def _slope(before: float, here: float, after: float) -> float:
    """Return the smaller one-sided difference of inverse depth; inf where both are unknown."""
    a = 1.0 / here - 1.0 / before if before > 0.0 else np.inf
    b = 1.0 / after - 1.0 / here if after > 0.0 else np.inf
    return a if abs(a) < abs(b) else b


@kernel
def _facing(depths: F32, Ks: NDArray[np.float64], out: F32) -> None:
    # On a plane inverse depth is affine in the pixel, so its slope is the plane's normal.
    views, height, width = depths.shape
    for_each(views, _facing_at, (depths, Ks, out, height, width))


@inlined
def _facing_at(v: int, depths: F32, Ks: NDArray[np.float64], out: F32, height: int,
               width: int) -> None:
    d, fx, fy, cx, cy = depths[v], Ks[v, 0, 0], Ks[v, 1, 1], Ks[v, 0, 2], Ks[v, 1, 2]
    for i in range(height):
        for j in range(width):
            here = d[i, j]
            if here <= 0.0:
                continue
            su = fx * _slope(d[i, max(j - 1, 0)] if j > 0 else 0.0, here,
                             d[i, j + 1] if j + 1 < width else 0.0)
            sv = fy * _slope(d[i - 1, j] if i > 0 else 0.0, here,
                             d[i + 1, j] if i + 1 < height else 0.0)
            if not (abs(su) < 1e12 and abs(sv) < 1e12):
                continue
            inverse = 1.0 / here
            sz = inverse - (j + 0.5 - cx) / fx * su - (i + 0.5 - cy) / fy * sv
            out[v, i, j] = inverse / np.sqrt(su * su + sv * sv + sz * sz)
