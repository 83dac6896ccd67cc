"""Splitting: one motion that hides two parts rather well is left for one motion of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np

from part2gs_robotics.decide.judge import (
    INCOHERENT,
    MIN_SURFELS,
    MORE_MET,
    PLAIN_ASKEW,
    SLOW,
    Judge,
    Verdict,
)
from part2gs_robotics.decide.pieces import apart, pieces
from part2gs_robotics.decide.tune_slides import PARALLEL, tune
from part2gs_robotics.evidence.study import Study
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.search.hypothesis import Hypothesis
from part2gs_robotics.search.refine import misfit, refine

# Of the poorer state's surfels: one body meets 0.66 and more, two under one motion 0.22 to 0.65.
# What pays must pay all the same, so trying costs nothing but time.
WHOLE = 0.8
MOST_PAIRS = 20  # of each kind tried in the place of each motion; a set takes about 30 ms
HOPE = 2.0  # prices: two drawers cost that much more before tuning than after
NEAR = 0.005  # of the diagonal: two motions that carry a piece nearer than that are one
TORN = 0.5  # of a price: that nothing joins what one motion carries, or few meet, tells the rest
PIECE_STEPS = (-0.04, -0.02, 0.0, 0.02, 0.04)  # of the diagonal: refinement reaches half a step


def split(judge: Judge, verdict: Verdict, pool: list[Hypothesis],
          say: Callable[[str], None]) -> Verdict:
    """Return the verdict with one motion replaced by two parallel ones, itself if none pays.

    One motion between two drawers' explains both rather well: neither drawer alone is worth adding
    to it, and neither is worth more in its place. One shut and one opened look like a slide askew,
    and of two doors like one door that swung across. Two that meet a tenth more need save half.

    Args:
        judge: of the study.
        verdict: to improve.
        pool: hypotheses.
        say: told every step.
    """
    far = NEAR * judge.study.diag
    pairs = [pair for kind in (0, 1) for pair in _parallel(pool, kind, far)[:MOST_PAIRS]]
    doubtful = ((judge.met(verdict.motions, verdict.hard) < WHOLE)
                | (judge.leans(verdict.motions, verdict.hard) >= PLAIN_ASKEW))
    sets = [[*verdict.motions[:k], *pair, *verdict.motions[k + 1:]]
            for k in np.flatnonzero(doubtful) for pair in pairs
            if pair[0].kind == verdict.motions[k].kind]
    found, price = _best(judge, verdict, sets, say)
    worth = TORN * price if found.met > verdict.met + MORE_MET else price
    # A drawer that shares surfels with doors looks a little askew until it is settled.
    excused = INCOHERENT * max(found.askew - verdict.askew, 0.0)
    gain = verdict.cost - found.cost + (excused if found.askew < PLAIN_ASKEW else 0.0)
    return found if gain >= worth and found.improves(verdict) else verdict


def parted(judge: Judge, verdict: Verdict, say: Callable[[str], None]) -> Verdict:
    """Return the verdict with one motion replaced by a motion of each of its pieces, if that pays.

    Drawers in far corners that are pulled out by nearly as much look like one body in two pieces.
    Nothing joins them and they move differently: that is told half of what a part is worth. It is
    not where one hardly moves: a piece of a wardrobe's drawer that stays behind is a wrong label.
    """
    study, sets = judge.study, []
    far, slow = NEAR * study.diag, SLOW * study.diag
    for k, h in enumerate(verdict.motions):
        found = pieces(h, study.own(verdict.hard, k + 1), study.diag, MIN_SURFELS)
        if len(found) > 1:
            own = [_own(judge, h, piece) for piece in found[:2]]
            ways = [apart(replace(g, kind=0, value=0.0), g, piece)
                    for g, piece in zip(own, found, strict=False)]
            if apart(own[0], own[1], found[1]) > far and min(ways) > slow:
                sets.append([*verdict.motions[:k], *own, *verdict.motions[k + 1:]])
    best, price = _best(judge, verdict, sets, say)
    if best is verdict:
        return verdict
    gain, worth = verdict.cost - best.cost, TORN * price
    say(f"a part's pieces on their own: {gain:.4f} less; price {worth:.4f}")
    return best if gain >= worth and best.improves(verdict) else verdict


def torn(study: Study, verdict: Verdict) -> int:
    """Return how many pieces the parts of a verdict have beyond one each."""
    counts = [len(pieces(h, study.own(verdict.hard, k + 1), study.diag, MIN_SURFELS))
              for k, h in enumerate(verdict.motions)]
    return sum(max(count - 1, 0) for count in counts)


def _best(judge: Judge, verdict: Verdict, sets: list[list[Hypothesis]],
          say: Callable[[str], None]) -> tuple[Verdict, float]:
    """Return the best of the sets, tuned where that may matter, and what it must save."""
    if not sets:
        return verdict, np.inf
    found = judge.polished(judge.best_of(sets, verdict))
    price = judge.price(found, verdict.cost)
    if found.cost < verdict.cost + HOPE * price:  # lengths and labels are off until tuned
        found = tune(judge, found, say)
    return found, price


def _own(judge: Judge, h: Hypothesis, piece: tuple[Surfels, Surfels]) -> Hypothesis:
    """Return the motion near h, a slide also shorter or longer, that lands a piece best."""
    study = judge.study
    tries = [refine(replace(h, value=h.value + step * study.diag), piece, judge.lands, study.taus)
             for step in ((0.0,) if h.kind else PIECE_STEPS)]
    return min(tries, key=lambda g: misfit(g, piece, judge.lands, study.tau))


def _parallel(pool: list[Hypothesis], kind: int, far: float,
              ) -> list[tuple[Hypothesis, Hypothesis]]:
    """Return the pairs of motions of one kind along parallel axes; slides that differ by `far`."""
    return [(a, b) for a, b in combinations([h for h in pool if h.kind == kind], 2)
            if abs(a.axis @ b.axis) > np.cos(PARALLEL)
            and (kind or np.linalg.norm(a.axis * a.value - b.axis * b.value) > far)]
