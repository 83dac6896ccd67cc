"""Order: a seat rises once its lid has, a drawer comes out once the door before it is open.

Joints are driven one at a time, the others where state 0 is. Where another part then stands in the
way of the true surfaces, and does not where state 1 is, the joint waits: it is driven with the
others at state 1. What waits must have something that goes first.
"""

from __future__ import annotations

from dataclasses import replace

from part2gs_robotics.sim_checks.driven import DrivenJoint
from part2gs_robotics.sim_checks.interpenetration import LIMIT, Poser, Swept, sweep
from part2gs_robotics.sim_checks.subject import Subject

STATE = "state_1"


def in_order(subject: Subject, steps: int) -> tuple[Subject, dict[int, Swept]]:
    """Return the subject with the postures that waiting joints are driven in, and all sweeps.

    Args:
        subject: the model under test.
        steps: positions per joint.
    """
    poser = Poser(subject)
    sweeps = {j.index: sweep(poser, j, steps) for j in subject.joints}
    if STATE not in subject.states or len(subject.joints) < 2:
        return subject, sweeps
    opened, limit = subject.states[STATE], LIMIT * subject.size
    trial = Poser(replace(subject, around={j.index: opened for j in subject.joints}))
    waiting = {}
    for joint in subject.joints:
        if sweeps[joint.index][1].depth > limit:
            again = sweep(trial, joint, steps)
            if again[1].depth <= limit:
                waiting[joint.index] = again
    if len(waiting) == len(subject.joints):  # none could go first
        return subject, sweeps
    notes = tuple(_told(subject, j, sweeps[j.index]) for j in subject.joints if j.index in waiting)
    around = dict.fromkeys(waiting, opened)
    return replace(subject, around=around, notes=subject.notes + notes), sweeps | waiting


def _told(subject: Subject, joint: DrivenJoint, alone: Swept) -> str:
    worst = alone[1]
    one, two = (subject.body(b) for b in worst.pair)
    return (f"{joint.name} waits for other joints: with those at state 0 {one} and {two} meet at "
            f"{worst.position:.4g} {joint.unit}; driven with them at state 1")
