"""Pruning: parts that leave again once joints are settled, and what stays put right.

Before joints are settled a bend may look like a part, before a carried part is known a turn about
the base may have stood in for it, and of two motions alike in cost the wrong one may be taken: then
the images do not hold it, and another has its place.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from part2gs_robotics.decide.candidate import MORE_MET, Candidate
from part2gs_robotics.decide.grow import one_more
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.decide.split import TORN, torn
from part2gs_robotics.decide.turn_alternatives import righted
from part2gs_robotics.evidence.surfels import apart
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.search.choose_kind import choose_joint

logger = logging.getLogger(__name__)
MUCH = 8.0  # prices: false parts that images did not hold saved 6 and 7, true ones 9 and 13
LOOSE = 0.02  # rad: five times the loosest true part of eleven scenes; false ones: 0.034, none
# rad, by images or faces: plain true parts are held to 0.0015 to 0.002, a false one to 0.01.
FIRM = 0.004
FEW = 2.5  # prices: firm parts whose way images do not show saved 5.4 to 35, a bent false one 1.2
# Of the richer state's surfels: true parts 0.2 up, two that save much 0.06, 0.11; a false one 0.11.
SHARED = 0.15
# Prices before anything is settled: in 19 builds true parts saved 1.08 to 42, a false one -0.03.
HOPEFUL = 0.25
ALIKE = 0.05  # of the diagonal: refinement takes motions nearer than that to one place


def refilled(judge: Judge, before: Candidate, after: Candidate, pool: Sequence[Joint],
             ) -> Candidate:
    """Return what is left of parts on the base, turned and filled up as it pays.

    Args:
        judge: of the study.
        before: with the parts that left.
        after: without them; itself where none left.
        pool: motions to choose from in the place of those.
    """
    if len(after) == len(before):
        return after
    return regrown(judge, before, refitted(judge, after), pool)


def staying(judge: Judge, found: Candidate) -> Candidate:
    """Return settled parts without those that no longer pay or that the images do not hold."""
    return held(judge, pruned(judge, found))


def hopeful(judge: Judge, found: Candidate) -> Candidate:
    """Return parts on the base without those that save nothing as joints, before time goes there.

    The decision is made of motions; what hides a bend as a motion may save nothing as a joint.
    """
    kept, now = found, judge.judge(found)
    for k in reversed(range(len(found))):
        rest, gain, price = _gain(judge, now, k)
        if gain < HOPEFUL * price and len(now) > 1:
            logger.info("prune: part %d saves %.4f as a joint; price %.4f", k + 1, gain, price)
            kept = now = rest
    return kept


def pruned(judge: Judge, found: Candidate) -> Candidate:
    """Return the candidate without parts that no longer pay; the last one that moves stays.

    A part whose leaving makes one motion carry two bodies need pay half.
    """
    kept, now = found, judge.judge(found)
    for k in reversed(range(len(found))):
        proven = now.parents[k] and not now.known[k]  # it paid beside the settled others
        if proven or k + 1 in now.parents or len(now) == 1:
            continue
        rest, gain, price = _gain(judge, now, k)
        if price > gain >= TORN * price and _two_in_one(judge, now, rest):
            price *= TORN
        logger.info("prune: without part %d %.4f more; price %.4f", k + 1, gain, price)
        if gain < price or not now.improves(rest):
            kept = now = rest
    return kept


def unpaid(judge: Judge, found: Candidate) -> list[int]:
    """Return the numbers of parts that save less than a part must, beside all others."""
    if len(found) < 2:
        return []
    now, few = judge.judge(found), []
    for k in range(len(found)):
        rest, gain, price = _gain(judge, now, k)
        if k + 1 not in found.parents and (gain < price or not now.improves(rest)):
            few.append(k + 1)
    return few


def _two_in_one(judge: Judge, now: Candidate, rest: Candidate) -> bool:
    """Return whether one motion of `rest` carries what two of `now` do.

    It then meets few of its surfels in the other state, or carries pieces that nothing joins.
    """
    return (rest.scores.met < now.scores.met - MORE_MET
            or torn(judge.study, rest) > torn(judge.study, now))


def _gain(judge: Judge, now: Candidate, k: int) -> tuple[Candidate, float, float]:
    """Return the candidate without motion k, what it saves, and its price.

    Without one of two drawers the other's motion hides both rather well, but is no body's any more.
    """
    rest = judge.judge(now.without(k))
    left = rest.scores.left
    gain = max(left - now.scores.surfels - now.scores.images, rest.cost - now.cost)
    return rest, gain, judge.price(now, left)


def held(judge: Judge, found: Candidate) -> Candidate:
    """Return the candidate without parts that images do not hold in place, unless they save much.

    A motion that only hides what one state's bent depth shows has no edges that must fit: its
    curvature is that of noise, and how far it moves is as good as unknown. A plain door in few
    photos has little more, but saves more, or has a firm axis and saves a few prices. If the whole
    cost is lower without it, nothing keeps it.
    A carried part needs an axis whatever it saves: those of eleven builds had it to 0.0022 rad, a
    false one had none.
    """
    motions = found.motions
    shown = judge.shared(motions, found.labels) > SHARED
    seen = [np.isfinite(j.seen[1]) and j.seen[0] < LOOSE for j in motions]
    firm = [j.sigma_axis < FIRM and both for j, both in zip(motions, shown, strict=True)]
    if all(seen) or not any(seen + firm):  # plain parts: photos that hold none do not tell
        return found
    now = judge.judge(found)

    def alone(k: int) -> bool:
        if seen[k] or k + 1 in found.parents:
            return False
        if not firm[k] and found.parents[k] and not np.isfinite(motions[k].sigma_axis):
            return True  # what a carrier leaves is bent surface, unless something shows its axis
        rest, gain, price = _gain(judge, now, k)
        against = rest.cost + price < now.cost  # a line in the air may cost more than all it saves
        return against or gain < (FEW if firm[k] else MUCH) * price

    loose = [k for k in range(len(found)) if alone(k)]
    for k in loose:
        logger.info("prune: part %d is not held by the images, axis +- %.2g deg", k + 1,
                    np.degrees(motions[k].seen[0]))
    kept = found
    for k in reversed(loose):
        kept = kept.without(k)
    return judge.judge(kept) if loose else found


def refitted(judge: Judge, found: Candidate) -> Candidate:
    """Return parts on the base, every turn the way round that fits now that parts have left.

    A part that left had part of the surface: what stayed may be the motion that fitted the rest.
    """
    old = judge.judge(found)
    new = righted(judge, old)
    return found if new is old else _kinds_chosen(judge, new, old)


def regrown(judge: Judge, before: Candidate, after: Candidate, pool: Sequence[Joint]) -> Candidate:
    """Return `after`, on the base, with other motions in the place of parts that left, if they pay.

    Args:
        judge: of the study.
        before: with the parts that left.
        after: without them.
        pool: motions to choose from; those that do as a part did that left are not asked again.
    """
    stayed = set(after.known)
    gone = [k for k in range(len(before)) if before.known[k] not in stayed]
    others = [h for h in pool if not any(_alike(judge, before, k, h) for k in gone)]
    best = start = judge.judge(after)
    for _ in gone if others else ():
        grown, price = one_more(judge, best, others, False, False)
        gain = best.cost - grown.cost
        logger.info("prune: another motion saves %.4f; price %.4f", gain, price)
        if gain < price or not (grown.coherent and grown.improves(best)):
            break
        best = grown
    return after if best is start else _kinds_chosen(judge, best, start)


def _kinds_chosen(judge: Judge, new: Candidate, old: Candidate) -> Candidate:
    """Return a candidate with the kind of every motion chosen that `old` does not have."""
    stays = [any(h is known for known in old.motions) for h in new.motions]
    return new.with_motions(h if stays[k] else joint_of(judge, new, k)
                            for k, h in enumerate(new.motions))


def _alike(judge: Judge, found: Candidate, k: int, h: Joint) -> bool:
    """Return whether a motion carries a part to where its joint does."""
    own = judge.study.own(found.labels, k + 1)
    return apart(h, found.motions[k], own) < ALIKE * judge.study.diag


def joint_of(judge: Judge, found: Candidate, k: int) -> Joint:
    """Return the joint that explains the surfels of motion k best."""
    study, h = judge.study, found.motions[k]
    joint = choose_joint(h, study.own(found.labels, k + 1), judge.lands, study.tau, study.diag,
                         judge.confidence(found, k))
    return replace(joint, carrier=h.carrier)
