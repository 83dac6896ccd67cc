"""Where to cut a noisy solid: its main directions and the walls along them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64

SAME_DIRECTION = np.cos(np.deg2rad(20.0))  # noisy walls: normals spread by 10..15 degrees
MAX_DIRECTIONS = 6  # twice those of a box, largest first
DIRECTION_SHARE = 0.03  # of the surface: smaller facets are no wall
WALL_SHARE = 0.02  # of the surface
LIFT = 2e-7  # of the tolerance, that a cut lies above a clean wall: what just touches leaves films
MAX_CUTS = 12  # candidates per piece, largest walls first; 24 found no better pieces in trials


@dataclass(frozen=True)
class Cut:
    """A plane normal.x = level; a wall's lies half-way up its bumps, so neither side drags a film.

    Attributes:
        normal: unit.  level: scene units.  area: of the wall, units^2.
    """

    normal: F64
    level: float
    area: float


@dataclass(frozen=True)
class Facets:
    """Triangles of a surface: [F, 3] centres, unit normals, [F] areas."""

    centers: F64
    normals: F64
    areas: F64


def facets(vertices: F64, faces: NDArray[np.int64]) -> Facets:
    """Return centres, normals and areas of triangles, empty ones left out."""
    tri = vertices[faces]
    cross = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    length = np.linalg.norm(cross, axis=1)
    good = length > 0
    return Facets(tri.mean(1)[good], cross[good] / length[good, None], length[good] / 2)


def main_directions(surface: Facets) -> F64:
    """Return [D, 3] unit directions in which most of the surface looks, sign-free.

    Takes the largest cluster of normals, removes it, repeats. A surface that looks everywhere
    alike gets the principal axes of its normals.
    """
    normals, areas = surface.normals.copy(), surface.areas.copy()
    total = areas.sum()
    found: list[F64] = []
    seeds = _sphere()
    while len(found) < MAX_DIRECTIONS:
        near = (np.abs(seeds @ normals.T) > SAME_DIRECTION) @ areas
        best = int(np.argmax(near))
        if near[best] < DIRECTION_SHARE * total:
            break
        direction = _settle(seeds[best], normals, areas)
        found.append(direction)
        keep = np.abs(normals @ direction) <= SAME_DIRECTION
        normals, areas = normals[keep], areas[keep]
    if not found:
        return np.asarray(np.linalg.eigh((normals * areas[:, None]).T @ normals)[1].T)
    return np.array(found)


def _sphere() -> F64:
    """Return 512 evenly spread directions of a half sphere (golden spiral)."""
    i = np.arange(512) + 0.5
    z = i / 512
    phi = i * np.pi * (1 + 5**0.5)
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], 1)


def _settle(seed: F64, normals: F64, areas: F64) -> F64:
    """Return the mean direction of the normals around a seed."""
    direction = seed
    for _ in range(4):  # converges in two for a wall
        along = normals @ direction
        near = np.abs(along) > SAME_DIRECTION
        mean = (np.sign(along[near]) * areas[near]) @ normals[near]
        direction = mean / max(float(np.linalg.norm(mean)), 1e-300)
    return np.asarray(direction)


def wall_cuts(surface: Facets, directions: F64, tolerance: float) -> list[Cut]:
    """Return cuts along the walls of a surface, largest wall first.

    A wall is a peak of face area over the offset along a direction, for either sign.
    """
    cuts = []
    for direction in directions:
        along = surface.normals @ direction
        offsets = surface.centers @ direction
        for sign in (1.0, -1.0):
            mine = sign * along > SAME_DIRECTION
            cuts += _walls(direction, sign, offsets[mine], surface, mine, tolerance)
        cuts += _thirds(direction, offsets)
    return sorted(cuts, key=lambda c: -c.area)[:MAX_CUTS]


def _walls(
    direction: F64, sign: float, offsets: F64, surface: Facets, mine: NDArray[np.bool_], tol: float
) -> list[Cut]:
    areas, least = surface.areas[mine].copy(), WALL_SHARE * surface.areas.sum()
    cuts = []
    while areas.sum() > least:
        middle = _peak(offsets, areas, tol)
        near = np.abs(offsets - middle) <= tol
        area = float(areas[near].sum())
        if area <= least:
            break
        level = weighted_quantile(offsets[near], areas[near], 0.5)
        spread = weighted_quantile(np.abs(offsets[near] - level), areas[near], 0.9)
        gap = float(np.clip(1.5 * spread, LIFT * tol, tol))
        cuts.append(Cut(direction, level + 0.5 * sign * gap, area))
        areas[near] = 0.0
    return cuts


def _peak(offsets: F64, areas: F64, width: float) -> float:
    """Return the middle of the window of width 2 `width` that holds most area."""
    order = np.argsort(offsets)
    x, total = offsets[order], np.concatenate([[0.0], np.cumsum(areas[order])])
    end = np.searchsorted(x, x + 2 * width, side="right")
    held = total[end] - total[:-1]
    best = int(np.argmax(held))
    inside = slice(best, int(end[best]))
    return weighted_quantile(x[inside], areas[order][inside], 0.5)


def _thirds(direction: F64, offsets: F64) -> list[Cut]:
    """Return plain cuts for curved pieces; area 0 ranks them behind every wall."""
    low, high = float(offsets.min()), float(offsets.max())
    return [Cut(direction, low + share * (high - low), 0.0) for share in (0.25, 0.5, 0.75)]


def weighted_quantile(values: F64, weights: F64, share: float) -> float:
    """Return the value below which a share of the weight lies."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][min(int(np.searchsorted(total, share * total[-1])), len(order) - 1)])
