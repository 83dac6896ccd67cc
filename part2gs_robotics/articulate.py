"""Articulation: which Gaussian belongs to which part, and how every part moves.

Evidence first (what left, what arrived), then a search for motions, then the images of both states
decide how many parts there are, and at last every joint is aligned to the images on its own.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from part2gs_robotics.config import ArticulateConfig, SearchConfig
from part2gs_robotics.decide.candidate import PART, Candidate, on_base
from part2gs_robotics.decide.grow import decide, lowered, neared
from part2gs_robotics.decide.hang import hang
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.decide.leave_out import joint_of, kinds_chosen, least, saved, thinned
from part2gs_robotics.errors import FitError
from part2gs_robotics.evidence.canonical import Canonical
from part2gs_robotics.evidence.study import Study, gather
from part2gs_robotics.joints.align import judged
from part2gs_robotics.joints.labels import final_labels, labels_under, part_probs, start_labels
from part2gs_robotics.joints.settle import (
    Photos,
    Views,
    aligned,
    finely,
    moved,
    nearly,
    problem_of,
    settle,
)
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.motion import Motion
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.model.small_views import both_small
from part2gs_robotics.paper.pull import part_diagnostics, physical_steps
from part2gs_robotics.search.pool import find_more, find_pool, in_its_light

logger = logging.getLogger(__name__)
MIN_EVIDENCE = 0.004  # of all surfels: less is noise, nothing moved
Progress = Callable[[int, int, float], None]  # step, steps, number of parts
Align = Callable[[Judge, Candidate, Views], Candidate]


@dataclass(frozen=True)
class Found:
    """Motions that were decided on: the first half of the articulation.

    Attributes:
        judge: of the study.
        candidate: the motions.
        pool: motions that were to choose from, for parts that do not stay.
        short: whether one more motion would pay though their number was given.
        clock: seconds of every step so far.
    """

    judge: Judge
    candidate: Candidate
    pool: list[Joint]
    short: bool
    clock: Clock


def articulate(both: Canonical, config: ArticulateConfig, progress: Progress | None = None,
               search: SearchConfig | None = None) -> Motion:
    """Return the moving parts and their joints.

    Args:
        both: states, comparable.
        config: `parts` fixes the number of moving parts, else it is found.
        progress: called as (step, steps, number of parts).
        search: how closely to look; None = the standard preset.

    Raises:
        FitError: nothing moves between the states.
    """
    search = search or SearchConfig()
    return settled_motion(both.scene, found_motions(both, config, progress, search), config, search)


def found_motions(both: Canonical, config: ArticulateConfig, progress: Progress | None = None,
                  search: SearchConfig | None = None) -> Found:
    """Return the motions that were decided on. Arguments and errors as of `articulate`."""
    clock, search = Clock(progress), search or SearchConfig()
    study = gather(both, search)
    moved = _require_moved(study, both.scene)
    clock.tick("evidence", 1)
    study = in_its_light(study, np.random.default_rng(config.seed), moved, search)
    logger.info(study.light.told())
    rng = np.random.default_rng(config.seed)
    judge = Judge(study)
    pool = neared(judge, on_base([]), find_pool(study, rng, moved, search))
    clock.tick("search", 2)
    candidate, short = decide(judge, pool, config.parts,
                              lambda left: find_more(study, left, rng, search))
    _require_parts(candidate, both.scene)
    clock.tick("decision", 3, len(candidate))
    return Found(judge, candidate, pool, short, clock)


class Clock:
    """Seconds of every step, and progress."""

    def __init__(self, progress: Progress | None) -> None:
        self.progress, self.last, self.seconds = progress, time.monotonic(), dict[str, float]()

    def tick(self, name: str, step: int, parts: int = 0) -> None:
        """Note the seconds since the last tick, and tell how far the room is."""
        now = time.monotonic()
        self.seconds[name], self.last = now - self.last, now
        if self.progress:
            self.progress(step, 5, float(parts))


def _require_moved(study: Study, scene: Scene) -> int:
    """Return how many surfels left their place or are new in it; raise where that is noise."""
    moved = len(study.evidence.vacated) + len(study.evidence.arrived)
    total = len(study.surfels[0]) + len(study.surfels[1])
    logger.info("evidence: %d of %d surfels left their place or are new in it", moved, total)
    logger.info("edges: %d straight ones in the photos, %d directions of parallel ones",
                sum(map(len, study.segments)), len(study.straight.directions))
    if moved < MIN_EVIDENCE * total:
        raise FitError(
            f"{scene.path}: only {moved} of {total} surface points moved between the states. "
            f"Expected at least {MIN_EVIDENCE:.1%}. Photograph the object in two "
            "clearly different states."
        )
    return moved


def _require_parts(found: Candidate, scene: Scene) -> None:
    if not found.motions:
        raise FitError(
            f"{scene.path}: no rigid motion explains the difference of the two states. "
            "Expected at least one part that turns or slides; check that both states show the "
            "same object in one frame."
        )


def settled_motion(scene: Scene, found: Found, config: ArticulateConfig,
                   search: SearchConfig | None = None) -> Motion:
    """Return joints and part identities of the motions that were decided on: the second half."""
    judge, clock, search = found.judge, found.clock, search or SearchConfig()
    study = judge.study
    small = both_small(scene.states, search.align_views, search.align_side)
    start, pulled = _pulled(found, config, small)
    kept = [{"physics_kept": float(new is not old)}
            for new, old in zip(pulled.motions, start.motions, strict=True)]
    end = pulled
    if config.alignment and not config.paper_mode:
        sharp = both_small(scene.states, search.align_views, search.sharp_side)
        end = _settled(judge, pulled, Photos(small, sharp), config, found.pool)
    clock.tick("alignment", 4, len(end))
    end = _with_bodies(judge, end, config)
    hard = end.labels
    saves = (math.nan,) * len(end) if config.paper_mode else saved(judge, end)
    probs = part_probs(study, end, config)
    diagnostics, notes = part_diagnostics(study, end.motions, hard, config.paper_mode)
    diagnostics = tuple({**row, **(kept[n - 1] if n else {}), "prices_saved": gap}
                        for row, n, gap in zip(diagnostics, end.known, saves, strict=True))
    clock.tick("identity", 5, len(end))
    alone = tuple(replace(j, carrier=None) for j in end.motions)  # the parents say it from here on
    notes = (*notes, *_about_number(config.parts, len(end), found.short, saves))
    return Motion(probs, alone, end.parents, diagnostics, notes, clock.seconds,
                  shades=tuple(map(float, study.light.shades)))


def _with_bodies(judge: Judge, found: Candidate, config: ArticulateConfig) -> Candidate:
    """Return a candidate with its last labels, without motions that no surfel has.

    Such a motion explains nothing, so the set without it is cheaper by its price.
    """
    hard = final_labels(judge, found, config)
    bare = [k for k in range(len(found)) if not (hard == k + 1).any()
            and k + 1 not in found.parents]
    if not bare or len(found) == 1 or config.parts or config.paper_mode:  # a number was asked for
        return replace(found, labels=hard)
    logger.info("part %d: no surface moves with it once labels are settled; left out", bare[0] + 1)
    return _with_bodies(judge, found.without(bare[0]), config)


def _pulled(found: Found, config: ArticulateConfig, views: Views,
            ) -> tuple[Candidate, Candidate]:
    """Return joints of the motions that were decided on, and pulled by the terms that are on."""
    judge, study = found.judge, found.judge.study
    decided = replace(found.candidate, labels=start_labels(judge, found.candidate, config))
    joints = [joint_of(judge, decided, k) for k in range(len(decided))]
    start = on_base(joints, decided.labels)
    start = replace(start, labels=labels_under(judge, start, config))
    pulled = physical_steps(study, joints, start.labels, config)
    if pulled is not joints and not config.paper_mode:  # the paper refines by its losses alone
        pulled = judged(problem_of(judge, start, views), joints, pulled, change="physics terms")
    return start, start.with_motions(pulled)


def _settled(judge: Judge, found: Candidate, photos: Photos, config: ArticulateConfig,
             pool: Sequence[Joint]) -> Candidate:
    """Return the joints settled, with parts that other parts carry, aligned to the images.

    A part that does not pay once joints are settled is left out, motions of the pool compete for
    its place, and the others settle again.

    Args:
        judge: of the study.
        found: joints of parts on the base, and labels, to start from.
        photos: of both states.
        config: number of moving parts, if known, and seed.
        pool: motions to choose from in the place of parts that do not stay.
    """
    found = settle(judge, found, photos, config)
    if config.parts is None and len(found) > 1:
        left = thinned(judge, judge.judge(found))
        if len(left) < len(found):
            new = kinds_chosen(judge, lowered(judge, left, pool), left)
            found = settle(judge, new, photos, config)
    flat, hung = found, hang(judge, found, config.parts, np.random.default_rng(config.seed))
    found = _on_carriers(judge, (flat, hung), nearly, photos.sharp, config.parts)
    left = found if config.parts else least(judge, judge.judge(found))
    if len(left) < len(found):
        return _paying(judge, aligned(judge, left, photos.sharp), photos)
    if any(found.parents):
        left = _on_carriers(judge, (flat, found), finely, photos.sharp, config.parts)
    return left if config.parts else _paying(judge, left, photos)


def _on_carriers(judge: Judge, found: tuple[Candidate, Candidate], align: Align, sharp: Views,
                 asked: int | None) -> Candidate:
    """Return parts that others carry aligned; where that costs a price more, all on the base.

    Hung on each other, two parts may explain the photos as well as on the base, and photos that
    are looked at again from there may lead both astray.

    Args:
        judge: of the study.
        found: settled on the base, and hung.
        align: to the photos, both carriers and carried.
        sharp: photos of both states.
        asked: number of moving parts, if known: what has fewer is no way out.
    """
    flat, hung = found
    if not any(hung.parents):
        return hung
    was, end = judge.judge(hung), align(judge, hung, sharp)
    cost = moved(judge, was, end).cost
    if cost < was.cost + PART or (asked and len(flat) < len(hung)):
        return end
    logger.info("nested: cost %.4f once aligned, %.4f before: left on the base", cost, was.cost)
    return flat


def _paying(judge: Judge, found: Candidate, photos: Photos) -> Candidate:
    """Return the candidate judged, aligned again without what its last joints do not pay for.

    The last alignment may lead a joint away from what it was decided by.
    """
    found = judge.judge(found)
    left = thinned(judge, found)
    if len(left) == len(found):
        return found
    return _paying(judge, aligned(judge, left, photos.sharp), photos)


def _about_number(asked: int | None, found: int, short: bool, saves: Sequence[float],
                  ) -> list[str]:
    """Return what to say where the number of parts asked for is wrong."""
    notes, idle = [], [k for k, gap in enumerate(saves, 1) if gap <= 0.0]
    if asked and asked != found:
        notes.append(f"--parts asks for {asked} moving parts; only {found} are "
                     "rigid bodies of their own, the others were left out.")
    if asked and found > 1 and idle:
        names = ", ".join(f"part_{k}" for k in idle)
        notes.append(f"--parts asks for {asked} moving parts; {names} would not be found without "
                     "it: the photos gain too little. Leave --parts out to have the number found.")
    if short:
        notes.append(f"--parts asks for {asked} moving parts; one more would explain what now "
                     "looks wrong. Leave --parts out to have the number found.")
    return notes
