"""Steps of an alignment: fixed coordinates beside a start, and accelerated iteration in them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from part2gs_robotics.joints.align_system import parameters, perturbed
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint, move_of

MEMORY = 6  # earlier steps used; a turn has five parameters
HELD = 1e-4  # of the mean squared change of a step: along what hardly changes, nothing is learnt
LEAP = 10.0  # lengths of a plain step at most: 0.1 is the smallest share of a way seen in one step
FARTHEST = 0.03  # rad or diagonals per step: pictures shifted by more do not overlap


@dataclass(frozen=True)
class Pose:
    """A joint as an offset from another one: the same coordinates for a sequence of steps.

    Attributes:
        start: where the coordinates begin.  offset: [P], see joint_fit.perturbed.
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
        move = move_of(self.joint)
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
