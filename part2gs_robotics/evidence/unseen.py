"""Unseen: Gaussians that no photo shows, inside or behind a surface, with colours never tested.

A part that moves, or leaves, bares them: speckles along seams that no photo has. They make true
motions look worse, and pull on joints that are aligned to the images.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.small_views import SmallViews
from part2gs_robotics.render.dispatch import render, render_backward
from part2gs_robotics.render.ellipses import LOW_PASS
from part2gs_robotics.runtime.buffers import Workspace

VIEWS, SIDE = 24, 200  # photos that tell, and their longest side: 48 change 2 % of the answers
LEAST = 0.05  # of what it could cover in the view that shows most of it: less is a leak
CLEAR = -20.0  # logit of an opacity that nothing draws


def without_unseen(gaussians: Gaussians, views: SmallViews) -> Gaussians:
    """Return the Gaussians, all of them, with those that no view shows made clear.

    Args:
        gaussians: of one state.
        views: of the same state.
    """
    shown = shares_shown(gaussians, views) >= LEAST
    logits = np.where(shown, gaussians.logit_opacities, np.float32(CLEAR))
    return replace(gaussians, logit_opacities=logits)


def shares_shown(gaussians: Gaussians, views: SmallViews) -> NDArray[np.float64]:
    """Return [N] the share of its opacity over its footprint that the best view shows of each.

    What a Gaussian adds to an image is the gradient of the image's sum by its colour.

    Args:
        gaussians: of one state.
        views: of the same state.
    """
    best, work = np.zeros(len(gaussians)), Workspace()
    white = np.ones((len(gaussians), 3), np.float32)
    splats = replace(gaussians.splats, colors=white)
    broad = np.sort(gaussians.scales.astype(np.float64), axis=1)[:, 1:]
    for v in range(len(views)):
        view, K = views.viewmats[v], views.Ks[v]
        out = render(splats, views.camera(v), workspace=work)
        one = np.zeros((*views.alphas[v].shape, 3), np.float32)
        one[..., 0] = 1.0
        added = np.asarray(render_backward(out, one).colors)[:, 0]
        depth = np.maximum(gaussians.means @ view[2, :3] + view[2, 3], 1e-6)
        widths = (broad * (K[0, 0] / depth)[:, None]) ** 2 + LOW_PASS
        footprint = 2 * np.pi * np.sqrt(widths.prod(1))
        best = np.maximum(best, added / (footprint * np.maximum(gaussians.opacities, 1e-9)))
    return best
