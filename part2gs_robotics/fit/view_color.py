"""View-dependent colour: degree 1 of the spherical harmonics, kept only if unseen views gain.

Positions, shapes and mean colours stay as fitted: gloss must not hide a wrong surface.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from part2gs_robotics.fit.image_loss import psnr
from part2gs_robotics.fit.step import image_terms
from part2gs_robotics.fit.training_photos import Views
from part2gs_robotics.model.arrays import F32
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.render.dispatch import Rendered, render, render_backward
from part2gs_robotics.render.sh import seen_from, sh_colors_backward
from part2gs_robotics.runtime.adam import Adam

logger = logging.getLogger(__name__)
GAIN = 0.5  # dB over held-out views: less is what more steps of any kind give
STEPS = 60  # one look at 56 views; colours alone settle that fast
RATE = 2e-2  # per step and coefficient: 60 steps reach a colour change of a third
WHITE = np.ones(3, np.float32)  # held-out views are measured over white, as in NeRF


def drawn_over(gaussians: Gaussians, state: StateViews, view: int, background: F32) -> Rendered:
    """Return a view of a state rendered at full size with the colours seen from its camera."""
    colors = seen_from(gaussians, state.viewmats[view])
    return render(replace(gaussians.splats, colors=colors), state.camera(view),
                  background=background)


def held_out_psnr(gaussians: Gaussians, state: StateViews, views: Views) -> float:
    """Return the mean PSNR in dB over held-out views, over training views when there are none."""
    pick = np.flatnonzero(state.held_out)
    scores = []
    for view in pick if len(pick) else range(min(8, len(state))):
        target, _, _ = views.target(int(view), 0, WHITE)
        seen = drawn_over(gaussians, state, int(view), WHITE)
        scores.append(psnr(np.clip(seen.color, 0, 1), target))
    return float(np.mean(scores))


def with_view_dependence(gaussians: Gaussians, state: StateViews, views: Views,
                         alpha_weight: float, seed: int) -> Gaussians:
    """Return the Gaussians with colours of degree 1 if held-out views gain GAIN, else unchanged.

    Args:
        gaussians: a finished fit with one colour each.
        state: natural photos; without held-out views nothing can be decided, nothing is tried.
        views: of the same state.
        alpha_weight: as in the fit; it has no gradient by colours.
        seed: order of views and backgrounds.
    """
    if not state.held_out.any():
        return gaussians
    rng, train = np.random.default_rng(seed), np.flatnonzero(~state.held_out)
    shN = np.zeros((len(gaussians), 3, 3), np.float32)
    adam = Adam({"shN": RATE})
    for _ in range(STEPS):
        view = int(rng.choice(train))
        tried = replace(gaussians, shN=shN)
        background = rng.random(3, dtype=np.float32)
        target, alpha, _ = views.target(view, 0, background)
        rendered = drawn_over(tried, state, view, background)
        _, d_color, _ = image_terms(rendered, target, alpha, alpha_weight)
        by_color = render_backward(rendered, d_color, np.zeros_like(alpha), None, None).colors
        eye = -state.viewmats[view, :3, :3].T @ state.viewmats[view, :3, 3]
        _, by_shN, _ = sh_colors_backward(tried.means, tried.sh0, shN, eye, by_color)
        adam.step({"shN": shN}, {"shN": by_shN.astype(np.float32)})
    before = held_out_psnr(gaussians, state, views)
    after = held_out_psnr(replace(gaussians, shN=shN), state, views)
    logger.info("view-dependent colour: held-out views %.2f dB with it, %.2f dB without: %s",
                after, before, "kept" if after > before + GAIN else "left out")
    return replace(gaussians, shN=shN) if after > before + GAIN else gaussians
