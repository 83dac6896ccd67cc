"""Tuning: lengths and directions of slides that run beside each other, changed together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from part2gs_robotics.decide.judge import Judge, Verdict
from part2gs_robotics.search.hypothesis import Hypothesis

ROUNDS = 3  # the third seldom changes anything
PARALLEL = np.deg2rad(12.0)  # rad; drawers of one cabinet run parallel
STEPS = (-0.02, -0.01, -0.005, 0.0, 0.005, 0.01, 0.02)  # of the diagonal


def tune(judge: Judge, verdict: Verdict, say: Callable[[str], None]) -> Verdict:
    """Return the verdict after every slide tried other lengths and its neighbours' directions.

    Look-alike drawers share surfels while their lengths are wrong, and the lengths stay wrong
    while they share surfels: both are changed together. One moving part needs none of this.
    """
    best = verdict
    for _ in range(ROUNDS if len(verdict.motions) > 1 else 0):
        before = best.cost
        for k in range(len(best.motions)):
            sets = [
                [*best.motions[:k], h, *best.motions[k + 1 :]]
                for h in _variants(best.motions, k, judge.study.diag)
            ]
            trial = judge.best_of(sets) if sets else best
            best = trial if trial.cost < best.cost else best
        say(f"tuned: cost {best.cost:.4f}, {before - best.cost:.4f} less")
        if before - best.cost < 1e-4:  # a tenth of what one wrong surfel in a thousand costs
            break
    return best


def _variants(motions: tuple[Hypothesis, ...], k: int, diag: float) -> list[Hypothesis]:
    own = motions[k]
    if own.kind:
        return []
    ways = [own]
    for other in motions:
        cosine = float(other.axis @ own.axis)
        if other is not own and not other.kind and abs(cosine) > np.cos(PARALLEL):
            axis = other.axis * np.sign(cosine)
            if all(float(axis @ known.axis) < 1 - 1e-9 for known in ways):  # parallel: one try
                ways.append(replace(own, axis=axis, held=other.held))
    return [
        replace(way, value=own.value + float(step) * diag)
        for way in ways
        for step in STEPS
    ]
