"""Flips: the same part landed the other way round.

A panel turned about its hinge, and turned half a turn further or less about a line in the air,
ends in one place with its ends exchanged. A search ranks motions of small patches, and where
shadows move the wrong one may be all it keeps. Once parts are known both compete before the images.
A part that looks the same after half a turn leaves the images no choice: then the lesser turn is
the likelier.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from part2gs_robotics.decide.judge import NEAR, Judge, Verdict, arm_of
from part2gs_robotics.decide.pieces import at_home
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.search.hypothesis import Hypothesis
from part2gs_robotics.search.refine import refine

FEWEST = 50  # surfels of both states: fewer have no middle and no axes of their own
MOST_RISE = 0.05  # of the diagonal: a part's middle is known so well; more is no turn
UPRIGHT = 0.1  # sine: a panel that turns in its own plane has no way across of its own
LEAST_TURN = np.deg2rad(5.0)  # less has no axis worth the name, and may be a slide
LARGE = np.deg2rad(90.0)  # a lesser turn has no other way round that turns less
LESSER = 0.5  # of a turn: what turns nearly as far is no likelier
CENTRAL = 1.4  # radii of gyration from the part's middle: a board's edge is 1.73 away
ALIKE = 0.02  # of the cost: a blade's slide was 1.1 % worse than its half turn


def righted(judge: Judge, verdict: Verdict, say: Callable[[str], None]) -> Verdict:
    """Return the verdict with turns in the air put right, where that costs less.

    A hinge goes through its part or lies beside it.

    Args:
        judge: of the study.
        verdict: decided.
        say: told of every turn that changes.
    """
    best = verdict
    for k, h in enumerate(verdict.motions):
        own, near = judge.study.own(best.hard, k + 1), NEAR * judge.study.diag
        if not h.kind or h.carrier is not None or arm_of(h, own) < near:
            continue
        for guess in _flips(h, own, judge.study.diag):
            new = refine(guess, own, judge.lands, judge.study.taus)
            if not new.kind or arm_of(new, own) > near:
                continue
            trial = judge.judge([*best.motions[:k], new, *best.motions[k + 1:]])
            if trial.cost < best.cost:
                say(f"part {k + 1} the other way round: cost {trial.cost:.4f}, "
                    f"{best.cost - trial.cost:.4f} less")
                best = trial
    return best


def calmed(judge: Judge, verdict: Verdict, pool: list[Hypothesis], say: Callable[[str], None],
           ) -> Verdict:
    """Return the verdict with large turns of parts that look alike after half a turn made less.

    A flap that folds over turns about its edge; a line through the part is hardly a hinge's.

    Args:
        judge: of the study.
        verdict: decided.
        pool: hypotheses, that compete with what half a turn of the part makes of its motion.
        say: told of every turn that changes.
    """
    best = verdict
    for k, h in enumerate(verdict.motions):
        if h.kind != 1 or h.carrier is not None or abs(h.value) < LARGE:
            continue
        own = judge.study.own(best.hard, k + 1)
        if not _central(h, own):
            continue
        turned = [refine(guess, own, judge.lands, judge.study.taus)
                  for guess in _flips(h, own, judge.study.diag)]
        less = lesser(h, [*turned, *pool])
        if not less:
            continue
        trial = judge.polished(judge.best_of(
            [[*best.motions[:k], new, *best.motions[k + 1:]] for new in less]))
        if trial.coherent and trial.cost < (1 + ALIKE) * best.cost:
            say(f"part {k + 1} looks alike after half a turn: it moves less; cost "
                f"{trial.cost:.4f}, was {best.cost:.4f}")
            best = trial
    return best


def lesser(h: Hypothesis, others: list[Hypothesis]) -> list[Hypothesis]:
    """Return the slides among other motions, and the turns by less than half as much."""
    return [new for new in others if not new.kind or abs(new.value) < LESSER * abs(h.value)]


def _central(h: Hypothesis, own: tuple[Surfels, Surfels]) -> bool:
    """Return whether a turn's line goes through its part rather than along its edge."""
    points = at_home(h, own)
    if not len(points):
        return False
    arms = np.cross(points - h.origin, h.axis)
    return bool(np.linalg.norm(arms.mean(0)) < CENTRAL * np.sqrt(arms.var(0).sum()))


def _flips(h: Hypothesis, own: tuple[Surfels, Surfels], diag: float) -> list[Hypothesis]:
    points = at_home(h, own)
    if len(points) < FEWEST:
        return []
    # Of a square panel only the normal is its own: the other ways follow the motion's axis.
    normal = np.linalg.svd(points - points.mean(0), full_matrices=False)[2][2]
    across = np.cross(h.axis, normal)
    if np.linalg.norm(across) < UPRIGHT:
        across = np.cross(h.axis, np.eye(3)[np.abs(h.axis).argmin()])
    across /= np.linalg.norm(across)
    frame = np.stack([h.axis, across, np.cross(h.axis, across)])
    local = points @ frame.T
    centre = frame.T @ (0.5 * (local.min(0) + local.max(0)))
    found = (joint_near(h.own @ se3.screw_motion(axis, centre, np.pi, 0.0), centre, diag)
             for axis in frame)
    return [joint for joint in found if joint is not None]


def joint_near(move: F64, centre: F64, diag: float) -> Hypothesis | None:
    """Return the turn or the slide that a [4, 4] motion nearly is, None if it is none.

    Args:
        move: of a part.
        centre: [3] of the part before the motion.
        diag: diagonal of the object in scene units.
    """
    axis, origin, angle, rise = se3.screw_of(move, centre, LEAST_TURN)
    if not angle:
        return Hypothesis(0, axis, centre, rise) if rise else None
    if abs(rise) > MOST_RISE * diag:
        return None
    return Hypothesis(1, axis, origin, angle)
