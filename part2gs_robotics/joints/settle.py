"""Settlement: joints and labels taken in turn until both fit the images.

One moving part is labelled anew once its joint is nearly right. Look-alike neighbours need more:
while they hold each other's surfels their joints stay wrong, so alignment, relabelling and tuning
alternate.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.decide.cross_render import both_cost
from part2gs_robotics.decide.judge import Judge, Verdict
from part2gs_robotics.decide.screws import plain
from part2gs_robotics.decide.tune_slides import tune
from part2gs_robotics.joints.align import (
    COARSE,
    FINE,
    LEAST_GAIN,
    Level,
    align,
    judged,
    with_missing_deviations,
)
from part2gs_robotics.joints.claim import claim
from part2gs_robotics.joints.labels import identity_labels, labels_under
from part2gs_robotics.model.arrays import Labels
from part2gs_robotics.model.joint import Joint, move_of
from part2gs_robotics.model.small_views import SmallViews
from part2gs_robotics.search.hypothesis import Hypothesis, hypothesis_of

logger = logging.getLogger(__name__)
Views = tuple[SmallViews, SmallViews]
ROUNDS = 2  # of alignment and relabelling before and after tuning; a third changed < 0.05 deg
# Of the moving surfels: 0.6 to 0.9 % changed in three scenes where a second alignment was no use,
# 4 % where fronts are mixed up.
RELABELLED = 0.02
THIN = 2  # every other view until the last alignment
VETO = 0.002  # of the image cost: surfels were heard too, and three drawers differed by 0.0013


def settle(
    judge: Judge, joints: list[Joint], hard: Labels, views: Views, sharp: Views,
    config: ArticulateConfig,
) -> tuple[list[Joint], Labels]:
    """Return the joints and surfel labels [N0 + N1] that the images prefer.

    Args:
        judge: of the study.
        joints: of parts 1..K, start.
        hard: surfel labels, start.
        views: images of both states to settle with.
        sharp: the same at full size, for the last alignment.
        config: whether Gaussians have part identities.
    """
    if len(joints) == 1:
        return _alone(judge, joints, hard, views, sharp, config)
    thin = views[0].every(THIN), views[1].every(THIN)
    new, verdict = _alternate(judge, joints, hard, thin, (*COARSE, *FINE[:1]))
    verdict = tune(judge, verdict, lambda text: logger.info("settle: %s", text))
    new = [_follow(j, h) for j, h in zip(new, verdict.motions, strict=True)]
    new, verdict = _alternate(judge, new, verdict.hard, thin, FINE[:1])
    costs = [_cost(judge, j, h, views) for j, h in ((joints, hard), (new, verdict.hard))]
    logger.info("settle: image cost %.4f after, %.4f before", costs[1], costs[0])
    if costs[1] < (1.0 + VETO) * costs[0]:
        return _aligned(judge, new, verdict.hard, sharp, config), verdict.hard
    return _alone(judge, joints, hard, views, sharp, config)


def _alone(judge: Judge, joints: list[Joint], hard: Labels, views: Views, sharp: Views,
           config: ArticulateConfig) -> tuple[list[Joint], Labels]:
    """Return the joints aligned, with the labels under them as they are once nearly right.

    The decision's motion is off by degrees, and what lies beside the hinge is mislabelled by it.
    """
    study = judge.study
    labels = study.gaussian_labels(hard)
    near = align(study.gaussians, labels, joints, views, study.diag, COARSE, deviations=False)
    near = judged(study.gaussians, labels, joints, near, views, LEAST_GAIN)
    hard, _ = labels_under(judge, near, hard, config)
    return _aligned(judge, near, hard, sharp, config), hard


def _aligned(judge: Judge, joints: list[Joint], hard: Labels, sharp: Views,
             config: ArticulateConfig) -> list[Joint]:
    """Return joints that are nearly right after their last alignment."""
    study = judge.study
    labels = identity_labels(judge, joints, hard, config)
    end = _final(judge, joints, labels, sharp)
    if not all(_held(j) for j in end):
        end, labels = _again(judge, end, labels, hard, sharp, config)
    kept = judged(study.gaussians, labels, joints, end, sharp, LEAST_GAIN)
    return with_missing_deviations(study.gaussians, labels, kept, sharp, study.diag)


def _again(judge: Judge, end: list[Joint], labels: tuple[Labels, Labels], hard: Labels,
           sharp: Views, config: ArticulateConfig) -> tuple[list[Joint], tuple[Labels, Labels]]:
    """Return joints and labels aligned once more if the images hold more joints then.

    Labels made under a wrong joint hold it where it is; where they hardly change under what became
    of it, nothing else would come out.
    """
    new, _ = labels_under(judge, end, hard, config)
    if (new != hard).sum() < RELABELLED * (hard > 0).sum():
        return end, labels
    others = identity_labels(judge, end, new, config)
    again = _final(judge, end, others, sharp)
    more = sum(_held(j) for j in again) > sum(_held(j) for j in end)
    logger.info("settle: images do not hold every joint; labelled and aligned again: %s",
                "they hold more" if more else "no gain")
    return (again, others) if more else (end, labels)


def _final(judge: Judge, joints: list[Joint], labels: tuple[Labels, Labels],
           sharp: Views) -> list[Joint]:
    """Return the joints aligned at full size, screws as turns where no image shows a rise."""
    study = judge.study
    clues = study.clues(labels, len(joints))
    end = align(study.gaussians, labels, joints, sharp, study.diag, FINE, clues=clues)
    turns = plain(end, study.diag)
    if any(new is not old for new, old in zip(turns, end, strict=True)):
        logger.info("settle: a screw's rise is not proven by the images: a turn")
        end = align(study.gaussians, labels, turns, sharp, study.diag, FINE, clues=clues)
    return end


def _held(joint: Joint) -> bool:
    """Say whether the images hold a joint in every way (a slide's origin has no deviation)."""
    return not np.isinf([joint.sigma_axis, joint.sigma_origin, joint.seen[1]]).any()


def _alternate(
    judge: Judge, joints: list[Joint], hard: Labels, views: Views, levels: tuple[Level, ...]
) -> tuple[list[Joint], Verdict]:
    study = judge.study
    for turn in range(ROUNDS):
        labels = study.gaussian_labels(hard)
        joints = align(study.gaussians, labels, joints, views, study.diag,
                       FINE[:1] if turn else levels, deviations=False)
        verdict = judge.judge([hypothesis_of(j) for j in joints])
        hard, _ = claim(judge, joints, verdict.hard)
        verdict = replace(verdict, hard=hard)
    return joints, verdict


def _cost(judge: Judge, joints: list[Joint], hard: Labels, views: Views) -> float:
    moves = [np.eye(4), *(move_of(j) for j in joints)]
    study = judge.study
    labels = study.gaussian_labels(hard)
    return both_cost(study.gaussians, labels, moves, views, (0.5, 0.5), study.light)


def _follow(joint: Joint, motion: Hypothesis) -> Joint:
    """Return the joint with the motion's axis, origin and value."""
    origin = motion.origin if motion.kind else joint.origin
    return replace(joint, axis=motion.axis, origin=origin, value=motion.value,
                   pitch=motion.pitch)
