"""Askew motions: a made thing slides along its own walls and turns about its own edges.

A chance likeness goes in any direction: one drawer shut and its neighbour opened look like one
drawer that went through the shelf between, two flaps of a carton like one that turned over.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from part2gs_robotics.model.arrays import F64, Labels, Mask
from part2gs_robotics.model.joint import Joint

WAYS = 200  # directions tried, 8 deg apart at most: fitted normals are not better
MOST = 400  # normals looked at: their mean is known to 0.02; every set of motions is asked
# Mean |sin 2 angle| to walls over the best way's: true slides 0 to 0.24 (few photos), false 0.3 up.
FREE, FULL = 0.25, 0.35
# rad to the next edge: 63 of 65 joints below 0.1 deg, two 1.2 (benchmarks/edges.py); unaligned 3.
BESIDE, OFF = np.deg2rad(5.0), np.deg2rad(9.0)
APART = np.sin(np.deg2rad(30.0))  # edges that meet at less have no sure line across them


def askew(h: Joint, normals: F64) -> float:
    """Return 0..1, how surely a slide runs neither along its part's walls nor across them.

    A shape without walls (a ball) leans as much in every direction, so none of them is askew.

    Args:
        h: motion; 0 for what turns.
        normals: [n, 3] unit, of the part in either state: a slide turns none of them.
    """
    if h.turns or not len(normals):
        return 0.0
    normals = normals[:: 1 + len(normals) // MOST]
    excess = _lean(normals, h.axis[None])[0] - _lean(normals, _half_sphere(WAYS)).min()
    return float(np.clip((excess - FREE) / (FULL - FREE), 0.0, 1.0))


def square(edges: F64) -> F64:
    """Return [C, 3] directions that joints keep to: edges [E, 3] and the lines across two of them.

    Without two directions of edges nothing is known: [0, 3].
    """
    across = [np.cross(a, b) for a, b in combinations(edges, 2)]
    found = [c / np.linalg.norm(c) for c in across if np.linalg.norm(c) > APART]
    return np.array([*edges, *found] if found else []).reshape(-1, 3)


def crooked(h: Joint, lines: F64) -> float:
    """Return 0..1, how surely an axis keeps to none of the lines [C, 3] of `square`."""
    if not len(lines):
        return 0.0
    gap = np.arccos(min(float(np.abs(lines @ h.axis).max()), 1.0))
    return float(np.clip((gap - BESIDE) / (OFF - BESIDE), 0.0, 1.0))


def way_over(ways: csr_matrix, own: Mask, alike: Mask, ends: tuple[Mask, Mask]) -> Labels:
    """Return rows of the shortest way from a part to either end along what is like it, sorted.

    Args:
        ways: [N, N] distances between neighbours.
        own: [N] of the part.
        alike: [N] where a way may go on.
        ends: [N] each where one may end; one that is not reached adds none.
    """
    rows = np.flatnonzero(own | alike)
    far, before, _ = dijkstra(ways[rows][:, rows], False, np.flatnonzero(own[rows]),
                              return_predecessors=True, min_only=True)
    found = set[int]()
    for end in ends:
        here = np.where(end[rows], far, np.inf)
        at = int(here.argmin()) if np.isfinite(here).any() else -1
        while at >= 0:
            found.add(int(rows[at]))
            at = int(before[at])
    return np.array(sorted(found), np.int64)


def _lean(normals: F64, ways: F64) -> F64:
    """Return [D] the mean of |sin 2 angle| between unit normals [n, 3] and directions [D, 3]."""
    cosine = np.minimum(np.abs(ways @ normals.T), 1.0)
    return np.asarray((2 * cosine * np.sqrt(1 - cosine**2)).mean(1))


@lru_cache(1)
def _half_sphere(count: int) -> F64:
    """Return [count, 3] unit directions, evenly over half a sphere (golden spiral)."""
    step = np.arange(count) + 0.5
    height, turn = step / count, np.pi * (1 + np.sqrt(5)) * step
    flat = np.sqrt(1 - height**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), height], 1)
