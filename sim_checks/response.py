"""How a servo answers: a step by itself, and the whole range at full speed with everything on."""

from __future__ import annotations

from collections.abc import Collection
from copy import copy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from part2gs_robotics.assets.driven import DrivenJoint
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.runtime.threads import in_threads
from part2gs_robotics.sim_checks.actuation import HIGH, LOW, REACH, smooth, start, warnings_of
from part2gs_robotics.sim_checks.result import CheckResult, passed, row
from part2gs_robotics.sim_checks.subject import Subject

STEP_TIME = 3.0  # s after a step
SAMPLE = 0.005  # s between samples of a step: a thirtieth of the slowest servo's settling
BAND = 0.05  # of the step, in which a servo has settled (SimReady)
SLOWEST = 1.5  # s to settle; SimReady allows 5, finished twins take 0.02 to 0.2
OVERSHOOT = 0.25  # of the step; SimReady allows 50 %, finished twins reach 0.5 %
TURNS = 20  # changes of direction while settling (SimReady)
CREEP = 1e-3  # of the highest speed: slower turns are rounding
COMMAND = 0.001  # s between commands of a drive: coarser stairs ring in force and speed
FAST, REST = 0.5, 0.5  # s for the whole range, a brisk hand, and to arrive at its ends
SLOW = 10.0  # s for the whole range under stress: friction sticks where a servo is soft
SPEEDING = 1.05  # x the highest speed commanded (SimReady's velocity_limit)
USED = 0.95  # of the force range, in the slow drive; more and nothing is left for a load


@dataclass(frozen=True)
class Step:
    """What came of a step: all in shares of the step, or s.

    Attributes:
        overshoot.  settling: s, inf if never.  turns: changes of direction.  said: warnings.
    """

    overshoot: float
    settling: float
    turns: int
    said: tuple[str, ...]


@dataclass(frozen=True)
class Run:
    """A drive 0 -> 100 -> 0 %.

    Attributes:
        top, bottom: positions at rest there.  speeding: highest speed over the highest commanded.
        effort: largest force over the force range, 0 without one.  said: warnings.
    """

    top: float
    bottom: float
    speeding: float
    effort: float
    said: tuple[str, ...]


def check_response(subject: Subject, stuck: Collection[str] = (), stress: bool = False
                   ) -> list[CheckResult]:
    """Return rows for every joint with a servo of its own.

    Args:
        subject: the model under test.
        stuck: joints that cannot travel.
        stress: also drive slowly.
    """
    joints = [j for j in subject.joints
              if j.servo >= 0 and not j.ours and j.span > 0 and j.name not in stuck]
    times = (FAST, SLOW) if stress else (FAST,)
    tasks = [partial(_rows, subject, joint, times) for joint in joints]
    return [r for rows in in_threads(tasks) for r in rows]


def _rows(subject: Subject, joint: DrivenJoint, times: tuple[float, ...]) -> list[CheckResult]:
    step = step_of(subject, joint)
    said = f"; {', '.join(step.said)}" if step.said else ""
    alone = f"step of {(HIGH - LOW) * joint.span:.3g} {joint.unit}, contacts, limits off{said}"
    rows = [row("overshoot", joint.name, step.overshoot, OVERSHOOT, "of the step", alone),
            row("settling", joint.name, step.settling, SLOWEST, "s", f"to within {BAND:.0%}"),
            row("jitter", joint.name, float(step.turns), TURNS, "turns", "on the way to rest")]
    for name, time in zip(("fast drive", "slow drive"), times, strict=False):
        rows += _judged(name, joint, run_of(subject, joint, time), time)
    return rows


def _judged(name: str, joint: DrivenJoint, run: Run, time: float) -> list[CheckResult]:
    share = min(run.top - joint.low, run.top - run.bottom) / joint.span
    good = share >= REACH and run.speeding <= SPEEDING and not run.said
    detail = (f"0 to 100 % and back in {time:g} s each: rests at {run.top:.4g} and "
              f"{run.bottom:.4g} of {joint.low:.4g}..{joint.high:.4g} {joint.unit}, up to "
              f"{run.speeding:.0%} of the speed commanded")
    detail += f"; {', '.join(run.said)}" if run.said else ""
    out = [CheckResult(name, joint.name, passed(good), float(share), REACH, "of the way", detail)]
    if name == "slow drive":
        out.append(row("effort", joint.name, run.effort, USED, "of the force range",
                       "largest force of the slow drive"))
    return out


def step_of(subject: Subject, joint: DrivenJoint) -> Step:
    """Command a joint from 5 % to 95 % at once, with contacts and limits off, of force too.

    What is left is what the gains make of it; a servo that saturates swings whatever they are.
    """
    import mujoco

    model = copy(subject.model)
    bits = mujoco.mjtDisableBit
    model.opt.disableflags |= int(bits.mjDSBL_LIMIT) | int(bits.mjDSBL_CONTACT)
    model.actuator_forcelimited[joint.servo] = 0
    model.jnt_actfrclimited[joint.index] = 0
    data = start(replace(subject, model=model), joint, LOW)
    goal, way = joint.low + HIGH * joint.span, (HIGH - LOW) * joint.span
    data.ctrl[joint.servo] = goal
    substeps = max(1, round(SAMPLE / model.opt.timestep))
    count = int(np.ceil(STEP_TIME / (substeps * model.opt.timestep)))
    q, speed, times = (np.zeros(count) for _ in range(3))
    for i in range(count):
        mujoco.mj_step(model, data, substeps)
        q[i], speed[i], times[i] = data.qpos[joint.qpos], data.qvel[joint.dof], data.time
    rest = float(q[-1])  # droop is told by hold
    outside = np.flatnonzero(~(np.abs(q - rest) <= BAND * way))
    late = bool(np.isfinite(rest)) and abs(rest - goal) <= BAND * way
    settling = float(times[outside[-1]]) if len(outside) else 0.0
    if not late or (len(outside) and outside[-1] > 0.9 * count):
        settling = float("inf")
    return Step(float((q - goal).max() / way), settling, turns_of(speed), warnings_of(data))


def turns_of(speed: F64) -> int:
    """Return how often a speed changes its sign, slow creeping left out."""
    brisk = speed[np.abs(speed) > CREEP * np.abs(speed).max()]
    return int((np.sign(brisk[1:]) != np.sign(brisk[:-1])).sum())


def run_of(subject: Subject, joint: DrivenJoint, time: float) -> Run:
    """Drive a joint 0 -> 100 -> 0 % in a time each way, with everything on."""
    model, data = subject.model, start(subject, joint, 0.0)
    stepper = subject.stepper(data)
    substeps = max(1, round(COMMAND / model.opt.timestep))
    limit = float(np.abs(model.actuator_forcerange[joint.servo]).max())
    fastest, effort, ends = 0.0, 0.0, []
    for way in (1.0, -1.0):
        began = data.time
        while data.time - began < time + REST:
            share = smooth((data.time - began) / time)
            data.ctrl[joint.servo] = joint.low + joint.span * (share if way > 0 else 1 - share)
            stepper.step(substeps)
            fastest = max(fastest, abs(float(data.qvel[joint.dof])))
            effort = max(effort, abs(float(data.actuator_force[joint.servo])))
        ends.append(float(data.qpos[joint.qpos]))
    commanded = 1.875 * joint.span / time  # highest speed of a minimum-jerk drive
    limited = bool(model.actuator_forcelimited[joint.servo]) and limit > 0
    return Run(ends[0], ends[1], fastest / commanded, effort / limit if limited else 0.0,
               warnings_of(data))
