"""Alignment: the joints' few parameters against the images, Gaussians frozen, second order.

Gaussians that move together with the joint absorb its error, so the joint is solved on its own:
every view gives a linear equation between image difference and joint parameters (direct image
alignment), and all views together one small Gauss-Newton system per part.
"""

from __future__ import annotations

import logging

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics import se3
from part2gs_robotics.align_pixels import CHANNELS, CHUNKS, slopes, sums
from part2gs_robotics.align_sigma import Patches, observed_directions, with_sigma
from part2gs_robotics.align_system import System, damping_of, solved, summed, weighed, weights_of
from part2gs_robotics.cross_render import both_cost, move_gaussians
from part2gs_robotics.gaussians import Gaussians
from part2gs_robotics.joint_fit import move_of, parameters, perturbed
from part2gs_robotics.joints import Joint
from part2gs_robotics.render import render
from part2gs_robotics.small_views import SmallViews
from part2gs_robotics.workspace import Workspace

logger = logging.getLogger(__name__)
F64 = NDArray[np.float64]
F32 = NDArray[np.float32]
BLURS = (2.5, 1.5, 1.0, 0.7)  # pixels: wide catches large errors, narrow decides
STEPS = 3  # per blur; each halves the error or more
ROBUST = (0.10, 0.08, 0.05, 0.03)  # per blur: colour difference at which a pixel counts a quarter
ALPHA_GAIN = 0.6  # silhouettes beside colours: no shading error, but mask edges of half a pixel
MIN_OWN = 0.35  # share of a pixel a part must have to speak for it
OCCLUSION = (
    0.01  # of the diagonal: something this much nearer moves the edge, not the part behind it
)
TELLING = 8  # views per state that tell whether a curvature is one of the images
PROBE = 1e-3  # rad or diagonals: a tenth of a pixel, well above rounding


def align(
    gaussians: tuple[Gaussians, Gaussians],
    labels: tuple[NDArray[np.int64], NDArray[np.int64]],
    joints: list[Joint],
    views: tuple[SmallViews, SmallViews],
    diag: float,
    first_blur: int = 0,
    deviations: bool = True,
) -> list[Joint]:
    """Return the joints after direct alignment against both states' views.

    Args:
        gaussians: of both states.
        labels: [N_s] part of every Gaussian, 0 = base.
        joints: of parts 1..K, all relative to the base.
        views: images of both states.
        diag: diagonal of the object in scene units.
        first_blur: of BLURS; later ones suffice for joints that are nearly right.
        deviations: whether to estimate standard deviations; no need where joints change again.
    """
    for blur in BLURS[first_blur:]:
        for _ in range(STEPS):
            pairs = _systems(gaussians, labels, joints, views, diag, blur)
            systems = [weighed(*pair) for pair in pairs]
            joints = [perturbed(j, solved(s), diag) for j, s in zip(joints, systems, strict=True)]
    if not deviations:
        return joints
    pairs = _systems(gaussians, labels, joints, views, diag, BLURS[-1], patches=True)
    true = _true_curvatures(gaussians, labels, joints, views, diag)
    return [
        _judged_by_curvature(j, *pair, h, diag)
        for j, pair, h in zip(joints, pairs, true, strict=True)
    ]


def judged(
    gaussians: tuple[Gaussians, Gaussians],
    labels: tuple[NDArray[np.int64], NDArray[np.int64]],
    start: list[Joint],
    end: list[Joint],
    views: tuple[SmallViews, SmallViews],
) -> list[Joint]:
    """Return, joint by joint, `end` where the images prefer it to `start`."""

    def cost(joints: list[Joint]) -> float:
        return both_cost(
            gaussians, labels, [np.eye(4), *(move_of(j) for j in joints)], views, (0.5, 0.5)
        )

    kept = list(end)
    best = cost(kept)
    for k, old in enumerate(start):
        trial = [*kept[:k], old, *kept[k + 1 :]]
        value = cost(trial)
        logger.info("part %d: image cost %.4f after, %.4f before", k + 1, best, value)
        if value < best:
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
    joints: list[Joint],
    views: tuple[SmallViews, SmallViews],
    diag: float,
) -> list[tuple[F64, F64]]:
    """Return [P, P] of every joint: change of the gradient, and the curvature meant to be it.

    A neighbour's texture at a part's rim has slopes that do not follow the part: curvature of the
    equations, none of the images. Some views tell.
    """
    few = _few(views[0]), _few(views[1])
    pairs = _systems(gaussians, labels, joints, few, diag, BLURS[-1])
    weights = [weights_of(*pair) for pair in pairs]
    change = [np.zeros((len(parameters(j)),) * 2) for j in joints]
    for i in range(max(map(len, change), default=0)):
        steps = [PROBE * np.eye(max(len(c), i + 1))[i, : len(c)] for c in change]
        there = [perturbed(j, s, diag) for j, s in zip(joints, steps, strict=True)]
        for k, pair in enumerate(_systems(gaussians, labels, there, few, diag, BLURS[-1])):
            if i < len(change[k]):
                was, now = (summed(p, weights[k]).g for p in (pairs[k], pair))
                change[k][:, i] = (was - now) / PROBE
    return [
        (c, summed(pair, w).h) for c, pair, w in zip(change, pairs, weights, strict=True)
    ]


def _few(views: SmallViews) -> SmallViews:
    s = slice(None, None, max(1, len(views.colors) // TELLING))
    return SmallViews(views.colors[s], views.alphas[s], views.Ks[s], views.viewmats[s])


def _systems(
    gaussians: tuple[Gaussians, Gaussians],
    labels: tuple[NDArray[np.int64], NDArray[np.int64]],
    joints: list[Joint],
    views: tuple[SmallViews, SmallViews],
    diag: float,
    blur: float,
    patches: bool = False,
) -> list[tuple[System, System]]:
    """Return every part's systems in both directions, with patches for the last one."""
    sizes = [len(parameters(j)) for j in joints]
    both = []
    for target in (0, 1):
        systems = [System(np.zeros((n, n)), np.zeros(n)) for n in sizes]
        source = 1 - target
        moves = [np.eye(4), *(_into(j, target) for j in joints)]
        means, quats = move_gaussians(gaussians[source], labels[source], moves)
        rates = [_rates(j, target, diag) for j in joints]
        for k, system in enumerate(systems):
            system.patches = Patches(means[labels[source] == k + 1]) if patches else None
        hot = np.eye(len(joints) + 1, dtype=np.float32)[labels[source]]
        g = gaussians[source]
        small, work = views[target], Workspace()
        arrays = means, quats, g.scales, g.opacities, g.colors
        for v in range(len(small.colors)):
            height, width = small.alphas[v].shape
            camera = small.viewmats[v], small.Ks[v], width, height
            out = render(*arrays, *camera, extra=hot, workspace=work)
            _add_view(
                systems, rates, out.color, out.alpha, out.depth, out.extra, small, v, diag, blur
            )
        both.append(systems)
    return list(zip(*both, strict=True))


def _into(joint: Joint, target: int) -> F64:
    move = move_of(joint)
    return move if target else se3.inverse(move)


def _rates(joint: Joint, target: int, diag: float) -> F64:
    """Return [P, 4, 4]: velocity of a point of the target state per unit of each parameter."""
    base = _into(joint, target)
    step = 1e-5
    count = len(parameters(joint))
    return np.stack(
        [
            (_into(perturbed(joint, step * np.eye(count)[i], diag), target) - base)
            @ se3.inverse(base)
            / step
            for i in range(count)
        ]
    )


def _add_view(
    systems: list[System],
    rates: list[F64],
    color: F32,
    alpha: F32,
    depth: F32,
    share: F32,
    small: SmallViews,
    v: int,
    diag: float,
    blur: float,
) -> None:
    def soft(image: F32) -> F32:
        return cv2.GaussianBlur(image, (0, 0), blur)

    drawn = soft(cv2.merge([color, ALPHA_GAIN * alpha]))
    photo = soft(cv2.merge([small.colors[v], ALPHA_GAIN * small.alphas[v]]))
    across = 0.5 * (np.roll(drawn, -1, 1) - np.roll(drawn, 1, 1))
    down = 0.5 * (np.roll(drawn, -1, 0) - np.roll(drawn, 1, 0))
    z = np.where(alpha > 0.05, depth / np.maximum(alpha, 0.05), 0.0).astype(np.float32)
    cover = soft(alpha)
    for k, system in enumerate(systems):
        own = soft(np.ascontiguousarray(share[..., k + 1])) / np.maximum(cover, 0.02)
        pixels = (own > MIN_OWN) & (cover > 0.1) & ~_hidden_edge(z, share[..., k + 1], diag)
        pixels[:2] = pixels[-2:] = pixels[:, :2] = pixels[:, -2:] = False
        part_z = _spread_depth(z, share[..., k + 1])
        pixels &= part_z > 0
        if pixels.sum() > 20:
            _add_pixels(
                system,
                rates[k],
                np.nonzero(pixels),
                part_z,
                (across, down),
                photo - drawn,
                own.astype(np.float32),
                small,
                v,
                ROBUST[BLURS.index(blur)],
            )


def _spread_depth(z: F32, own: F32) -> F32:
    """Depth of the part, carried a few pixels over its rim where the blurred edge lies."""
    inside = np.where((own > 0.5) & (z > 0), z, 0).astype(np.float32)
    weight = (inside > 0).astype(np.float32)
    return cv2.blur(inside, (7, 7)) / np.maximum(cv2.blur(weight, (7, 7)), 1e-6)


def _hidden_edge(z: F32, own: F32, diag: float) -> NDArray[np.bool_]:
    other = np.where((z > 0) & (own < 0.5), z, np.float32(1e9)).astype(np.float32)
    nearest_other = cv2.erode(other, np.ones((5, 5), np.uint8))
    return np.asarray((own >= 0.2) & (nearest_other < z - OCCLUSION * diag))


def _add_pixels(
    system: System,
    rates: F64,
    index: tuple[NDArray[np.intp], ...],
    z: F32,
    gradients: tuple[F32, F32],
    difference: F32,
    own: F32,
    small: SmallViews,
    v: int,
    robust: float,
) -> None:
    rows, cols = index
    jac = np.zeros((len(rows), CHANNELS, len(rates)))
    slopes(rows, cols, z, *gradients, own, rates, small.Ks[v], small.viewmats[v], jac)
    residual = difference[index].astype(np.float64)
    # Light is fixed in the world: a turned face changes brightness as a whole, which is no motion.
    residual[:, :3] -= np.median(residual[:, :3], 0)
    jac[:, :3] -= jac[:, :3].mean(0)
    if system.patches is not None:
        camera = small.Ks[v], small.viewmats[v]
        system.patches.add(rows, cols, z, gradients, own, rates, camera, residual, robust)
    h, g = np.zeros((CHUNKS, *system.h.shape)), np.zeros((CHUNKS, *system.g.shape))
    error, count = np.zeros(CHUNKS), np.zeros(CHUNKS)
    sums(jac, residual, robust, h, g, error, count)
    system.h += h.sum(0)
    system.g += g.sum(0)
    system.error += float(error.sum())
    system.count += float(count.sum())
