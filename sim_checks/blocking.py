"""Parts that stop each other: what a real object does, told from overlap that geometry invents.

At a random combination of joints two parts stand in each other. Where the relation of both hangs on
one joint alone, the twin's geometry is wrong. Where it hangs on several, the way there is swept
from the observed states, one joint after the other: none is open all the way. If the parts would go
through each other for real (deep, or against the face of a thin board), the object blocks itself,
and the order of joints that works is told. A thin film along the motion is none: two surfaces that
a real object slides past each other overlap, and that is an error of the twin.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

from part2gs_robotics.assets.driven import DrivenJoint
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.sim_checks.interpenetration import (
    LIMIT,
    Pair,
    Poser,
    Swept,
    Worst,
    deepest_of,
    graded,
    measured,
    names,
)
from part2gs_robotics.sim_checks.result import CheckResult, row
from part2gs_robotics.sim_checks.subject import Subject

THROUGH = 3.0  # x the limit, the noise of one surface: two of them and half as much again
FACING = 0.5  # cosine of 60 deg between the thin side of an overlap and the motion into it
LEG = 12  # positions on the way of one joint
MOST_MOVERS = 3  # joints whose orders are tried: six orders


def check_combinations(subject: Subject, sweeps: dict[int, Swept], count: int
                       ) -> list[CheckResult]:
    """Return the deepest overlap over random joint combinations, and what real blocks explain.

    Args:
        subject: the model under test, with the postures of joints that wait.
        sweeps: of every joint by index.
        count: combinations; 0 = none.
    """
    if not subject.joints or not count:
        return []
    rng, poser = np.random.default_rng(0), Poser(subject)
    deepest: dict[Pair, tuple[Worst, F64]] = {}
    for turn in range(count):
        qpos = _combination(subject, rng, turn)
        poser.pose(qpos)
        for one in measured(poser.overlaps(poser.pairs)):
            if one.depth > deepest.get(one.pair, (Worst(), qpos))[0].depth:
                deepest[one.pair] = one, qpos
    rows, worst, limit = list[CheckResult](), Worst(), LIMIT * subject.size
    for pair, (one, qpos) in deepest.items():
        block = block_of(poser, qpos, pair, sweeps) if one.depth > limit else None
        if block:
            rows.append(CheckResult("blocking", names(subject, pair), "pass", detail=block))
        elif one.depth > worst.depth:
            worst = one
    detail = f"{count} random joint combinations"
    if worst.volume:
        detail += f", worst {names(subject, worst.pair)}, {worst.volume:.3g} units^3"
    return [*rows, graded(subject, row("overlap", "", worst.depth, limit, "units", detail))]


def _combination(subject: Subject, rng: np.random.Generator, turn: int) -> F64:
    """Return qpos with random joint positions.

    Where joints wait for others, those that go first are drawn in even turns, and in odd ones those
    that waited for the same posture, the others there.
    """
    waiting = [j for j in subject.joints if j.index in subject.around]
    drawn = [j for j in subject.joints if j.index not in subject.around]
    leader = waiting[turn // 2 % len(waiting)] if turn % 2 and waiting else None
    if leader:
        posture = subject.around[leader.index]
        drawn = [j for j in waiting if np.array_equal(subject.around[j.index], posture)]
    values = {j.qpos: float(rng.uniform(j.low, j.high)) for j in drawn}
    return subject.at(values, leader)


def block_of(poser: Poser, qpos: F64, pair: Pair, sweeps: dict[int, Swept]) -> str | None:
    """Return who stops whom where, and which order works; None if no real object would stop.

    Args:
        poser: of the model; it is left at another pose.
        qpos: combination of joints where two bodies overlap.
        pair: those bodies.
        sweeps: of every joint by index, each in a posture that lets it move.
    """
    subject = poser.subject
    movers = movers_of(subject, pair)
    jammed = any(sweeps[j.index][1].depth > LIMIT * subject.size for j in movers)
    if jammed or not 2 <= len(movers) <= MOST_MOVERS:
        return None
    if not _goes_through(poser, qpos, pair, movers):
        return None
    for name, start in _starts(subject).items():
        stops = [_first_contact(poser, (start, qpos), order, pair)
                 for order in permutations(movers)]
        if all(stop is not None for stop in stops):
            said = "; ".join(dict.fromkeys(s for s in stops if s))
            return f"{said} (swept from {name}){_order(poser, pair, movers)}"
    return None


def movers_of(subject: Subject, pair: Pair) -> list[DrivenJoint]:
    """Return the joints that move one body against the other."""
    return [j for j in subject.joints if (pair[0] in j.moved) != (pair[1] in j.moved)]


def _goes_through(poser: Poser, qpos: F64, pair: Pair, movers: list[DrivenJoint]) -> bool:
    """Return whether bodies are deep in each other, or pushed against each other's faces."""
    poser.pose(qpos)
    found = poser.overlaps([pair])
    if deepest_of(found).depth > THROUGH * LIMIT * poser.subject.size:
        return True
    solid = found[pair].solid
    assert solid is not None  # the bodies overlap here
    corners = np.asarray(solid.to_mesh().vert_properties, np.float64)[:, :3]
    center = corners.mean(0)
    thin = np.linalg.svd(corners - center, full_matrices=False)[2][-1]
    for joint in movers:
        way = poser.data.xaxis[joint.index]
        if joint.hinge:
            way = np.cross(way, center - poser.data.xanchor[joint.index])
        length = float(np.linalg.norm(way))
        if length > 0 and abs(float(thin @ way)) >= FACING * length:
            return True
    return False


def _starts(subject: Subject) -> dict[str, F64]:
    states = {k: v for k, v in subject.states.items() if k.startswith("state_")}
    return states or {"rest": subject.model.qpos0}


def _first_contact(poser: Poser, ends: tuple[F64, F64], order: tuple[DrivenJoint, ...], pair: Pair
                   ) -> str | None:
    """Return where a pair first meets on the way from start to goal; None if never, or at once."""
    subject, (start, goal) = poser.subject, ends
    values = {j.qpos: float(start[j.qpos]) for j in subject.joints}
    if _deep(poser, values, pair):
        return None
    for joint in order:
        for q in np.linspace(start[joint.qpos], goal[joint.qpos], LEG)[1:]:
            values[joint.qpos] = float(q)
            if _deep(poser, values, pair):
                others = ", ".join(f"{j.name} at {values[j.qpos]:.3g} {j.unit}" for j in order
                                   if j.index != joint.index)
                return f"with {others}, {joint.name} is stopped at {q:.3g} {joint.unit}"
    return None


def _deep(poser: Poser, values: dict[int, float], pair: Pair) -> bool:
    poser.pose(poser.subject.at(values))
    return deepest_of(poser.overlaps([pair])).depth > LIMIT * poser.subject.size


def _order(poser: Poser, pair: Pair, movers: list[DrivenJoint]) -> str:
    """Return the order of joints that leads from state 0 to state 1 without contact, in words."""
    states = poser.subject.states
    if "state_0" not in states or "state_1" not in states:
        return ""
    ends = states["state_0"], states["state_1"]
    for order in permutations(movers):
        if _first_contact(poser, ends, order, pair) is None:
            return f"; from state 0 to state 1 in the order {', '.join(j.name for j in order)}"
    return "; no order of single joints leads from state 0 to state 1"
