"""Screws: turns that rise along their axis, grown from the turns that a search finds.

A turn alone matches what lies around a screw's axis, such as the side of a cap; what lies across it
shows the rise.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from part2gs_robotics.decide.candidate import PART, Candidate, on_base
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.evidence.landing import land
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.search.choose_kind import LEAST_RISE
from part2gs_robotics.search.cover import SEARCH_TAU
from part2gs_robotics.search.refine import refine

logger = logging.getLogger(__name__)
RISES = (-0.10, -0.04, 0.0, 0.04, 0.10)  # of the diagonal: steps as wide as what a refinement spans
LESS = 0.97  # of what its turn leaves: one number more always leaves a little less
MOST = 3  # screws that are judged
ALIKE = 1e-3  # of what is left: two that grew into one
RARE = 2  # prices of a part that a screw pays for being one; a false one would pay one
PROVEN = 3.0  # standard deviations of the rise, which images must exclude zero by
SAMPLE = 1500  # surfels of evidence per state: as many as refine a motion in some 50 ms


def risen(judge: Judge, found: Candidate, pool: Sequence[Joint]) -> Candidate:
    """Return the candidate with screws for other motions, where the rise pays as a part must.

    One screw may do for several parts: what rises with a cap was explained by a slide. With as many
    parts it must save as much as two more parts must.

    Args:
        judge: of the study.
        found: decided without screws.
        pool: motions that competed; screws grow from its turns.
    """
    best = found
    for screw in grown(judge, pool):
        alone = judge.polished(judge.judge(on_base([screw])))
        sets = [found.swapped(k, screw) for k in range(len(found)) if len(found) > 1]
        trials = [alone, *([judge.polished(judge.best_of(sets))] if sets else [])]
        for trial in trials:
            if trial.cost < best.cost - RARE * PART:
                logger.info("decide: a screw among %d parts: cost %.4f, %.4f less", len(trial),
                            trial.cost, best.cost - trial.cost)
                best = trial
    return best


def grown(judge: Judge, pool: Sequence[Joint]) -> list[Joint]:
    """Return screws that land more of the evidence than the turns they grew from."""
    study, rng = judge.study, np.random.default_rng(0)
    few = [s.select(rng.permutation(len(s))[:SAMPLE]) for s in study.evidence.sets]
    taus = SEARCH_TAU * study.diag, study.tau

    def missed(h: Joint) -> float:
        moves = h.move, se3.inverse(h.move)
        return sum(float(land(m, s, judge.lands[1 - state], study.tau)[0].sum())
                   for state, (m, s) in enumerate(zip(moves, few, strict=True)))

    out: list[tuple[float, Joint]] = []
    for turn in pool:
        if turn.kind == "revolute":
            starts = [replace(turn, kind="screw", pitch=rise * study.diag / turn.value)
                      for rise in RISES]
            screw = min((refine(h, (few[0], few[1]), judge.lands, taus, 3) for h in starts),
                        key=missed)
            left, rises = missed(screw), abs(screw.rise) > LEAST_RISE * study.diag
            if rises and left < LESS * missed(turn) and all(abs(left - other) > ALIKE * left
                                                            for other, _ in out):
                out.append((left, screw))
    return [screw for _, screw in sorted(out, key=lambda pair: pair[0])[:MOST]]


def plain(joints: Sequence[Joint], diag: float) -> list[Joint]:
    """Return the joints with turns instead of screws whose rise the images do not prove.

    Args:
        joints: aligned, with standard deviations.
        diag: diagonal of the object in scene units.
    """
    return [replace(j, kind="revolute", pitch=0.0, sigma_rise=float("nan"))
            if j.kind == "screw" and not _proven(j, diag) else j for j in joints]


def _proven(joint: Joint, diag: float) -> bool:
    rise = abs(joint.rise)
    return rise > LEAST_RISE * diag and rise > PROVEN * joint.sigma_rise
