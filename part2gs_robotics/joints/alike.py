"""Alike: parts that shared one motion, because photos hardly tell them apart, each on its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from part2gs_robotics.config import Config
from part2gs_robotics.evidence.canonical import Canonical
from part2gs_robotics.joints.align import COARSE, FINE, AlignmentProblem, align, judged
from part2gs_robotics.model.kinematics import chain
from part2gs_robotics.model.motion import Motion
from part2gs_robotics.model.small_views import both_small


def each_aligned(both: Canonical, motion: Motion, config: Config) -> Motion:
    """Return the motion with a joint for every part, of parts that share one.

    Two drawers pulled out by nearly the same amount were found as one slide, between theirs. Each
    joint starts from it and is aligned to the photos; it stays where they do not like that better.

    Args:
        both: states, comparable.
        motion: in which some parts have the very same joint.
        config: whether joints are aligned to photos at all, and how closely to look.
    """
    if not config.articulate.alignment or config.articulate.paper_mode:
        return motion
    joints, parents, values = motion.joints, motion.parents, [j.value for j in motion.joints]
    start = [replace(joint, carrier=chain(parent, joints, parents, values)) if parent else joint
             for joint, parent in zip(joints, parents, strict=True)]
    shared = [sum(joint is other for other in joints) > 1 and k not in parents
              for k, joint in enumerate(joints, 1)]
    views = both_small(both.scene.states, config.search.align_views, config.search.sharp_side)
    labels = (np.asarray(motion.labels(0), np.int64), np.asarray(motion.labels(1), np.int64))
    problem = AlignmentProblem(both.gaussians, labels, views, both.surfaces.diag)
    end = align(problem, start, (COARSE[-1], *FINE))
    new = [after if mine else before
           for before, after, mine in zip(start, end, shared, strict=True)]
    kept = judged(problem, start, new)
    return replace(motion, joints=tuple(replace(joint, carrier=None) for joint in kept))
