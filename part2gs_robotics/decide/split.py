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
from part2gs_robotics.model.joint import Joint

logger = logging.getLogger(__name__)
PARALLEL = np.deg2rad(12.0)  # rad; drawers side by side run parallel
MOST_PAIRS = 20  # of each kind tried in the place of each motion; a set takes about 30 ms
NEAR = 0.005  # of the diagonal: two slides that differ by less are one
ROUNDS = 3  # of tuning; the third seldom changes anything
STEPS = (-0.02, -0.01, -0.005, 0.0, 0.005, 0.01, 0.02)  # of the diagonal, of tuned lengths


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
    return [found.swapped(k, one).plus(two) for k, h in enumerate(found.motions)
            for one, two in pairs if one.kind == h.kind and found.free(k)]


def beside(judge: Judge, found: Candidate) -> list[Candidate]:
    """Return sets, not judged yet, with one slide more, a little longer or shorter than another.

    Drawers opened nearly alike land nearly right by one slide, so that nothing that is left
    proposes the other.

    Args:
        judge: of the study.
        found: to improve.
    """
    return [found.plus(replace(h, value=h.value + step * judge.study.diag))
            for h, parent in zip(found.motions, found.parents, strict=True)
            if not h.turns and not parent for step in (-NEAR, NEAR)]


def _parallel(pool: Sequence[Joint], turning: bool, far: float) -> list[tuple[Joint, Joint]]:
    """Return the pairs of turns, or slides that differ by `far`, along parallel axes."""
    kind = "revolute" if turning else "prismatic"
    return [(a, b) for a, b in combinations([h for h in pool if h.kind == kind], 2)
            if abs(a.axis @ b.axis) > np.cos(PARALLEL)
            and (turning or np.linalg.norm(a.axis * a.value - b.axis * b.value) > far)]


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
