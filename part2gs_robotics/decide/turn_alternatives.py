"""Alternatives to a turn: the other way round, a lesser turn, or a slide.

A panel turned about its hinge, and turned half a turn further or less about a line in the air,
ends in one place with its ends exchanged. A part that looks the same after half a turn leaves the
images no choice: then the lesser turn is the likelier.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from part2gs_robotics.decide.candidate import Candidate
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.evidence.surfels import Surfels, at_home
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.search.refine import refine

logger = logging.getLogger(__name__)
FEWEST = 50  # surfels of both states: fewer have no middle and no axes of their own
MOST_RISE = 0.05  # of the diagonal: a part's middle is known so well; more is no turn
UPRIGHT = 0.1  # sine: a panel that turns in its own plane has no way across of its own
LEAST_TURN = np.deg2rad(5.0)  # less has no axis worth the name, and may be a slide
HALF_WAY = np.deg2rad(90.0)  # a lesser turn has no other way round that turns less
LESSER = 0.5  # of a turn: what turns nearly as far is no likelier
CENTRAL = 1.4  # radii of gyration from the part's middle: a board's edge is 1.73 away
ALIKE = 0.02  # of the cost: the lesser of two motions that look the same cost 1.1 % more


def calmed(judge: Judge, found: Candidate, pool: Sequence[Joint]) -> Candidate:
    """Return the candidate with large turns of parts that look alike after half a turn made less.

    A flap that folds over turns about its edge; a line through the part is hardly a hinge's.

    Args:
        judge: of the study.
        found: decided.
        pool: motions that compete with what half a turn of the part makes of its motion.
    """
    best = found
    for k, h in enumerate(found.motions):
        if h.kind != "revolute" or h.carrier is not None or abs(h.value) < HALF_WAY:
            continue
        own = judge.study.own(best.labels, k + 1)
        if not _central(h, own):
            continue
        turned = [refine(guess, own, judge.lands, judge.study.taus)
                  for guess in _flips(h, own, judge.study.diag)]
        less = lesser(h, [*turned, *pool])
        if not less:
            continue
        trial = judge.polished(judge.best_of([best.swapped(k, new) for new in less]))
        if trial.cost < (1 + ALIKE) * best.cost:
            logger.info("decide: part %d looks alike after half a turn: it moves less; cost %.4f, "
                        "was %.4f", k + 1, trial.cost, best.cost)
            best = trial
    return best


def lesser(h: Joint, others: Sequence[Joint]) -> list[Joint]:
    """Return the slides among other motions, and the turns by less than half as much."""
    return [new for new in others if not new.turns or abs(new.value) < LESSER * abs(h.value)]


def _central(h: Joint, own: tuple[Surfels, Surfels]) -> bool:
    """Return whether a turn's line goes through its part rather than along its edge."""
    points = at_home(h, own)
    if not len(points):
        return False
    arms = np.cross(points - h.origin, h.axis)
    return bool(np.linalg.norm(arms.mean(0)) < CENTRAL * np.sqrt(arms.var(0).sum()))


def _flips(h: Joint, own: tuple[Surfels, Surfels], diag: float) -> list[Joint]:
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


def joint_near(move: F64, centre: F64, diag: float) -> Joint | None:
    """Return the turn or the slide that a [4, 4] motion nearly is, None if it is none.

    Args:
        move: of a part.
        centre: [3] of the part before the motion.
        diag: diagonal of the object in scene units.
    """
    axis, origin, angle, rise = se3.screw_of(move, centre, LEAST_TURN)
    if not angle:
        return Joint("prismatic", axis, centre, rise) if rise else None
    if abs(rise) > MOST_RISE * diag:
        return None
    return Joint("revolute", axis, origin, angle)
