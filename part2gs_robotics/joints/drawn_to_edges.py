"""Turns: how far a part's own straight edges turned between the states.

Two fitted surfaces bend differently, and the turn that lays one on the other is off by as much. An
edge across a hinge is seen in both states; the angle between its two directions is the turn.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.evidence.edges import CLEAR, PEAK, RING, STAYED, Bundle, looked_at
from part2gs_robotics.evidence.guides import NEAR, Direction, Guides, direction_of
from part2gs_robotics.evidence.part_edges import PartEdges
from part2gs_robotics.joints.solver import damping_of, perturbed
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint

ACROSS = np.sin(np.deg2rad(20.0))  # edges across a hinge, by their ends' rough depth
ALIKE = np.cos(np.deg2rad(15.0))  # of a rough direction and the one on the segment's plane
VAGUE = np.deg2rad(1.0)  # rad: segments that tell an angle no better are left out
WIDTHS = np.deg2rad([1.0, 0.5, 0.5, 0.25, 0.25, 0.15, 0.15])  # of the kernel
FAR = 3.0  # standard deviations from the images' turn: farther, it is another edge's
# rad: what is left; a part has a few edges, seen many times. 0.004 to 0.1 deg seen, median 0.025.
TRUE = np.deg2rad(0.04)
LEAST = 8  # segments of either state that must agree
DRAWN = 9.21  # squared distance, two degrees of freedom, that chance exceeds once in a hundred
FARTHER = 36.0  # likewise, six deviations, if images agree: a true part of a short fit was 4 off
# rad: fitted walls, and what is aligned to them, are bent: by 0.04 to 0.12 deg on seen objects.
BEND = np.deg2rad(0.1)


def turn_of(edges: PartEdges, axis: F64, value: float) -> tuple[float, float] | None:
    """Return the turn about an axis near a given one, and its deviation, rad; None if unknown.

    Args:
        edges: of the part.
        axis: [3] unit, of the hinge.
        value: rad, a degree from the truth at most.
    """
    (one, errors_one, views_one), (two, errors_two, views_two) = (
        _angles(bundle, way, axis) for bundle, way in zip(edges.bundles, edges.ways, strict=True))
    if min(len(one), len(two)) < LEAST:
        return None
    base = 1 / (errors_one[:, None] ** 2 + errors_two**2)
    turn = value
    for width in WIDTHS:
        gaps = two - one[:, None] - turn
        gaps -= np.pi * np.round(gaps / np.pi)  # an edge has no sign
        weight = base / (1 + (gaps / width) ** 2) ** 2
        turn += float((weight * gaps).sum() / weight.sum())
    near, ring = np.abs(gaps) < PEAK, np.abs(gaps) < RING
    own = float(base[near].sum())
    chance = float(base[ring & ~near].sum() * PEAK / (RING - PEAK))
    few = min(near.any(1).sum(), near.any(0).sum()) < LEAST
    if few or own < CLEAR * chance or abs(turn - value) > STAYED:
        return None
    asked = weight * gaps
    spread = (_by_view(asked.sum(1), views_one) + _by_view(asked.sum(0), views_two))
    return turn, float(np.sqrt(spread / weight.sum() ** 2 + TRUE**2))


def turned(joint: Joint, h: F64, edges: PartEdges, diag: float) -> Joint:
    """Return the joint turned as far as its part's edges say, its place following.

    Args:
        joint: as in guides.squared, and h and diag.
        h: [P, P].
        edges: of the part.
        diag: scene units.
    """
    slides = joint.kind == "prismatic" or joint.carrier is not None  # a carrier turns edges too
    found = None if slides else turn_of(edges, joint.axis, joint.value)
    if found is None:
        return joint
    turn, error = found
    own = np.hypot(joint.sigma_value, BEND)  # infinite where the images do not show it
    gap = turn - joint.value
    if gap**2 > FAR**2 * (own**2 + error**2):
        return joint
    gain = 1.0 if np.isinf(own) else float(own**2 / (own**2 + error**2))
    moved = followed(joint, h, 2, np.array([gain * gap]), diag)
    return joint if moved is None else replace(moved, sigma_value=gain**0.5 * error)


def _by_view(asked: F64, views: NDArray[np.int64]) -> float:
    """Return the sum over views of the square of what each asks for."""
    return float((np.bincount(views, asked) ** 2).sum())


def _angles(bundle: Bundle, ways: F64, axis: F64) -> tuple[F64, F64, NDArray[np.int64]]:
    """Return angle about the axis, its error and the camera of every edge across it."""
    side = np.linalg.svd(axis[None])[2][1]
    up = np.cross(axis, side)
    across = np.cross(axis, bundle.planes)
    size = np.linalg.norm(across, axis=1)
    across /= np.maximum(size, 1e-9)[:, None]
    _, slopes, errors = looked_at(bundle, across)
    slope = np.abs((slopes * np.cross(axis, across)).sum(1))
    error = errors / np.maximum(slope, 1e-9)
    good = ((size > 1e-6) & (error < VAGUE) & (np.abs(ways @ axis) < ACROSS)
            & (np.abs((ways * across).sum(1)) > ALIKE))
    angle = np.arctan2(across @ up, across @ side)
    return angle[good], error[good], bundle.cameras[good]


def squared(joint: Joint, h: F64, guides: Guides, diag: float, within: float = DRAWN) -> Joint:
    """Return the joint with its axis drawn to the guides' direction, everything else following.

    Args:
        joint: aligned, with standard deviations.
        h: [P, P] curvature of the alignment in the coordinates of joint_fit.perturbed.
        guides: of the object.
        diag: diagonal of the object in scene units.
        within: squared distance in deviations up to which it is drawn.
    """
    known = drawn(joint.sigma_axis, direction_of(joint.axis, guides), within)
    moved = None if known is None else followed(joint, h, 0, known.tilts, diag)
    if known is None or moved is None:
        return joint
    return replace(moved, sigma_axis=float(np.sqrt(np.trace(known.covariance))))


def followed(joint: Joint, h: F64, first: int, known: F64, diag: float) -> Joint | None:
    """Return the joint with some coordinates moved, later ones following by the curvature.

    Args:
        joint: aligned.
        h: [P, P] curvature in the coordinates of joint_fit.perturbed.
        first: where the known ones begin; those before stay.
        known: [K] their change.
        diag: diagonal of the object in scene units.

    Returns:
        None where what follows hangs on what no image shows: it would go as far as NEAR.
    """
    end = first + len(known)
    step = np.zeros(len(h))
    step[first:end] = known
    held = h[end:, end:] + damping_of(h) * np.eye(len(h) - end)
    step[end:] = -np.linalg.solve(held, h[end:, first:end] @ known)
    return None if np.abs(step).max() > NEAR else perturbed(joint, step, diag)


def drawn(sigma: float, direction: Direction | None, within: float = DRAWN) -> Direction | None:
    """Return the tilts of an axis drawn to a direction, None where it stays.

    Args:
        sigma: standard deviation of the axis, rad, infinite = not known.
        direction: of the guides, relative to the axis.
        within: squared distance in deviations up to which it is drawn.
    """
    if direction is None:
        return None
    if not np.isfinite(sigma):
        return direction
    own = np.eye(2) * (0.5 * sigma**2 + BEND**2)
    if direction.tilts @ np.linalg.solve(own + direction.covariance, direction.tilts) > within:
        return None
    gain = own @ np.linalg.inv(own + direction.covariance)
    return Direction(gain @ direction.tilts, own - gain @ own)
