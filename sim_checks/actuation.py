"""Drive every joint through its range with its own servo and watch everything else."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.assets.driven import DrivenJoint
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.runtime.threads import in_threads
from part2gs_robotics.sim_checks.result import CheckResult, passed, row
from part2gs_robotics.sim_checks.subject import Subject

if TYPE_CHECKING:
    import mujoco

LOW, HIGH = 0.05, 0.95  # of the range: clear of the soft limits
REACH = 0.99  # of the way between them
TRACKING = 0.10  # of the range: lag of a critically damped 30 rad/s servo is 4 %
STILL_ANGLE = np.deg2rad(0.1)  # rad that a hinge may move while another joint is driven
STILL_SHARE = 1e-3  # of the size for slides: 1 mm on a metre
CARRIED_SHARE = 0.01  # of its own range, for a joint that rides on the driven part: it sags anew
SETTLE, TRAVEL, HOLD = 0.5, 3.0, 1.0  # s; settle + 2 (travel + hold) = 8.5 s < 10 s
FAR_END = SETTLE + TRAVEL + HOLD
CONTROL = 0.02  # s between commands
SOFT = ("tracking", "hold", "rest")  # rows that a servo fails by its softness alone
MAX_STEPS = 200_000  # of one drive; a finer time step is reported, not waited for


@dataclass(frozen=True)
class Drive:
    """Trace of one drive, sampled at every command.

    Attributes:
        time, target: [S].  qpos: [S, nq].  warnings: names of the engine's warnings.
        held: [S] bool, target at rest.  finite: no NaN anywhere.
    """

    time: F64
    target: F64
    qpos: F64
    held: NDArray[np.bool_]
    warnings: tuple[str, ...]
    finite: bool


def check_actuation(subject: Subject) -> list[CheckResult]:
    """Drive every joint 5 % -> 95 % -> 5 % and return its rows."""
    rows: list[CheckResult] = []
    hindered = [_why_not(subject, joint) for joint in subject.joints]
    driven = [joint for joint, why in zip(subject.joints, hindered, strict=True) if not why]
    traces = iter(in_threads([partial(drive, subject, joint) for joint in driven]))
    for joint, why in zip(subject.joints, hindered, strict=True):
        if why:
            rows.append(CheckResult("actuation", joint.name, "incomplete", detail=why))
        else:
            rows += _judge(subject, joint, next(traces))
    return theirs(subject, rows)


def theirs(subject: Subject, rows: list[CheckResult]) -> list[CheckResult]:
    """Return what fails by a servo in assets of others as warnings: it is not what is on trial.

    Their own servos are as strong as they mean them, and the check's may be too soft for a spring.
    Whether anything is in the way of a joint is told by `reach` of the check's own servo, and by
    the sweep of what collides.
    """
    weak = {j.name for j in subject.joints if not j.ours}
    cause = "a servo too soft for the joint's springs and weight, or with a narrow ctrlrange"
    return [replace(r, status="warn", cause=cause) if not subject.ours and r.status == "fail"
            and (r.subject in weak or r.name in SOFT) else r for r in rows]


def _why_not(subject: Subject, joint: DrivenJoint) -> str | None:
    """Return why a joint cannot be driven, None if it can."""
    if joint.servo < 0:
        return "no servo could be added: unnamed joint"
    if not joint.span > 0:
        return "range is empty"
    step = subject.model.opt.timestep
    if 2 * (TRAVEL + HOLD) / step > MAX_STEPS:
        return f"time step {step:.2g} s needs more than {MAX_STEPS} steps"
    return None


def drive(subject: Subject, joint: DrivenJoint) -> Drive:
    """Simulate the drive of one joint, the others held where it needs them: mostly at state 0."""
    model, data = subject.model, start(subject, joint, LOW)
    stepper, substeps = subject.stepper(data), max(1, round(CONTROL / model.opt.timestep))
    count = int(np.ceil((SETTLE + 2 * (TRAVEL + HOLD)) / (substeps * model.opt.timestep)))
    times = np.arange(1, count + 1) * substeps * model.opt.timestep
    targets = joint.low + joint.span * np.array([_profile(t) for t in times])
    qpos = np.full((count, model.nq), np.nan)
    for i, target in enumerate(targets):
        data.ctrl[joint.servo] = target
        stepper.step(substeps)
        qpos[i] = data.qpos
        if not np.isfinite(data.qpos).all():
            break
        if i and times[i - 1] < FAR_END <= times[i] and not _arrived(joint, data.qpos):
            return _cut_short(i + 1, times, targets, qpos, data)
    return _cut_short(count, times, targets, qpos, data)


def _arrived(joint: DrivenJoint, qpos: F64) -> bool:
    way = (HIGH - LOW) * joint.span
    return bool(qpos[joint.qpos] - joint.low - LOW * joint.span >= REACH * way)


def _cut_short(count: int, times: F64, targets: F64, qpos: F64, data: mujoco.MjData) -> Drive:
    """Return the trace so far: a joint that is stuck is not asked to come back."""
    held = np.concatenate([[False], np.abs(np.diff(targets[:count])) < 1e-12])
    trace, fine = qpos[:count], bool(np.isfinite(qpos[:count]).all())
    return Drive(times[:count], targets[:count], trace, held, warnings_of(data), fine)


def start(subject: Subject, joint: DrivenJoint, share: float) -> mujoco.MjData:
    """Return data with one joint at a share of its range and every servo holding its joint."""
    import mujoco

    data = mujoco.MjData(subject.model)
    data.qpos[:] = subject.at({joint.qpos: joint.low + share * joint.span}, joint)
    for other in subject.joints:
        if other.servo >= 0:
            data.ctrl[other.servo] = data.qpos[other.qpos]
    return data


def warnings_of(data: mujoco.MjData) -> tuple[str, ...]:
    """Return the names of all warnings the engine counted."""
    import mujoco

    kinds = mujoco.mjtWarning.__members__.items()
    count = len(data.warning)
    return tuple(n for n, k in kinds if int(k) < count and data.warning[int(k)].number)


def _profile(time: float) -> float:
    """Return the commanded share of the range: rest, up, hold, down, hold; minimum jerk."""
    up = smooth((time - SETTLE) / TRAVEL)
    down = smooth((time - SETTLE - TRAVEL - HOLD) / TRAVEL)
    return LOW + (HIGH - LOW) * (up - down)


def smooth(s: float) -> float:
    """Return the share of the way at a share of the time: minimum jerk, peak speed 1.875."""
    s = min(max(s, 0.0), 1.0)
    return s**3 * (10 - 15 * s + 6 * s * s)


def _judge(subject: Subject, joint: DrivenJoint, trace: Drive) -> list[CheckResult]:
    rows = []
    bad = ", ".join(trace.warnings) or ("" if trace.finite else "NaN")
    status = passed(not bad)
    rows.append(CheckResult("warnings", joint.name, status, detail=bad or "no engine warning"))
    if not trace.finite:
        return [*rows, CheckResult("reach", joint.name, "fail", detail="the simulation blew up")]
    q = trace.qpos[:, joint.qpos]
    rows.append(_reach(joint, trace, q))
    lag = float(np.abs(q - trace.target).max()) / joint.span
    rows.append(row("tracking", joint.name, lag, TRACKING, "of range", "largest lag of the servo"))
    return [*rows, *_still(subject, joint, trace)]


def _reach(joint: DrivenJoint, trace: Drive, q: F64) -> CheckResult:
    way = (HIGH - LOW) * joint.span
    first = joint.low + LOW * joint.span
    top = q[trace.time <= FAR_END][-1]  # where it rests at the far end
    there = (top - first) / way
    back = (top - q[-1]) / way if trace.time[-1] > FAR_END + CONTROL else there
    share = float(min(there, back))
    detail = f"rests at {top:.4g} and {q[-1]:.4g} of {joint.low:.4g}..{joint.high:.4g} {joint.unit}"
    status = passed(share >= REACH)
    return CheckResult("reach", joint.name, status, share, REACH, "of the way", detail)


def _still(subject: Subject, driven: DrivenJoint, trace: Drive) -> list[CheckResult]:
    """Return the worst other joint: what it moved, relative to what it may move."""
    settled = min(int(np.searchsorted(trace.time, SETTLE)), len(trace.time) - 1)
    worst, name, limit, unit = 0.0, "", 1.0, ""
    for other in subject.joints:
        if other.index == driven.index:
            continue
        rides = int(subject.model.jnt_bodyid[other.index]) in driven.moved
        allowed = STILL_ANGLE if other.hinge else STILL_SHARE * subject.size
        # before, every servo takes up the weight of what it holds
        chosen = trace.held if rides else trace.time >= trace.time[settled]
        if rides:  # inertia moves it during the drive: judged at rest
            allowed = max(allowed, CARRIED_SHARE * other.span)
            chosen = chosen & _rested(trace)
        track = trace.qpos[:, other.qpos]
        moved = float(np.abs(track[chosen] - track[settled]).max())
        if moved / allowed >= worst / limit:
            worst, name, limit, unit = moved, other.name, allowed, other.unit
    if not name:
        return []
    return [row("others still", driven.name, worst, limit, unit, f"moved most: {name}")]


def _rested(trace: Drive) -> NDArray[np.bool_]:
    """Return which samples lie in the second half of a hold."""
    ends = (FAR_END, FAR_END + TRAVEL + HOLD)
    near = [(trace.time <= end) & (trace.time > end - HOLD / 2) for end in ends]
    return near[0] | near[1]
