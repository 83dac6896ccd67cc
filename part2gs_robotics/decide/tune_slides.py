"""Tuning: lengths and directions of slides that run beside each other, changed together."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from part2gs_robotics.decide.candidate import Candidate
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.model.joint import Joint

logger = logging.getLogger(__name__)
ROUNDS = 3  # the third seldom changes anything
PARALLEL = np.deg2rad(12.0)  # rad; drawers side by side run parallel
STEPS = (-0.02, -0.01, -0.005, 0.0, 0.005, 0.01, 0.02)  # of the diagonal


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
