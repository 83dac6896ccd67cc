"""The twin without motors: does a light push move every joint, and nothing move by itself."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.assets.driven import DrivenJoint, followers_of
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.runtime.threads import in_threads
from part2gs_robotics.sim_checks.actuation import (
    CONTROL,
    HIGH,
    LOW,
    REACH,
    STILL_ANGLE,
    STILL_SHARE,
    start,
    warnings_of,
)
from part2gs_robotics.sim_checks.result import CheckResult, passed, row
from part2gs_robotics.sim_checks.subject import Subject

if TYPE_CHECKING:
    import mujoco

PUSH = 0.1  # of the weight a joint carries: 3 N on a drawer of 3 kg, one finger
HELD = 1.1  # of its pull at an observed state: what friction holds there (exporters/dynamics.py)
STANDS = 0.02  # of the range: half of it is what may lie between a part and the stop it rests on
PUSH_TIME = 10.0  # s for 90 % of the range, one way
LET_GO = 2.0  # s without any force
DRIFT = 0.01  # of the range: what touching collision pieces may push apart
EARTH = 9.81  # units/s2 where a model has no gravity


def check_passive(subject: Subject) -> list[CheckResult]:
    """Push every joint through its range, and let go of all at both observed states.

    Without gravity a hand carries the weight, and gravity explains no motion. Others stay still
    under a push, but for what carries the joint and what it carries: those feel its inertia. With
    gravity a part stands where it was photographed: it stood there by itself.
    """
    model = copy(subject.model)
    model.opt.gravity[:] = 0
    floating = replace(subject, model=model)
    moving = [j for j in subject.joints if j.span > 0]
    pushed = in_threads([partial(_push, floating, j, push_of(subject, j)) for j in moving])
    return [*(r for rows in pushed for r in rows), *_drift(subject, floating), *_stand(subject)]


def push_of(subject: Subject, joint: DrivenJoint) -> float:
    """Return the force or torque of a push: PUSH of the weight, and what friction holds of it.

    The weight acts at the radius of gyration. Friction may be what let the part stand where it was
    photographed: the weight's own pull there.
    """
    model = subject.model
    mass = float(model.body_mass[list(joint.moved)].sum())
    gravity = float(np.linalg.norm(model.opt.gravity)) or EARTH
    held = max((abs(_pulls(subject, qpos)[joint.dof]) for qpos in _observed(subject).values()),
               default=0.0)
    return PUSH * gravity * float(np.sqrt(mass * model.dof_M0[joint.dof])) + HELD * held


def _push(subject: Subject, joint: DrivenJoint, force: float) -> list[CheckResult]:
    """Push a joint up its range and back; a joint that is stuck is not asked to come back."""
    data = start(subject, joint, LOW)
    before = data.qpos.copy()
    up, seconds = _pushed(subject, data, joint, force)
    reached, took, top = up - LOW, f"{seconds:.1f}", data.qpos.copy()
    if up >= LOW + REACH * (HIGH - LOW):
        down, seconds = _pushed(subject, data, joint, -force)
        reached, took = min(reached, up - down), f"{took} and {seconds:.1f}"
    reached = min(reached / (HIGH - LOW), 1.0)
    said = ", ".join(warnings_of(data))
    unit = "kg units2/s2" if joint.hinge else "kg units/s2"
    detail = f"{force:.3g} {unit}, {PUSH:.0%} of its weight and what friction holds, for {took} s"
    detail += f"; {said}" if said else ""
    status = passed(reached >= REACH and not said)
    moved = np.maximum(np.abs(top - before), np.abs(data.qpos - before))
    return [CheckResult("push", joint.name, status, float(reached), REACH, "of the way", detail),
            *_undisturbed(subject, joint, moved)]


def _undisturbed(subject: Subject, joint: DrivenJoint, moved: F64) -> list[CheckResult]:
    """Return the joint that a push on another one moved most, against what it may move."""
    body = int(subject.model.jnt_bodyid[joint.index])
    rows = []
    for other in subject.joints:
        if int(subject.model.jnt_bodyid[other.index]) in joint.moved or body in other.moved:
            continue
        allowed = STILL_ANGLE if other.hinge else STILL_SHARE * subject.size
        rows.append(row("others pushed", joint.name, float(moved[other.qpos]), allowed, other.unit,
                        f"moved most: {other.name}"))
    return [max(rows, key=lambda r: (r.value or 0.0) / (r.limit or 1.0))] if rows else []


def _pushed(
    subject: Subject, data: mujoco.MjData, joint: DrivenJoint, force: float
) -> tuple[float, float]:
    """Return the share of the range where a joint is after a push, and the seconds it took."""
    way, model, began = np.sign(force), subject.model, data.time
    goal = joint.low + (HIGH if way > 0 else LOW) * joint.span
    data.qfrc_applied[joint.dof] = force
    stepper, steps = subject.stepper(data), max(1, round(CONTROL / model.opt.timestep))
    while data.time - began < PUSH_TIME and way * (goal - data.qpos[joint.qpos]) > 0:
        stepper.step(steps)
    return float(data.qpos[joint.qpos] - joint.low) / joint.span, float(data.time - began)


def _drift(subject: Subject, floating: Subject) -> list[CheckResult]:
    """Return what every joint does by itself, its weight taken away, at the worse state."""
    states = _observed(subject) or {"reference": subject.model.qpos0}
    return _moved_most(floating, states, "drift", (DRIFT, "without gravity"))


def _stand(subject: Subject) -> list[CheckResult]:
    """Return how far every joint falls from where it was photographed, at the worse state."""
    return _moved_most(subject, _observed(subject), "stands", (STANDS, "with gravity"))


def _moved_most(subject: Subject, states: dict[str, F64], name: str,
                allowed: tuple[float, str]) -> list[CheckResult]:
    """Return a row per joint: its way when all is let go, at the state where that is longest."""
    worst: dict[int, tuple[float, str]] = {}
    friction, falls = subject.model.dof_frictionloss, bool(subject.model.opt.gravity.any())
    for state, qpos in states.items():
        moved, pulls = _let_go(subject, qpos), _pulls(subject, qpos)
        for joint in subject.joints:
            share = float(moved[joint.qpos]) / max(joint.span, 1e-12)
            if share >= worst.get(joint.index, (-1.0, ""))[0] or not np.isfinite(share):
                told = (f"; gravity pulls {pulls[joint.dof]:.3g}, friction holds "
                        f"{friction[joint.dof]:.3g}" if falls else "")
                worst[joint.index] = share, f"let go at {state} {allowed[1]}{told}"
    by_index = {j.index: j.name for j in subject.joints}
    return [row(name, by_index[i], share, allowed[0], "of range", detail)
            for i, (share, detail) in worst.items()]


def _observed(subject: Subject) -> dict[str, F64]:
    return {k: v for k, v in subject.states.items() if k.startswith("state_")}


def _let_go(subject: Subject, qpos: F64) -> F64:
    """Return how far every joint gets from where it was let go."""
    import mujoco

    data = mujoco.MjData(subject.model)
    data.qpos[:] = qpos
    furthest = np.zeros(subject.model.nq)
    stepper = subject.stepper(data)
    steps = max(1, round(CONTROL / subject.model.opt.timestep))
    for _ in range(round(LET_GO / CONTROL)):
        stepper.step(steps)
        furthest = np.maximum(furthest, np.abs(data.qpos - qpos))  # keeps NaN
    return furthest


def _pulls(subject: Subject, qpos: F64) -> F64:
    """Return [V] with what force or torque the weight pulls along every degree of freedom.

    What a screw lifts pulls at its turn.
    """
    import mujoco

    model, data = subject.model, mujoco.MjData(subject.model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    pulls = np.asarray(-data.qfrc_bias + 0.0)
    dof = dict(zip(model.jnt_qposadr.tolist(), model.jnt_dofadr.tolist(), strict=True))
    for follower, leader, polynomial in followers_of(model):
        pulls[dof[leader]] += polynomial[1] * pulls[dof[follower]]
    return pulls
