"""What one file of a twin says, in words that all formats share: scene units, world at state 0."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64

NO = float("nan")  # of a number that a format has no word for: it is not compared


@dataclass(frozen=True)
class Drive:
    """The joint between a part and the one that carries it.

    Attributes:
        kind: revolute | prismatic | screw | fixed, or what else the file calls it.
        axis: [3] unit, world at state 0.  origin: [3] a point on it.  pitch: units per rad.
        limits: rad or units.  numbers: damping, friction, effort, kp, ... by name, NaN = not said.
        states: joint position by state.  name: of the joint, "" = not said.
    """

    kind: str
    axis: F64
    origin: F64
    pitch: float = 0.0
    limits: tuple[float, float] = (NO, NO)
    numbers: dict[str, float] = field(default_factory=dict)
    states: dict[str, float] = field(default_factory=dict)
    name: str = ""


@dataclass(frozen=True)
class Body:
    """One part as a file has it.

    Attributes:
        parent: name, "" for the base.  mass: kg.  center: [3].  inertia: [3, 3] about the centre.
        surface: [V, 3] corners of what is seen.  pieces: [P][N, 3] corners of what collides; None
            where the format has none.  drive: None for the base.
    """

    name: str
    parent: str
    mass: float
    center: F64
    inertia: F64
    surface: F64
    pieces: tuple[F64, ...] | None
    drive: Drive | None


@dataclass(frozen=True)
class Described:
    """A whole file.

    Attributes:
        file: its name, from the twin folder.  bodies: by name.
        same: relative difference that its digits allow.
        title: name of the whole, "" = not said.
        faults: what cannot be true whatever other files say, as (check, subject, text, cause).
    """

    file: str
    bodies: dict[str, Body]
    same: float = 1e-6
    faults: tuple[tuple[str, str, str, str], ...] = ()
    title: str = ""

    def drives(self) -> dict[str, Drive]:
        """Return the joints by the part that they move; the base has none."""
        return {n: b.drive for n, b in self.bodies.items() if b.drive is not None}


def moved(described: Described, name: str, values: dict[str, float]) -> F64:
    """Return [4, 4] world at values from world at 0 of one part, along the file's own chain.

    Args:
        described: a file.
        name: of a part; a parent that is missing or a ring of parents ends the chain.
        values: joint positions by part; others are 0.
    """
    out, seen = np.eye(4), set[str]()
    while name in described.bodies and name not in seen:
        seen.add(name)
        body = described.bodies[name]
        if body.drive is not None:
            out = step(body.drive, values.get(name, 0.0)) @ out
        name = body.parent
    return out


def step(drive: Drive, value: float) -> F64:
    """Return the [4, 4] motion of one joint at a position."""
    if drive.kind == "prismatic":
        out = np.eye(4)
        out[:3, 3] = value * drive.axis
        return out
    if drive.kind in ("revolute", "screw"):
        return se3.screw_motion(drive.axis, drive.origin, value, drive.pitch * value)
    return np.eye(4)


def rotated(tensor: F64, rotation: F64) -> F64:
    """Return a [3, 3] tensor seen from another frame."""
    return np.asarray(rotation @ tensor @ rotation.T)


def tensor_of(values: dict[str, float]) -> F64:
    """Return the [3, 3] tensor of ixx, ixy, ..., izz; NaN where one is missing."""
    at = [[values.get(f"i{min(a, b)}{max(a, b)}", NO) for b in "xyz"] for a in "xyz"]
    return np.array(at, np.float64)
