"""Does the end of a motion depend on the time step, the gain or the waiting time."""

from __future__ import annotations

from collections.abc import Collection
from copy import copy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from part2gs_robotics.assets.driven import DrivenJoint
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.runtime.threads import in_threads
from part2gs_robotics.sim_checks.actuation import HIGH, LOW, MAX_STEPS, start, warnings_of
from part2gs_robotics.sim_checks.result import CheckResult, row
from part2gs_robotics.sim_checks.subject import Subject

Run = tuple[int, float]  # what the time step is divided and the gain multiplied by
SAME_END = 0.01  # of the range
MOVE, REST = 1.0, 1.0  # s of ramp and of waiting
HALVINGS = (1, 2, 4)  # what the time step is divided by: whole, halved, halved twice
GAIN = 100.0  # on the stiffness; its root on the damping keeps the damping ratio
HOLD_TIME = 3.0  # s
DRIFT = 1e-3  # of the range during the last second of holding
FALLEN = 0.01  # of the range in all: a servo of ours droops by 0.4 % under weight and friction
ENERGY = 0.01  # of the weight times the size: what rounding and soft contacts may add
SHORT, LONG = 2.0, 10.0  # s after letting go, and under stress
SAMPLE = 0.05  # s between looks at the energy
COMMANDS = 50  # of one ramp


@dataclass(frozen=True)
class End:
    """Where a joint came to rest, and the warnings on the way."""

    position: float
    warnings: tuple[str, ...]


def check_stability(
    subject: Subject, stuck: Collection[str] = (), stress: bool = False
) -> list[CheckResult]:
    """Return one row per joint and per variation of step and gain, plus hold and energy rows.

    Args:
        subject: the model under test.
        stuck: joints that cannot travel; where a jam rests says nothing about the step.
        stress: watch energy for ten seconds.
    """
    rows, step = list[CheckResult](), subject.model.opt.timestep
    driven = [j for j in subject.joints if j.servo >= 0 and j.span > 0]  # actuation told the rest
    free = [j for j in driven if j.name not in stuck]
    short = (MOVE + REST) * HALVINGS[-1] / step > MAX_STEPS
    ends = _ends(subject, [] if short else free)
    for joint in driven:
        if joint not in free:
            why = "not run: the joint does not travel"
            rows.append(CheckResult("time step", joint.name, "skipped", detail=why))
        elif short:
            why = f"time step {step:.2g} s is too small to halve twice"
            rows.append(CheckResult("time step", joint.name, "incomplete", detail=why))
        else:
            rows += _vary(step, joint, ends[joint.index])
    seconds = LONG if stress else SHORT
    rest = in_threads([partial(_hold, subject), partial(_energy, subject, seconds)])
    return [*rows, *rest[0], *rest[1]]


def _ends(subject: Subject, joints: list[DrivenJoint]) -> dict[int, dict[Run, End]]:
    """Return by joint, and by what the step is divided and the gain multiplied by, where it ends.

    The longest run first, so that none is waited for at the end.
    """
    step = subject.model.opt.timestep
    runs = [(j, (n, 1.0)) for n in reversed(HALVINGS) for j in joints]
    runs += [(j, (1, GAIN)) for j in joints if not j.ours]
    ends = in_threads([partial(run_to_end, subject, j, step / n, gain) for j, (n, gain) in runs])
    found: dict[int, dict[Run, End]] = {j.index: {} for j in joints}
    for (joint, run), end in zip(runs, ends, strict=True):
        found[joint.index][run] = end
    return found


def _vary(step: float, joint: DrivenJoint, ends: dict[Run, End]) -> list[CheckResult]:
    rows = []
    for n in HALVINGS[1:]:
        detail = f"h/{n} = {step / n:.3g} s against h = {step:.3g} s"
        rows.append(_compare("time step", joint, ends[1, 1.0], ends[n, 1.0], detail))
    if joint.ours:
        detail = "the servo is the check's own"
        return [*rows, CheckResult("gain x 100", joint.name, "skipped", detail=detail)]
    detail = f"at h = {step:.3g} s"
    return [*rows, _compare("gain x 100", joint, ends[1, 1.0], ends[1, GAIN], detail)]


def _compare(name: str, joint: DrivenJoint, a: End, b: End, detail: str) -> CheckResult:
    gap = abs(a.position - b.position) / joint.span
    said = sorted({*a.warnings, *b.warnings})
    detail += f": ends at {a.position:.5g} and {b.position:.5g} {joint.unit}"
    if said or not np.isfinite(gap):
        detail += f"; {', '.join(said) or 'not finite'}"
        return CheckResult(name, joint.name, "fail", _known(gap), SAME_END, "of range", detail)
    return row(name, joint.name, gap, SAME_END, "of range", detail)


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None


def run_to_end(subject: Subject, joint: DrivenJoint, step: float, gain: float) -> End:
    """Ramp one joint from 5 % to 95 % and return where it rests; the model stays as it is."""
    model, a = copy(subject.model), joint.servo
    subject = replace(subject, model=model)
    model.opt.timestep = step
    model.actuator_gainprm[a, 0] *= gain
    model.actuator_biasprm[a, 1] *= gain
    model.actuator_biasprm[a, 2] *= np.sqrt(gain)
    data = start(subject, joint, LOW)
    stepper = subject.stepper(data)
    per_command = max(1, round(MOVE / COMMANDS / step))
    for k in range(1, COMMANDS + 1):
        share = LOW + (HIGH - LOW) * k / COMMANDS
        data.ctrl[a] = joint.low + share * joint.span
        stepper.step(per_command)
    stepper.step(round(REST / step))
    return End(float(data.qpos[joint.qpos]), warnings_of(data))


def _hold(subject: Subject) -> list[CheckResult]:
    """Hold every observed state with the servos: no creep in the last second."""
    import mujoco

    rows: list[CheckResult] = []
    states = {k: v for k, v in subject.states.items() if k.startswith("state_")}
    model = subject.model
    for name, qpos in (states or {"reference": model.qpos0}).items():
        data = mujoco.MjData(model)
        data.qpos[:] = qpos
        stepper = subject.stepper(data)
        for joint in subject.joints:
            if joint.servo >= 0:
                data.ctrl[joint.servo] = qpos[joint.qpos]
        stepper.step(round((HOLD_TIME - 1.0) / model.opt.timestep))
        before = data.qpos.copy()
        stepper.step(round(1.0 / model.opt.timestep))
        said = ", ".join(warnings_of(data))
        for joint in subject.joints:
            rows.append(_fallen(joint, name, float(data.qpos[joint.qpos] - qpos[joint.qpos])))
            creep = abs(float(data.qpos[joint.qpos] - before[joint.qpos])) / max(joint.span, 1e-12)
            detail = f"held at {name} for {HOLD_TIME:g} s{': ' + said if said else ''}"
            result = row("hold", joint.name, creep, DRIFT, "of range per s", detail)
            rows.append(result if not said else _failed(result))
    return rows


def _fallen(joint: DrivenJoint, state: str, way: float) -> CheckResult:
    """Return whether a joint is still where it was to be held."""
    return row("hold", joint.name, abs(way) / max(joint.span, 1e-12), FALLEN, "of range",
               f"{way:+.4g} {joint.unit} from {state}, where its servo was to hold it")


def _failed(result: CheckResult) -> CheckResult:
    return CheckResult(
        result.name, result.subject, "fail", result.value, result.limit, result.unit, result.detail
    )


def _energy(subject: Subject, seconds: float) -> list[CheckResult]:
    """Let go of all servos at every observed state: nothing gains energy."""
    if not subject.joints:
        return []
    states = {k: v for k, v in subject.states.items() if k.startswith("state_")}
    gains = {name: _gained(subject, qpos, seconds)
             for name, qpos in (states or {"reference": subject.model.qpos0}).items()}
    worst = max(gains, key=lambda n: np.nan_to_num(gains[n][0], nan=np.inf))
    gained, said = gains[worst]
    result = row("passive", "", gained, ENERGY, "of m g size",
                 f"energy gained in {seconds:g} s, servos off, let go at {worst}")
    return [_failed(result) if said or not np.isfinite(gained) else result]


def _gained(subject: Subject, qpos: F64, seconds: float) -> tuple[float, tuple[str, ...]]:
    """Return the largest gain of energy after letting go, of m g size, and the warnings."""
    import mujoco

    model = copy(subject.model)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    for joint in subject.joints:
        if joint.ours:  # our motor carries the weight no more
            model.body_gravcomp[list(joint.moved)] = 0.0
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    mujoco.mj_forward(model, data)
    stepper = replace(subject, model=model).stepper(data)
    first, highest = float(data.energy.sum()), -np.inf
    for _ in range(round(seconds / SAMPLE)):
        stepper.step(max(1, round(SAMPLE / model.opt.timestep)))
        highest = max(highest, float(data.energy.sum()))
    gravity = float(np.linalg.norm(model.opt.gravity)) or 9.81
    scale = float(model.body_subtreemass[0]) * gravity * subject.size
    return (highest - first) / max(scale, 1e-300), warnings_of(data)
