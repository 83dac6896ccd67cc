"""Guides: directions of an object's faces and edges, and what they say about a joint's axis.

Made things turn about their edges and slide along their walls. A joint's axis that lies, within
what the images know of it, along or across flat faces and straight edges is drawn to their common
direction; both are weighed by their errors, and an axis off every one stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from part2gs_robotics.model.arrays import F64

NEAR = np.deg2rad(3.0)  # rad: guides that may belong to an axis
AGREED = 3.0  # standard deviations at which a guide counts a quarter
# rad added to deviations: axes start so far off that edges known to 0.01 deg would count for none.
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

