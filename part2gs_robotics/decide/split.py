"""Splitting: sets with two motions in the place of one that hides two parts rather well.

Tuning: lengths and directions of slides that run beside each other, changed together.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from part2gs_robotics.decide.candidate import Candidate
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.evidence.surfels import FLOATER, Surfels, apart, at_home
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.search.bodies import GAP, connected
from part2gs_robotics.search.refine import misfit, refine

logger = logging.getLogger(__name__)
PARALLEL = np.deg2rad(12.0)  # rad; drawers side by side run parallel
MOST_PAIRS = 20  # of each kind tried in the place of each motion; a set takes about 30 ms
NEAR = 0.005  # of the diagonal: two motions that carry a piece nearer than that are one
PIECE = 0.15  # of a part's surfels: less is a handle or a patch gone astray
ROUNDS = 3  # of tuning; the third seldom changes anything
STEPS = (-0.02, -0.01, -0.005, 0.0, 0.005, 0.01, 0.02)  # of the diagonal, of tuned lengths
PIECE_STEPS = (-0.04, -0.02, 0.0, 0.02, 0.04)  # of the diagonal: refinement reaches half a step


def halved(judge: Judge, found: Candidate, pool: Sequence[Joint]) -> list[Candidate]:
    """Return sets with one motion replaced by two parallel ones of its kind, not judged yet.

    One motion between two drawers' explains both rather well: neither drawer alone is worth adding
    to it, and neither is worth more in its place.

    Args:
        judge: of the study.
        found: to improve.
        pool: motions to choose from.
    """
    far = NEAR * judge.study.diag
    pairs = [pair for turning in (False, True)
             for pair in _parallel(pool, turning, far)[:MOST_PAIRS]]
    return [_in_place(found, k, pair) for k, h in enumerate(found.motions) for pair in pairs
            if pair[0].kind == h.kind and found.free(k)]


def in_pieces(judge: Judge, found: Candidate) -> list[Candidate]:
    """Return sets with one motion replaced by one of each of two of its pieces, not judged yet.

    Drawers in far corners that are pulled out by nearly as much look like one body in two pieces.
    """
    study, sets = judge.study, []
    for k, h in enumerate(found.motions):
        bodies = pieces(h, study.own(found.labels, k + 1), study.diag, FLOATER)
        if len(bodies) > 1 and found.free(k):
            own = [_own(judge, h, piece) for piece in bodies[:2]]
            if apart(own[0], own[1], bodies[1]) > NEAR * study.diag:
                sets.append(_in_place(found, k, (own[0], own[1])))
    return sets


def _in_place(found: Candidate, k: int, pair: tuple[Joint, Joint]) -> Candidate:
    """Return the candidate, not judged yet, with two motions in the place of k."""
    return found.swapped(k, pair[0]).plus(pair[1])


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
    piece, sizes = connected(points, GAP * diag)
    found = []
    for n in np.argsort(-sizes, kind="stable"):
        if sizes[n] < PIECE * len(points):
            break
        zero, one = (np.flatnonzero(part == n) for part in np.split(piece, [len(own[0])]))
        if min(len(zero), len(one)) >= least:
            found.append((own[0].select(zero), own[1].select(one)))
    return found


def tune(judge: Judge, found: Candidate) -> Candidate:
    """Return the candidate after every slide tried other lengths and its neighbours' directions.

    Look-alike drawers share surfels while their lengths are wrong, and the lengths stay wrong
    while they share surfels: both are changed together. One moving part needs none of this.
    """
    best = found
    for _ in range(ROUNDS if len(found) > 1 else 0):
        before = best.cost
        for k in range(len(best)):
            sets = [best.swapped(k, h) for h in _variants(best.motions, k, judge.study.diag)]
            trial = judge.best_of(sets, 1) if sets else best
            best = trial if trial.cost < best.cost else best
        logger.info("tune: cost %.4f, %.4f less", best.cost, before - best.cost)
        if before - best.cost < 1e-4:  # a tenth of what one wrong surfel in a thousand costs
            break
    return best


def _variants(motions: Sequence[Joint], k: int, diag: float) -> list[Joint]:
    own = motions[k]
    if own.turns:
        return []
    ways = [own]
    for other in motions:
        cosine = float(other.axis @ own.axis)
        if other is not own and not other.turns and abs(cosine) > np.cos(PARALLEL):
            axis = other.axis * np.sign(cosine)
            if all(float(axis @ known.axis) < 1 - 1e-9 for known in ways):  # parallel: one try
                ways.append(replace(own, axis=axis, held=other.held))
    return [
        replace(way, value=own.value + float(step) * diag)
        for way in ways
        for step in STEPS
    ]
