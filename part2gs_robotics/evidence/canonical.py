"""Canonical: both states made comparable, every Gaussian where it was observed.

The two sets share one world frame and one exposure; what no photo shows is known, and so is which
state is richer in motion. Joints do the warping: an averaged centre (Part2GS eq. 3) lies in
neither state, at half weight a 90 deg door shrinks to 0.71 of its radius.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.config import SearchConfig
from part2gs_robotics.errors import FitError
from part2gs_robotics.evidence.exposure import gain_between, matched, told
from part2gs_robotics.evidence.surfaces import Surfaces, surfaces_of
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.scene import Scene, StateViews
from part2gs_robotics.model.small_views import SmallViews, small_views
from part2gs_robotics.render.dispatch import render, render_backward
from part2gs_robotics.render.ellipses import LOW_PASS
from part2gs_robotics.runtime.buffers import Workspace
from part2gs_robotics.runtime.side_by_side import side_by_side

logger = logging.getLogger(__name__)
VIEWS, SIDE = 24, 200  # photos that tell, and their longest side: 48 change 2 % of the answers
LEAST = 0.05  # of what it could cover in the view that shows most of it: less is a leak
CLEAR = -20.0  # logit of an opacity that nothing draws


@dataclass(frozen=True)
class Canonical:
    """Both states, comparable; what only the search needs is made when first asked for.

    Attributes:
        scene: images of both states, equally bright.
        gaussians: of both states, equally bright.
        exposure: what was changed about brightness, a sentence; empty if nothing was.
        surfel_size: as a share of the object's diagonal.
    """

    scene: Scene
    gaussians: tuple[Gaussians, Gaussians]
    exposure: str
    surfel_size: float

    @cached_property
    def seen(self) -> tuple[Gaussians, Gaussians]:
        """The Gaussians, clear where no photo of their state shows them."""
        one, two = side_by_side([partial(_seen, *pair) for pair in
                                 zip(self.gaussians, self.scene.states, strict=True)])
        return one, two

    @cached_property
    def surfaces(self) -> Surfaces:
        """Surfaces of both states, and what of them left or arrived."""
        return surfaces_of(self.scene, self.gaussians, self.surfel_size)

    @property
    def weights(self) -> tuple[float, float]:
        """Richness weight of each state; they add up to 1."""
        return self.surfaces.evidence.weights

    @property
    def told(self) -> str:
        """Which state leads, for the log and the report."""
        share, richer = self.weights[0], int(self.weights[0] < self.weights[1])
        return f"state {richer} richer in motion, weight of state 0 {share:.2f}"


def canonical(scene: Scene, gaussians: tuple[Gaussians, Gaussians],
              config: SearchConfig | None = None) -> Canonical:
    """Return both states made comparable.

    Args:
        scene: images of both states.
        gaussians: fitted to them, same world frame.
        config: size of surfels; None = the standard preset.

    Raises:
        FitError: a state holds no Gaussian, or non-finite centres.
    """
    for state, fitted in enumerate(gaussians):
        _require_sound(fitted, state)
    gain = gain_between(scene, gaussians)
    exposure = told(gain)
    if exposure:
        logger.info("%s", exposure)
    size = (config or SearchConfig()).surfel_size
    return Canonical(*matched(scene, gaussians, gain), exposure, size)


def _seen(gaussians: Gaussians, state: StateViews) -> Gaussians:
    return without_unseen(gaussians, small_views(state, VIEWS, SIDE))


def _require_sound(gaussians: Gaussians, state: int) -> None:
    if len(gaussians) == 0:
        raise FitError(
            f"state {state}: the fit holds 0 Gaussians, so no motion can be measured. "
            "At least 1 was expected; check that the object is inside the masks of this state."
        )
    bad = int((~np.isfinite(gaussians.means).all(1)).sum())
    if bad:
        raise FitError(
            f"state {state}: {bad} of {len(gaussians)} Gaussians have NaN or infinite centres. "
            "Finite centres were expected; fit this state again with a lower learning rate."
        )


def without_unseen(gaussians: Gaussians, views: SmallViews) -> Gaussians:
    """Return the Gaussians, all of them, with those that no view shows made clear.

    Inside or behind a surface, with colours never tested: a part that moves, or leaves, bares them
    as speckles. They make true motions look worse, and pull on joints aligned to the images.

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
