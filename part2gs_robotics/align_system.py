"""Normal equations of one part's joint: from two directions, weighed, and their damped solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.align_sigma import Patches

F64 = NDArray[np.float64]


@dataclass
class System:
    """Normal equations of one part in one direction; patches where asked for."""

    h: F64
    g: F64
    error: float = 0.0
    count: float = 0.0
    patches: Patches | None = None

    @property
    def variance(self) -> float:
        """Mean squared residual of a pixel."""
        return self.error / max(self.count, 1.0) + 1e-12  # a part that no pixel shows


def weights_of(one: System, two: System) -> tuple[float, float]:
    """Return the weights of a part's systems in both directions.

    A state that shows a part badly has its surface wrong and looks wrong when carried over. Weights
    are squared ratios of the residual variances, since much of either is plain noise.
    """
    least = min(one.variance, two.variance)
    a, b = ((least / s.variance) ** 2 for s in (one, two))
    return a, b


def weighed(one: System, two: System) -> System:
    """Return the sum of a part's systems in both directions, the truer direction first."""
    return summed((one, two), weights_of(one, two))


def summed(pair: tuple[System, System], weights: tuple[float, float]) -> System:
    """Return the sum of a part's systems in both directions with given weights."""
    (one, two), (a, b) = pair, weights
    return System(a * one.h + b * two.h, a * one.g + b * two.g, a * one.error + b * two.error,
                  a * one.count + b * two.count)


def damping_of(h: F64) -> float:
    """Return what is added to the [P, P] curvature's diagonal."""
    return float(1e-3 * np.trace(h) / len(h) + 1e-9)


def solved(system: System) -> F64:
    """Return the [P] step, at most 0.03 along any parameter."""
    # A direction that no pixel sees is held by the damping, not thrown about.
    damping = damping_of(system.h)
    step = np.linalg.solve(system.h + damping * np.eye(len(system.g)), system.g)
    return np.asarray(step * min(1.0, 0.03 / max(float(np.abs(step).max()), 1e-12)))


def bread(pair: tuple[System, System], weights: tuple[float, float]) -> F64:
    """Return [P, P], the curvature of the robust cost of both directions with their patches.

    Weights of outliers fall as the joint moves, so this is less than the curvature of the steps.
    """
    both = zip(pair, weights, strict=True)
    return np.asarray(sum(s.patches.total(w, len(s.g)).bread.sum(0) for s, w in both if s.patches))
