"""A motion that may explain what moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint, JointKind

SCREW = 2  # kind of a hypothesis; grown from turns, never searched
KINDS: tuple[JointKind, ...] = ("prismatic", "revolute", "screw")  # by Hypothesis.kind


@dataclass(frozen=True)
class Hypothesis:
    """A one-degree-of-freedom motion, world_at_1_from_world_at_0.

    Attributes:
        kind: 0 = prismatic, 1 = revolute, 2 = screw.
        axis: [3] unit.  origin: [3].  value: rad or scene units.
        carrier: [4, 4] motion of the part that carries this one, None = the base.
        pitch: scene units per rad, screw only.
        held: whether the axis is that of straight edges, so that surfels need not find it.
    """

    kind: int
    axis: F64
    origin: F64
    value: float
    carrier: F64 | None = None
    pitch: float = 0.0
    held: bool = False

    @property
    def move(self) -> F64:
        """[4, 4] motion from state 0 to state 1."""
        return self.own if self.carrier is None else self.carrier @ self.own

    @property
    def own(self) -> F64:
        """[4, 4] motion beside the carrier, in the world at state 0."""
        if self.kind:
            return se3.screw_motion(self.axis, self.origin, self.value, self.pitch * self.value)
        return se3.make(np.eye(3), self.axis * self.value)


def hypothesis_of(joint: Joint) -> Hypothesis:
    """Return a joint's motion as the search knows it."""
    return Hypothesis(KINDS.index(joint.kind), joint.axis, joint.origin, joint.value,
                      joint.carrier, joint.pitch)


def rise_of(motion: Hypothesis | Joint) -> float:
    """Return how far a screw slides along its axis between the states, scene units."""
    return motion.pitch * motion.value
