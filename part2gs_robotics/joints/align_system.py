"""Normal equations of one part's joint: from two directions, weighed, and their damped solution."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from part2gs_robotics.joints.sigma import Patches
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint

PARAMETERS = {"prismatic": 3, "revolute": 5, "screw": 6}


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


def parameters(joint: Joint) -> F64:
    """Return zeros: two tilts, the value, two offsets of a turning axis, the rise of a screw."""
    return np.zeros(PARAMETERS[joint.kind])


def perturbed(joint: Joint, step: F64, diag: float) -> Joint:
    """Return the joint moved by a [P] step of `parameters`.

    Tilts are rad, the value rad or diagonals, offsets and rise (pitch times value) diagonals.
    """
    side = np.linalg.svd(joint.axis[None])[2][1:]
    axis = joint.axis + step[0] * side[0] + step[1] * side[1]
    if joint.kind == "prismatic":
        return replace(
            joint, axis=axis / np.linalg.norm(axis), value=joint.value + float(step[2]) * diag
        )
    origin = joint.origin + diag * (step[3] * side[0] + step[4] * side[1])
    value, pitch = joint.value + float(step[2]), 0.0
    if joint.kind == "screw":
        pitch = (joint.pitch * joint.value + diag * float(step[5])) / value
    return replace(joint, axis=axis / np.linalg.norm(axis), origin=origin, value=value, pitch=pitch)
