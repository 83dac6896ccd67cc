"""Canonical: both states made comparable, every Gaussian where it was observed.

The two sets share one world frame and one exposure; what no photo shows is known, and so is which
state is richer in motion. Joints do the warping: an averaged centre (Part2GS eq. 3) lies in
neither state, at half weight a 90 deg door shrinks to 0.71 of its radius.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from part2gs_robotics.config import SearchConfig
from part2gs_robotics.errors import FitError
from part2gs_robotics.evidence.exposure import gain_between, matched, told
from part2gs_robotics.evidence.surfaces import Surfaces, surfaces_of
from part2gs_robotics.evidence.unseen import SIDE, VIEWS, without_unseen
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.scene import Scene, StateViews
from part2gs_robotics.model.small_views import small_views
from part2gs_robotics.runtime.side_by_side import side_by_side

logger = logging.getLogger(__name__)


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
