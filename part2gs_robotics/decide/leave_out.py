"""Leaving out: parts without which the cost is lower, and the joints of motions that came anew.

The decision is made of motions. Settled as joints, one may pay no more: the same cost says so.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from functools import partial

from part2gs_robotics.decide.candidate import PART, Candidate
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.runtime.side_by_side import side_by_side
from part2gs_robotics.search.choose_kind import choose_joint

logger = logging.getLogger(__name__)
POLISHES = 3.0  # prices: joints of two parts without a false third saved 1.3


def thinned(judge: Judge, found: Candidate) -> Candidate:
    """Return the judged candidate without parts that cost more than they save, worst first.

    What carries another part stays, and so does the last part that moves.
    """
    while len(found) > 1:
        trials = side_by_side([partial(judge.judge, found.without(k)) for k in range(len(found))
                               if k + 1 not in found.parents])
        best = min(trials, key=lambda c: c.cost)
        if best.cost >= found.cost:
            break
        logger.info("decide: one less: %d parts, cost %.4f, %.4f less", len(best), best.cost,
                    found.cost - best.cost)
        found = best
    return found


def least(judge: Judge, found: Candidate) -> Candidate:
    """Return the judged candidate thinned, joints polished of what is left before it is compared.

    A false part takes surfels that the joints of others then fit without; polished alone, they may
    cost less. What is gained by polishing alone is no reason to leave, so the set is polished too.
    """
    found = thinned(judge, found)
    if len(found) < 2:
        return found
    trials = [judge.judge(found.without(k)) for k in range(len(found))
              if k + 1 not in found.parents]
    near = [judge.polished(t) for t in trials if t.cost < found.cost + POLISHES * PART]
    best = min(near, key=lambda c: c.cost, default=found)
    if best is found or best.cost >= judge.polished(found).cost:
        return found
    logger.info("decide: one less, polished: %d parts, cost %.4f, %.4f less", len(best), best.cost,
                found.cost - best.cost)
    return least(judge, best)


def saved(judge: Judge, found: Candidate) -> tuple[float, ...]:
    """Return how much dearer the set is without each part, in prices of a part; NaN = it carries.

    How sure the number of parts is: below zero the set would have been found without that part.
    """
    now = judge.judge(found)
    fewer = side_by_side([partial(judge.judge, now.without(k)) for k in range(len(found))
                          if k + 1 not in found.parents])
    gaps = iter([(less.cost - now.cost) / PART for less in fewer])
    return tuple(float("nan") if k + 1 in found.parents else next(gaps)
                 for k in range(len(found)))


def kinds_chosen(judge: Judge, new: Candidate, old: Candidate) -> Candidate:
    """Return a candidate with the kind of every motion chosen that `old` does not have."""
    stays = [any(h is known for known in old.motions) for h in new.motions]
    return new.with_motions(h if stays[k] else joint_of(judge, new, k)
                            for k, h in enumerate(new.motions))


def joint_of(judge: Judge, found: Candidate, k: int) -> Joint:
    """Return the joint that explains the surfels of motion k best; the motion where it has none."""
    study, h = judge.study, found.motions[k]
    own = study.own(found.labels, k + 1)
    if not len(own[0]) + len(own[1]):  # labels moved on: the set without it is cheaper, and wins
        return h
    joint = choose_joint(h, own, judge.lands, study.tau, study.diag, judge.confidence(found, k))
    return replace(joint, carrier=h.carrier)
