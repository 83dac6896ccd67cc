"""Solver of the alignment: coordinates of a joint, its normal equations, and accelerated steps."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from part2gs_robotics.joints.sigma import Patches
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import PARAMETERS, Joint

MEMORY = 6  # earlier steps used; a turn has five parameters
HELD = 1e-4  # of the mean squared change of a step: along what hardly changes, nothing is learnt
LEAP = 10.0  # lengths of a plain step at most: 0.1 is the smallest share of a way seen in one step
FARTHEST = 0.03  # rad or diagonals per step: pictures shifted by more do not overlap


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
        pitch = (joint.rise + diag * float(step[5])) / value
    return replace(joint, axis=axis / np.linalg.norm(axis), origin=origin, value=value, pitch=pitch)


@dataclass(frozen=True)
class Pose:
    """A joint as an offset from another one: the same coordinates for a sequence of steps.

    Attributes:
        start: where the coordinates begin.  offset: [P], see `perturbed`.
        diag: diagonal of the object in scene units.
    """

    start: Joint
    offset: F64
    diag: float

    @property
    def joint(self) -> Joint:
        """The joint meant."""
        return perturbed(self.start, self.offset, self.diag)

    def moved(self, step: F64) -> Pose:
        """Return the pose a [P] step further."""
        return Pose(self.start, self.offset + step, self.diag)

    def into(self, target: int) -> F64:
        """Return [4, 4]: the part's motion into a state from the other one."""
        move = self.joint.state1_from_0
        return move if target else se3.inverse(move)

    def rates(self, target: int) -> F64:
        """Return [P, 4, 4]: velocity of a point of the target state per unit of each coordinate."""
        base, step = self.into(target), 1e-5
        return np.stack([(self.moved(step * unit).into(target) - base) @ se3.inverse(base) / step
                         for unit in np.eye(len(self.offset))])


def at(joint: Joint, diag: float) -> Pose:
    """Return a joint as the origin of its own coordinates."""
    return Pose(joint, parameters(joint), diag)


@dataclass
class Mixing:
    """Anderson's acceleration of an iteration that halves its error slowly.

    Robust weights and slopes that do not follow the part make a Gauss-Newton step as short as a
    tenth of the way. How the steps changed between places tells where they vanish.

    Source: Walker and Ni 2011, type II, least squares held by HELD.
    """

    places: list[F64] = field(default_factory=list)
    steps: list[F64] = field(default_factory=list)

    def step(self, place: F64, plain: F64) -> F64:
        """Return the [P] step to take from a place whose plain step is given."""
        self.places.append(place)
        self.steps.append(plain)
        out = plain
        past = min(MEMORY, len(self.places) - 1)
        if past:
            recent = range(len(self.places) - past, len(self.places))
            ways = np.stack([self.places[i] - self.places[i - 1] for i in recent], 1)
            changes = np.stack([self.steps[i] - self.steps[i - 1] for i in recent], 1)
            held = HELD * float((changes**2).sum(0).mean()) + 1e-30  # all steps equal: plain one
            mix = np.linalg.solve(changes.T @ changes + held * np.eye(past), changes.T @ plain)
            out = plain - (ways + changes) @ mix
        longest = min(LEAP * float(np.abs(plain).max()), FARTHEST)
        return np.asarray(out * min(1.0, longest / max(float(np.abs(out).max()), 1e-30)))

    @property
    def best(self) -> F64:
        """The place whose plain step was shortest."""
        return self.places[int(np.argmin([np.linalg.norm(s) for s in self.steps]))]
