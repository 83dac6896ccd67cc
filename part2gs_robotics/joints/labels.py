"""Labels: which part a surfel or Gaussian belongs to, by part identities or by landing alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.decide.candidate import Candidate
from part2gs_robotics.decide.claim import STAYS, claim
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.decide.labelling import Unary, unary_costs
from part2gs_robotics.evidence.study import Study
from part2gs_robotics.evidence.surfels import FLOATER
from part2gs_robotics.model.arrays import F32, F64, Labels
from part2gs_robotics.paper.identity import PAPER, IdentityConfig, refine_identities


def start_labels(judge: Judge, found: Candidate, config: ArticulateConfig) -> Labels:
    """Return [N0 + N1] surfel labels that joints are chosen by.

    Those of the decision; without part identities, the motion that lands a surfel best, except
    for a motion that lands next to none best: it keeps the decision's surfels.
    """
    if config.identity:
        return found.labels
    hard = landing_costs(judge, [h.move for h in found.motions]).argmin(1)
    counts = np.bincount(hard, minlength=len(found) + 1)
    few = np.flatnonzero(counts < FLOATER)
    return np.where(np.isin(found.labels, few), found.labels, hard)


def labels_under(judge: Judge, found: Candidate, config: ArticulateConfig, stays: float = 0.0,
                 ) -> Labels:
    """Return surfel labels [N0 + N1] under the joints.

    Args:
        judge: of the study.
        found: joints of parts 1..K, and labels to start from.
        config: identity = what nothing shows goes to the nearest proven part, else every surfel
            to the motion that lands it best; in paper mode eq. 4 as printed follows.
        stays: diagonals by which a part must be nearer than the base to what nothing shows.
    """
    if config.identity and not config.paper_mode:
        return claim(judge.study, judge.lands, found, stays)
    costs = landing_costs(judge, [j.state1_from_0 for j in found.motions])
    if not config.identity:
        return costs.argmin(1)
    study = judge.study
    probs = part_probs(study, replace(found, labels=costs.argmin(1)), config)
    near = [np.asarray(cKDTree(study.gaussians[s].means).query(study.surfels[s].points)[1])
            for s in (0, 1)]
    return np.concatenate([probs[s].argmax(1)[near[s]] for s in (0, 1)])


def final_labels(judge: Judge, end: Candidate, config: ArticulateConfig) -> Labels:
    """Return surfel labels [N0 + N1] under joints that are final.

    What nothing shows is claimed from labels as they were judged. Arguments as of `labels_under`.
    """
    # Only now: used while joints were still aligned, `STAYS` cost one scene a door.
    if config.identity and not config.paper_mode:
        end = judge.judge(replace(end, judged=None))
    return labels_under(judge, end, config, STAYS)


def identity_labels(judge: Judge, found: Candidate, config: ArticulateConfig,
                    ) -> tuple[Labels, Labels]:
    """Return per state [N_s] the most likely part of every Gaussian under the joints.

    Args:
        judge: of the study.
        found: joints of parts 1..K on the base, and surfel labels to start from.
        config: as of `labels_under`.
    """
    hard = labels_under(judge, found, config)
    zero, one = part_probs(judge.study, replace(found, labels=hard), config)
    return np.asarray(zero.argmax(1), np.int64), np.asarray(one.argmax(1), np.int64)


def landing_costs(judge: Judge, moves: list[F64]) -> F64:
    """Return [N0 + N1, K+1] how badly every motion lands every surfel; column 0 = static."""
    unary = _landing(judge, moves)
    return unary.cost(np.ones_like(unary.match))


def _landing(judge: Judge, moves: list[F64]) -> Unary:
    study = judge.study
    return unary_costs([np.eye(4), *moves], study.surfels, judge.lands, study.tau)


def part_probs(study: Study, found: Candidate, config: ArticulateConfig) -> tuple[F32, F32]:
    """Return [N_s, K+1] part identities of the Gaussians of both states.

    Evidence is the labels of the surfels around, of which bonds and reach have had their say: what
    surfels cost where they land (tried) undid that. Where no surfel is near, neighbours decide.

    Args:
        study: both states.
        found: joints of parts 1..K, and labels of the surfels.
        config: identity (off: labels as they are) and paper mode.
    """
    if not config.identity:
        eye = np.eye(len(found) + 1, dtype=np.float32)
        labels = study.gaussian_labels(found.labels)
        return eye[labels[0]], eye[labels[1]]
    settings = PAPER if config.paper_mode else IdentityConfig()
    zero, one = (settings.unary_cap * against
                 for against in study.against(found.labels, len(found) + 1))
    return refine_identities(zero, one, study.gaussians, found.motions, settings, found.parents)
