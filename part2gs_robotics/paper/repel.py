"""Repel points: where base and moving part touch, and the push they give the joint."""

from __future__ import annotations

import numpy as np

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.points import farthest, outermost, tree_of

NUM_REPEL = 2000  # N_R of the paper
REACH_SPACINGS = 1.5  # the paper's proximity threshold, read as multiples of the local spacing
REPEL_STRENGTH = 5e-4  # k_r of the paper, scene units^3
REPEL_EPSILON = 1e-5  # epsilon of the paper, added to the distance
BLOCK = 64  # points at a time in the printed sum: 2000 repel points are 3 MB
NUM_NEAREST = 8  # the paper sums over all points; the nearest 8 are one spacing's ring


def repel_points(
    states: list[tuple[F64, F64]],
    reach_spacings: float = REACH_SPACINGS,
    max_points: int = NUM_REPEL,
) -> F64:
    """Return [M, 3] base points beside the moving part in any state; empty without a seam.

    A base point is on the seam when a part point lies within reach_spacings times the median
    spacing. The base does not move, so the points of all states live in one world frame.

    Args:
        states: per state, (base [B, 3], part [P, 3]) centres in the world, scene units.
        reach_spacings: proximity threshold in median spacings.
        max_points: N_R; more are thinned by farthest points.

    Source: Part2GS eq. 5, R.
    """
    found = [_seam(np.asarray(b, float), np.asarray(p, float), reach_spacings) for b, p in states]
    seam = np.concatenate([np.zeros((0, 3)), *found])
    return seam[np.sort(farthest(seam, max_points, outermost(seam)))]


def repel_forces(
    points: F64,
    repels: F64,
    voxel: float,
    strength: float = REPEL_STRENGTH,
    num_nearest: int = NUM_NEAREST,
    paper: bool = False,
) -> F64:
    """Return [n, 3] displacements that repel points give the moving part's points.

    Paper: sum_j k_r (r_j - mu) / |r_j - mu|^3, which draws mu TOWARDS r_j (magnitude inverse
    square) and grows with the number of points. Corrected: from r_j to mu, mean over the nearest
    repel points of pushes of at most half a voxel: minus the gradient of `losses.repel_loss`.

    Args:
        points: [n, 3] moving part in the world, scene units.
        repels: [M, 3] of `repel_points`.
        voxel: resolution of the scene, scene units; bounds the corrected step.
        strength: k_r.
        num_nearest: repel points that count, corrected form only.
        paper: True = as printed.

    Source: Part2GS eq. 5; epsilon keeps coincident points finite in both forms.
    """
    if len(points) == 0 or len(repels) == 0:
        return np.zeros((len(points), 3))
    if paper:
        blocks = np.array_split(points, -(-len(points) // BLOCK))
        return strength * np.concatenate(
            [_inverse_square(repels - block[:, None]).sum(1) for block in blocks])
    count = min(num_nearest, len(repels))
    tree, kept = tree_of(repels, count)
    index = kept[tree.query(points, k=count)[1]]
    away = points[:, None] - repels[np.reshape(index, (len(points), count))]
    length = np.sqrt(np.square(away).sum(-1, keepdims=True) + REPEL_EPSILON**2)
    push = np.minimum(strength / length**2, 0.5 * voxel)
    return np.asarray((push * away / length).mean(1))


def net_wrench(points: F64, forces: F64, origin: F64) -> tuple[F64, F64]:
    """Return mean force [3] and mean torque [3] about origin of forces at points [n, 3]."""
    if len(points) == 0:
        return np.zeros(3), np.zeros(3)
    return forces.mean(0), np.cross(points - origin, forces).mean(0)


def joint_gradient(points: F64, forces: F64, joint: Joint) -> float:
    """Return the wrench's work per unit of joint position: where the forces drive q.

    Forces act on the joint, not on single Gaussians, so the part stays rigid: torque about the
    axis for a turn, force along it for a slide, both with the pitch for a screw, 0 if fixed.

    Args:
        points: [n, 3] part points in the world at the present joint position.
        forces: [n, 3] displacements or forces at them.
        joint: world frame; its own motion leaves axis and origin in place.
    """
    if joint.kind == "fixed":
        return 0.0
    force, torque = net_wrench(points, forces, joint.origin)
    along, about = float(force @ joint.axis), float(torque @ joint.axis)
    if joint.kind == "prismatic":
        return along
    return about + (joint.pitch * along if joint.kind == "screw" else 0.0)


def _seam(base: F64, part: F64, reach_spacings: float) -> F64:
    if len(base) == 0 or len(part) == 0:
        return np.zeros((0, 3))
    both = np.concatenate([base, part])
    spacing = float(np.median(tree_of(both, 2)[0].query(both, k=2)[0][:, 1]))
    distance, _ = tree_of(part)[0].query(base)
    return base[distance <= reach_spacings * spacing]


def _inverse_square(vectors: F64) -> F64:
    """Return v / (|v|^2 + eps^2)^(3/2): direction of v, magnitude 1 / |v|^2."""
    squared = np.square(vectors).sum(-1, keepdims=True) + REPEL_EPSILON**2
    return np.asarray(vectors / squared**1.5)
