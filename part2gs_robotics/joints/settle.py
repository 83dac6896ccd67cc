"""Settlement: joints and labels taken in turn until both fit the images.

One moving part is labelled anew once its joint is nearly right. Look-alike neighbours need more:
while they hold each other's surfels their joints stay wrong, so alignment, relabelling and tuning
alternate.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.decide.candidate import PART, Candidate
from part2gs_robotics.decide.claim import claim
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.decide.screws import plain
from part2gs_robotics.decide.split import tune
from part2gs_robotics.evidence.cross_render import both_cost
from part2gs_robotics.joints.align import (
    COARSE,
    FINE,
    LEAST_GAIN,
    AlignmentProblem,
    align,
    judged,
    with_missing_deviations,
)
from part2gs_robotics.joints.labels import identity_labels, labels_under
from part2gs_robotics.joints.view import Level
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.small_views import SmallViews

logger = logging.getLogger(__name__)
Views = tuple[SmallViews, SmallViews]
ROUNDS = 2  # of alignment and relabelling before and after tuning; a third changed < 0.05 deg
# Of moving surfels: 0.6 to 0.9 % in three scenes that needed no realignment, 4 % where fronts mix.
RELABELLED = 0.02
THIN = 2  # every other view until the last alignment
VETO = 0.002  # of the image cost: surfels were heard too, and three drawers differed by 0.0013


@dataclass(frozen=True)
class Photos:
    """Photos of both states: small ones to settle with, sharp ones for the last alignment."""

    small: Views
    sharp: Views


def settle(judge: Judge, found: Candidate, photos: Photos, config: ArticulateConfig) -> Candidate:
    """Return joints and surfel labels that the images prefer.

    Args:
        judge: of the study.
        found: joints of parts on the base, and labels, to start from.
        photos: of both states.
        config: whether Gaussians have part identities.
    """
    return _kept(judge, found, _settled(judge, found, photos, config), photos.sharp)


def _kept(judge: Judge, before: Candidate, after: Candidate, sharp: Views) -> Candidate:
    """Return aligned joints, where they cost a part's price more than before, aligned from there.

    Photos lead a joint astray where look-alike neighbours hold each other's surfels, and then the
    next one. The cost that decided about the parts sees that; smaller differences are below what
    surfels can tell. One part alone may be a little dearer by bent depths and right, if photos of
    all of it say so.
    """
    was = judge.judge(before)
    best = end = moved(judge, was, after)
    shown = len(after) == 1 and end.scores.images < was.scores.images
    if shown or end.cost < was.cost + PART:
        return after
    for k in range(len(after)):
        trial = judge.judge(best.swapped(k, before.motions[k]))
        best = trial if trial.cost + PART < best.cost else best
    best = was if was.cost + PART < best.cost else best  # each alone may mend nothing
    if best is end:
        return after
    logger.info("settle: cost %.4f, %.4f with joints as before", end.cost, best.cost)
    again = judge.judge(aligned(judge, best, sharp))
    if again.cost < best.cost + PART:
        return again
    problem = problem_of(judge, best, sharp)
    return best.with_motions(with_missing_deviations(problem, list(best.motions)))


def moved(judge: Judge, was: Candidate, after: Candidate) -> Candidate:
    """Return aligned joints judged, by labels found anew or by those of before, which costs less.

    A little further on, labels found anew may be much dearer by what photos show.
    """
    return min(judge.judge(after), judge.given(replace(after, labels=was.labels)),
               key=lambda c: c.cost)


def _settled(judge: Judge, found: Candidate, photos: Photos, config: ArticulateConfig,
             ) -> Candidate:
    """Return joints and surfel labels that the images prefer. Arguments as of `settle`."""
    if len(found) == 1:
        return _alone(judge, found, photos, config)
    thin = photos.small[0].every(THIN), photos.small[1].every(THIN)
    new = _alternate(judge, found, thin, (*COARSE, *FINE[:1]))
    new = _alternate(judge, tune(judge, new), thin, FINE[:1])
    after, before = (_cost(judge, one, photos.small) for one in (new, found))
    logger.info("settle: image cost %.4f after, %.4f before", after, before)
    if after < (1.0 + VETO) * before:
        return new.with_motions(_aligned(judge, new, photos.sharp, config))
    return _alone(judge, found, photos, config)


def aligned(judge: Judge, found: Candidate, views: Views) -> Candidate:
    """Return the candidate aligned to the images, carried parts as their carriers take them."""
    return finely(judge, nearly(judge, found, views), views)


def nearly(judge: Judge, found: Candidate, views: Views) -> Candidate:
    """Return the candidate aligned as far as it takes to tell whether its parts pay."""
    return _under_claims(judge, found, views, last=False)


def finely(judge: Judge, found: Candidate, views: Views) -> Candidate:
    """Return the candidate aligned for good, given as `nearly` returns it."""
    return _under_claims(judge, found, views, last=True)


def _under_claims(judge: Judge, found: Candidate, views: Views, last: bool) -> Candidate:
    """Return the candidate labelled anew and aligned; only the last time with deviations."""
    found = replace(found, labels=claim(judge.study, judge.lands, found))
    problem = problem_of(judge, found, views)
    clues = judge.study.clues(problem.labels, len(found)) if last else None
    levels = FINE if last else FINE[:1]
    return found.with_motions(align(problem, found.motions, levels, last, clues))


def problem_of(judge: Judge, found: Candidate, views: Views) -> AlignmentProblem:
    """Return the alignment of a candidate's joints to photos, Gaussians labelled as its surfels."""
    study = judge.study
    return AlignmentProblem(study.gaussians, study.gaussian_labels(found.labels), views, study.diag)


def _alone(judge: Judge, found: Candidate, photos: Photos, config: ArticulateConfig) -> Candidate:
    """Return the joints aligned, with the labels under them as they are once nearly right.

    The decision's motion is off by degrees, and what lies beside the hinge is mislabelled by it.
    """
    problem = problem_of(judge, found, photos.small)
    near = align(problem, found.motions, COARSE, deviations=False)
    found = found.with_motions(judged(problem, found.motions, near, LEAST_GAIN))
    found = replace(found, labels=labels_under(judge, found, config))
    return found.with_motions(_aligned(judge, found, photos.sharp, config))


def _aligned(judge: Judge, found: Candidate, sharp: Views, config: ArticulateConfig) -> list[Joint]:
    """Return joints that are nearly right after their last alignment."""
    study = judge.study
    problem = AlignmentProblem(study.gaussians, identity_labels(judge, found, config), sharp,
                               study.diag)
    end = _final(judge, found.motions, problem)
    if not all(_held(j) for j in end):
        end, problem = _again(judge, found.with_motions(end), problem, config)
    kept = judged(problem, found.motions, end, LEAST_GAIN)
    return with_missing_deviations(problem, kept)


def _again(judge: Judge, end: Candidate, problem: AlignmentProblem, config: ArticulateConfig,
           ) -> tuple[list[Joint], AlignmentProblem]:
    """Return joints aligned once more, and to what, if the images hold more joints then.

    Labels made under a wrong joint hold it where it is; where they hardly change under what became
    of it, nothing else would come out.
    """
    new = labels_under(judge, end, config)
    if (new != end.labels).sum() < RELABELLED * (end.labels > 0).sum():
        return list(end.motions), problem
    other = replace(problem, labels=identity_labels(judge, replace(end, labels=new), config))
    again = _final(judge, end.motions, other)
    more = sum(_held(j) for j in again) > sum(_held(j) for j in end.motions)
    logger.info("settle: images do not hold every joint; labelled and aligned again: %s",
                "they hold more" if more else "no gain")
    return (again, other) if more else (list(end.motions), problem)


def _final(judge: Judge, joints: Sequence[Joint], problem: AlignmentProblem) -> list[Joint]:
    """Return the joints aligned at full size, screws as turns where no image shows a rise."""
    clues = judge.study.clues(problem.labels, len(joints))
    end = align(problem, joints, FINE, clues=clues)
    turns = plain(end, problem.diag)
    if any(new is not old for new, old in zip(turns, end, strict=True)):
        logger.info("settle: a screw's rise is not proven by the images: a turn")
        end = align(problem, turns, FINE, clues=clues)
    return end


def _held(joint: Joint) -> bool:
    """Say whether the images hold a joint in every way (a slide's origin has no deviation)."""
    return not np.isinf([joint.sigma_axis, joint.sigma_origin, joint.seen[1]]).any()


def _alternate(judge: Judge, found: Candidate, views: Views, levels: tuple[Level, ...],
               ) -> Candidate:
    """Return the candidate aligned and labelled in turn."""
    for turn in range(ROUNDS):
        problem = problem_of(judge, found, views)
        joints = align(problem, found.motions, FINE[:1] if turn else levels, deviations=False)
        found = judge.judge(found.with_motions(joints))
        found = replace(found, labels=claim(judge.study, judge.lands, found))
    return found


def _cost(judge: Judge, found: Candidate, views: Views) -> float:
    problem = problem_of(judge, found, views)
    moves = [np.eye(4), *(j.state1_from_0 for j in found.motions)]
    return both_cost(problem.gaussians, problem.labels, moves, views, (0.5, 0.5), judge.study.light)
