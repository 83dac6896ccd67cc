"""Alignment: the joints' few parameters against the images, Gaussians frozen, second order.

Gaussians that move together with the joint absorb its error, so the joint is solved on its own:
every view gives a linear equation between image difference and joint parameters (direct image
alignment), and all views together one small Gauss-Newton system per part.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.decide.cross_render import both_cost, move_gaussians
from part2gs_robotics.evidence.part_edges import Clues
from part2gs_robotics.joints.align_steps import Mixing, Pose, at
from part2gs_robotics.joints.align_system import (
    System,
    bread,
    damping_of,
    solved,
    summed,
    weighed,
    weights_of,
)
from part2gs_robotics.joints.drawn_to_edges import DRAWN, FARTHER, squared, turned
from part2gs_robotics.joints.sigma import Patches, observed_directions, with_sigma
from part2gs_robotics.joints.view import add_view
from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint, move_of
from part2gs_robotics.model.small_views import SmallViews
from part2gs_robotics.render.dispatch import render
from part2gs_robotics.runtime.buffers import Workspace
from part2gs_robotics.runtime.side_by_side import side_by_side

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Level:
    """One width of an alignment.

    Attributes:
        blur: of the images, pixels: wide catches large errors, narrow decides.
        robust: colour difference at which a pixel counts a quarter.
        steps: at most.
    """

    blur: float
    robust: float
    steps: int


COARSE = (Level(2.5, 0.10, 3), Level(1.5, 0.08, 3))  # each step halves the error or more
# Narrow and strict decide: shading and neighbours pull on what a wide one lets speak. 0.02 or half
# a pixel's blur change joints by less than 0.02 deg.
FINE = (Level(1.0, 0.06, 5), Level(0.7, 0.03, 8))
STILL = 5e-5  # rad or diagonals: a step shorter than 0.003 deg ends a level
TELLING = 8  # views per state that tell whether a curvature is one of the images
PROBE = 1e-3  # rad or diagonals: a tenth of a pixel, well above rounding
# Of the image cost: less is what two views' noise changes. Twenty joints rightly drawn to edges, by
# 0.02 to 0.4 deg, cost at most 0.23 % by it, two wrongly drawn 1.1 and 4.1 %.
LEAST_GAIN = 0.01


def align(
    gaussians: tuple[Gaussians, Gaussians],
    labels: tuple[NDArray[np.int64], NDArray[np.int64]],
    joints: list[Joint],
    views: tuple[SmallViews, SmallViews],
    diag: float,
    levels: tuple[Level, ...] = (*COARSE, *FINE),
    deviations: bool = True,
    clues: Clues | None = None,
) -> list[Joint]:
    """Return the joints after direct alignment against both states' views.

    Args:
        gaussians: of both states.
        labels: [N_s] part of every Gaussian, 0 = base.
        joints: of parts 1..K, all relative to the base.
        views: images of both states.
        diag: diagonal of the object in scene units.
        levels: widths, one after the other; late ones suffice for joints that are nearly right.
        deviations: whether to estimate standard deviations; no need where joints change again.
        clues: faces and edges that joints are drawn to, as far as the images leave them free; a
            joint that looks clearly worse by it stays as the images alone have it.
    """
    for level in levels:
        poses = [at(j, diag) for j in joints]
        mixing = [Mixing() for _ in joints]
        for _ in range(level.steps):
            pairs = _systems(gaussians, labels, poses, views, level)
            plain = [solved(weighed(*pair)) for pair in pairs]
            poses = [pose.moved(m.step(pose.offset, step))
                     for pose, m, step in zip(poses, mixing, plain, strict=True)]
            if max((float(np.abs(step).max()) for step in plain), default=0.0) < STILL:
                break
        joints = [pose.joint for pose in poses]
    if not deviations:
        return joints
    known = _with_deviations(gaussians, labels, joints, views, diag, levels[-1])
    if clues is None:
        return [j for j, _ in known]
    return _drawn(gaussians, labels, known, views, diag, clues)


def _drawn(
    gaussians: tuple[Gaussians, Gaussians],
    labels: tuple[NDArray[np.int64], NDArray[np.int64]],
    known: list[tuple[Joint, F64]],
    views: tuple[SmallViews, SmallViews],
    diag: float,
    clues: Clues,
) -> list[Joint]:
    """Return joints, given with their curvatures, drawn to faces and edges as images allow.

    What lies within the deviations is drawn unless images are clearly against it. Short fits are
    bent by more than the curvature knows: what lies farther is drawn if images like it better.
    """
    near, far = ([turned(squared(j, h, clues.guides, diag, within), h, edges, diag)
                  for (j, h), edges in zip(known, clues.edges, strict=True)]
                 for within in (DRAWN, FARTHER))
    kept = judged(gaussians, labels, [j for j, _ in known], near, views, LEAST_GAIN,
                  "edges and faces")
    bold = [now if np.array_equal(one.axis, two.axis) else two
            for now, one, two in zip(kept, near, far, strict=True)]
    return judged(gaussians, labels, kept, bold, views, change="edges farther off")


def with_missing_deviations(
    gaussians: tuple[Gaussians, Gaussians],
    labels: tuple[NDArray[np.int64], NDArray[np.int64]],
    joints: list[Joint],
    views: tuple[SmallViews, SmallViews],
    diag: float,
) -> list[Joint]:
    """Return the joints, with standard deviations for those that have none.

    A joint that was kept as it was before an alignment has none yet.

    Args:
        gaussians: of both states.
        labels: [N_s] part of every Gaussian.
        joints: of parts 1..K.
        views: images of both states.
        diag: diagonal of the object in scene units.
    """
    if not any(np.isnan(j.sigma_axis) for j in joints):
        return joints
    known = _with_deviations(gaussians, labels, joints, views, diag, FINE[-1])
    return [new if np.isnan(j.sigma_axis) else j for j, (new, _) in zip(joints, known, strict=True)]


def _with_deviations(
    gaussians: tuple[Gaussians, Gaussians],
    labels: tuple[NDArray[np.int64], NDArray[np.int64]],
    joints: list[Joint],
    views: tuple[SmallViews, SmallViews],
    diag: float,
    level: Level,
) -> list[tuple[Joint, F64]]:
    """Return the joints with standard deviations, each with the [P, P] curvature of its steps."""
    poses = [at(j, diag) for j in joints]
    pairs = _systems(gaussians, labels, poses, views, level, patches=True)
    true = _true_curvatures(gaussians, labels, poses, views, level)
    return [(_judged_by_curvature(j, *pair, h, diag), weighed(*pair).h)
            for j, pair, h in zip(joints, pairs, true, strict=True)]


def judged(
    gaussians: tuple[Gaussians, Gaussians],
    labels: tuple[NDArray[np.int64], NDArray[np.int64]],
    start: list[Joint],
    end: list[Joint],
    views: tuple[SmallViews, SmallViews],
    margin: float = 0.0,
    change: str = "alignment",
) -> list[Joint]:
    """Return, joint by joint, `end` where the images prefer it to `start`.

    Args:
        gaussians: of both states.
        labels: [N_s] part of every Gaussian.
        start: joints before.
        end: joints after.
        views: images of both states.
        margin: share of the image cost by which `start` must be better to be kept.
        change: what came between, for the log.
    """

    def cost(joints: list[Joint]) -> float:
        return both_cost(
            gaussians, labels, [np.eye(4), *(move_of(j) for j in joints)], views, (0.5, 0.5)
        )

    kept = list(end)
    changed = [k for k, (old, new) in enumerate(zip(start, end, strict=True)) if old is not new]
    best = cost(kept) if changed else 0.0
    for k in changed:
        old = start[k]
        trial = [*kept[:k], old, *kept[k + 1 :]]
        value = cost(trial)
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


def _true_curvatures(
    gaussians: tuple[Gaussians, Gaussians],
    labels: tuple[NDArray[np.int64], NDArray[np.int64]],
    poses: list[Pose],
    views: tuple[SmallViews, SmallViews],
    level: Level,
) -> list[tuple[F64, F64]]:
    """Return [P, P] of every joint: change of the gradient, and the curvature meant to be it.

    A neighbour's texture at a part's rim has slopes that do not follow the part: curvature of the
    equations, none of the images. Some views tell.
    """
    few = _few(views[0]), _few(views[1])
    pairs = _systems(gaussians, labels, poses, few, level, patches=True)
    weights = [weights_of(*pair) for pair in pairs]
    change = [np.zeros((len(p.offset),) * 2) for p in poses]
    for i in range(max(map(len, change), default=0)):
        steps = [PROBE * np.eye(max(len(c), i + 1))[i, : len(c)] for c in change]
        there = [p.moved(s) for p, s in zip(poses, steps, strict=True)]
        for k, pair in enumerate(_systems(gaussians, labels, there, few, level)):
            if i < len(change[k]):
                was, now = (summed(p, weights[k]).g for p in (pairs[k], pair))
                change[k][:, i] = (was - now) / PROBE
    return [(c, bread(pair, w)) for c, pair, w in zip(change, pairs, weights, strict=True)]


def _few(views: SmallViews) -> SmallViews:
    return views.every(max(1, len(views.colors) // TELLING))


def _systems(
    gaussians: tuple[Gaussians, Gaussians],
    labels: tuple[NDArray[np.int64], NDArray[np.int64]],
    poses: list[Pose],
    views: tuple[SmallViews, SmallViews],
    level: Level,
    patches: bool = False,
) -> list[tuple[System, System]]:
    """Return every part's systems in both directions, with patches where asked for."""

    def into(target: int) -> list[System]:
        source, g = 1 - target, gaussians[1 - target]
        moves = [np.eye(4), *(p.into(target) for p in poses)]
        means, quats = move_gaussians(g, labels[source], moves)
        systems = [System(np.zeros((n, n)), np.zeros(n)) for n in (len(p.offset) for p in poses)]
        for k, system in enumerate(systems):
            system.patches = Patches(means[labels[source] == k + 1]) if patches else None
        hot = np.eye(len(poses) + 1, dtype=np.float32)[labels[source]]
        arrays = means, quats, g.scales, g.opacities, g.colors
        _add_views(systems, [p.rates(target) for p in poses], arrays, hot, views[target],
                   poses[0].diag, level)
        return systems

    return list(zip(*side_by_side([partial(into, 0), partial(into, 1)]), strict=True))


def _add_views(systems: list[System], rates: list[F64], arrays: tuple[F32, ...], hot: F32,
               small: SmallViews, diag: float, level: Level) -> None:
    """Add all views of one state to the systems; arrays and hot: moved Gaussians, their parts."""
    work = Workspace()
    means, quats, scales, opacities, colors = arrays
    for v in range(len(small.colors)):
        height, width = small.alphas[v].shape
        out = render(means, quats, scales, opacities, colors, small.viewmats[v], small.Ks[v],
                     width, height, extra=hot, workspace=work)
        add_view(systems, rates, out, small, v, diag, level.blur, level.robust)
