"""Hanging: parts carried by other parts, found once the parts on the base are settled.

Seen from the carrier such a part moves by one joint as well, so the search is the same with state
1 brought back by the carrier's motion. Only what the carrier's motion leaves unexplained is
looked at; a scene that leaves nothing needs none of this.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from part2gs_robotics.decide.candidate import PART, Candidate
from part2gs_robotics.decide.judge import NEAR, Judge, arm_of
from part2gs_robotics.decide.leave_out import joint_of, thinned
from part2gs_robotics.decide.screws import RARE
from part2gs_robotics.evidence.faces import directions
from part2gs_robotics.evidence.landing import UNEXPLAINED, land
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64, Labels
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.points import farthest
from part2gs_robotics.search.cover import PATCH_POINTS, PATCH_RADIUS, SEARCH_TAU, spread
from part2gs_robotics.search.patches import Aim, search_patch
from part2gs_robotics.search.refine import refine

logger = logging.getLogger(__name__)
LEAST_LEFT = 0.01  # of a carrier's surfels: small carried parts leave more, noise of rims less
SEEDS = 6  # patches of what is left: a carried part is a small thing
GUESSES = 6  # motions of each patch that are refined
TRIED = 8  # refined motions, those that land most of what is left, that are judged
POLISHED = 8  # rounds of refinement; a line 5 % of the diagonal off takes three
LEAST_TURN = np.deg2rad(3.0)  # beside the carrier: less is the carrier's own error
SLOW = 0.05  # of the diagonal: bent depth looks like parts that move less (seen: 4.3 %)
LEAST_SLIDE = 0.02  # of the diagonal, likewise
HALF = np.deg2rad(135.0)  # beside the carrier: from here on a plate lands on itself, sides swapped
# Of the cost: two parallel turns make one about a far line.
FAR_PRICE = 0.04
FAR = 0.3  # of the diagonal


def hang(judge: Judge, found: Candidate, most: int | None, rng: np.random.Generator) -> Candidate:
    """Return parts on the base with parts carried by others, not yet aligned; at most `most`."""
    count = len(found)
    found = _rehung(judge, found)
    for carrier in range(1, count + 1):
        while most is None or len(found) < most:
            grown = _grown(judge, found, carrier, most is None, rng)
            if grown is None:
                break
            found = grown
    if most is None and len(found) > count:
        found = thinned(judge, judge.judge(found))
    return found.carriers_first()


def _grown(judge: Judge, found: Candidate, carrier: int, priced: bool, rng: np.random.Generator,
           ) -> Candidate | None:
    """Return the candidate with one more part on a carrier, or None if that does not pay."""
    now = judge.judge(found)
    hard = now.labels
    left = _left(judge, judge.costs(now.motions, hard), hard, carrier)
    if len(left) < LEAST_LEFT * max((hard == carrier).sum(), 1) or len(left) < SEEDS:
        return None
    body = judge.study.surfels[0].select(hard[: len(judge.study.surfels[0])] == carrier)
    tried = _search(judge, left, found.motions[carrier - 1].state1_from_0, body, rng)
    if not tried:
        return None
    grown = _polished(judge, judge.best_of([now.plus(h, carrier) for h in tried]))
    gain = now.cost - grown.cost if priced else now.scores.left - grown.scores.left
    logger.info("nested: %d of part %d left, %d motions on it: %.4f less", len(left), carrier,
                len(tried), gain)
    if gain <= 0:
        return None
    return grown.swapped(len(found), joint_of(judge, grown, len(found)))


def _left(judge: Judge, costs: F64, hard: Labels, carrier: int) -> Surfels:
    """Return the surfels of state 1 that belong to a carrier but do not land with it."""
    n0 = len(judge.study.surfels[0])
    rows = np.flatnonzero((costs[n0:] > UNEXPLAINED) & (hard[n0:] == carrier))
    return judge.study.surfels[1].select(rows)


def _search(judge: Judge, left: Surfels, carrier: F64, body: Surfels,
            rng: np.random.Generator) -> list[Joint]:
    """Return motions on a carrier that land what it leaves; body: its surfels of state 0."""
    study = judge.study
    back, diag = se3.inverse(carrier), study.diag
    home = replace(left, points=se3.apply(back, left.points), normals=left.normals @ back[:3, :3].T)
    empty = study.surfels[0].select(np.zeros(0, np.int64))
    aim = Aim(study.lands[0], study.box, diag, SEARCH_TAU * diag, forward=False)
    found: list[Joint] = []
    for i in farthest(home.points, SEEDS, int(rng.integers(len(left)))):
        gaps = np.linalg.norm(home.points - home.points[i], axis=1)
        near = rng.permutation(np.flatnonzero(gaps < PATCH_RADIUS * diag))
        if len(near) < SEEDS:
            continue
        patch = home.select(near[:PATCH_POINTS])
        axes = directions(study.lands[0].surfels, patch, rng)
        ranked = search_patch(patch, aim, axes)
        for _, guess in spread(ranked, GUESSES, patch.points, 1):
            start = replace(guess, carrier=carrier)
            found.append(refine(start, (empty, left.select(near)), study.lands,
                                (SEARCH_TAU * diag, study.tau), 3))
    real = [h for h in found if abs(h.value) > (LEAST_TURN if h.turns else LEAST_SLIDE * diag)
            and not _swaps_sides(h, home.points, body.points, SLOW * diag)]
    costs = [land(se3.inverse(h.move), left, study.lands[0], study.tau)[0].sum() for h in real]
    return [real[i] for i in np.argsort(costs, kind="stable")[:TRIED]]


def _swaps_sides(h: Joint, home: F64, body: F64, near: float) -> bool:
    """Return whether a motion on a carrier is half a turn that leaves a thing in its place.

    Of a lid each state may show one side only. Half a turn of the lid within itself then explains
    both, and all it says is that the sides look alike. home [n, 3]: points of state 1 brought back
    by the carrier; body [m, 3]: of the carrier in state 0.
    """
    if not h.turns or abs(h.value) < HALF or not len(body):
        return False
    there = se3.apply(se3.inverse(h.own), home)
    tree = cKDTree(body)
    return all(float(tree.query(p)[0].mean()) < near for p in (home, there))


def _polished(judge: Judge, found: Candidate) -> Candidate:
    """Return the candidate, its last motion refined on its own surfels for as long as that helps.

    Found on a patch, it may land a rod on another stretch of the same rod; what more it lands then
    shows the rod's end. From near, refinement would keep that place: it looks farther as well.
    """
    near, last = judge.study.taus, len(found) - 1
    far = SEARCH_TAU * judge.study.diag, *near
    for _ in range(POLISHED):
        own = judge.study.own(found.labels, len(found))
        trials = [judge.judge(found.swapped(last, refine(found.motions[last], own, judge.lands,
                                                         taus))) for taus in (near, far)]
        new = min(trials, key=lambda c: c.cost)
        if new.cost >= found.cost:
            break
        found = new
    return found


def _rehung(judge: Judge, found: Candidate) -> Candidate:
    """Return the candidate with parts moved to the part that explains them better than the base.

    A lid that turns and a latch in it that turns about another axis move together like a screw; a
    turn about the base fits it nearly. Two turns about parallel axes are one turn about a line
    that may lie anywhere: then the hinge beside its part is the likelier one.
    """
    for k in range(len(found)):
        if k + 1 in found.parents:
            continue  # carries something itself
        motions, best = found.motions, judge.judge(found)
        if (judge.way(best, k) or 0.0) < SLOW * judge.study.diag:
            continue  # what a carrier's turn backwards would explain just as well
        start, score = best, best.cost * (1 + _apart(judge, best, k))
        for p in range(len(found)):
            if p == k or found.parents[p] or not (motions[k].turns or motions[p].turns):
                continue  # a slide on a slide is one on the base as well: nothing tells them apart
            trial = _moved_to(judge, best, k, p, motions[k])
            if se3.turn(trial.motions[k].move) < LEAST_TURN:
                continue  # taken back, the carrier's turn leaves a slide: one on the base
            cost = trial.cost * (1 + _apart(judge, trial, k))
            logger.info("nested: part %d on part %d: %.4f, was %.4f", k + 1, p + 1, cost, score)
            # Two turns about one line explain the same either way: the carrier has its price.
            # A screw, which both together are as well, is rarer than a part on a part.
            rarer = RARE * PART if best.motions[k].kind == "screw" else 0.0
            if cost < score + rarer:
                best, score = trial, cost
        if best is not start:
            found = best.swapped(k, joint_of(judge, best, k))
    return found


def _moved_to(judge: Judge, found: Candidate, k: int, p: int, h: Joint) -> Candidate:
    """Return the candidate with part k, which moves by h on the base, on part p."""
    study, own = judge.study, judge.study.own(found.labels, k + 1)
    guess = _beside(h, found.motions[p].state1_from_0, own)
    return judge.judge(found.swapped(k, refine(guess, own, judge.lands, study.taus), p + 1))


def _beside(h: Joint, carrier: F64, own: tuple[Surfels, Surfels]) -> Joint:
    """Return the motion of one joint on a carrier that is nearest to a motion of the world."""
    rest = se3.inverse(carrier) @ h.move
    centre = np.concatenate([own[0].points, h.origin[None]]).mean(0)
    axis, origin, angle, way = se3.screw_of(rest, centre, LEAST_TURN)
    if not angle:
        return Joint("prismatic", axis if way else h.axis, centre, way, carrier=carrier)
    return Joint("revolute", axis, origin, angle, carrier=carrier)


def _apart(judge: Judge, found: Candidate, k: int) -> float:
    """Return what a hinge line away from its part adds to the cost, as a share of it."""
    h, own = found.motions[k], judge.study.own(found.labels, k + 1)
    arm = arm_of(h, own)
    if not h.turns or not np.isfinite(arm):
        return 0.0
    return FAR_PRICE * min(max(arm / judge.study.diag - NEAR, 0.0) / (FAR - NEAR), 1.0)
