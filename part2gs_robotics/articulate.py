"""Motion: which Gaussian belongs to which part, and how every part moves.

Evidence first (what left, what arrived), then a hypothesis search, then the images of both states
decide how many parts there are, and at last every joint is aligned to the images on its own.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.config import ArticulateConfig, SearchConfig
from part2gs_robotics.errors import FitError
from part2gs_robotics.gaussians import Gaussians
from part2gs_robotics.joints import Joint
from part2gs_robotics.scene import Scene

if TYPE_CHECKING:
    from part2gs_robotics.judge import Verdict
    from part2gs_robotics.motion_search import Hypothesis
    from part2gs_robotics.study import Study

logger = logging.getLogger(__name__)
SHARE_0 = 8 / 22  # of the patches in state 0: the open state shows more of what moved
POOL_PRICE = 0.004  # of the evidence: what a hypothesis must explain to enter the competition
POOL_TOP = 12  # hypotheses that are also tried on the object's own directions
MIN_EVIDENCE = 0.004  # of all surfels: less is noise, nothing moved


@dataclass(frozen=True)
class Motion:
    """Result of the articulation room.

    Attributes:
        part_probs: per state, [N_s, K+1] float32 part identity of every Gaussian; column 0 = base.
        joints: K joints, of parts 1..K.
        parents: K parent part indices (0 = base).
        diagnostics: per moving part, losses and residuals by name.
        notes: decisions worth reporting.
    """

    part_probs: tuple[NDArray[np.float32], NDArray[np.float32]]
    joints: tuple[Joint, ...]
    parents: tuple[int, ...]
    diagnostics: tuple[dict[str, float], ...] = ()
    notes: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)

    def labels(self, state: int) -> NDArray[np.int64]:
        """Return [N_s] the most likely part of every Gaussian of a state."""
        return np.asarray(self.part_probs[state].argmax(1), np.int64)


def without_part(motion: Motion, part: int, note: str) -> Motion:
    """Return the motion without a part that carries none; what it had goes to its carrier.

    Args:
        motion: with the part.
        part: 1..K.
        note: why, worth reporting.
    """
    keep = [k for k in range(len(motion.joints)) if k != part - 1]
    probs = []
    for old in motion.part_probs:
        new = np.delete(old, part, axis=1)
        parent = motion.parents[part - 1]
        new[:, parent - (parent > part)] += old[:, part]
        probs.append(new)
    return replace(
        motion, part_probs=(probs[0], probs[1]), joints=tuple(motion.joints[k] for k in keep),
        parents=tuple(p - (p > part) for p in (motion.parents[k] for k in keep)),
        diagnostics=tuple(d for k, d in enumerate(motion.diagnostics) if k != part - 1),
        notes=(*motion.notes, note))


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
    from part2gs_robotics.study import gather

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
    pool = _pool(study, np.random.default_rng(config.seed), moved, search)
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


def _pool(
    study: Study, rng: np.random.Generator, moved: int, search: SearchConfig
) -> list[Hypothesis]:
    from part2gs_robotics.motion_select import choose, propose
    from part2gs_robotics.motion_snap import distinct, slide_families, snapped

    first = round(SHARE_0 * search.patches)
    seeds = first, search.patches - first
    found = propose(study.evidence, study.lands, study.box, seeds, rng, search.patch_points,
                    study.straight.directions)
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


def _decide(
    study: Study, pool: list[Hypothesis], parts: int | None, scene: Scene, swap: bool = True
) -> Verdict:
    from part2gs_robotics.decide import decide

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
    from part2gs_robotics.align import judged
    from part2gs_robotics.judge import Judge
    from part2gs_robotics.nested import nest
    from part2gs_robotics.part_labels import labels_under, part_probs, start_labels
    from part2gs_robotics.part_tree import flat
    from part2gs_robotics.physics_terms import part_diagnostics, physical_steps
    from part2gs_robotics.prune import joint_of, unpaid
    from part2gs_robotics.reach import STAYS
    from part2gs_robotics.small_views import both_small

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
