"""Who is odd: files say the same thing, and the few that say another are at fault."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from part2gs_robotics.model.arrays import F64

COPIES = {"scene.xml": "twin_actuated.xml"}  # what a file includes, it does not say itself
Far = Callable[[F64, F64], float]


@dataclass(frozen=True)
class Vote:
    """What most files say.

    Attributes:
        winner: file whose value most others share, the first of them.
        agreed: files that say the same.  odd: the others with their distance from it.
        worst: largest distance among those that agree.
    """

    winner: str
    agreed: tuple[str, ...]
    odd: dict[str, float]
    worst: float

    @property
    def said(self) -> str:
        """Who says the other thing, for people."""
        return f"{', '.join(self.agreed)} {'say' if len(self.agreed) > 1 else 'says'}"


def vote(values: Mapping[str, F64], far: Far, limits: Mapping[str, float]) -> Vote:
    """Return what most files say; of equally many, what the first file says.

    Args:
        values: by file, in order of trust; at least one.
        far: distance of two values; NaN = they cannot be compared, so they differ.
        limits: by file, up to which its value is the same as another; 0 where it is not named.
    """
    names = list(values)
    gaps = {a: {b: far(values[a], values[b]) for b in names} for a in names}
    voters = [n for n in names if COPIES.get(n) not in names]
    near = {a: [b for b in names if gaps[a][b] <= max(limits.get(a, 0.0), limits.get(b, 0.0))]
            for a in names}
    exact = min(limits.get(n, 0.0) for n in voters)  # a looser one would be like two that differ
    winner = max((n for n in voters if limits.get(n, 0.0) <= exact),
                 key=lambda n: (len(set(near[n]) & set(voters)), -names.index(n)))
    agreed = tuple(near[winner]) or (winner,)
    odd = {n: gaps[winner][n] for n in names if n not in agreed}
    for copy, source in COPIES.items():  # told once, where it is written
        if copy in odd and source in odd and source in near[copy]:
            del odd[copy]
    return Vote(winner, agreed, odd, max(gaps[winner][n] for n in agreed))


def apart(a: F64, b: F64) -> float:
    """Return the largest difference of two arrays; equal infinities differ by nothing."""
    if a.shape != b.shape:
        return float("inf")
    same = a == b
    return float(np.abs(np.where(same, 0.0, a) - np.where(same, 0.0, b)).max(initial=0.0))


def relative(a: F64, b: F64) -> float:
    """Return the largest difference of two arrays, of the largest number in either."""
    gap, scale = apart(a, b), max(np.abs(a).max(initial=0.0), np.abs(b).max(initial=0.0))
    return gap if gap == 0.0 else float(gap / scale)


def cloud(a: F64, b: F64) -> float:
    """Return the Hausdorff distance of two sets of points [N, 3]."""
    if not len(a) or not len(b):
        return 0.0 if len(a) == len(b) else float("inf")
    if a.shape == b.shape and (direct := apart(a, b)) < np.ptp(a):
        order = np.lexsort(a.T), np.lexsort(b.T)
        return min(direct, apart(a[order[0]], b[order[1]])) if direct > 0 else direct
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        return float("nan")
    from scipy.spatial import cKDTree

    one, two = cKDTree(a).query(b)[0], cKDTree(b).query(a)[0]
    return float(max(one.max(), two.max()))
