"""Views: what of a photo may be trusted for colours, with the twin's own depth in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32, F64

SOLID = 250  # of 255: a pixel that shows the object alone
EDGE_PIXELS = 3.0  # from silhouettes and depth edges; there the photo may show what is behind
JUMP = 0.01  # of the size: such a step between neighbours' depths is an edge


@dataclass(frozen=True)
class Views:
    """Some photos of one state.

    Attributes:
        images: [V, H, W, 3] uint8.
        trust: [V, H, W] float32 0..1, 0 where the photo shows no object alone.
        depths: [V, H, W] float32 depth of the posed twin, infinite beside it.
        Ks: [V, 3, 3] pixels.
        viewmats: [V, 4, 4] camera from world.
    """

    images: NDArray[np.uint8]
    trust: F32
    depths: F32
    Ks: F64
    viewmats: F64


def trusted(alphas: NDArray[np.uint8], depths: F32, size: float) -> F32:
    """Return [V, H, W] how far every pixel is from silhouettes and depth edges, 0..1.

    Args:
        alphas: [V, H, W].
        depths: [V, H, W] of the posed twin.
        size: of the twin, scene units.
    """
    import cv2

    out = np.zeros(depths.shape, np.float32)
    for alpha, depth, into in zip(alphas, depths, out, strict=True):
        edge = np.zeros(depth.shape, bool)
        with np.errstate(invalid="ignore"):
            for axis in (0, 1):
                step = np.abs(np.diff(depth, axis=axis)) > JUMP * size
                one = np.s_[:-1] if axis == 0 else np.s_[:, :-1]
                two = np.s_[1:] if axis == 0 else np.s_[:, 1:]
                edge[one] |= step
                edge[two] |= step
        inner = cv2.distanceTransform((~edge).astype(np.uint8), cv2.DIST_L2, 3)
        solid = cv2.distanceTransform((alpha >= SOLID).astype(np.uint8), cv2.DIST_L2, 3)
        near = np.minimum(inner, solid) / EDGE_PIXELS
        into[:] = np.where(solid > 0, np.clip(near, 1e-3, 1.0), 0.0)
    return out
