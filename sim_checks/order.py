"""Order: a seat rises once its lid has, a drawer comes out once the door before it is open.

Joints are driven one at a time, the others where the model rests. Where another part then stands in
the way, and does not in another posture, the joint waits: it is driven with the others there. The
posture is state 1 of a twin, else the ends of joints that carry what stands in the way, opened one
after the other. What waits must have something that goes first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from part2gs_robotics.assets.driven import DrivenJoint
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.sim_checks.interpenetration import LIMIT, Poser, Swept, sweep
from part2gs_robotics.sim_checks.subject import Subject

STATE = "state_1"
MOST_OPENED = 3  # joints that one may wait for: each costs two sweeps of every other one
Found = tuple[F64, Swept]


def in_order(subject: Subject, steps: int) -> tuple[Subject, dict[int, Swept]]:
    """Return the subject with the postures that waiting joints are driven in, and all sweeps.

    Args:
        subject: the model under test.
        steps: positions per joint.
    """
    poser = Poser(subject)
    sweeps = {j.index: sweep(poser, j, steps) for j in subject.joints}
    blocked = [j for j in subject.joints if _deep(subject, sweeps[j.index])]
    if len(blocked) == len(subject.joints):  # none could go first
        return subject, sweeps
    waiting: dict[int, Found] = {}
    for _ in blocked:  # what waits for one that waits itself is found in a later round
        for joint in blocked:
            if joint.index not in waiting:
                opened = {i: qpos for i, (qpos, _) in waiting.items()}
                free = [j for j in subject.joints if j not in blocked or j.index in opened]
                found = _posture(subject, (joint, sweeps[joint.index]), (free, opened), steps)
                waiting |= {joint.index: found} if found else {}
    notes = tuple(_told(subject, j, sweeps[j.index], waiting[j.index][0])
                  for j in subject.joints if j.index in waiting)
    around = {i: qpos for i, (qpos, _) in waiting.items()}
    sweeps |= {i: swept for i, (_, swept) in waiting.items()}
    return replace(subject, around=around, notes=subject.notes + notes), sweeps


def _deep(subject: Subject, swept: Swept) -> bool:
    return swept[1].depth > LIMIT * subject.size


def _posture(subject: Subject, blocked: tuple[DrivenJoint, Swept],
             free: tuple[list[DrivenJoint], dict[int, F64]], steps: int) -> Found | None:
    """Return where the others let a joint through, and its sweep there; None if nowhere.

    Args:
        subject: the model under test.
        blocked: a joint, and its sweep with the others at rest.
        free: joints that may go first, and the postures that some of them need themselves.
        steps: positions per joint.
    """
    joint, swept = blocked
    if STATE in subject.states:
        found = _tried(subject, joint, subject.states[STATE], steps)
        if not _deep(subject, found[1]):
            return found
    posture = subject.model.qpos0.copy()
    for _ in range(MOST_OPENED):
        trials = [_tried(subject, joint, qpos, steps)
                  for qpos in _opened(subject, (joint, swept), free, posture)]
        if not trials:
            return None
        posture, swept = min(trials, key=lambda t: t[1][1].depth)
        if not _deep(subject, swept):
            return posture, swept
    return None


def _tried(subject: Subject, joint: DrivenJoint, qpos: F64, steps: int) -> Found:
    return qpos, sweep(Poser(replace(subject, around={joint.index: qpos})), joint, steps)


def _opened(subject: Subject, blocked: tuple[DrivenJoint, Swept],
            free: tuple[list[DrivenJoint], dict[int, F64]], posture: F64) -> Iterator[F64]:
    """Yield postures with one more joint, that carries one of the two that meet, at an end."""
    joint, swept = blocked
    pair = set(swept[1].pair)
    for other in free[0]:
        moved = len(pair & other.moved) == 1 and other.index != joint.index
        if moved and posture[other.qpos] == subject.model.qpos0[other.qpos]:
            for end in (other.high, other.low):
                qpos = posture.copy()
                needed = free[1].get(other.index, subject.model.qpos0)
                qpos[needed != subject.model.qpos0] = needed[needed != subject.model.qpos0]
                qpos[other.qpos] = end
                if end != posture[other.qpos]:
                    yield qpos


def _told(subject: Subject, joint: DrivenJoint, alone: Swept, posture: F64) -> str:
    worst = alone[1]
    one, two = (subject.body(b) for b in worst.pair)
    first = [f"{j.name} at {posture[j.qpos]:.4g} {j.unit}" for j in subject.joints
             if posture[j.qpos] != subject.model.qpos0[j.qpos] and j.index != joint.index]
    return (f"{joint.name} waits for other joints: with those at rest {one} and {two} meet at "
            f"{worst.position:.4g} {joint.unit}; driven with {', '.join(first) or 'them'} instead")
