"""The twin without motors: does a light push move every joint, and nothing move by itself."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.assets.driven import DrivenJoint
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
PUSH_TIME = 10.0  # s for 90 % of the range, one way
LET_GO = 2.0  # s without any force
DRIFT = 0.01  # of the range: what touching collision pieces may push apart
EARTH = 9.81  # units/s2 where a model has no gravity


def check_passive(subject: Subject) -> list[CheckResult]:
    """Push every joint through its range, and let go of all at both observed states.

    Both without gravity: a hand carries the weight, and gravity explains no motion. Others stay
    still under a push, but for what carries the joint and what it carries: those feel its inertia.
    """
    model = copy(subject.model)
    model.opt.gravity[:] = 0
    floating = replace(subject, model=model)
    moving = [j for j in subject.joints if j.span > 0]
    pushed = in_threads([partial(_push, floating, j, push_of(subject, j)) for j in moving])
    return [*(r for rows in pushed for r in rows), *_drift(subject, floating)]


def push_of(subject: Subject, joint: DrivenJoint) -> float:
    """Return the force or torque of a light push: PUSH of the weight, at the radius of gyration."""
    model = subject.model
    mass = float(model.body_mass[list(joint.moved)].sum())
    gravity = float(np.linalg.norm(model.opt.gravity)) or EARTH
    return PUSH * gravity * float(np.sqrt(mass * model.dof_M0[joint.dof]))


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
    detail = f"{force:.3g} {unit}, {PUSH:.0%} of its weight, for {took} s"
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
    states = {k: v for k, v in subject.states.items() if k.startswith("state_")}
    worst: dict[int, tuple[float, str]] = {}
    for name, qpos in (states or {"reference": subject.model.qpos0}).items():
        moved, pulls = _let_go(floating, qpos), _pulls(subject, qpos)
        for joint in subject.joints:
            share = float(moved[joint.qpos]) / max(joint.span, 1e-12)
            if share >= worst.get(joint.index, (-1.0, ""))[0] or not np.isfinite(share):
                worst[joint.index] = share, f"let go at {name} without gravity; {pulls[joint.dof]}"
    by_index = {j.index: j.name for j in subject.joints}
    return [row("drift", by_index[i], share, DRIFT, "of range", detail)
            for i, (share, detail) in worst.items()]


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


def _pulls(subject: Subject, qpos: F64) -> list[str]:
    """Return for every degree of freedom whether its weight overcomes its friction."""
    import mujoco

    model, data = subject.model, mujoco.MjData(subject.model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    pairs = zip(-data.qfrc_bias + 0.0, model.dof_frictionloss, strict=True)
    return [f"gravity pulls {pull:.3g}, friction holds {hold:.3g}" for pull, hold in pairs]
