"""Flat faces of the object, with what is known of their normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.evidence.guides import Guides, guides_of
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model.arrays import F64

TURNED = np.cos(np.deg2rad(15.0))  # of a surfel's normal against its face: fitted ones are noisy
BIN = 0.008  # of the diagonal: twice the depth noise of fits
THICK = (0.012, 0.006)  # of the diagonal, from the first to the last fit of a face
LEAST = 0.01  # of the surfels; smaller faces are strips whose normals nobody knows
ROUNDS = 8  # of fitting a plane to its surfels
ROBUST = 0.004  # of the diagonal: distance from a face at which a surfel counts a quarter
PATCH = 0.1  # of the diagonal: depth errors are alike this far
BENT = np.deg2rad(0.12)  # rad: faces of fitted objects are bent as a whole; 0.03 to 0.25 seen


def flat_faces(states: tuple[Surfels, Surfels], diag: float, rng: np.random.Generator) -> Guides:
    """Return the normals of the flat faces of both states.

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
    return guides_of(found)


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


def directions(surfels: Surfels, patch: Surfels, rng: np.random.Generator, limit: int = 10,
               known: F64 | None = None) -> F64:
    """Return [D, 3] sign-free candidate axes: known ones, dominant normals, crosses, patch axes."""
    normals = surfels.normals[rng.permutation(len(surfels))[:3000]]
    found: list[F64] = []
    rest = normals
    while len(rest) > 0.02 * len(normals) and len(found) < limit:
        picks = rest[rng.permutation(len(rest))[:64]]
        votes = (np.abs(picks @ rest.T) > np.cos(np.deg2rad(8))).sum(1)
        best = picks[votes.argmax()]
        members = rest[np.abs(rest @ best) > np.cos(np.deg2rad(8))]
        mean = (members * np.sign(members @ best)[:, None]).mean(0)
        found.append(mean / np.linalg.norm(mean))
        rest = rest[np.abs(rest @ best) < np.cos(np.deg2rad(15))]
    strong = found[:4]
    found += [np.cross(a, b) for i, a in enumerate(strong) for b in strong[:i]]
    centred = patch.points - patch.points.mean(0)
    found += list(np.linalg.svd(centred, full_matrices=False)[2])
    first = list(known) if known is not None else []
    return _distinct(np.array([*first, *found]), np.deg2rad(6.0))


def on_edge(axis: F64, straight: F64 | None) -> bool:
    """Return whether an axis is one of the directions [E, 3] of edges."""
    return straight is not None and bool((np.abs(straight @ axis) > 1 - 1e-12).any())


def _distinct(axes: F64, angle: float) -> F64:
    out: list[F64] = []
    for axis in axes:
        norm = np.linalg.norm(axis)
        if norm > 0.3 and all(abs(axis @ o) / norm < np.cos(angle) for o in out):
            out.append(axis / norm)
    return np.array(out)
