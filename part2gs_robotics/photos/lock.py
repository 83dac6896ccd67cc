"""One frame for both states: the similarity that carries what stayed from state 1 to state 0.

Each state was registered on its own, so nothing that moved could disturb its cameras. Points
matched across the states then vote: what stayed moved by one similarity (another origin, other
axes, another scale), and every part that moved by another one. What stayed is the answer that
fills most of the room, not the one with most points: a part may hold half the pictures and
nearly all texture, but it stands in one place, and what stayed surrounds it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64

Bools = NDArray[np.bool_]

TRIALS = 2000  # triples: one of three right pairs among 15 % is drawn with probability 0.999
TOLERANCE = 0.02  # of a point's distance from the cameras' middle: SIFT points are off by a tenth
CELL = 0.15  # of the cameras' distance: a large part fills 15 cells, a room 69 to 178
ANSWERS = 3  # motions looked at: what stayed, and the two largest parts that moved
ROUNDS = 5  # of fitting anew to what agrees: plenty to settle, each takes a millisecond
FEWEST_PAIRS = 30  # a similarity has 7 unknowns: four times as many never agree by chance
RIVAL_SHARE = 0.6  # a second motion that fills more cells than this share may be what stayed


@dataclass(frozen=True)
class Lock:
    """How state 1 lies in the frame of state 0.

    Attributes:
        scale: lengths of state 0 per length of state 1.
        zero_from_one: [4, 4] rotation and shift, applied after scaling.
        kept: [M] pairs that stayed.
        cells: places of the room that they fill.
        rival: cells of the next best motion, what it shares with this one left out.
        residual: median distance of kept pairs, in units of state 0.
    """

    scale: float
    zero_from_one: F64
    kept: Bools
    cells: int
    rival: int
    residual: float

    @property
    def sure(self) -> bool:
        """Whether enough stayed, and no other motion fills nearly as much."""
        return int(self.kept.sum()) >= FEWEST_PAIRS and self.rival < RIVAL_SHARE * self.cells


def lock_states(first: F64, second: F64, middle: F64, radius: float) -> Lock | None:
    """Return how state 1 lies in the frame of state 0, None where fewer than three pairs agree.

    Args:
        first: [M, 3] points of state 0, its own frame.
        second: [M, 3] the same points' places in state 1's frame, wrong pairs among them.
        middle: [3] what the cameras of state 0 look at.
        radius: their distance from it.
    """
    rng = np.random.default_rng(0)
    reach = TOLERANCE * np.maximum(np.linalg.norm(first - middle, axis=1), radius)
    cells = _cells(first, middle, radius)
    left, found = np.ones(len(first), bool), []
    for _ in range(ANSWERS):
        best = _best(first, second, reach, left, rng)
        if best is None:
            break
        answer, agree = best
        found.append((_filled(cells[agree]), answer, agree))
        left &= ~agree
    if not found:
        return None
    order = sorted(range(len(found)), key=lambda n: -found[n][0])
    filled, (scale, move), agree = found[order[0]]
    rival = max((_filled(cells[found[n][2] & ~agree]) for n in order[1:]), default=0)
    gaps = np.linalg.norm(first - carried(second, scale, move), axis=1)
    return Lock(scale, move, agree, filled, rival, float(np.median(gaps[agree])))


def similarity(first: F64, second: F64) -> tuple[float, F64]:
    """Return scale and [4, 4] motion with first = motion (scale second), by least squares.

    Source: Umeyama 1991, without weights.

    Args:
        first: [N, 3], N >= 3, not on one line.
        second: [N, 3].
    """
    a, b = first.mean(0), second.mean(0)
    u, s, vt = np.linalg.svd((first - a).T @ (second - b))
    flip = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt)) or 1.0])
    rotation = (u * flip) @ vt
    scale = float((s * flip).sum() / max(((second - b) ** 2).sum(), 1e-300))
    move = np.eye(4)
    move[:3, :3], move[:3, 3] = rotation, a - scale * rotation @ b
    return scale, move


def carried(points: F64, scale: float, move: F64) -> F64:
    """Return [N, 3] points scaled, then moved."""
    return np.asarray(scale * points @ move[:3, :3].T + move[:3, 3])


def _best(first: F64, second: F64, reach: F64, left: Bools, rng: np.random.Generator,
          ) -> tuple[tuple[float, F64], Bools] | None:
    """Return the similarity that most of the pairs left agree on, and all that agree."""
    index = np.flatnonzero(left)
    if len(index) < 3:
        return None
    best, most = None, 2
    for _ in range(TRIALS):
        three = rng.choice(index, 3, replace=False)
        scale, move = similarity(first[three], second[three])
        near = np.linalg.norm(first - carried(second, scale, move), axis=1) < reach
        if scale > 0 and (near & left).sum() > most:
            best, most = near, int((near & left).sum())
    if best is None or most < FEWEST_PAIRS // 3:
        return None
    for _ in range(ROUNDS):
        scale, move = similarity(first[best], second[best])
        best = np.linalg.norm(first - carried(second, scale, move), axis=1) < reach
        if best.sum() < 3:
            return None
    return (scale, move), best


def _cells(points: F64, middle: F64, radius: float) -> NDArray[np.int64]:
    """Return [M] which place of the room each point is in; places grow with their distance."""
    away = (points - middle) / radius
    far = np.linalg.norm(away, axis=1, keepdims=True)
    grid = np.floor(away / np.maximum(far, 1e-9) * np.log1p(far) / CELL).astype(np.int64) + 512
    return np.asarray((grid[:, 0] << 20) + (grid[:, 1] << 10) + grid[:, 2])


def _filled(cells: NDArray[np.int64]) -> int:
    """Return how many places hold two points or more: one alone may be a wrong pair."""
    return int((np.unique(cells, return_counts=True)[1] > 1).sum())
