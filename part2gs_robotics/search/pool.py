"""The pool: motions that compete to explain what moved."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from part2gs_robotics.config import SearchConfig
from part2gs_robotics.evidence.study import Study
from part2gs_robotics.evidence.surfaces import Evidence
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.search.bodies import propose_bodies
from part2gs_robotics.search.cover import choose, propose, saved_matrix
from part2gs_robotics.search.snap import distinct, slide_families, snapped

logger = logging.getLogger(__name__)

SHARE_0 = 8 / 22  # of the patches in state 0: the open state shows more of what moved
POOL_PRICE = 0.004  # of the evidence: what a hypothesis must explain to enter the competition
POOL_TOP = 12  # hypotheses that are also tried on the object's own directions


LEFT = 3  # times fewer patches where a set of motions has explained most, and to choose a light


def find_more(study: Study, left: Evidence, rng: np.random.Generator, search: SearchConfig,
              ) -> list[Joint]:
    """Return motions that may explain what a set of motions leaves.

    What one part leaves is not seen by a search that ranks patches of all of them together.

    Args:
        study: both states.
        left: surfels of both states that the set does not explain.
        rng: picks patches.
        search: how closely to look.
    """
    count, seen = sum(map(len, left.sets)), study.looking_at(left)
    few = replace(search, patches=max(search.patches // LEFT, 1))
    if not count:
        return []
    small = propose_bodies(seen, rng, search.patch_points)
    return distinct([*find_pool(seen, rng, count, few), *small], study)


def in_its_light(study: Study, rng: np.random.Generator, moved: int, search: SearchConfig,
                 ) -> Study:
    """Return the study, in even light where first motions explain clearly more of what moved in it.

    Dark doors on a light cabinet look like a front in the shade. What turned tells: its paint
    stays the same. Clearly: by as much as one motion must explain.

    Args:
        study: in the light that neighbouring faces tell of.
        rng: picks patches.
        moved: surfels that left their place or are new in theirs.
        search: how closely to look.
    """
    if study.light.even:
        return study
    even = study.under(np.zeros_like(study.light.shades))
    few = find_pool(even, rng, moved, replace(search, patches=max(search.patches // LEFT, 1)))

    def explained(seen: Study) -> float:
        saved = saved_matrix(few, seen.evidence, seen.lands, seen.diag)
        return float(saved.max(0, initial=0.0).sum())

    return even if explained(even) - explained(study) > POOL_PRICE * moved else study


def find_pool(
    study: Study, rng: np.random.Generator, moved: int, search: SearchConfig
) -> list[Joint]:
    """Return the motions that compete, refined, and turned onto the object's directions too."""
    first = round(SHARE_0 * search.patches)
    seeds = first, search.patches - first
    found = propose(study, seeds, rng, search.patch_points)
    ranked = sorted(
        choose(found, study.evidence, study.lands, study.diag, POOL_PRICE * moved),
        key=lambda p: -p[1],
    )
    top = distinct([h for h, _ in ranked][:POOL_TOP], study)
    straight = snapped(top, study, rng)
    families = slide_families([*straight, *top], study, 5 * POOL_PRICE * moved, rng)
    pool = distinct([*top, *families, *straight], study)
    logger.info("search: %d patches' motions, %d compete", len(found), len(pool))
    return pool
