"""Splitting: one motion that hides two parts rather well is left for one motion of each."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from part2gs_robotics.decide.candidate import INCOHERENT, MORE_MET, PLAIN_ASKEW, Candidate, on_base
from part2gs_robotics.decide.judge import MIN_SURFELS, SLOW, Judge
from part2gs_robotics.decide.tune_slides import PARALLEL, tune
from part2gs_robotics.evidence.study import Study
from part2gs_robotics.evidence.surfels import Surfels, apart, at_home
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.search.refine import misfit, refine

logger = logging.getLogger(__name__)
# Of the poorer state's surfels: one body meets 0.66 up, two in one 0.22 to 0.65; to try costs time.
WHOLE = 0.8
MOST_PAIRS = 20  # of each kind tried in the place of each motion; a set takes about 30 ms
HOPE = 2.0  # prices: two drawers cost that much more before tuning than after
NEAR = 0.005  # of the diagonal: two motions that carry a piece nearer than that are one
TORN = 0.5  # of a price: that nothing joins what one motion carries, or few meet, tells the rest
GAP = 0.02  # of the diagonal, two surfels: pieces nearer to each other are joined
PIECE = 0.15  # of a part's surfels: less is a handle or a patch gone astray
PIECE_STEPS = (-0.04, -0.02, 0.0, 0.02, 0.04)  # of the diagonal: refinement reaches half a step


def split(judge: Judge, found: Candidate, pool: Sequence[Joint]) -> Candidate:
    """Return the candidate with one motion replaced by two parallel ones, itself if none pays.

    One motion between two drawers' explains both rather well: neither drawer alone is worth adding
    to it, and neither is worth more in its place. One shut and one opened look like a slide askew,
    and of two doors like one door that swung across. Two that meet a tenth more need save half.

    Args:
        judge: of the study.
        found: to improve.
        pool: motions to choose from.
    """
    far = NEAR * judge.study.diag
    pairs = [pair for turning in (False, True)
             for pair in _parallel(pool, turning, far)[:MOST_PAIRS]]
    doubtful = ((judge.met(found.motions, found.labels) < WHOLE)
                | (judge.leans(found.motions, found.labels) >= PLAIN_ASKEW))
    sets = [_in_place(found, int(k), pair) for k in np.flatnonzero(doubtful) for pair in pairs
            if pair[0].kind == found.motions[k].kind]
    best, price = _best(judge, found, sets)
    new, old = best.scores, found.scores
    worth = TORN * price if new.met > old.met + MORE_MET else price
    # A drawer that shares surfels with doors looks a little askew until it is settled.
    excused = INCOHERENT * max(new.askew - old.askew, 0.0)
    gain = found.cost - best.cost + (excused if new.askew < PLAIN_ASKEW else 0.0)
    return best if gain >= worth and best.improves(found) else found


def parted(judge: Judge, found: Candidate) -> Candidate:
    """Return the candidate with one motion replaced by a motion of each of its pieces, if it pays.

    Drawers in far corners that are pulled out by nearly as much look like one body in two pieces.
    Nothing joins them and they move differently: that is told half of what a part is worth. It is
    not where one hardly moves: a piece that stays behind is a wrong label.
    """
    study, sets = judge.study, []
    far, slow = NEAR * study.diag, SLOW * study.diag
    for k, h in enumerate(found.motions):
        bodies = pieces(h, study.own(found.labels, k + 1), study.diag, MIN_SURFELS)
        if len(bodies) > 1:
            own = [_own(judge, h, piece) for piece in bodies[:2]]
            ways = [apart(replace(g, kind="prismatic", value=0.0), g, piece)
                    for g, piece in zip(own, bodies, strict=False)]
            if apart(own[0], own[1], bodies[1]) > far and min(ways) > slow:
                sets.append(_in_place(found, k, (own[0], own[1])))
    best, price = _best(judge, found, sets)
    if best is found:
        return found
    gain, worth = found.cost - best.cost, TORN * price
    logger.info("split: a part's pieces on their own: %.4f less; price %.4f", gain, worth)
    return best if gain >= worth and best.improves(found) else found


def torn(study: Study, found: Candidate) -> int:
    """Return how many pieces the parts of a candidate have beyond one each."""
    counts = [len(pieces(h, study.own(found.labels, k + 1), study.diag, MIN_SURFELS))
              for k, h in enumerate(found.motions)]
    return sum(max(count - 1, 0) for count in counts)


def _in_place(found: Candidate, k: int, pair: tuple[Joint, Joint]) -> Candidate:
    """Return the candidate, on the base and not judged yet, with two motions in the place of k."""
    return on_base([*found.motions[:k], *pair, *found.motions[k + 1:]])


def _best(judge: Judge, found: Candidate, sets: Sequence[Candidate]) -> tuple[Candidate, float]:
    """Return the best of the sets, tuned where that may matter, and what it must save."""
    if not sets:
        return found, np.inf
    best = judge.polished(judge.best_of(sets, found))
    price = judge.price(best, found.cost)
    if best.cost < found.cost + HOPE * price:  # lengths and labels are off until tuned
        best = tune(judge, best)
    return best, price


def _own(judge: Judge, h: Joint, piece: tuple[Surfels, Surfels]) -> Joint:
    """Return the motion near h, a slide also shorter or longer, that lands a piece best."""
    study = judge.study
    tries = [refine(replace(h, value=h.value + step * study.diag), piece, judge.lands, study.taus)
             for step in ((0.0,) if h.turns else PIECE_STEPS)]
    return min(tries, key=lambda g: misfit(g, piece, judge.lands, study.tau))


def _parallel(pool: Sequence[Joint], turning: bool, far: float) -> list[tuple[Joint, Joint]]:
    """Return the pairs of turns, or slides that differ by `far`, along parallel axes."""
    kind = "revolute" if turning else "prismatic"
    return [(a, b) for a, b in combinations([h for h in pool if h.kind == kind], 2)
            if abs(a.axis @ b.axis) > np.cos(PARALLEL)
            and (turning or np.linalg.norm(a.axis * a.value - b.axis * b.value) > far)]


def pieces(h: Joint, own: tuple[Surfels, Surfels], diag: float, least: int,
           ) -> list[tuple[Surfels, Surfels]]:
    """Return the surfels of every piece of a part, the largest first.

    Args:
        h: motion of the part.
        own: its surfels of both states.
        diag: of the object, scene units.
        least: surfels in either state that make a piece.
    """
    points = at_home(h, own)
    if not len(points):
        return []
    near = cKDTree(points).sparse_distance_matrix(cKDTree(points), GAP * diag,
                                                  output_type="coo_matrix")
    number, piece = connected_components(near, directed=False)
    sizes = np.bincount(piece, minlength=number)
    found = []
    for n in np.argsort(-sizes, kind="stable"):
        if sizes[n] < PIECE * len(points):
            break
        zero, one = (np.flatnonzero(part == n) for part in np.split(piece, [len(own[0])]))
        if min(len(zero), len(one)) >= least:
            found.append((own[0].select(zero), own[1].select(one)))
    return found
