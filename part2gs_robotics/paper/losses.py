"""Physical losses of Part2GS (eq. 6-9): as printed (`paper=True`) and corrected (default).

All are torch, differentiable and finite at coincident points, turns of 0 and 180 deg, and empty
parts. Lengths are scene units, frames are the world; `weights [n, K]` say how much point i
belongs to moving part k (one-hot, or columns 1..K of the part probabilities).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from part2gs_robotics.model.points import tree_of
from part2gs_robotics.paper.repel import NUM_NEAREST, REPEL_EPSILON, REPEL_STRENGTH

SignedDistance = Callable[[Tensor], Tensor]
"""[..., 3] points -> [...] distance to a surface, negative inside."""

EPSILON = 1e-12  # lengths below are one point; far under any scene unit, far above underflow


@dataclass(frozen=True)
class Form:
    """Which form of a loss.

    Attributes:
        paper: as printed; else corrected.
        sigma: robust scale of the corrected form, as the points' lengths.
    """

    paper: bool = False
    sigma: float = 0.01


CORRECTED = Form()


def articulation_loss(
    rotation: Tensor,
    translation: Tensor,
    pairs: tuple[Tensor, Tensor],
    target_rotation: Tensor | None = None,
    rot_weight: float = 0.1,
    form: Form = CORRECTED,
) -> Tensor:
    """Return the alignment of one moved part with its matches (eq. 6), a scalar.

    Paper: mean |R x + t - y|^2 + rot_weight * angle(R, target_rotation). Corrected: Geman-McClure
    on the distance, and 2 (1 - cos angle), equal to angle^2 for small ones and smooth at 0 and pi.

    Args:
        rotation: [3, 3] R_k, state1_from_state0.
        translation: [3].
        pairs: [n, 3] points of part k in state 0, and [n, 3] their matches in state 1.
        target_rotation: [3, 3]; None = best rigid fit of the pairs (the paper names no source).
        rot_weight: lambda_rot; unknown in the paper.
        form: printed or corrected.
    """
    points, targets = pairs
    if target_rotation is None:
        ones = torch.ones(len(points), dtype=points.dtype)
        target_rotation = best_rotation(points, targets, ones)
    squared = (points @ rotation.T + translation - targets).square().sum(-1)
    if form.paper:
        return _mean(squared) + rot_weight * rotation_angle(rotation, target_rotation)
    turn = 3.0 - (rotation * target_rotation).sum()  # = 2 (1 - cos angle): trace = 1 + 2 cos
    return _mean(geman_mcclure(squared, form.sigma)) + rot_weight * turn


def contact_loss(
    points: Tensor,
    static_points: Tensor | None = None,
    sdf: SignedDistance | None = None,
    margin: float = 0.0,
    paper: bool = False,
) -> Tensor:
    """Return how much a moving part enters the static one (eq. 7), a scalar.

    Paper: mean max(0, -cos theta), theta between the directions to the nearest static point and to
    the static centroid; it fires on a drawer with a clean gap and drops for one pushed into the
    wall. Corrected: mean max(0, -margin - sdf)^2 over points and joint values.

    Args:
        points: [n, 3] or [S, n, 3], one slice per joint value (see `moved_points`).
        static_points: [m, 3], paper form only.
        sdf: signed distance of the static part, corrected form only.
        margin: tolerated depth, >= 0.
        paper: True = as printed.
    """
    flat = points.reshape(-1, 3)
    if paper:
        assert static_points is not None, "the printed contact loss compares with static points"
        if len(flat) == 0 or len(static_points) == 0:
            return flat.sum() * 0.0
        nearest = static_points[_nearest(flat, static_points)] - flat
        centroid = static_points.mean(0) - flat
        return torch.relu(-(_unit(nearest) * _unit(centroid)).sum(-1)).mean()
    assert sdf is not None, "the corrected contact loss needs the static part's signed distance"
    return _mean(torch.relu(-margin - sdf(flat)).square())


def repel_loss(
    points: Tensor,
    repels: Tensor,
    voxel: float,
    strength: float = REPEL_STRENGTH,
    num_nearest: int = NUM_NEAREST,
) -> Tensor:
    """Return the energy whose force is the corrected push of eq. 5, a scalar in units^2.

    Mean over the points, and over the nearest repel points of each, of k_r / s where the push
    k_r / s^2 is below half a voxel, a straight line with that slope nearer by. The printed form
    has no loss: it moves single Gaussians, see `repel.repel_forces`.

    Args:
        points: [n, 3] moving part.
        repels: [M, 3] of `repel.repel_points`.
        voxel: resolution of the scene; bounds the push.
        strength: k_r.
        num_nearest: repel points that count for one point.

    Source: Part2GS eq. 5 with the sign turned; minus its gradient is `repel.repel_forces` / n.
    """
    count = min(num_nearest, len(repels))
    if count == 0 or len(points) == 0:
        return points.sum() * 0.0
    tree, kept = tree_of(repels.detach().numpy(), count)
    index = kept[tree.query(points.detach().numpy(), k=count)[1]].reshape(len(points), count)
    squared = (points[:, None] - repels[torch.from_numpy(index)]).square().sum(-1)
    length = (squared + REPEL_EPSILON**2).sqrt()
    steepest = 0.5 * voxel
    near = (strength / steepest) ** 0.5
    line = strength / near + steepest * (near - length)
    return torch.where(length < near, line, strength / length).mean()


def velocity_loss(
    points0: Tensor,
    points1: Tensor,
    weights: Tensor,
    paper: bool = False,
    rotations: Tensor | None = None,
) -> Tensor:
    """Return the sum over parts of the spread of their motion (eq. 8), units^2.

    Paper: variance of the displacement; 4 sin^2(theta/2) w^2/12 for a perfect turn of a door of
    width w. Corrected: variance of what a turn leaves, 0 for every rigid motion that turns so.

    Args:
        points0: [n, 3] in state 0.
        points1: [n, 3] the same points in state 1.
        weights: [n, K].
        paper: True = as printed.
        rotations: [K, 3, 3] turns of the parts, corrected form only; None = best rigid fits, which
            tell how rigidly the points move but pull on no joint.
    """
    total = points0.sum() * 0.0
    for k, part in enumerate(weights.T):
        rotation = torch.eye(3, dtype=points0.dtype)
        if rotations is not None and not paper:
            rotation = rotations[k]
        elif not paper:
            # constant in the gradient: the fit is a minimum, where its derivative vanishes
            rotation = best_rotation(points0, points1, part)
        residual = points1 - points0 @ rotation.T
        share = part / part.sum().clamp_min(EPSILON)
        residual = residual - share @ residual
        total = total + share @ residual.square().sum(-1)
    return total


def vector_field_loss(
    points0: Tensor,
    points1: Tensor,
    rotations: Tensor,
    translations: Tensor,
    weights: Tensor,
    form: Form = CORRECTED,
) -> Tensor:
    """Return how far the joints carry state 0 from state 1 (eq. 9), a scalar.

    Paper: sum_k sum_i w_ik |R_k x_i + t_k - y_i|^2 over given pairs. Corrected: per part, the mean
    Geman-McClure cost, in [0, 1), of the distance to the nearest point of state 1 (one way,
    matched anew at every call), so wrong pairs and unseen places lose their pull.

    Args:
        points0: [n, 3] state 0.
        points1: paper: [n, 3] matches of points0; corrected: [m, 3] the cloud of state 1.
        rotations: [K, 3, 3] state1_from_state0.
        translations: [K, 3].
        weights: [n, K].
        form: printed or corrected.
    """
    total = points0.sum() * 0.0 + rotations.sum() * 0.0 + translations.sum() * 0.0
    for rotation, translation, part in zip(rotations, translations, weights.T, strict=True):
        moved = points0 @ rotation.T + translation
        if form.paper:
            total = total + part @ (moved - points1).square().sum(-1)
        elif len(points1) and len(moved):
            squared = (moved - points1[_nearest(moved, points1)]).square().sum(-1)
            cost = part @ geman_mcclure(squared, form.sigma)
            total = total + cost / part.sum().clamp_min(EPSILON)
    return total


def geman_mcclure(squared: Tensor, sigma: float) -> Tensor:
    """Return r^2 / (r^2 + sigma^2) of squared lengths: quadratic near 0, bounded by 1."""
    return squared / (squared + sigma**2)


def moved_points(
    points: Tensor, axis: Tensor, origin: Tensor, turns: Tensor, slides: Tensor
) -> Tensor:
    """Return [S, n, 3]: points turned about and slid along one axis, at S joint values.

    Args:
        points: [n, 3].
        axis: [3], normalised here.
        origin: [3] a point on the axis.
        turns: [S] rad.
        slides: [S] scene units.
    """
    unit = axis / axis.norm()
    arm = points - origin
    along = (arm @ unit)[:, None] * unit
    across = torch.linalg.cross(unit.expand_as(arm), arm)
    cos, sin = torch.cos(turns)[:, None, None], torch.sin(turns)[:, None, None]
    return origin + along + cos * (arm - along) + sin * across + slides[:, None, None] * unit


def rotation_angle(first: Tensor, second: Tensor) -> Tensor:
    """Return the geodesic angle between two [3, 3] rotations, rad in [0, pi].

    The gradient is 0 where the angle has a kink (0 and pi), never NaN.
    """
    between = first.T @ second
    twice_sin = torch.stack(
        [
            between[2, 1] - between[1, 2],
            between[0, 2] - between[2, 0],
            between[1, 0] - between[0, 1],
        ]
    )
    return torch.atan2(_length(twice_sin), torch.diagonal(between).sum() - 1.0)


def best_rotation(points0: Tensor, points1: Tensor, weights: Tensor) -> Tensor:
    """Return [3, 3] R minimising sum w |R x0 + t - x1|^2 (Kabsch), detached; identity if empty."""
    with torch.no_grad():
        share = weights / weights.sum().clamp_min(EPSILON)
        arm0, arm1 = points0 - share @ points0, points1 - share @ points1
        u, _, vt = torch.linalg.svd(arm1.T @ (share[:, None] * arm0))
        flip = torch.ones(3, dtype=points0.dtype)
        flip[2] = torch.sign(torch.det(u @ vt))
        return (u * flip) @ vt


def _nearest(points: Tensor, cloud: Tensor) -> Tensor:
    """Return [n] indices of the nearest cloud point; matching itself carries no gradient."""
    tree, kept = tree_of(cloud.detach().numpy())
    return torch.from_numpy(kept[tree.query(points.detach().numpy())[1]])


def _length(vectors: Tensor) -> Tensor:
    squared = vectors.square().sum(-1)
    safe = torch.where(squared > EPSILON**2, squared, torch.ones_like(squared))
    return torch.where(squared > EPSILON**2, safe.sqrt(), torch.zeros_like(squared))


def _unit(vectors: Tensor) -> Tensor:
    """Return directions; a zero vector has none, so it stays zero."""
    return vectors / _length(vectors).clamp_min(EPSILON)[..., None]


def _mean(values: Tensor) -> Tensor:
    return values.sum() / max(values.numel(), 1)
