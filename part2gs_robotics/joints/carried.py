"""Chains: parts carried by other parts, found once the parts on the base are settled.

Seen from the carrier such a part moves by one joint as well, so the search is the same with state
1 brought back by the carrier's motion. Only what the carrier's motion leaves unexplained is
looked at; a scene that leaves nothing needs none of this.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.decide.judge import AGAINST, NEAR, SLOW, Judge, Verdict, arm_of
from part2gs_robotics.decide.labelling import EVEN
from part2gs_robotics.decide.leave_out import held, hopeful, joint_of, pruned, refitted, regrown
from part2gs_robotics.evidence.faces import directions
from part2gs_robotics.evidence.landing import land
from part2gs_robotics.evidence.points import farthest
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.joints.align import FINE, align
from part2gs_robotics.joints.claim import claim
from part2gs_robotics.joints.settle import settle
from part2gs_robotics.joints.tree import Tree, carried, flat, ordered
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64, Labels
from part2gs_robotics.model.joint import Joint, move_of
from part2gs_robotics.model.small_views import SmallViews
from part2gs_robotics.search.cover import PATCH_POINTS, PATCH_RADIUS, SEARCH_TAU, spread
from part2gs_robotics.search.hypothesis import SCREW, Hypothesis, hypothesis_of
from part2gs_robotics.search.patches import search_patch
from part2gs_robotics.search.refine import refine

logger = logging.getLogger(__name__)
Views = tuple[SmallViews, SmallViews]
UNEXPLAINED = 0.5  # landing cost: halfway from an unobserved place to one seen empty
LEAST_LEFT = 0.01  # of a carrier's surfels: a magazine or a latch leaves more, noise of rims less
SEEDS = 6  # patches of what is left: a carried part is a small thing
GUESSES = 6  # motions of each patch that are refined
TRIED = 8  # refined motions, those that land most of what is left, that are judged
POLISHED = 8  # rounds of refinement; a latch's line 5 % of the diagonal off takes three
LEAST_TURN = np.deg2rad(3.0)  # beside the carrier: less is the carrier's own error
LEAST_SLIDE = 0.02  # of the diagonal, likewise
HALF = np.deg2rad(135.0)  # beside the carrier: from here on a plate lands on itself, sides swapped
# Prices, for a part to hang on a part and not on the base: labels found anew save 2 % of the cost
# left whatever it hangs on; false carriers saved up to 2.7 % in nine builds, a lamp's arm 8.5 %. A
# new part pays as much: a blurred door's glass saved 1.25 prices, a door's latch 4.1 to 5.6.
CARRIED = 2
# Of the cost left: for a hinge line FAR away from its part, see `_apart`; more than CARRIED prices:
# it alone tells two turns about parallel axes from one about a far line, which both make together.
FAR_PRICE = 0.04
FAR = 0.3  # of the diagonal


def nest(judge: Judge, joints: list[Joint], hard: Labels, config: ArticulateConfig,
         views: tuple[Views, Views], pool: Sequence[Hypothesis] = ()) -> Tree:
    """Return the joints settled, with parts that other parts carry, aligned to the images.

    A part that does not pay once joints are settled, or that the images do not hold in place, is
    left out or another motion has its place, and the others settle again.

    Args:
        judge: of the study.
        joints: of parts 1..K on the base, start.
        hard: [N0 + N1] surfel labels, start.
        config: number of moving parts, if known, and seed.
        views: images of both states, small and sharp.
        pool: motions to choose from for parts that do not stay.
    """
    start = flat(joints, hard)
    if config.parts is None and len(joints) > 1:
        left = _regrown(judge, start, hopeful(judge, start), pool)
        tree = _proven(judge, _settled(judge, left, views, config), config, views, pool)
    else:
        tree = _settled(judge, start, views, config)
    tree = chains(judge, tree, config.parts, np.random.default_rng(config.seed))
    if not any(tree.parents):
        return tree
    tree = aligned(judge, tree, views[1])
    return held(judge, tree) if config.parts is None else tree


def _proven(judge: Judge, tree: Tree, config: ArticulateConfig, views: tuple[Views, Views],
            pool: Sequence[Hypothesis]) -> Tree:
    """Return a settled flat tree without parts that do not stay, settled again."""
    paying = held(judge, pruned(judge, tree))
    if len(paying.joints) == len(tree.joints):
        return tree
    found = _regrown(judge, tree, paying, pool)
    new = _settled(judge, found, views, config)
    same = len(found.joints) == len(paying.joints)
    return new if same else _proven(judge, new, config, views, ())


def _settled(judge: Judge, tree: Tree, views: tuple[Views, Views],
             config: ArticulateConfig) -> Tree:
    joints, hard = settle(judge, tree.joints, tree.hard, *views, config)
    return replace(tree, joints=joints, hard=hard)


def _regrown(judge: Judge, before: Tree, after: Tree, pool: Sequence[Hypothesis]) -> Tree:
    """Return what is left of a flat tree, turned and filled up as it pays."""
    if len(after.joints) == len(before.joints):
        return after
    return regrown(judge, before, refitted(judge, after), pool)


def chains(judge: Judge, tree: Tree, most: int | None, rng: np.random.Generator) -> Tree:
    """Return a flat tree with parts carried by others, not yet aligned; at most `most` parts."""
    count = len(tree.joints)
    tree = _rehung(judge, tree)
    for carrier in range(1, count + 1):
        while most is None or len(tree.joints) < most:
            grown = _grown(judge, tree, carrier, most is None, rng)
            if grown is None:
                break
            tree = grown
    if most is None and len(tree.joints) > count:
        tree = pruned(judge, tree)
    return ordered(tree)


def aligned(judge: Judge, tree: Tree, views: Views) -> Tree:
    """Return the tree aligned to the images, carriers first in the labels' and joints' eyes."""
    study = judge.study
    for levels in (FINE[:1], FINE):
        hard, _ = claim(judge, tree.joints, tree.hard)
        labels = study.gaussian_labels(hard)
        joints = align(study.gaussians, labels, tree.joints, views, study.diag, levels,
                       levels is FINE, study.clues(labels, len(tree.joints)))
        tree = carried(replace(tree, joints=joints, hard=hard))
    return tree


def _grown(judge: Judge, tree: Tree, carrier: int, priced: bool, rng: np.random.Generator,
           ) -> Tree | None:
    """Return the tree with one more part on a carrier, or None if that does not pay."""
    motions = [hypothesis_of(j) for j in tree.joints]
    now = judge.judge(motions)
    # Evenly shared out: what neither explains, a latch, goes to rest where labels lean to it.
    hard, _ = judge.sort_out(motions, starts=EVEN)
    left = _left(judge, judge.costs(motions, hard), hard, carrier)
    if len(left) < LEAST_LEFT * max((hard == carrier).sum(), 1) or len(left) < SEEDS:
        return None
    body = judge.study.surfels[0].select(hard[: len(judge.study.surfels[0])] == carrier)
    found = _search(judge, left, move_of(tree.joints[carrier - 1]), body, rng)
    if not found:
        return None
    grown = judge.best_of([[*motions, h] for h in found], now)
    grown = _polished(judge, grown)
    gain = now.cost - grown.cost
    price = CARRIED * judge.price(grown, now.cost) if priced else 0.0
    logger.info("nested: %d of part %d left, %d motions on it: %.4f less; price %.4f", len(left),
                carrier, len(found), gain, price)
    if not grown.coherent or gain < price or not grown.improves(now):
        return None
    joint = joint_of(judge, grown, len(motions))
    return Tree([*tree.joints, joint], (*tree.parents, carrier), grown.hard, (*tree.known, 0))


def _left(judge: Judge, costs: F64, hard: Labels, carrier: int) -> Surfels:
    """Return the surfels of state 1 that belong to a carrier but do not land with it."""
    n0 = len(judge.study.surfels[0])
    rows = np.flatnonzero((costs[n0:] > UNEXPLAINED) & (hard[n0:] == carrier))
    return judge.study.surfels[1].select(rows)


def _search(judge: Judge, left: Surfels, carrier: F64, body: Surfels,
            rng: np.random.Generator) -> list[Hypothesis]:
    """Return motions on a carrier that land what it leaves; body: its surfels of state 0."""
    study = judge.study
    back, diag = se3.inverse(carrier), study.diag
    home = replace(left, points=se3.apply(back, left.points), normals=left.normals @ back[:3, :3].T)
    empty = study.surfels[0].select(np.zeros(0, np.int64))
    found: list[Hypothesis] = []
    for i in farthest(home.points, SEEDS, rng):
        gaps = np.linalg.norm(home.points - home.points[i], axis=1)
        near = rng.permutation(np.flatnonzero(gaps < PATCH_RADIUS * diag))
        if len(near) < SEEDS:
            continue
        patch = home.select(near[:PATCH_POINTS])
        axes = directions(study.lands[0].surfels, patch, rng)
        ranked = search_patch(patch, study.lands[0], axes, study.box, SEARCH_TAU * diag, False)
        for _, guess in spread(ranked, GUESSES, patch.points, 1):
            start = replace(guess, carrier=carrier)
            found.append(refine(start, (empty, left.select(near)), study.lands,
                                (SEARCH_TAU * diag, study.tau), 3))
    real = [h for h in found if abs(h.value) > (LEAST_TURN if h.kind else LEAST_SLIDE * diag)
            and not _swaps_sides(h, home.points, body.points, SLOW * diag)]
    costs = [land(se3.inverse(h.move), left, study.lands[0], study.tau)[0].sum() for h in real]
    return [real[i] for i in np.argsort(costs, kind="stable")[:TRIED]]


def _swaps_sides(h: Hypothesis, home: F64, body: F64, near: float) -> bool:
    """Return whether a motion on a carrier is half a turn that leaves a thing in its place.

    Of a lid each state may show one side only. Half a turn of the lid within itself then explains
    both, and all it says is that the sides look alike. home [n, 3]: points of state 1 brought back
    by the carrier; body [m, 3]: of the carrier in state 0.
    """
    if not h.kind or abs(h.value) < HALF or not len(body):
        return False
    there = se3.apply(se3.inverse(h.own), home)
    tree = cKDTree(body)
    return all(float(tree.query(p)[0].mean()) < near for p in (home, there))


def _polished(judge: Judge, verdict: Verdict) -> Verdict:
    """Return the verdict with its last motion refined on its own surfels for as long as that helps.

    Found on a patch, it may land a rod on another stretch of the same rod; what more it lands then
    shows the rod's end. From near, refinement would keep that place: it looks farther as well.
    """
    near = judge.study.taus
    far = SEARCH_TAU * judge.study.diag, *near
    for _ in range(POLISHED):
        own = judge.study.own(verdict.hard, len(verdict.motions))
        trials = [judge.judge([*verdict.motions[:-1],
                               refine(verdict.motions[-1], own, judge.lands, taus)])
                  for taus in (near, far)]
        new = min(trials, key=lambda v: v.cost)
        if new.cost >= verdict.cost:
            break
        verdict = new
    return verdict


def _rehung(judge: Judge, tree: Tree) -> Tree:
    """Return the tree with parts moved to the part that explains them better than the base.

    A lid that turns and a latch in it that turns about another axis move together like a screw; a
    turn about the base fits it nearly. Two turns about parallel axes are one turn about a line
    that may lie anywhere: then the hinge beside its part is the likelier one.
    """
    for k in range(len(tree.joints)):
        if any(p == k + 1 for p in tree.parents):
            continue  # carries something itself
        motions = [hypothesis_of(j) for j in tree.joints]
        best, parent = judge.judge(motions), 0
        if (judge.way(best, k) or 0.0) < SLOW * judge.study.diag:
            continue  # what a carrier's turn backwards would explain just as well
        score = best.cost * (1 + _apart(judge, best, k))
        for p in range(len(tree.joints)):
            if p == k or tree.parents[p] or not (motions[k].kind or motions[p].kind):
                continue  # a slide on a slide is one on the base as well: nothing tells them apart
            guess = _beside(motions[k], move_of(tree.joints[p]), judge.study.own(best.hard, k + 1))
            trial = _replaced(judge, best, k, guess)
            if trial is None or se3.turn(trial.motions[k].move) < LEAST_TURN:
                continue  # taken back, the carrier's turn leaves a slide: one on the base
            cost = trial.cost * (1 + _apart(judge, trial, k))
            logger.info("nested: part %d on part %d: %.4f, was %.4f", k + 1, p + 1, cost, score)
            # The base is likelier than a carrier by as much as no part is than one more: two turns
            # about one line explain the same either way. A screw, which both together are as well,
            # is rarer than a part on a part.
            prices = -1 if best.motions[k].kind == SCREW else CARRIED
            price = judge.price(trial, score) * prices
            if trial.coherent and cost < score - price:
                best, parent, score = trial, p + 1, cost
        if parent:
            joints = list(tree.joints)
            joints[k] = joint_of(judge, best, k)
            parents = (*tree.parents[:k], parent, *tree.parents[k + 1:])
            tree = Tree(joints, parents, best.hard, tree.known)
    return tree


def _replaced(judge: Judge, verdict: Verdict, k: int, guess: Hypothesis) -> Verdict | None:
    """Return the verdict with one motion replaced; None where surfels alone speak against it."""
    study = judge.study
    h = refine(guess, study.own(verdict.hard, k + 1), judge.lands, study.taus)
    motions = [*verdict.motions[:k], h, *verdict.motions[k + 1:]]
    known = judge.sort_out(motions)
    return judge.judge(motions, known) if known[1] < (1 + AGAINST) * verdict.surfel_cost else None


def _beside(h: Hypothesis, carrier: F64, own: tuple[Surfels, Surfels]) -> Hypothesis:
    """Return the motion of one joint on a carrier that is nearest to a motion of the world."""
    rest = se3.inverse(carrier) @ h.move
    centre = np.concatenate([own[0].points, h.origin[None]]).mean(0)
    axis, origin, angle, way = se3.screw_of(rest, centre, LEAST_TURN)
    if not angle:
        return Hypothesis(0, axis if way else h.axis, centre, way, carrier)
    return Hypothesis(1, axis, origin, angle, carrier)


def _apart(judge: Judge, verdict: Verdict, k: int) -> float:
    """Return what a hinge line away from its part adds to the cost, as a share of it."""
    h, own = verdict.motions[k], judge.study.own(verdict.hard, k + 1)
    arm = arm_of(h, own)
    if not h.kind or not np.isfinite(arm):
        return 0.0
    return FAR_PRICE * min(max(arm / judge.study.diag - NEAR, 0.0) / (FAR - NEAR), 1.0)
