"""Loose: what a part does not hold together by what is seen, or does not land.

A part is one body, and a motion is proven by what it lands: two bodies that are carried alike are
no simpler than two parts, and to put a thing where nobody can see it explains anything.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from part2gs_robotics.decide.candidate import price
from part2gs_robotics.decide.labelling import Unary
from part2gs_robotics.model.arrays import F64, Labels, Mask

# Gained by hiding, of that by landing, by true parts: nearly all up to 7.7, one of them 10.
HIDES = 10.0
# Of a part's price, for a body in the air: at 1.0 two parts alike were as dear as one of two.
HELD = 1.5
ENDS = 2.0, 98.0  # percentiles: a body's outline without what strays
BEHIND = 0.5  # of a body, in that outline: backs lie behind their front, neighbours beside it


def vanished(unary: Unary, hard: Labels) -> tuple[float, Labels]:
    """Return what moving parts gain by hiding beyond `HIDES` times what they gain by landing.

    A motion is proven by what it lands: to put a thing where nobody can see it explains anything.
    What a part gains is beyond rest, and beyond all parts that are proven better: of look-alikes
    each hides most of what another lands.

    Returns:
        That gain, all parts together, and labels [N] as photos see them: of a part that hides too
        much, what is gained by no landing looks as the best of the others would have it.
    """
    labels, rows = unary.match.shape[1], np.arange(len(hard))
    costs, own = unary.of_parts(hard), unary.own(hard)
    met = unary.target[rows, hard]
    lands = (met >= 0) & (hard[met] == hard)
    proof = np.bincount(hard, lands * np.maximum(costs[:, 0] - own, 0.0), labels)
    order = np.concatenate([[0], 1 + np.argsort(-proof[1:], kind="stable")])  # rest, best proven ..
    proven = (proof > 0) | (np.arange(labels) == 0)
    costs = np.where(proven, costs, np.inf)
    for part in np.flatnonzero(~proven):  # nothing tells its surfels apart: one other has them all
        own_ones = hard == part
        least = costs[own_ones].sum(0).argmin()
        costs[own_ones] = np.where(np.arange(labels) == least, costs[own_ones], np.inf)
    before = np.minimum.accumulate(costs[:, order], 1)[rows, np.maximum(np.argsort(order)[hard], 1)
                                                       - 1]
    gain = np.maximum(before - own, 0.0)
    landed, hidden = (np.bincount(hard, gain * here, labels) for here in (lands, ~lands))
    excess = np.maximum(hidden - HIDES * landed, 0.0)
    excess[0] = 0.0  # what rests gains nothing
    seen = hard.copy()
    for place, part in enumerate(order):
        if excess[part] > 0:
            idle = (hard == part) & ~(lands & (gain > 0))
            seen[idle] = order[costs[idle][:, order[:place]].argmin(1)]
    return float(excess.sum()), seen


def hanging(hard: Labels, body: Labels) -> Mask:
    """Return [N] which surfels are not of the largest body of their part.

    Args:
        hard: [N] labels; 0 rests.
        body: [N] see `bodies_of`.
    """
    moving = hard > 0
    sizes, of = np.bincount(body, moving), np.zeros(body.max(initial=-1) + 1, np.int64)
    of[body[moving]] = hard[moving]
    largest = np.zeros(of.max(initial=0) + 1, np.int64)
    order = np.argsort(sizes, kind="stable")
    largest[of[order]] = order  # the last one stays
    return np.asarray(moving & (body != largest[hard]))


def hung(hanging: Mask, body: Labels) -> float:
    """Return what telling of hanging bodies [N] costs, in prices of a part.

    Something that no photo shows must hold each: more than a joint of its own would be. What is so
    small that a part of it would be told by its joint alone may be noise, and costs nothing.
    """
    shares = np.bincount(body[hanging], minlength=1) / max(len(body), 1)
    return float((HELD * 2.0 * (price(shares) - price(0.0))).sum())


def behind(body: Labels, hard: Labels, points: F64, axes: Sequence[F64 | None]) -> Mask:
    """Return [N] the hanging surfels whose body lies behind the rest of its part, as it slides.

    What holds a drawer's back to its front is its floor, which hides in the cabinet.

    Args:
        body: [N] see `bodies_of`.
        hard: [N] labels; 0 rests.
        points: [N, 3] of either state: a slide moves none of them sideways.
        axes: unit ones of parts 1..K that slide on the base, None = of another part.
    """
    loose = hanging(hard, body)
    out = np.zeros_like(loose)
    for part in np.unique(hard[loose]):
        own, axis = hard == part, axes[part - 1]
        if axis is None:
            continue
        sideways = points[own] @ np.linalg.svd(axis[None])[2][1:].T
        low, high = np.percentile(sideways[~loose[own]], ENDS, axis=0)
        inside = ((sideways >= low) & (sideways <= high)).all(1)
        shares = np.bincount(body[own], inside) / np.maximum(np.bincount(body[own]), 1)
        out[own] = loose[own] & (shares[body[own]] > BEHIND)
    return out


def bodies_of(hard: Labels, met: Labels, neighbors: NDArray[np.int32], touching: Mask) -> Labels:
    """Return [N] the number of the connected body of its part that every moving surfel is in.

    Args:
        hard: [N] labels; 0 rests.
        met: [N] the surfel of the same part that it meets in the other state, -1 = none.
        neighbors: [N, k] rows.
        touching: [N, k] which of them are near enough.
    """
    here = np.flatnonzero(hard)
    near = touching[here] & (hard[neighbors[here]] == hard[here, None])
    meets = here[met[here] >= 0]
    rows = np.concatenate([np.repeat(here, near.sum(1)), meets])
    links = csr_matrix((np.ones(len(rows), np.int8),
                        (rows, np.concatenate([neighbors[here][near], met[meets]]))),
                       (len(hard), len(hard)))
    return np.asarray(connected_components(links, directed=False)[1], np.int64)
