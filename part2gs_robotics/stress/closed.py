"""A joint by itself, whose motion is known in closed form: mass ratios and gains against it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from part2gs_robotics.assets.driven import DrivenJoint
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.stress.cells import SAMPLES, Cell, Start, against, judged, run

if TYPE_CHECKING:
    import mujoco

RATIOS = tuple(10.0**k for k in range(-6, 7))  # of mass: a sheet of paper to a ship
GAINS = tuple(10.0**k for k in range(1, 10))  # N/m or N m/rad: a rubber band to a rail
TIME = 1.0  # s of a push; of which a semi-implicit step of h is wrong by h, 0.2 % at 2 ms
SETTLES = 0.5  # s of a step of the servo
PUSHED, FROM, TO = 0.5, 0.25, 0.75  # of the range: how far a push goes; from where a servo goes
LEAST = 1e-12  # kg or kg m2: a joint that carries nothing


def inertia_of(model: mujoco.MjModel, joint: DrivenJoint) -> float:
    """Return what a joint accelerates at the reference position without its armature."""
    felt = float(model.dof_M0[joint.dof] - model.dof_armature[joint.dof])
    return max(felt, LEAST)


def alone(model: mujoco.MjModel, joint: DrivenJoint, inertia: float, motor: str,
          damping: float | None = None) -> Start:
    """Return a mass on a joint with the armature and damping of another model, and its options.

    Args:
        model: of the asset.
        joint: whose numbers are taken.
        inertia: kg, or kg units2 of a hinge.
        motor: what drives it, as XML.
        damping: None = that of the joint.
    """
    import mujoco

    held = damping_of(model, joint) if damping is None else damping
    numbers = f'armature="{model.dof_armature[joint.dof]:.17g}" damping="{held:.17g}"'
    # A hinge by its axis alone: its inertia is the number, whatever the mass.
    mass, tensor = (1.0, inertia) if joint.hinge else (inertia, inertia)
    made = mujoco.MjModel.from_xml_string(
        '<mujoco><compiler boundmass="0" boundinertia="0" balanceinertia="false"/><worldbody><body>'
        f'<joint name="j" type="{"hinge" if joint.hinge else "slide"}" axis="1 0 0" {numbers}/>'
        f'<inertial pos="0 0 0" mass="{mass:.17g}" diaginertia="{tensor:.17g} {tensor:.17g} '
        f'{tensor:.17g}"/></body></worldbody>{motor}</mujoco>')
    for name in ("integrator", "solver", "iterations", "tolerance", "jacobian", "cone", "impratio"):
        setattr(made.opt, name, getattr(model.opt, name))
    made.opt.disableflags = model.opt.disableflags
    return Start(made, np.zeros(1), np.zeros(1), np.zeros(made.nu), (0,), np.array([joint.span]))


def damping_of(model: mujoco.MjModel, joint: DrivenJoint) -> float:
    """Return the damping of a joint: the linear part, where the engine knows more."""
    return float(np.ravel(model.dof_damping[joint.dof])[0])


def pushed(mass: float, damping: float, force: float, times: F64) -> F64:
    """Return [S] places of a mass that a constant force pushes from rest against damping.

    x(t) = F/c (t - M/c (1 - exp(-c t / M))), F t^2 / 2 M without damping; written by expm1 and a
    series, so that neither M/c nor c/M may be too large.
    """
    z = damping / mass * times
    # (z - 1 + exp(-z)) / z^2 is 1/2 - z/6 + ... near 0, where the difference loses its digits
    small = 0.5 - z / 6 + z**2 / 24 - z**3 / 120
    with np.errstate(divide="ignore", invalid="ignore"):
        shape = np.where(z < 1e-3, small, (z + np.expm1(-z)) / np.where(z == 0, 1, z)**2)
    return np.asarray(force / mass * times**2 * shape)


def settled(rate: float, times: F64) -> F64:
    """Return [S] where a critically damped servo is on its way of TO - FROM of the range.

    x(t) = (TO - FROM) (1 - (1 + w t) exp(-w t)), w the rate, rad/s.
    """
    return np.asarray((TO - FROM) * (1.0 - (1.0 + rate * times) * np.exp(-rate * times)))


def mass_ratios(model: mujoco.MjModel, joints: Sequence[DrivenJoint]) -> list[Cell]:
    """Return a cell per joint and ratio of the carried mass: a push against the closed form."""
    cells = []
    for joint in joints:
        damping = damping_of(model, joint)
        for ratio in RATIOS:
            carried = ratio * inertia_of(model, joint)
            start = alone(model, joint, carried, '<actuator><motor joint="j"/></actuator>')
            mass = carried + float(model.dof_armature[joint.dof])
            force = PUSHED * joint.span / float(pushed(mass, damping, 1.0, np.array([TIME]))[0])
            start.ctrl[:] = force
            right = partial(pushed, mass, damping, force / joint.span)
            cells.append(_compared(start, (TIME, model.opt.timestep), right,
                                   {"joint": joint.name, "ratio": ratio}))
    return cells


def gains(model: mujoco.MjModel, joints: Sequence[DrivenJoint]) -> list[Cell]:
    """Return a cell per joint and gain of a critically damped servo: a step against its form."""
    cells = []
    for joint in joints:
        inertia = inertia_of(model, joint)
        mass = inertia + float(model.dof_armature[joint.dof])
        for gain in GAINS:
            rate = float(np.sqrt(gain / mass))
            servo = (f'<actuator><general joint="j" biastype="affine" gainprm="{gain:.17g}" '
                     f'biasprm="0 {-gain:.17g} {-2 * gain / rate:.17g}"/></actuator>')
            start = alone(model, joint, inertia, servo, damping=0.0)
            start.ctrl[:] = (TO - FROM) * joint.span
            cells.append(_compared(start, (SETTLES, model.opt.timestep), partial(settled, rate),
                                   {"joint": joint.name, "gain": gain, "rate": rate}))
    return cells


def _compared(start: Start, times: tuple[float, float], right: Callable[[F64], F64],
              settings: dict[str, Any]) -> Cell:
    """Return a run against a closed form: its time and step, s, or the next that fits samples."""
    count = SAMPLES * max(1, round(times[0] / times[1] / SAMPLES))
    return judged(run(start, times[0], count), against(right, times[0], count), settings)
