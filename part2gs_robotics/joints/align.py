"""Alignment: the joints' few parameters against the images, Gaussians frozen, second order.

Gaussians that move together with the joint absorb its error, so the joint is solved on its own:
every view gives a linear equation between image difference and joint parameters (direct image
alignment), and all views together one small Gauss-Newton system per part.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from part2gs_robotics.evidence.cross_render import both_cost, move_gaussians
from part2gs_robotics.evidence.part_edges import Clues
from part2gs_robotics.joints.drawn_to_edges import DRAWN, FARTHER, squared, turned
from part2gs_robotics.joints.sigma import Patches, observed_directions, with_sigma
from part2gs_robotics.joints.solver import (
    Mixing,
    Pose,
    System,
    at,
    bread,
    damping_of,
    solved,
    summed,
    weighed,
    weights_of,
)
from part2gs_robotics.joints.view import Level, add_view, reach_of
from part2gs_robotics.model.arrays import F64, Labels
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.small_views import SmallViews
from part2gs_robotics.render.dispatch import Near, render
from part2gs_robotics.render.project import ALPHA_MIN
from part2gs_robotics.runtime.buffers import Workspace
from part2gs_robotics.runtime.side_by_side import side_by_side

logger = logging.getLogger(__name__)


COARSE = (Level(2.5, 0.10, 3), Level(1.5, 0.08, 3))  # each step halves the error or more
# Narrow and strict, as shading pulls on wide ones; 0.02 or half a pixel's blur: less than 0.02 deg.
FINE = (Level(1.0, 0.06, 5), Level(0.7, 0.03, 8))
STILL = 5e-5  # rad or diagonals: a step shorter than 0.003 deg ends a level
TELLING = 8  # views per state that tell whether a curvature is one of the images
PROBE = 1e-3  # rad or diagonals: a tenth of a pixel, well above rounding
# Of the image cost: 20 joints rightly drawn to edges cost 0.23 % at most by it, wrong ones 1.1 up.
LEAST_GAIN = 0.01


@dataclass(frozen=True)
class AlignmentProblem:
    """What joints are aligned to.

    Attributes:
        gaussians: of both states.
        labels: per state, [N_s] part of every Gaussian, 0 = base.
        views: images of both states.
        diag: diagonal of the object in scene units.
    """

    gaussians: tuple[Gaussians, Gaussians]
    labels: tuple[Labels, Labels]
    views: tuple[SmallViews, SmallViews]
    diag: float
    _costs: dict[bytes, float] = field(default_factory=dict, init=False)  # of motions, known so far

    def cost(self, joints: Sequence[Joint]) -> float:
        """Return the image cost of joints, in both directions alike."""
        moves = [np.eye(4), *(j.state1_from_0 for j in joints)]
        key = np.stack(moves).tobytes()
        if key not in self._costs:
            self._costs[key] = both_cost(self.gaussians, self.labels, moves, self.views, (0.5, 0.5))
        return self._costs[key]


def align(problem: AlignmentProblem, joints: Sequence[Joint],
          levels: tuple[Level, ...] = (*COARSE, *FINE), deviations: bool = True,
          clues: Clues | None = None) -> list[Joint]:
    """Return the joints after direct alignment against both states' views.

    Args:
        problem: Gaussians, their parts, and photos.
        joints: of parts 1..K, carriers' motions within.
        levels: widths, one after the other; late ones suffice for joints that are nearly right.
        deviations: whether to estimate standard deviations; no need where joints change again.
        clues: faces and edges that joints are drawn to, as far as the images leave them free; a
            joint that looks clearly worse by it stays as the images alone have it.
    """
    joints = list(joints)
    for level in levels:
        poses = [at(j, problem.diag) for j in joints]
        mixing = [Mixing() for _ in joints]
        for _ in range(level.steps):
            pairs = _systems(problem, poses, level)
            plain = [solved(weighed(*pair)) for pair in pairs]
            poses = [pose.moved(m.step(pose.offset, step))
                     for pose, m, step in zip(poses, mixing, plain, strict=True)]
            if max((float(np.abs(step).max()) for step in plain), default=0.0) < STILL:
                break
        joints = [pose.joint for pose in poses]
    if not deviations:
        return joints
    known = _with_deviations(problem, joints, levels[-1])
    return [j for j, _ in known] if clues is None else _drawn(problem, known, clues)


def _drawn(problem: AlignmentProblem, known: list[tuple[Joint, F64]], clues: Clues) -> list[Joint]:
    """Return joints, given with their curvatures, drawn to faces and edges as images allow.

    What lies within the deviations is drawn unless images are clearly against it. Short fits are
    bent by more than the curvature knows: what lies farther is drawn if images like it better.
    """
    diag = problem.diag
    near, far = ([turned(squared(j, h, clues.guides, diag, within), h, edges, diag)
                  for (j, h), edges in zip(known, clues.edges, strict=True)]
                 for within in (DRAWN, FARTHER))
    kept = judged(problem, [j for j, _ in known], near, LEAST_GAIN, "edges and faces")
    bold = [now if np.array_equal(one.axis, two.axis) else two
            for now, one, two in zip(kept, near, far, strict=True)]
    return judged(problem, kept, bold, change="edges farther off")


def with_missing_deviations(problem: AlignmentProblem, joints: list[Joint]) -> list[Joint]:
    """Return the joints of parts 1..K, with standard deviations for those that have none.

    A joint that was kept as it was before an alignment has none yet.
    """
    if not any(np.isnan(j.sigma_axis) for j in joints):
        return joints
    known = _with_deviations(problem, joints, FINE[-1])
    return [new if np.isnan(j.sigma_axis) else j for j, (new, _) in zip(joints, known, strict=True)]


def _with_deviations(problem: AlignmentProblem, joints: list[Joint], level: Level,
                     ) -> list[tuple[Joint, F64]]:
    """Return the joints with standard deviations, each with the [P, P] curvature of its steps."""
    poses = [at(j, problem.diag) for j in joints]
    pairs = _systems(problem, poses, level, patches=True)
    true = _true_curvatures(problem, poses, level)
    return [(_judged_by_curvature(j, *pair, h, problem.diag), weighed(*pair).h)
            for j, pair, h in zip(joints, pairs, true, strict=True)]


def judged(problem: AlignmentProblem, start: Sequence[Joint], end: Sequence[Joint],
           margin: float = 0.0, change: str = "alignment") -> list[Joint]:
    """Return, joint by joint, `end` where the images prefer it to `start`.

    Args:
        problem: Gaussians, their parts, and photos.
        start: joints before.
        end: joints after.
        margin: share of the image cost by which `start` must be better to be kept.
        change: what came between, for the log.
    """
    kept = list(end)
    changed = [k for k, (old, new) in enumerate(zip(start, end, strict=True)) if old is not new]
    best = problem.cost(kept) if changed else 0.0
    for k in changed:
        trial = [*kept[:k], start[k], *kept[k + 1 :]]
        value = problem.cost(trial)
        logger.info("part %d: image cost %.4f after %s, %.4f before", k + 1, best, change, value)
        if value < (1.0 - margin) * best:
            kept, best = trial, value
    return kept


def _judged_by_curvature(
    joint: Joint, one: System, two: System, true: tuple[F64, F64], diag: float
) -> Joint:
    assert one.patches is not None  # asked for
    assert two.patches is not None
    h = weighed(one, two).h
    ways = observed_directions(h, damping_of(h), *true)
    return with_sigma(joint, (one.patches, two.patches), weights_of(one, two), ways, diag)


def _true_curvatures(problem: AlignmentProblem, poses: list[Pose], level: Level,
                     ) -> list[tuple[F64, F64]]:
    """Return [P, P] of every joint: change of the gradient, and the curvature meant to be it.

    A neighbour's texture at a part's rim has slopes that do not follow the part: curvature of the
    equations, none of the images. Some views tell.
    """
    few = replace(problem, views=(_few(problem.views[0]), _few(problem.views[1])))
    pairs = _systems(few, poses, level, patches=True)
    weights = [weights_of(*pair) for pair in pairs]
    change = [np.zeros((len(p.offset),) * 2) for p in poses]
    for i in range(max(map(len, change), default=0)):
        steps = [PROBE * np.eye(max(len(c), i + 1))[i, : len(c)] for c in change]
        there = [p.moved(s) for p, s in zip(poses, steps, strict=True)]
        for k, pair in enumerate(_systems(few, there, level)):
            if i < len(change[k]):
                was, now = (summed(p, weights[k]).g for p in (pairs[k], pair))
                change[k][:, i] = (was - now) / PROBE
    return [(c, bread(pair, w)) for c, pair, w in zip(change, pairs, weights, strict=True)]


def _few(views: SmallViews) -> SmallViews:
    return views.every(max(1, len(views) // TELLING))


def _systems(problem: AlignmentProblem, poses: list[Pose], level: Level, patches: bool = False,
             ) -> list[tuple[System, System]]:
    """Return every part's systems in both directions, with patches where asked for."""

    def into(target: int) -> list[System]:
        labels = problem.labels[1 - target]
        moves = [np.eye(4), *(p.into(target) for p in poses)]
        splats = move_gaussians(problem.gaussians[1 - target], labels, moves)
        systems = [System(np.zeros((n, n)), np.zeros(n)) for n in (len(p.offset) for p in poses)]
        for k, system in enumerate(systems):
            own = splats.means[labels == k + 1]
            system.patches = Patches(own.astype(np.float32)) if patches else None
        drawn = splats.opacities >= ALPHA_MIN
        splats, labels = splats.select(drawn), labels[drawn]
        hot = np.eye(len(poses) + 1, dtype=np.float32)[labels, 1:]
        near = Near(labels > 0, reach_of(level))
        rates, work = [p.rates(target) for p in poses], Workspace()
        for v in range(len(problem.views[target])):
            photo = problem.views[target].photo(v)
            out = render(splats, photo.camera, extra=hot, workspace=work, near=near)
            add_view(systems, rates, out, photo, poses[0].diag, level)
        return systems

    return list(zip(*side_by_side([partial(into, 0), partial(into, 1)]), strict=True))
