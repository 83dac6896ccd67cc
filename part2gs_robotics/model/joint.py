"""Joint: how one part moves, from the first guess of a search to what is exported."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64

JointKind = Literal["fixed", "revolute", "prismatic", "screw"]
# Numbers that tell where it goes: two of the axis and the value, two of its place, one of the rise.
PARAMETERS: dict[JointKind, int] = {"prismatic": 3, "revolute": 5, "screw": 6}


@dataclass(frozen=True)
class Joint:
    """A motion of one degree of freedom in the world frame at state 0, where q = 0.

    Attributes:
        kind: at last chosen by model selection.
        axis: [3] unit.
        origin: [3] a point on the axis (prismatic: any point of the part).
        value: joint position at state 1 (rad or scene units); 0 at state 0.
        pitch: scene units per radian, screw only.
        carrier: [4, 4] motion between the states of the part that carries this one, where a joint
            must know it; None = the base.
        held: whether the axis is that of straight edges, so that surfels need not find it.
        sigma_axis: standard deviation of the axis direction, rad.
        sigma_origin: standard deviation of the axis position, scene units.
        sigma_value: standard deviation of `value`. Of all: NaN = not estimated,
            infinite = the photos do not show it; files hold null for both.
        sigma_rise: standard deviation of `rise`, scene units.
        bic: criterion of every joint kind tried, lower is better.
        confidence: 0..1, share of the evidence this joint explains.
        seen: sigma_axis and sigma_value by the images alone, before walls and edges had their say.
    """

    kind: JointKind
    axis: F64
    origin: F64
    value: float
    pitch: float = 0.0
    carrier: F64 | None = None
    held: bool = False
    sigma_axis: float = float("nan")
    sigma_origin: float = float("nan")
    sigma_value: float = float("nan")
    sigma_rise: float = float("nan")
    bic: dict[str, float] = field(default_factory=dict)
    confidence: float = float("nan")
    seen: tuple[float, float] = (float("nan"), float("nan"))

    @property
    def turns(self) -> bool:
        """Whether the part turns, about a hinge or a screw."""
        return self.kind in ("revolute", "screw")

    @property
    def rise(self) -> float:
        """How far a screw slides along its axis between the states, scene units."""
        return self.pitch * self.value

    @property
    def own(self) -> F64:
        """[4, 4] motion between the states beside the carrier, in the world at state 0."""
        if self.turns:
            return se3.screw_motion(self.axis, self.origin, self.value, self.rise)
        return se3.make(np.eye(3), self.axis * self.value)

    @property
    def move(self) -> F64:
        """[4, 4] motion of the part from state 0 to state 1, its carrier's included."""
        return self.own if self.carrier is None else self.carrier @ self.own

    @property
    def state1_from_0(self) -> F64:
        """The same as `move` by `transform`, which takes the axis as unit: equal up to rounding."""
        own = self.transform(self.value)
        return own if self.carrier is None else self.carrier @ own

    def transform(self, q: float) -> F64:
        """Return [4, 4] world_at_q_from_world_at_0 of the part for joint position q."""
        return self.transforms(np.array([q]))[0]

    def transforms(self, q: F64) -> F64:
        """Return [P, 4, 4] `transform` of [P] joint positions."""
        turns = q if self.turns else np.zeros_like(q)
        slides = q if self.kind == "prismatic" else self.pitch * turns
        return se3.screw_motions(self.axis, self.origin, turns, slides)
