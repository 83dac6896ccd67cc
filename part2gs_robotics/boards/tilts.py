"""Tilts: walls a few degrees off a common direction, told from bulges of fitted surfaces.

A wall that tapers by four degrees and one that is fitted with a bulge have the same normals. But
the one lies in a plane of its own, and in none of the common direction; the other does not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from part2gs_robotics.boards.facets import Facets
from part2gs_robotics.model.arrays import F64

SPREAD = 25  # degrees about a common direction that are looked at
OWN = 3.0  # degrees: normals that speak for a tilt, twice the noise of smoothed ones
APART = 4.0  # degrees between tilts: nearer ones share their normals
MOST = 4  # tilts of a direction: the sides of a hopper have two
BETTER = 1.5  # times the area in its best plane: of 60 tilts of bulging walls, most reach 1.3
WINDOW = 2.0  # cells: noise of a wall seen from one side, both ways


def tilts(direction: F64, surface: Facets, weights: F64, least: float, voxel: float) -> list[F64]:
    """Return unit normals near a direction in whose planes walls lie that lie in none of its own.

    Args:
        direction: [3] unit.
        surface: faces with smoothed normals.
        weights: [F] observed area.
        least: weight that a wall must have.
        voxel: of the grid that the surface came from.
    """
    along = surface.normals @ direction
    near = np.flatnonzero(np.abs(along) > np.cos(np.deg2rad(SPREAD)))
    normals = surface.normals[near] * np.sign(along[near])[:, None]
    across = np.linalg.svd(direction[None])[2][1:]
    angles = np.rad2deg(np.arctan2(normals @ across.T, (normals @ direction)[:, None]))
    edges = np.arange(-SPREAD, SPREAD + 1.0)
    held = np.histogram2d(angles[:, 0], angles[:, 1], [edges, edges], weights=weights[near])[0]
    held = gaussian_filter(held, 1.0)
    found: list[F64] = []
    for _ in range(MOST):
        middle = edges[np.array(np.unravel_index(held.argmax(), held.shape))] + 0.5
        own = np.linalg.norm(angles - middle, axis=1) < OWN
        if weights[near][own].sum() < least:
            break
        _forget(held, edges, middle)
        wall = normals[own].T @ weights[near][own]
        wall /= np.linalg.norm(wall)
        centers, areas = surface.centers[near][own], surface.areas[near][own]
        if _in_one(centers @ wall, areas, voxel) > BETTER * _in_one(centers @ direction, areas,
                                                                    voxel):
            found.append(wall)
    return found


def _forget(held: F64, edges: F64, middle: NDArray[np.float64]) -> None:
    """Clear a histogram about a peak."""
    x, y = (edges[:-1] + 0.5 - m for m in middle)
    held[x[:, None] ** 2 + y[None] ** 2 < APART**2] = 0.0


def _in_one(levels: F64, areas: F64, voxel: float) -> float:
    """Return the share of area in the best window of offsets."""
    step = WINDOW * voxel / 8
    bins = np.arange(levels.min() - WINDOW * voxel, levels.max() + 2 * WINDOW * voxel, step)
    held = np.histogram(levels, bins, weights=areas)[0]
    return float(np.convolve(held, np.ones(8), "valid").max() / areas.sum())
