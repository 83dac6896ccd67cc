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

from part2gs_robotics.decide.grow import one_more
from part2gs_robotics.decide.judge import MORE_MET, Judge, Verdict
from part2gs_robotics.decide.pieces import apart
from part2gs_robotics.decide.split import TORN, torn
from part2gs_robotics.decide.turn_alternatives import righted
from part2gs_robotics.joints.tree import Tree
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.search.choose_kind import choose_joint
from part2gs_robotics.search.hypothesis import Hypothesis, hypothesis_of

logger = logging.getLogger(__name__)
MUCH = 8.0  # prices: false parts that images did not hold saved 6 and 7, true doors 9 and 13
LOOSE = 0.02  # rad: five times the loosest true part of eleven scenes; false ones: 0.034, none
# rad: held so well, by images or by faces, a part is real though images do not show its way: plain
# doors, drawers and lids 0.0015 to 0.002, a false part on a microwave's door 0.01.
FIRM = 0.004
# Prices: firm parts whose way images do not show saved 5.4 (a stapler's magazine) to 35; a bent
# part of a laptop's dark screen, that edges held, 1.2.
FEW = 2.5
# Of the richer state's surfels: what images do not hold is a part only if both states show as much
# of it. True parts 0.2 to 1, but for two that save much (a thin flap 0.06, trays in one 0.11); a
# slide that hid a microwave's bent inside 0.11.
SHARED = 0.15
# Prices: before anything is settled parts that stayed, in 19 builds, saved 1.08 to 42, a false one
# -0.03.
HOPEFUL = 0.25
ALIKE = 0.05  # of the diagonal: refinement takes motions nearer than that to one place


def hopeful(judge: Judge, tree: Tree) -> Tree:
    """Return a flat tree without parts that save nothing as joints, before time goes into them.

    The decision is made of motions; what hides a bend as a motion may save nothing as a joint.
    """
    now = judge.judge([hypothesis_of(j) for j in tree.joints])
    for k in reversed(range(len(tree.joints))):
        rest, gain, price = _gain(judge, now, k)
        if gain < HOPEFUL * price and len(tree.joints) > 1:
            logger.info("prune: part %d saves %.4f as a joint; price %.4f", k + 1, gain, price)
            tree, now = _without(tree, k, rest), rest
    return tree


def pruned(judge: Judge, tree: Tree) -> Tree:
    """Return the tree without parts that no longer pay; the last one that moves stays.

    A part whose leaving makes one motion carry two bodies need pay half.
    """
    now = judge.judge([hypothesis_of(j) for j in tree.joints])
    for k in reversed(range(len(tree.joints))):
        proven = tree.parents[k] and not tree.known[k]  # it paid beside the settled others
        if proven or k + 1 in tree.parents or len(tree.joints) == 1:
            continue
        rest, gain, price = _gain(judge, now, k)
        if price > gain >= TORN * price and _two_in_one(judge, now, rest):
            price *= TORN
        logger.info("prune: without part %d %.4f more; price %.4f", k + 1, gain, price)
        if gain < price or not now.improves(rest):
            tree, now = _without(tree, k, rest), rest
    return tree


def unpaid(judge: Judge, tree: Tree) -> list[int]:
    """Return the numbers of parts that save less than a part must, beside all others."""
    if len(tree.joints) < 2:
        return []
    now = judge.judge([hypothesis_of(j) for j in tree.joints])
    found = []
    for k in range(len(tree.joints)):
        rest, gain, price = _gain(judge, now, k)
        if k + 1 not in tree.parents and (gain < price or not now.improves(rest)):
            found.append(k + 1)
    return found


def _without(tree: Tree, k: int, rest: Verdict) -> Tree:
    parents = tree.parents[:k] + tree.parents[k + 1:]
    return Tree(tree.joints[:k] + tree.joints[k + 1:], tuple(p - (p > k + 1) for p in parents),
                rest.hard, tree.known[:k] + tree.known[k + 1:])


def _two_in_one(judge: Judge, now: Verdict, rest: Verdict) -> bool:
    """Return whether one motion of `rest` carries what two of `now` do.

    It then meets few of its surfels in the other state, or carries pieces that nothing joins.
    """
    return (rest.met < now.met - MORE_MET
            or torn(judge.study, rest) > torn(judge.study, now))


def _gain(judge: Judge, now: Verdict, k: int) -> tuple[Verdict, float, float]:
    """Return the verdict without motion k, what it saves, and its price.

    Without one of two drawers the other's motion hides both rather well, but is no body's any more.
    """
    rest = judge.judge([*now.motions[:k], *now.motions[k + 1:]])
    left = rest.surfel_cost + rest.image_cost
    gain = max(left - now.surfel_cost - now.image_cost, rest.cost - now.cost)
    return rest, gain, judge.price(now, left)


def held(judge: Judge, tree: Tree) -> Tree:
    """Return the tree without parts that the images do not hold in place, unless they save much.

    A motion that only hides what one state's bent depth shows has no edges that must fit: its
    curvature is that of noise, and how far it moves is as good as unknown. A plain door in few
    photos has little more, but saves more, or has a firm axis and saves a few prices. If the whole
    cost is lower without it, nothing keeps it: a false part on a microwave's glass turned about a
    line in the air.
    A carried part needs an axis whatever it saves: those of eleven builds had it to 0.0022 rad, a
    false one on a microwave's door had none.
    """
    motions = [hypothesis_of(j) for j in tree.joints]
    shown = judge.shared(motions, tree.hard) > SHARED
    seen = [np.isfinite(j.seen[1]) and j.seen[0] < LOOSE for j in tree.joints]
    firm = [j.sigma_axis < FIRM and both for j, both in zip(tree.joints, shown, strict=True)]
    if all(seen) or not any(seen + firm):  # plain parts: photos that hold none do not tell
        return tree

    now = judge.judge(motions)

    def alone(k: int) -> bool:
        if seen[k] or k + 1 in tree.parents:
            return False
        if not firm[k] and tree.parents[k] and not np.isfinite(tree.joints[k].sigma_axis):
            return True  # what a carrier leaves is bent surface, unless something shows its axis
        rest, gain, price = _gain(judge, now, k)
        against = rest.cost + price < now.cost  # a line in the air may cost more than all it saves
        return against or gain < (FEW if firm[k] else MUCH) * price

    loose = [alone(k) for k in range(len(tree.joints))]
    if not any(loose):
        return tree
    keep = [k for k, away in enumerate(loose) if not away]
    for k in np.flatnonzero(loose):
        logger.info("prune: part %d is not held by the images, axis +- %.2g deg", k + 1,
                    np.degrees(tree.joints[k].seen[0]))
    joints = [tree.joints[k] for k in keep]
    number = np.cumsum([0, *(not away for away in loose)])
    hard = judge.judge([hypothesis_of(j) for j in joints]).hard
    return Tree(joints, tuple(int(number[tree.parents[k]]) for k in keep), hard,
                tuple(tree.known[k] for k in keep))


def refitted(judge: Judge, tree: Tree) -> Tree:
    """Return a flat tree with every turn the way round that fits now that parts have left.

    A part that left had part of the surface: what stayed may be the motion that fitted the rest.
    """
    old = judge.judge([hypothesis_of(j) for j in tree.joints])
    new = righted(judge, old, _say)
    joints = [j if a is b else joint_of(judge, new, k) for k, (j, a, b)
              in enumerate(zip(tree.joints, old.motions, new.motions, strict=True))]
    return replace(tree, joints=joints, hard=tree.hard if new is old else new.hard)


def regrown(judge: Judge, before: Tree, after: Tree, pool: Sequence[Hypothesis]) -> Tree:
    """Return the flat tree `after` with other motions in the place of parts that left, if they pay.

    Args:
        judge: of the study.
        before: tree with the parts that left.
        after: tree without them.
        pool: motions to choose from; those that do as a part did that left are not asked again.
    """
    stayed = set(after.known)
    gone = [k for k in range(len(before.joints)) if before.known[k] not in stayed]
    others = [h for h in pool if not any(_alike(judge, before, k, h) for k in gone)]
    best = start = judge.judge([hypothesis_of(j) for j in after.joints])
    for _ in gone if others else ():
        grown, price = one_more(judge, best, others, False, False, _say)
        gain = best.cost - grown.cost
        logger.info("prune: another motion saves %.4f; price %.4f", gain, price)
        if gain < price or not (grown.coherent and grown.improves(best)):
            break
        best = grown
    if best is start:
        return after
    stays = [any(h is old for old in start.motions) for h in best.motions]
    joints = [after.joints[k] if old else joint_of(judge, best, k) for k, old in enumerate(stays)]
    known = (*after.known, *(0,) * (len(joints) - len(after.joints)))
    return Tree(joints, (0,) * len(joints), best.hard, known)


def _alike(judge: Judge, tree: Tree, k: int, h: Hypothesis) -> bool:
    """Return whether a motion carries a part to where its joint does."""
    own = judge.study.own(tree.hard, k + 1)
    return apart(h, hypothesis_of(tree.joints[k]), own) < ALIKE * judge.study.diag


def _say(text: str) -> None:
    logger.info("prune: %s", text)


def joint_of(judge: Judge, verdict: Verdict, k: int) -> Joint:
    """Return the joint that explains the surfels of motion k best."""
    study, h = judge.study, verdict.motions[k]
    joint = choose_joint(h, study.own(verdict.hard, k + 1), judge.lands, study.tau, study.diag,
                         judge.confidence(verdict, k))
    return replace(joint, carrier=h.carrier)
