"""At rest: held half-way against gravity, left alone for ten seconds, and twice the same."""

from __future__ import annotations

from functools import partial

import numpy as np

from part2gs_robotics.assets.driven import DrivenJoint
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.runtime.threads import in_threads
from part2gs_robotics.sim_checks.actuation import CONTROL, smooth, start, warnings_of
from part2gs_robotics.sim_checks.result import CheckResult, passed, row
from part2gs_robotics.sim_checks.stability import FALLEN
from part2gs_robotics.sim_checks.subject import Subject

HALF = 0.5  # of the range: where gravity pulls a lid as it does at neither state
HALF_TIME = 2.0  # s: a servo that gives way has fallen far by then
LONG = 10.0  # s of rest under stress
TREMBLE = 1e-3  # of the range: how far a joint at rest may still move in the last second
REPEAT = 1.0  # s of the drive that is done twice


def check_rest(subject: Subject, stress: bool = False) -> list[CheckResult]:
    """Return rows of holding half-way, of doing one drive twice, and under stress of long rest.

    Args:
        subject: the model under test.
        stress: also ten seconds at every observed state.
    """
    joints = [j for j in subject.joints if j.servo >= 0 and j.span > 0]
    held = in_threads([partial(_half, subject, j) for j in joints])
    rows = [*held, *([_twice(subject)] if joints else [])]
    if stress and joints:
        states = {k: v for k, v in subject.states.items() if k.startswith("state_")}
        tasks = [partial(_long, subject, name, qpos)
                 for name, qpos in (states or {"reference": subject.model.qpos0}).items()]
        rows += [r for found in in_threads(tasks) for r in found]
    return rows


def _half(subject: Subject, joint: DrivenJoint) -> CheckResult:
    """Hold one joint in the middle of its range."""
    model, data = subject.model, start(subject, joint, HALF)
    before = float(data.qpos[joint.qpos])
    subject.stepper(data).step(max(1, round(HALF_TIME / model.opt.timestep)))
    way = float(data.qpos[joint.qpos]) - before
    said = ", ".join(warnings_of(data))
    pull = -float(data.qfrc_bias[joint.dof])
    detail = (f"{way:+.4g} {joint.unit} from half-way in {HALF_TIME:g} s; gravity pulls "
              f"{pull:.3g}{': ' + said if said else ''}")
    return row("hold", joint.name, abs(way) / joint.span if not said else float("nan"), FALLEN,
               "of range", detail)


def _twice(subject: Subject) -> CheckResult:
    """Drive all joints at once, twice from the same start: nothing but the model may count."""
    one, two = _driven(subject), _driven(subject)
    gap = float(np.abs(one - two).max()) if one.shape == two.shape else float("nan")
    same = bool(np.array_equal(one, two, equal_nan=True))
    return CheckResult("determinism", "", passed(same), gap, 0.0, "rad or units",
                       f"the same {REPEAT:g} s drive of all joints, done twice")


def _driven(subject: Subject) -> F64:
    """Return [S, nq] of a drive of all joints through the middle of their ranges."""
    import mujoco

    model, data = subject.model, mujoco.MjData(subject.model)
    stepper, steps = subject.stepper(data), max(1, round(CONTROL / model.opt.timestep))
    out = np.zeros((round(REPEAT / CONTROL), model.nq))
    for k in range(len(out)):
        for joint in subject.joints:
            if joint.servo >= 0:
                share = HALF * smooth((k + 1) / len(out))
                data.ctrl[joint.servo] = joint.low + share * joint.span
        stepper.step(steps)
        out[k] = data.qpos
    return out


def _long(subject: Subject, state: str, qpos: F64) -> list[CheckResult]:
    """Hold an observed state for ten seconds: nothing falls, creeps or trembles."""
    import mujoco

    model, data = subject.model, mujoco.MjData(subject.model)
    data.qpos[:] = qpos
    for joint in subject.joints:
        if joint.servo >= 0:
            data.ctrl[joint.servo] = qpos[joint.qpos]
    stepper = subject.stepper(data)
    stepper.step(round((LONG - 1.0) / model.opt.timestep))
    track, still = [], max(1, round(CONTROL / model.opt.timestep))
    for _ in range(round(1.0 / CONTROL)):
        stepper.step(still)
        track.append(data.qpos.copy())
    moved, said = np.ptp(np.array(track), axis=0), ", ".join(warnings_of(data))
    rows = []
    for joint in subject.joints:
        way = abs(float(track[-1][joint.qpos] - qpos[joint.qpos])) / max(joint.span, 1e-12)
        tremble = float(moved[joint.qpos]) / max(joint.span, 1e-12)
        detail = f"held at {state} for {LONG:g} s: {way:.2g} of the range away, moves by"
        detail += f" {tremble:.2g} in the last second{': ' + said if said else ''}"
        # both against their own limit; the worse one is the row's number
        value = max(way / FALLEN, tremble / TREMBLE) if not said else float("nan")
        rows.append(row("rest", joint.name, value, 1.0, "of what is allowed", detail))
    return rows
