"""Depth smoothness: where a photo shows no edge, a surface has no jump and no bend.

Colours cannot tell the depth inside a plain wall; its outline can. The inverse depth of a plane is
affine in the pixel, so its second difference is zero over any span.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.render_cpu import Rendered
from part2gs_robotics.render_jit import kernel, parallel_kernel

Floats = NDArray[np.floating]

SPANS = np.array([1, 2, 4, 8, 16])  # pixels: short ones calm noise, long ones carry the outline in
EDGE = 0.08  # of the colour range, summed along a span: there a bend costs a third
DEAD = 0.012  # of the colour range per pixel: three grey levels of noise are no edge
SOFT = 0.02  # of the diagonal: beyond, a bend is more likely a real jump and pulls less
SOLID = 0.5  # rendered alpha from which a pixel has a depth
COVERED = 0.98  # photo's alpha from which a pixel shows the object alone


def smooth_term(rendered: Rendered, photo: Floats, mask: Floats, diagonal: float, weight: float,
                ) -> tuple[float, Floats, Floats]:
    """Return the smoothness loss and its gradients by sum w z and by alpha.

    Equation: weight / pixels * sum over spans s, rows and columns, of
    exp(-edge / EDGE) * SOFT * log(1 + |u(-s) - 2 u(0) + u(s)| d^2 / (diagonal SOFT)), where u is
    the inverse depth alpha / sum w z, d = 1 / u is held constant, and edge is the total variation
    of the photo along the span.
    Source: edge-aware second-order smoothness (Woodford et al. 2008) on several scales.

    Args:
        rendered: with `depth` = sum w z and `alpha`.
        photo: [H, W, 3] colours of the view, without background.
        mask: [H, W] alpha of the photo.
        diagonal: of the object, scene units.
        weight: of the term.
    """
    by_depth, by_alpha = np.zeros_like(rendered.depth), np.zeros_like(rendered.alpha)
    rows, cols = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return 0.0, by_depth, by_alpha
    box = slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1)
    depth, alpha = rendered.depth[box], rendered.alpha[box]
    solid = (mask[box] > COVERED) & (alpha > SOLID) & (depth > 0)
    inverse = np.where(solid, alpha / np.where(solid, depth, 1), 0).astype(np.float64)
    color = np.ascontiguousarray(photo[box], np.float64)
    grad, across = np.zeros_like(inverse), np.zeros_like(inverse.T, order="C")
    loss = _bends(inverse, color, diagonal, SPANS, grad)
    loss += _bends(np.ascontiguousarray(inverse.T), np.ascontiguousarray(color.transpose(1, 0, 2)),
                   diagonal, SPANS, across)
    scale = weight / mask.size
    grad = scale * (grad + across.T)
    safe = np.where(solid, depth, 1)
    by_depth[box] = np.where(solid, -grad * alpha / safe**2, 0)
    by_alpha[box] = np.where(solid, grad / safe, 0)
    return scale * loss, by_depth, by_alpha


@kernel
def _bends_of_row(inverse: Floats, color: Floats, diagonal: float, spans: NDArray[np.int64],
                  edges: Floats, grad: Floats) -> float:
    """Return one row's loss, fill its gradient; `edges` holds the running total variation."""
    width = len(inverse)
    for j in range(1, width):
        step = 0.0
        for c in range(3):
            step = max(step, abs(color[j, c] - color[j - 1, c]))
        gap = inverse[j] == 0.0 or inverse[j - 1] == 0.0
        edges[j] = edges[j - 1] + (1e3 if gap else max(step - DEAD, 0.0))
    loss = 0.0
    for s in spans:
        for j in range(s, width - s):
            edge = edges[j + s] - edges[j - s]
            if inverse[j] == 0.0 or edge > 5 * EDGE:  # e^-5: counts for nothing
                continue
            size = 1.0 / (inverse[j] * inverse[j] * diagonal * SOFT)
            bend = (inverse[j - s] - 2 * inverse[j] + inverse[j + s]) * size
            weight = SOFT * np.exp(-edge / EDGE)
            loss += weight * np.log1p(abs(bend))
            pull = weight * np.sign(bend) / (1 + abs(bend)) * size
            grad[j - s] += pull
            grad[j] -= 2 * pull
            grad[j + s] += pull
    return loss


@parallel_kernel
def _bends(inverse: Floats, color: Floats, diagonal: float, spans: NDArray[np.int64],
           grad: Floats) -> float:
    height, width = inverse.shape
    losses = np.zeros(height)
    for i in numba.prange(height):
        losses[i] = _bends_of_row(inverse[i], color[i], diagonal, spans, np.zeros(width), grad[i])
    return losses.sum()
