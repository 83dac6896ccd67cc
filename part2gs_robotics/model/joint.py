"""Joints: one degree of freedom of one part relative to its parent."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64

JointKind = Literal["fixed", "revolute", "prismatic", "screw"]


@dataclass(frozen=True)
class Joint:
    """A joint in the world frame at state 0 (all parts in their state-0 place, q = 0).

    Attributes:
        kind: chosen by model selection.
        axis: [3] unit.
        origin: [3] a point on the axis (prismatic: any point of the part).
        value: joint position at state 1 (rad or scene units); 0 at state 0.
        pitch: scene units per radian, screw only.
        sigma_axis: standard deviation of the axis direction, rad.
        sigma_origin: standard deviation of the axis position, scene units.
        sigma_value: standard deviation of `value`. Of all: NaN = not estimated,
            infinite = the photos do not show it; files hold null for both.
        bic: criterion of every joint kind tried, lower is better.
        confidence: 0..1, share of the evidence this joint explains.
        carrier: [4, 4] motion between the states of the part that carries this one, where a joint
            must know it; None = the base.
        sigma_rise: standard deviation of how far a screw rises along its axis, pitch times value,
            scene units.
        seen: sigma_axis and sigma_value by the images alone, before walls and edges had their say.
    """

    kind: JointKind
    axis: NDArray[np.float64]
    origin: NDArray[np.float64]
    value: float
    pitch: float = 0.0
    sigma_axis: float = float("nan")
    sigma_origin: float = float("nan")
    sigma_value: float = float("nan")
    bic: dict[str, float] = field(default_factory=dict)
    confidence: float = float("nan")
    carrier: NDArray[np.float64] | None = None
    sigma_rise: float = float("nan")
    seen: tuple[float, float] = (float("nan"), float("nan"))

    def transform(self, q: float) -> NDArray[np.float64]:
        """Return [4, 4] world_at_q_from_world_at_0 of the part for joint position q."""
        return self.transforms(np.array([q]))[0]

    def transforms(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return [P, 4, 4] `transform` of [P] joint positions."""
        from part2gs_robotics.model.se3 import screw_motions

        turns = q if self.kind in ("revolute", "screw") else np.zeros_like(q)
        slides = q if self.kind == "prismatic" else self.pitch * turns
        return screw_motions(self.axis, self.origin, turns, slides)


def move_of(joint: Joint) -> F64:
    """Return the [4, 4] motion of a part from state 0 to state 1, its carrier's included."""
    own = joint.transform(joint.value)
    return own if joint.carrier is None else joint.carrier @ own
