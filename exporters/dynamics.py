"""Joint dynamics nobody photographed: damping and friction of a free joint, a servo that tracks.

Every number is assumed. Passive ones follow from mass and gravity, so that a finger moves a door of
any size in any unit: friction is a share of the weight that acts at the radius of gyration, or what
holds the part where it stood by itself in front of the camera; damping lets a push coast for a
time. A servo adds range and gravity load, and tracks against all of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from part2gs_robotics.exporters.inertia import (
    MassProperties,
    density_per_unit,
    gravity_vector,
    mass_properties,
    moment_about_axis,
)
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import moving_parts, part_transforms, subtree
from part2gs_robotics.model.solids import size_of
from part2gs_robotics.model.twin import Twin

TRAVEL_TIME = 0.5  # s for the full range at top speed: a brisk human hand
SERVO_FREQUENCY = 30.0  # rad/s, slowest servo: settles in 0.2 s
SAG = 0.004  # of the range: droop of the servo under gravity and friction (the check allows 1 %)
LEAST_SPAN = 1e-3  # rad, or of the size: a joint observed without motion still gets a servo
ARMATURE = 0.02  # of the joint's inertia: conditioning without a visible change
FRICTION = 0.02  # of the weight: greased hinge, ball-bearing slide; less than a tilt by 2 degrees
HOLD = 1.1  # of the weight's pull at an observed state: it stood there, and so it stands on
REST = 0.01  # of the range: nearer to the end that its weight presses it to, a part stands on that
COAST = 1.0  # s in which a push dies away: 3 N at the edge keep a 10 kg door at 1 m/s there
FORCE_MARGIN = 3.0  # servo force above gravity, friction and acceleration
MAX_STEP = 0.002  # s, MuJoCo's default
ASSUMED_DIGITS = 6  # of a number nobody measured: the same short one in every file
GAIN_STEP = 4.0  # frequency x step at gain x 100; critical damping, implicit: stable below 4.83


@dataclass(frozen=True)
class JointDynamics:
    """Assumed numbers of one joint, in kg, scene units, rad, s.

    Attributes:
        inertia: about the joint, everything carried included.  mass: carried.
        gravity: largest load in the range.  damping, friction, armature: passive.
        kp, kv, force: servo.  velocity: top speed.
    """

    inertia: float
    mass: float
    gravity: float
    damping: float
    friction: float
    armature: float
    kp: float
    kv: float
    force: float
    velocity: float

    @property
    def frequency(self) -> float:
        """Servo frequency in rad/s."""
        return float(np.sqrt(self.kp / (self.inertia + self.armature)))


@dataclass(frozen=True)
class Physics:
    """All masses and joint dynamics of a twin, and the time step they need.

    Attributes:
        masses: per part.  joints: by part index.  step: s.  gravity: [3] units/s2.
    """

    masses: tuple[MassProperties, ...]
    joints: dict[int, JointDynamics]
    step: float
    gravity: F64


def physics_of(twin: Twin) -> Physics:
    """Return the physical numbers all exporters write.

    Raises:
        ExportError: if a part has no physical mass.
    """
    density = density_per_unit(twin)
    masses = tuple(mass_properties(part.mesh, density) for part in twin.parts)
    joints = {i: _joint_dynamics(twin, i, masses) for i in moving_parts(twin)}
    fastest = max((10 * d.frequency for d in joints.values()), default=1.0)  # gain x 100
    step = min(MAX_STEP, float(f"{GAIN_STEP / fastest:.2g}"))
    return Physics(masses, joints, step, gravity_vector(twin))


def _joint_dynamics(twin: Twin, index: int, masses: tuple[MassProperties, ...]) -> JointDynamics:
    part = twin.parts[index]
    assert part.joint is not None  # moving parts have one
    slides = part.joint.kind == "prismatic"
    least = LEAST_SPAN * (size_of(tuple(one.mesh for one in twin.parts)) if slides else 1.0)
    span = max(part.limits[1] - part.limits[0], least)
    carried = [masses[i] for i in subtree(twin, index)]
    inertia = sum(_felt(part.joint, m) for m in carried)
    turns = [_with(twin, index, q) for q in np.linspace(*part.limits, 9)]
    load = max(abs(_gravity_load(twin, index, masses, values)) for values in turns)
    mass = sum(m.mass for m in carried)
    armature = _short(ARMATURE * inertia)
    weight = float(np.linalg.norm(gravity_vector(twin)) * np.sqrt(inertia * mass))
    friction = max(FRICTION * weight, HOLD * _held(twin, index, masses))
    accelerate = (inertia + armature) * 4 * span / TRAVEL_TIME**2  # bang-bang over the range
    held = load + friction
    kp = max((inertia + armature) * SERVO_FREQUENCY**2, held / (SAG * span))
    return JointDynamics(
        inertia=inertia,
        mass=mass,
        gravity=load,
        damping=_short((inertia + armature) / COAST),
        friction=_short(friction),
        armature=armature,
        kp=_short(kp),
        kv=_short(2 * float(np.sqrt(kp * (inertia + armature)))),
        force=_short(FORCE_MARGIN * (accelerate + held)),
        velocity=_short(2 * span / TRAVEL_TIME),
    )


def _held(twin: Twin, index: int, masses: tuple[MassProperties, ...]) -> float:
    """Return the pull of its weight that kept a part where it was seen, but for what stops held.

    Nobody held it in either state: it is at rest there.
    """
    part, loads = twin.parts[index], [0.0]
    assert part.joint is not None  # moving parts have one
    low, high = part.limits
    seen = [joint.value for i in moving_parts(twin) if (joint := twin.parts[i].joint)]
    for state in (0, 1):
        values = [state * value for value in seen]
        load = _gravity_load(twin, index, masses, values)
        q = state * part.joint.value
        if (high - q if load > 0 else q - low) > REST * (high - low):
            loads.append(abs(load))
    return max(loads)


def _with(twin: Twin, index: int, value: float) -> list[float]:
    """Return joint positions of all moving parts, all at state 0 but one."""
    return [value if i == index else 0.0 for i in moving_parts(twin)]


def _short(value: float) -> float:
    return float(f"{value:.{ASSUMED_DIGITS}g}")


def _felt(joint: Joint, props: MassProperties) -> float:
    if joint.kind == "prismatic":
        return props.mass
    return moment_about_axis(props, joint.axis, joint.origin) + props.mass * joint.pitch**2


def _gravity_load(twin: Twin, index: int, masses: tuple[MassProperties, ...],
                  values: list[float]) -> float:
    """Return the weight's force or torque along a joint, the moving parts at given positions."""
    part, places = twin.parts[index], part_transforms(twin, values)
    joint, carrier = part.joint, places[max(part.parent, 0)]
    assert joint is not None  # moving parts have one
    axis = carrier[:3, :3] @ joint.axis
    origin = carrier[:3, :3] @ joint.origin + carrier[:3, 3]
    slide = 1.0 if joint.kind == "prismatic" else joint.pitch
    turn = 0.0 if joint.kind == "prismatic" else 1.0
    load = 0.0
    for i in subtree(twin, index):
        arm = places[i][:3, :3] @ masses[i].center + places[i][:3, 3] - origin
        weight = masses[i].mass * gravity_vector(twin)
        load += float(slide * (axis @ weight) + turn * (axis @ np.cross(arm, weight)))
    return load
