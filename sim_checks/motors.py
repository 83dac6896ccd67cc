"""Motors as a URDF of others means them: each joint driven within its effort and its velocity."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from part2gs_robotics.assets.driven import DrivenJoint
from part2gs_robotics.runtime.threads import in_threads
from part2gs_robotics.sim_checks.actuation import REACH, start
from part2gs_robotics.sim_checks.response import FAST, SPEEDING, run_of
from part2gs_robotics.sim_checks.result import CheckResult
from part2gs_robotics.sim_checks.subject import Subject

PEAK = 1.875  # x the mean speed: the highest of a minimum-jerk drive
LONGEST = 60.0  # s for a range, beyond which a velocity limit is taken for a joint that stands


def check_motors(subject: Subject, path: Path) -> list[CheckResult]:
    """Return a row per joint of a URDF whose <limit> says an effort or a velocity.

    The check's servo gets that much force, no help against gravity, and a command that never asks
    for more than that speed; other joints hold still. A joint that its motor cannot move is a
    warning: what else drives it is not in the file.

    Args:
        subject: with servos of the check's own.
        path: of the file; others than URDF give no rows.
    """
    if path.suffix.lower() != ".urdf":
        return []
    told = motors_of(path)
    joints = [j for j in subject.joints if j.ours and j.span > 0 and j.name in told]
    return in_threads([partial(_row, subject, j, told[j.name]) for j in joints])


def motors_of(path: Path) -> dict[str, tuple[float, float]]:
    """Return effort and velocity by joint, 0 where one is no number, of an inspected URDF."""
    out = {}
    for joint in ET.parse(path).getroot().iter("joint"):
        limit = joint.find("limit")
        if limit is not None:
            out[joint.get("name", "")] = (_number(limit.get("effort")),
                                          _number(limit.get("velocity")))
    return out


def _number(text: str | None) -> float:
    try:
        value = float(text or 0)
    except ValueError:
        return 0.0
    return value if np.isfinite(value) else 0.0


def _row(subject: Subject, joint: DrivenJoint, motor: tuple[float, float]) -> CheckResult:
    effort, speed = motor
    lacking = " and ".join(n for n, v in (("effort", effort), ("velocity", speed)) if not v > 0)
    if lacking:
        return _warn(joint, None, f"{lacking} of 0: what honours it never moves the joint",
                     f"write the motor's {lacking} into <limit> of {joint.name}")
    time = max(FAST, PEAK * joint.span / speed)
    if time > LONGEST:
        return _warn(joint, None, f"its range takes {time:.3g} s at {speed:g} {joint.unit}/s",
                     f"raise velocity of {joint.name}")
    weighed = within(subject, joint, effort)
    run = run_of(weighed, joint, time)
    share = min(run.top - joint.low, run.top - run.bottom) / joint.span
    pull = _pull(weighed, joint)
    detail = (f"0 to 100 % and back in {time:.3g} s each with {effort:g} and {speed:g} "
              f"{joint.unit}/s: uses {run.effort:.0%} of the effort; gravity pulls up to "
              f"{pull:.3g}")
    if share >= REACH and run.speeding <= SPEEDING:
        return CheckResult("motor limits", joint.name, "pass", float(share), REACH, "of the way",
                           detail)
    return _warn(joint, float(share), detail, f"raise effort of {joint.name} above {pull:.3g}, or "
                 "lighten what it carries")


def _warn(joint: DrivenJoint, share: float | None, detail: str, cause: str) -> CheckResult:
    return CheckResult("motor limits", joint.name, "warn", share, REACH, "of the way", detail,
                       cause)


def within(subject: Subject, joint: DrivenJoint, effort: float) -> Subject:
    """Return the subject with a joint's servo limited to an effort and gravity on what it moves."""
    model = copy(subject.model)
    model.actuator_forcelimited[joint.servo] = 1
    model.actuator_forcerange[joint.servo] = -effort, effort
    model.body_gravcomp[list(joint.moved)] = 0.0
    return replace(subject, model=model)


def _pull(subject: Subject, joint: DrivenJoint) -> float:
    """Return the largest force of gravity on a joint over its range."""
    import mujoco

    worst = 0.0
    for share in np.linspace(0, 1, 9):
        data = start(subject, joint, float(share))
        mujoco.mj_forward(subject.model, data)
        worst = max(worst, abs(float(data.qfrc_bias[joint.dof])))
    return worst
