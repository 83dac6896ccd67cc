"""Guides: directions of an object's faces and edges, and what they say about a joint's axis.

Made things turn about their edges and slide along their walls. A joint's axis that lies, within
what the images know of it, along or across flat faces and straight edges is drawn to their common
direction; both are weighed by their errors, and an axis off every one stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.align_system import damping_of
from part2gs_robotics.joint_fit import perturbed
from part2gs_robotics.joints import Joint

F64 = NDArray[np.float64]
NEAR = np.deg2rad(3.0)  # rad: guides that may belong to an axis
AGREED = 3.0  # standard deviations at which a guide counts a quarter
DRAWN = 9.21  # squared distance, two degrees of freedom, that chance exceeds once in a hundred
FARTHER = 36.0  # likewise, six deviations: a short fit's lid was 4 off the edges, if images agree
# rad: fitted walls are bent, and what is aligned to them is off by that much, whatever its
# curvature says: 0.04 to 0.12 deg on seen objects.
BEND = np.deg2rad(0.1)
# rad, added to deviations while guides are weighed: an aligned axis starts so far off that edges
# known to a hundredth of a degree would all count for nothing.
SLACK = np.deg2rad([0.6, 0.4, 0.2, 0.1, 0.05, 0.02, 0.01, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class Guides:
    """G directions that axes lie along or across.

    Attributes:
        directions: [G, 3] unit: normals of faces, directions of edges.
        errors: [G, 3, 3] their covariance, rad^2.
    """

    directions: F64
    errors: F64

    def __add__(self, other: Guides) -> Guides:
        """Return both together."""
        return Guides(np.concatenate([self.directions, other.directions]),
                      np.concatenate([self.errors, other.errors]))


def guides_of(pairs: list[tuple[F64, F64]]) -> Guides:
    """Return the guides of (direction [3], covariance [3, 3]) pairs."""
    return Guides(np.array([d for d, _ in pairs]).reshape(-1, 3),
                  np.array([e for _, e in pairs]).reshape(-1, 3, 3))


@dataclass(frozen=True)
class Direction:
    """What is known of an axis: tilts [2] from a given one, rad, and their covariance [2, 2]."""

    tilts: F64
    covariance: F64


def direction_of(axis: F64, guides: Guides) -> Direction | None:
    """Return the direction near an axis that guides along and across it agree on, None if none do.

    Args:
        axis: [3] unit.
        guides: of the object.
    """
    sides = np.linalg.svd(axis[None])[2][1:]
    cosine = guides.directions @ axis
    rows: list[tuple[F64, float, float]] = []  # slopes, value, variance: slopes . tilts = value
    for n, error, c in zip(guides.directions, guides.errors, cosine, strict=True):
        if abs(c) > np.cos(NEAR):
            rows += [(np.eye(2)[i], float(np.sign(c) * (sides[i] @ n)),
                      float(sides[i] @ error @ sides[i])) for i in (0, 1)]
        elif abs(c) < np.sin(NEAR):
            rows.append((sides @ n, -float(c), float(axis @ error @ axis)))
    if not rows:
        return None
    slopes, values, variances = (np.array(column) for column in zip(*rows, strict=True))
    tilts = np.zeros(2)
    for slack in SLACK:
        u = (slopes @ tilts - values) ** 2 / (AGREED**2 * (variances + slack**2))
        weights = 1 / (1 + u) ** 2 / variances
        known = slopes.T @ (slopes * weights[:, None])
        known += np.eye(2) / NEAR**2  # what no guide says
        tilts = np.linalg.solve(known, slopes.T @ (weights * values))
    return Direction(tilts, np.linalg.inv(known))


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
