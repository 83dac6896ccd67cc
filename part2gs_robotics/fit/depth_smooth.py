"""Depth smoothness: where a photo shows no edge, a surface has no jump and no bend.

Colours cannot tell the depth inside a plain wall; its outline can. The inverse depth of a plane is
affine in the pixel, so its second difference is zero over any span.
"""

from __future__ import annotations

import numpy as np
from numba import get_num_threads
from numpy.typing import NDArray

from part2gs_robotics.fit.depth_smooth_kernels import PAD, STRIP, along_columns, along_rows
from part2gs_robotics.render.rendered import Rendered
from part2gs_robotics.runtime.buffers import Workspace

Floats = NDArray[np.floating]


def smooth_term(rendered: Rendered, photo: NDArray[np.generic], mask: Floats, diagonal: float,
                weight: float, workspace: Workspace | None = None,
                ) -> tuple[float, Floats, Floats]:
    """Return the smoothness loss and its gradients by sum w z and by alpha.

    Equation: weight / pixels * sum over spans s, rows and columns, of
    exp(-edge / EDGE) * SOFT * log(1 + |u(-s) - 2 u(0) + u(s)| d^2 / (diagonal SOFT)), where u is
    the inverse depth alpha / sum w z, d = 1 / u is held constant, and edge is the total variation
    of the photo along the span.
    Source: edge-aware second-order smoothness (Woodford et al. 2008) on several scales.

    Args:
        rendered: with `depth` = sum w z and `alpha`.
        photo: [H, W, 3] colours of the view, without background, uint8 or in [0, 1].
        mask: [H, W] alpha of the photo.
        diagonal: of the object, scene units.
        weight: of the term.
        workspace: buffers to use again; gradients are then valid until the next call with it.
    """
    work, dtype = workspace or Workspace(), rendered.depth.dtype
    by_depth, by_alpha = (work.take(f"smooth_by_{name}", mask.shape, dtype)
                          for name in ("depth", "alpha"))
    by_depth[:], by_alpha[:] = 0, 0
    rows, cols = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return 0.0, by_depth, by_alpha
    y0, x0, height, width = (int(v) for v in (rows[0], cols[0], np.ptp(rows) + 1, np.ptp(cols) + 1))
    stride = -(-width // STRIP) * STRIP + 2 * PAD
    inverse, size, grad = (work.take(f"smooth_{name}", (height, stride), dtype)
                           for name in ("inverse", "size", "grad"))
    scratch = work.take("smooth_scratch", (
        get_num_threads(), 3 * max(stride, (height + 2 * PAD) * STRIP)), dtype)
    losses = work.take("smooth_losses", (height + (stride - 2 * PAD) // STRIP,), np.float64)
    range_of = 255.0 if photo.dtype == np.uint8 else 1.0
    scale = weight / mask.size
    along_rows(rendered.depth, rendered.alpha, photo, mask, y0, x0, width, diagonal, range_of,
                inverse, size, grad, scratch, losses)
    along_columns(rendered.depth, rendered.alpha, photo, y0, x0, width, range_of, scale, inverse,
                   size, grad, scratch, by_depth, by_alpha, losses)
    return scale * float(losses.sum()), by_depth, by_alpha
