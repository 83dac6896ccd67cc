"""The canonical field as the paper prints it (eq. 3): one state's centres, averaged with matches.

An averaged centre lies in neither state, so no build uses this; the ablation measures what it
costs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64, I64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.points import tree_of
from part2gs_robotics.paper.matching import NUM_MATCHES, match_hungarian


@dataclass(frozen=True)
class Field:
    """The canonical field of two observed states, world frame, scene units.

    Attributes:
        gaussians: (state 0, state 1) by default; one averaged set in paper mode.
        reference_state: 0 or 1, the state richer in motion.
        richness_weight: lambda of eq. 3, the weight of state 0, in [0, 1].
        richness: (D_{0->1}, D_{1->0}), scene units.
        states: Gaussians of state 0 and state 1.
        num_matches: bound of the matches.
    """

    gaussians: tuple[Gaussians, ...]
    reference_state: int
    richness_weight: float
    richness: tuple[float, float]
    states: tuple[Gaussians, Gaussians]
    num_matches: int

    @cached_property
    def matches(self) -> I64:
        """[M, 2] indices into state 0 and state 1, seconds of work: only paper mode needs them."""
        zero, one = (g.means.astype(np.float64) for g in self.states)
        return match_hungarian(zero, one, self.num_matches)

    @property
    def weights(self) -> tuple[float, float]:
        """Weight of state 0 and of state 1; they add up to 1."""
        return self.richness_weight, 1.0 - self.richness_weight


def canonical_field(
    g0: Gaussians, g1: Gaussians, paper_mode: bool = False, num_matches: int = NUM_MATCHES
) -> Field:
    """Return the field of both states; average them only in paper mode.

    An averaged centre lies in neither state (at half weight a 90 deg door shrinks to 0.71 of its
    radius), so by default every Gaussian stays where it was observed and joints do the warping.

    Args:
        g0: Gaussians of state 0.
        g1: Gaussians of state 1, same world frame.
        paper_mode: True = Part2GS eq. 3 as printed, mu^c = lambda mu^0 + (1 - lambda) mu^1.
        num_matches: bound of the Hungarian subsample, at most MAX_MATCHES.
    """
    points0, points1 = g0.means.astype(np.float64), g1.means.astype(np.float64)
    richness = motion_richness(points0, points1), motion_richness(points1, points0)
    weight = richness_weight(*richness)
    reference = 0 if weight >= 0.5 else 1
    field = Field((g0, g1), reference, weight, richness, (g0, g1), num_matches)
    if not paper_mode:
        return field
    return replace(field, gaussians=(_averaged(field.states, field.matches, reference, weight),))


def motion_richness(points: F64, other: F64, observed: NDArray[np.bool_] | None = None) -> float:
    """Return D_{t->t'} = mean_i min_j |mu_i^t - mu_j^t'|, scene units.

    Args:
        points: [N, 3] centres of state t.
        other: [M, 3] centres of state t'.
        observed: [N] True where the other state saw the place; without it newly revealed
            interior counts as motion, as printed.

    Source: Part2GS eq. 3.
    """
    used = points if observed is None else points[observed]
    if len(used) == 0 or len(other) == 0:
        return 0.0
    distance, _ = tree_of(other)[0].query(used)
    return float(np.mean(distance))


def richness_weight(richness_01: float, richness_10: float) -> float:
    """Return lambda = D_{0->1} / (D_{0->1} + D_{1->0}), the weight of state 0.

    It favours the opened state: its moved surface is far from everything in the closed state,
    while the closed state's moved surface stays near the frame around it. Nothing moved: 0.5.
    """
    total = richness_01 + richness_10
    return 0.5 if total <= 0.0 else richness_01 / total


def _averaged(
    both: tuple[Gaussians, ...], matches: I64, reference: int, weight: float
) -> Gaussians:
    """Move every centre of the reference state towards the partner of its nearest sample."""
    own, other = matches[:, reference], matches[:, 1 - reference]
    means = both[reference].means.astype(np.float64)
    offsets = both[1 - reference].means[other].astype(np.float64) - means[own]
    tree, kept = tree_of(means[own])
    nearest = kept[tree.query(means)[1]]
    share = (1.0 - weight) if reference == 0 else weight
    moved = (means + share * offsets[nearest]).astype(np.float32)
    return replace(both[reference], means=moved)
