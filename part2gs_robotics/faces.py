"""Flat faces of the object, and what they say about the direction of a joint.

Made things turn about their edges and slide along their walls. A joint's axis that lies, within
what the images know of it, along or across flat faces is drawn to their common direction; both
are weighed by their errors, and an axis off every face stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.align_system import damping_of
from part2gs_robotics.joint_fit import perturbed
from part2gs_robotics.joints import Joint
from part2gs_robotics.motion_search import directions
from part2gs_robotics.surfels import Surfels

F64 = NDArray[np.float64]
TURNED = np.cos(np.deg2rad(15.0))  # of a surfel's normal against its face: fitted ones are noisy
BIN = 0.008  # of the diagonal: twice the depth noise of fits
THICK = (0.012, 0.006)  # of the diagonal, from the first to the last fit of a face
LEAST = 0.01  # of the surfels; smaller faces are strips whose normals nobody knows
ROUNDS = 8  # of fitting a plane to its surfels
ROBUST = 0.004  # of the diagonal: distance from a face at which a surfel counts a quarter
PATCH = 0.1  # of the diagonal: depth errors are alike this far
BENT = np.deg2rad(0.12)  # rad: faces of fitted objects are bent as a whole; 0.03 to 0.25 seen
NEAR = np.deg2rad(3.0)  # rad: faces that may belong to an axis
AGREED = 3.0  # standard deviations at which a face counts a quarter
DRAWN = 9.21  # squared distance, two degrees of freedom, that chance exceeds once in a hundred
STEPS = 10  # of reweighting; it settles in five


@dataclass(frozen=True)
class Faces:
    """F flat faces.

    Attributes:
        normals: [F, 3] unit.  errors: [F, 3, 3] covariance of the normals, rad^2.
    """

    normals: F64
    errors: F64


@dataclass(frozen=True)
class Direction:
    """What is known of an axis: tilts [2] from a given one, rad, and their covariance [2, 2]."""

    tilts: F64
    covariance: F64


def flat_faces(states: tuple[Surfels, Surfels], diag: float, rng: np.random.Generator) -> Faces:
    """Return the flat faces of both states.

    Args:
        states: surfels.
        diag: diagonal of the object in scene units.
        rng: of the search for directions.
    """
    found: list[tuple[F64, F64]] = []
    for surfels in states:
        if len(surfels) < 1 / LEAST:
            continue
        free = np.ones(len(surfels), bool)
        for axis in directions(surfels, surfels.select(rng.permutation(len(surfels))[:500]), rng):
            for side in (axis, -axis):
                found += _parallel(surfels, side, free, diag)
    normals = np.array([n for n, _ in found]).reshape(-1, 3)
    return Faces(normals, np.array([e for _, e in found]).reshape(-1, 3, 3))


def _parallel(surfels: Surfels, side: F64, free: NDArray[np.bool_], diag: float,
              ) -> list[tuple[F64, F64]]:
    """Return normal and covariance of the faces that look to one side; their surfels are taken."""
    found: list[tuple[F64, F64]] = []
    while True:
        facing = np.flatnonzero(free & (surfels.normals @ side > TURNED))
        if len(facing) < LEAST * len(surfels):
            return found
        heights = surfels.points[facing] @ side
        edges = np.arange(heights.min() - BIN * diag, heights.max() + 2 * BIN * diag, BIN * diag)
        counts = np.histogram(heights, edges)[0]
        pairs = counts[:-1] + counts[1:]
        top = int(pairs.argmax())
        if pairs[top] < LEAST * len(surfels):
            return found
        own = facing[np.abs(heights - edges[top + 1]) < 1.5 * BIN * diag]
        plane = _plane(surfels.points[own], side, diag)
        free[own] = False
        if plane is not None:
            found.append(plane)


def _plane(points: F64, side: F64, diag: float) -> tuple[F64, F64] | None:
    """Return the unit normal of a robust plane and its covariance."""
    normal, centre = side, np.median(points, 0)
    for thick in np.linspace(*THICK, ROUNDS):
        gap = (points - centre) @ normal
        weight = (np.abs(gap) < thick * diag) / (1 + (gap / (ROBUST * diag)) ** 2) ** 2
        if weight.sum() < 10:  # three points make a plane; ten make one that is believed
            return None
        centre = weight @ points / weight.sum()
        spread = ((points - centre) * weight[:, None]).T @ (points - centre) / weight.sum()
        values, frame = np.linalg.eigh(spread)
        normal = frame[:, 0] * np.sign(frame[:, 0] @ side)
    patches = max(12 * np.sqrt(values[1] * values[2]) / (PATCH * diag) ** 2, 1.0)
    tilts = values[0] / (patches * np.maximum(values[1:], 1e-30)) + BENT**2
    return normal, (frame[:, 1:] * tilts) @ frame[:, 1:].T


def direction_of(axis: F64, faces: Faces) -> Direction | None:
    """Return the direction near an axis that faces along and across it agree on, None if none do.

    Args:
        axis: [3] unit.
        faces: of the object.
    """
    sides = np.linalg.svd(axis[None])[2][1:]
    cosine = faces.normals @ axis if len(faces.normals) else np.zeros(0)
    rows: list[tuple[F64, float, float]] = []  # slopes, value, variance: slopes . tilts = value
    for n, error, c in zip(faces.normals, faces.errors, cosine, strict=True):
        if abs(c) > np.cos(NEAR):
            rows += [(np.eye(2)[i], float(np.sign(c) * (sides[i] @ n)),
                      float(sides[i] @ error @ sides[i])) for i in (0, 1)]
        elif abs(c) < np.sin(NEAR):
            rows.append((sides @ n, -float(c), float(axis @ error @ axis)))
    if not rows:
        return None
    slopes, values, variances = (np.array(column) for column in zip(*rows, strict=True))
    tilts = np.zeros(2)
    for _ in range(STEPS):
        u = (slopes @ tilts - values) ** 2 / (AGREED**2 * variances)
        weights = 1 / (1 + u) ** 2 / variances
        known = slopes.T @ (slopes * weights[:, None])
        known += np.eye(2) / NEAR**2  # what no face says
        tilts = np.linalg.solve(known, slopes.T @ (weights * values))
    return Direction(tilts, np.linalg.inv(known))


def squared(joint: Joint, h: F64, faces: Faces, diag: float) -> Joint:
    """Return the joint with its axis drawn to the faces' direction, everything else following.

    Args:
        joint: aligned, with standard deviations.
        h: [P, P] curvature of the alignment in the coordinates of joint_fit.perturbed.
        faces: of the object.
        diag: diagonal of the object in scene units.
    """
    known = drawn(joint.sigma_axis, direction_of(joint.axis, faces))
    if known is None:
        return joint
    held = h[2:, 2:] + damping_of(h) * np.eye(len(h) - 2)
    rest = -np.linalg.solve(held, h[2:, :2] @ known.tilts)
    step = np.concatenate([known.tilts, rest])
    if np.abs(step).max() > NEAR:  # the rest hangs on what no image shows
        return joint
    sigma = float(np.sqrt(np.trace(known.covariance)))
    return replace(perturbed(joint, step, diag), sigma_axis=sigma)


def drawn(sigma: float, direction: Direction | None) -> Direction | None:
    """Return the tilts of an axis drawn to a direction, None where it stays.

    Args:
        sigma: standard deviation of the axis, rad, infinite = not known.
        direction: of the faces, relative to the axis.
    """
    if direction is None:
        return None
    if not np.isfinite(sigma):
        return direction
    own = np.eye(2) * max(0.5 * sigma**2, 1e-16)
    if direction.tilts @ np.linalg.solve(own + direction.covariance, direction.tilts) > DRAWN:
        return None
    gain = own @ np.linalg.inv(own + direction.covariance)
    return Direction(gain @ direction.tilts, own - gain @ own)
