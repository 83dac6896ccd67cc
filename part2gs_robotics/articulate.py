"""Motion: which Gaussian belongs to which part, and how every part moves.

Evidence first (what left, what arrived), then a hypothesis search, then the images of both states
decide how many parts there are, and at last every joint is aligned to the images on its own.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.config import ArticulateConfig, SearchConfig
from part2gs_robotics.errors import FitError
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.motion import Motion
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.search.pool import find_pool

if TYPE_CHECKING:
    from part2gs_robotics.decide.judge import Verdict
    from part2gs_robotics.evidence.study import Study
    from part2gs_robotics.search.hypothesis import Hypothesis

logger = logging.getLogger(__name__)
MIN_EVIDENCE = 0.004  # of all surfels: less is noise, nothing moved


def articulate(
    scene: Scene,
    gaussians: tuple[Gaussians, Gaussians],
    config: ArticulateConfig,
    progress: Callable[[int, int, float], None] | None = None,
    search: SearchConfig | None = None,
) -> Motion:
    """Return the moving parts and their joints.

    Args:
        scene: images of both states.
        gaussians: fitted Gaussians of both states.
        config: `parts` fixes the number of moving parts, else it is found.
        progress: called as (step, steps, number of parts).
        search: how closely to look; None = the standard preset.

    Raises:
        FitError: nothing moves between the states.
    """
    study, verdict, clock = found_motions(scene, gaussians, config, progress, search)
    return settled_motion(scene, study, verdict, config, clock, search)


def found_motions(
    scene: Scene,
    gaussians: tuple[Gaussians, Gaussians],
    config: ArticulateConfig,
    progress: Callable[[int, int, float], None] | None = None,
    search: SearchConfig | None = None,
) -> tuple[Study, Verdict, Clock]:
    """Return the study of both states and the motions that were decided on: the first half."""
    from part2gs_robotics.evidence.study import gather

    clock, search = Clock(progress), search or SearchConfig()
    study = gather(scene, gaussians, search)
    moved = len(study.evidence.vacated) + len(study.evidence.arrived)
    total = len(study.surfels[0]) + len(study.surfels[1])
    logger.info("evidence: %d of %d surfels left their place or are new in it", moved, total)
    logger.info(study.light.told())
    logger.info("edges: %d straight ones in the photos, %d directions of parallel ones",
                sum(map(len, study.segments)), len(study.straight.directions))
    if moved < MIN_EVIDENCE * total:
        raise FitError(
            f"{scene.path}: only {moved} of {total} surface points moved between the states. "
            f"Expected at least {MIN_EVIDENCE:.1%}. Photograph the object in two "
            "clearly different states."
        )
    clock.tick("evidence", 1)
    pool = find_pool(study, np.random.default_rng(config.seed), moved, search)
    clock.tick("search", 2)
    verdict = _decide(study, pool, config.parts, scene, search.swap)
    clock.tick("decision", 3, len(verdict.motions))
    return study, verdict, clock


class Clock:
    """Seconds of every step, and progress."""

    def __init__(self, progress: Callable[[int, int, float], None] | None) -> None:
        self.progress, self.last, self.seconds = progress, time.monotonic(), dict[str, float]()

    def tick(self, name: str, step: int, parts: int = 0) -> None:
        """Note the seconds since the last tick, and tell how far the room is."""
        now = time.monotonic()
        self.seconds[name], self.last = now - self.last, now
        if self.progress:
            self.progress(step, 5, float(parts))


def _decide(
    study: Study, pool: list[Hypothesis], parts: int | None, scene: Scene, swap: bool = True
) -> Verdict:
    from part2gs_robotics.decide.grow import decide

    verdict = decide(study, pool, parts, lambda text: logger.info("decide: %s", text), swap)
    if not verdict.motions:
        raise FitError(
            f"{scene.path}: no rigid motion explains the difference of the two states. "
            "Expected at least one part that turns or slides; check that both states show the "
            "same object in one frame."
        )
    return verdict


def settled_motion(
    scene: Scene, study: Study, verdict: Verdict, config: ArticulateConfig, clock: Clock,
    search: SearchConfig | None = None,
) -> Motion:
    """Return joints and part identities of the motions that were decided on: the second half."""
    from part2gs_robotics.decide.judge import Judge
    from part2gs_robotics.decide.leave_out import joint_of, unpaid
    from part2gs_robotics.joints.align import judged
    from part2gs_robotics.joints.carried import nest
    from part2gs_robotics.joints.claim import STAYS
    from part2gs_robotics.joints.labels import labels_under, part_probs, start_labels
    from part2gs_robotics.joints.tree import flat
    from part2gs_robotics.model.small_views import both_small
    from part2gs_robotics.paper.pull import part_diagnostics, physical_steps

    judge, search = Judge(study), search or SearchConfig()
    verdict = replace(verdict, hard=start_labels(judge, verdict, config))
    start = [joint_of(judge, verdict, k) for k in range(len(verdict.motions))]
    views = both_small(scene.states, search.align_views, search.align_side)
    hard, _ = labels_under(judge, start, verdict.hard, config)
    joints = pulled = physical_steps(study, start, hard, config)
    if pulled is not start and not config.paper_mode:  # the paper refines by its losses alone
        joints = judged(study.gaussians, study.gaussian_labels(hard), start, pulled, views,
                        change="physics terms")
    kept = [{"physics_kept": float(new is not old)} for new, old in zip(joints, start, strict=True)]
    tree = flat(joints, hard)
    if config.alignment and not config.paper_mode:
        sharp = both_small(scene.states, search.align_views, search.sharp_side)
        tree = nest(judge, joints, hard, config, (views, sharp), verdict.pool)
    joints, parents = tree.joints, tree.parents
    idle = unpaid(judge, tree) if config.parts and not config.paper_mode else []
    clock.tick("alignment", 4, len(joints))
    # Only now: used while joints were still aligned, it cost one scene a door.
    hard, costs = labels_under(judge, joints, tree.hard, config, STAYS)
    probs = part_probs(study, joints, costs, hard, config, parents)
    diagnostics, notes = part_diagnostics(study, joints, hard, config.paper_mode)
    diagnostics = tuple({**row, **(kept[n - 1] if n else {})}
                        for row, n in zip(diagnostics, tree.known, strict=True))
    clock.tick("identity", 5, len(joints))
    alone = tuple(replace(j, carrier=None) for j in joints)  # the parents say it from here on
    notes = (*notes, *_about_number(config.parts, len(joints), verdict.short, idle))
    return Motion(probs, alone, parents, diagnostics, notes, clock.seconds)


def _about_number(asked: int | None, found: int, short: bool, idle: list[int]) -> list[str]:
    """Return what to say where the number of parts asked for is wrong."""
    notes = []
    if asked and asked != found:
        notes.append(f"--parts asks for {asked} moving parts; only {found} are "
                     "rigid bodies of their own, the others were left out.")
    if idle:
        names = ", ".join(f"part_{k}" for k in idle)
        notes.append(f"--parts asks for {asked} moving parts; {names} would not be found without "
                     "it: the photos gain too little. Leave --parts out to have the number found.")
    if short:
        notes.append(f"--parts asks for {asked} moving parts; one more would explain what now "
                     "looks wrong. Leave --parts out to have the number found.")
    return notes
