"""Joined pieces: neighbours whose common hull holds hardly more than they do become one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from part2gs_robotics.model.arrays import F64

Pair = tuple[int, int]


@dataclass(frozen=True)
class Hull:
    """A convex piece: [V, 3] corners, volume of the hull, and volume of the part in it."""

    corners: F64
    volume: float
    real: float

    @property
    def excess(self) -> float:
        """Empty volume of the hull."""
        return self.volume - self.real


def hull(points: F64, real: float) -> Hull:
    """Return the hull of points [N, 3] that hold so much of the part; flat ones have no volume."""
    try:
        found = ConvexHull(points)
    except (QhullError, ValueError):
        return Hull(points, 0.0, 0.0)
    return Hull(points[found.vertices], float(found.volume), real)


def joined(pieces: list[Hull], most: int, share: float, near: float) -> list[Hull]:
    """Return fewer pieces: those that hull well together, and on until there are few enough.

    Args:
        pieces: none over another.
        most: at most so many are left.
        share: of what is real in a common hull, that may be added as empty without need.
        near: pieces farther apart than that are joined only where no others are left.
    """
    left = dict(enumerate(pieces))
    common = _commons(left, near)
    while len(left) > 1:
        free = [pair for pair, both in common.items()
                if _added(both, left, pair) <= share * both.real]
        if not free and len(left) <= most:
            break
        if not common:
            common = _commons(left, np.inf)
        best = min(free or common, key=lambda pair: _added(common[pair], left, pair))
        new, number = common[best], max(left) + 1
        left = {index: piece for index, piece in left.items() if index not in best}
        common = {pair: both for pair, both in common.items() if not set(pair) & set(best)}
        common |= {(a, number): _common(piece, new) for a, piece in left.items()
                   if _gap(piece, new) <= near}
        left[number] = new
    return list(left.values())


def _commons(left: dict[int, Hull], near: float) -> dict[Pair, Hull]:
    """Return the common hulls of all pairs that lie so near to each other."""
    if not left:
        return {}
    names = list(left)
    low, high = (np.array([bound(left[n].corners, 0) for n in names]) for bound in (np.min, np.max))
    gaps = np.maximum(low[:, None], low[None]) - np.minimum(high[:, None], high[None])
    pairs = np.argwhere(np.triu(gaps.max(2) <= near, 1))
    return {(names[a], names[b]): _common(left[names[a]], left[names[b]]) for a, b in pairs}


def _added(both: Hull, left: dict[int, Hull], pair: Pair) -> float:
    """Return how much more is empty once a pair is one."""
    return both.excess - left[pair[0]].excess - left[pair[1]].excess


def _common(one: Hull, two: Hull) -> Hull:
    return hull(np.concatenate([one.corners, two.corners]), one.real + two.real)


def _gap(one: Hull, two: Hull) -> float:
    """Return the distance between the boxes round two pieces, 0 where they touch."""
    low = np.maximum(one.corners.min(0), two.corners.min(0))
    high = np.minimum(one.corners.max(0), two.corners.max(0))
    return float(np.maximum(low - high, 0.0).max())
