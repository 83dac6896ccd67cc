"""Labelling of surfels: which motion carries each, and which motions are needed at all."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.decide.cut import Ints, Net, minimum_cut
from part2gs_robotics.evidence.graph import GRAIN, SMOOTHNESS, Graph, Web
from part2gs_robotics.evidence.landing import FREE_COST, HIDDEN_COST, Landing, land
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64, Labels
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel

NEUTRAL_COST = (
    0.3  # landing unobserved: a part is proven by contradictions it removes, not by what it hides
)
# Dearer than unseen at rest: 0.32 to 0.91 as many wrong labels, four scenes (0.01 to 0.1 tried).
UNSEEN_MOVES = 0.05
# Dearer than landing as well at rest: a round post on a hinge's line turns without being seen to.
MOVES = 0.02
FOREIGN_COST = 0.35  # a surfel met that another motion carries: two surfaces cannot both become it


@inlined
def _cost(match: float, target: int, miss: float, theirs: float) -> float:
    """Return what a landing costs, at most a miss; theirs: the met surfel's share of the label."""
    if target < 0:
        return miss
    return min(match + FOREIGN_COST * (1.0 - theirs), max(miss, FOREIGN_COST))


@kernel
def _costs(match: F64, target: NDArray[np.int64], miss: F64, far: F64,
           q: NDArray[np.floating], out: NDArray[np.floating]) -> None:
    """Fill out [N, L or more]: what the surfel met costs; far from its part, more."""
    for_each(len(match), _costs_at, (match, target, miss, far, q, out))


@inlined
def _costs_at(i: int, match: F64, target: NDArray[np.int64], miss: F64, far: F64,
              q: NDArray[np.floating], out: NDArray[np.floating]) -> None:
    for k in range(match.shape[1]):
        j = target[i, k]
        out[i, k] = far[i, k] + _cost(match[i, k], j, miss[i, k], q[max(j, 0), k])


@kernel
def _own_costs(match: F64, target: NDArray[np.int64], miss: F64, far: F64,
               hard: NDArray[np.int64], out: F64) -> None:
    """Fill out [N] with what every surfel's landing costs under hard labels."""
    for_each(len(match), _own_costs_at, (match, target, miss, far, hard, out))


@inlined
def _own_costs_at(i: int, match: F64, target: NDArray[np.int64], miss: F64, far: F64,
                  hard: NDArray[np.int64], out: F64) -> None:
    k = hard[i]
    j = target[i, k]
    theirs = 1.0 if hard[max(j, 0)] == k else 0.0
    out[i] = far[i, k] + _cost(match[i, k], j, miss[i, k], theirs)


@kernel
def _energies(match: F64, target: NDArray[np.int64], miss: F64, far: F64, hard: NDArray[np.int64],
              neighbors: NDArray[np.int32], weights: NDArray[np.float32], out: F64) -> None:
    """Fill out [N] with what hard labels cost, each surfel alone and with its neighbours."""
    for_each(len(match), _energies_at, (match, target, miss, far, hard, neighbors, weights, out))


@inlined
def _energies_at(i: int, match: F64, target: NDArray[np.int64], miss: F64, far: F64,
                 hard: NDArray[np.int64], neighbors: NDArray[np.int32],
                 weights: NDArray[np.float32], out: F64) -> None:
    k = hard[i]
    j = target[i, k]
    theirs = 1.0 if hard[max(j, 0)] == k else 0.0
    whole = far[i, k] + _cost(match[i, k], j, miss[i, k], theirs)
    for n in range(neighbors.shape[1]):
        if hard[neighbors[i, n]] != k:
            whole += SMOOTHNESS * weights[i, n]
    out[i] = whole


@dataclass(frozen=True)
class Unary:
    """Landing of every surfel of both states under L motions (column 0 = static).

    Attributes:
        match: [N, L] cost of the surfel met.  target: [N, L] that surfel's row, -1 = none met.
        miss: [N, L] cost of meeting nothing there (free or hidden).
        far: [N, L] cost of being far from what is proven to have the label.
    """

    match: F64
    target: NDArray[np.int64]
    miss: F64
    far: F64 | float = 0.0

    @property
    def everywhere(self) -> F64:
        """`far` as an array [N, L] of its own: kernels are compiled for one kind of array."""
        return np.full(self.match.shape, self.far, np.float64)

    @property
    def resting(self) -> Unary:
        """These costs, but what moves (columns 1 ..) is a little dearer, to rest where it may."""
        match, miss = self.match.copy(), self.miss.copy()
        match[:, 1:] += MOVES
        miss[:, 1:] += UNSEEN_MOVES * (FREE_COST - miss[:, 1:]) / (FREE_COST - NEUTRAL_COST)
        return Unary(match, self.target, miss, self.far)

    def cost(self, q: NDArray[np.floating]) -> F64:
        """Return [N, L] costs given soft labels: a surface carried by another part is no match."""
        out = np.zeros_like(self.match)
        _costs(self.match, self.target, self.miss, self.everywhere, q, out)
        return out

    def own(self, hard: NDArray[np.int64]) -> F64:
        """Return [N] what `cost` says of every surfel's own label, given hard ones."""
        out = np.zeros(len(hard))
        _own_costs(self.match, self.target, self.miss, self.everywhere, hard, out)
        return out

    def of_parts(self, hard: Labels) -> F64:
        """Return [N, L] costs of every label if a surfel's whole part took it along, hard [N]."""
        met = hard[np.maximum(self.target, 0)]
        theirs = (met == np.arange(self.match.shape[1])) | (met == hard[:, None])
        found = np.minimum(self.match + FOREIGN_COST * ~theirs, np.maximum(self.miss, FOREIGN_COST))
        return np.asarray(np.where(self.target < 0, self.miss, found) + self.far)


def unary_costs(
    moves: list[F64], states: tuple[Surfels, Surfels], lands: tuple[Landing, Landing], tau: float
) -> Unary:
    """Return how every surfel lands in the other state under every motion."""
    n0 = len(states[0])
    columns: list[tuple[F64, NDArray[np.int64], F64]] = []
    for move in moves:
        zero, one = (
            land(move, states[0], lands[1], tau),
            land(se3.inverse(move), states[1], lands[0], tau),
        )
        target = np.concatenate([np.where(zero[1] >= 0, zero[1] + n0, -1), one[1]])
        columns.append(
            (np.concatenate([zero[0], one[0]]), target, np.concatenate([zero[2], one[2]]))
        )
    sure = (np.stack([c[2] for c in columns], 1) - HIDDEN_COST) / (FREE_COST - HIDDEN_COST)
    return Unary(
        np.stack([c[0] for c in columns], 1),
        np.stack([c[1] for c in columns], 1),
        NEUTRAL_COST + (FREE_COST - NEUTRAL_COST) * sure,
    )


def label(unary: Unary, web: Web, hard: Labels, asked: Iterable[int] | None = None) -> Labels:
    """Return labels [N] that no exchange of any one label for others makes cheaper.

    Every step is exact: all surfels at once keep their label or take the one asked for, whichever
    costs least together with landings, neighbours and bonds (alpha expansion: Boykov, Veksler,
    Zabih, 2001; the cost of meeting another part's surface is submodular, so one cut solves it).

    Args:
        unary: landing of every surfel under every motion.
        web: what neighbours with two labels cost.
        hard: [N] labels to start from.
        asked: labels that are tried, each once; None = all, until none helps.
    """
    columns = columns_of(unary)
    if asked is not None:
        for one in asked:
            hard = expanded(columns, web, hard, one)
        return hard
    count, idle, one = unary.match.shape[1], 0, 1
    while idle < count:
        new = expanded(columns, web, hard, one % count)
        idle = idle + 1 if (new == hard).all() else 1
        hard, one = new, one + 1
    return hard


@dataclass(frozen=True)
class Columns:
    """Landing costs in whole numbers, `GRAIN` to one.

    Attributes:
        target: [N, L] the surfel met, -1 = none.
        ours: [N, L] cost if that surfel has the label as well.  others: if it has not.
    """

    target: Ints
    ours: Ints
    others: Ints


def columns_of(unary: Unary) -> Columns:
    """Return the landing costs of every surfel under every label in whole numbers."""
    most, met = np.maximum(unary.miss, FOREIGN_COST), unary.target >= 0
    ours, others = (
        np.round(GRAIN * (np.where(met, np.minimum(unary.match + more, most), unary.miss)
                          + unary.far)).astype(np.int32)
        for more in (0.0, FOREIGN_COST))
    return Columns(unary.target.astype(np.int32), ours, others)


@kernel
def _ends(target: Ints, ours: Ints, others: Ints, first: Ints, to: Ints, cost: Ints,
          hard: Labels, one: int, ends: Ints, degrees: Ints) -> None:
    """Fill ends [N]: what taking a label costs beyond what keeping costs; degrees: arcs of each."""
    for i in range(len(hard)):
        own = hard[i]
        if own == one:
            continue
        j, takes = target[i, one], ours[i, one]  # dearer by an arc if the one met keeps another
        if j >= 0 and hard[j] != one and others[i, one] > takes:
            degrees[i] += 1
            degrees[j] += 1
        j = target[i, own]
        keeps = ours[i, own] if j < 0 or hard[j] == own else others[i, own]
        if j >= 0 and hard[j] == own and others[i, own] > ours[i, own]:
            degrees[i] += 1
            degrees[j] += 1
        for arc in range(first[i], first[i + 1]):
            j = to[arc]
            if hard[j] == one:
                keeps += cost[arc]
            else:
                degrees[i] += 1
                if hard[j] != own and i < j:
                    keeps += cost[arc]
        ends[i] = takes - keeps


@kernel
def _arcs(target: Ints, ours: Ints, others: Ints, first: Ints, to: Ints, cost: Ints,
          hard: Labels, one: int, begin: Ints, out: tuple[Ints, Ints, Ints]) -> None:
    """Fill node, arc back and capacity of every arc of the cut's graph; begin: where each starts.

    An arc is cut where its first node keeps its label and its second takes the one asked for.
    """
    nodes, sister, cap = out
    for i in range(len(hard)):
        own = hard[i]
        if own == one:
            continue
        j = target[i, one]
        if j >= 0 and hard[j] != one and others[i, one] > ours[i, one]:
            _join(j, i, others[i, one] - ours[i, one], 0, begin, nodes, sister, cap)
        j = target[i, own]
        if j >= 0 and hard[j] == own and others[i, own] > ours[i, own]:
            _join(i, j, others[i, own] - ours[i, own], 0, begin, nodes, sister, cap)
        for arc in range(first[i], first[i + 1]):
            j = to[arc]
            if i < j and hard[j] != one:
                _join(j, i, cost[arc], cost[arc] if hard[j] == own else 0, begin, nodes, sister,
                      cap)


@inlined
def _join(i: int, j: int, there: int, back: int, begin: Ints, nodes: Ints, sister: Ints, cap: Ints,
          ) -> None:
    """Add two arcs between two nodes, and move where the next ones of both start."""
    a, b = begin[i], begin[j]
    begin[i] += 1
    begin[j] += 1
    nodes[a], sister[a], cap[a] = j, b, there
    nodes[b], sister[b], cap[b] = i, a, back


def assembled(columns: Columns, web: Web, hard: Labels, one: int) -> tuple[Net, Ints]:
    """Return the graph whose least cut is the best exchange, see `minimum_cut`."""
    costs = columns.target, columns.ours, columns.others, web.first, web.to, web.cost
    ends, degrees = np.zeros((2, len(hard)), np.int32)
    _ends(*costs, hard, one, ends, degrees)
    first = np.concatenate([[0], np.cumsum(degrees)]).astype(np.int32)
    to, sister, cap = np.zeros((3, int(first[-1])), np.int32)
    _arcs(*costs, hard, one, first[:-1].copy(), (to, sister, cap))
    return (first, to, sister, cap), ends


def expanded(columns: Columns, web: Web, hard: Labels, one: int) -> Labels:
    """Return the labels [N] after the best exchange of any of them for one; as given if none."""
    arcs, ends = assembled(columns, web, hard, one)
    return np.where(minimum_cut(arcs, ends), one, hard)


def energy_of(unary: Unary, graph: Graph, hard: NDArray[np.int64]) -> float:
    """Return what hard labels [N] cost, all surfels together."""
    energies = np.zeros(len(hard))
    _energies(unary.match, unary.target, unary.miss, unary.everywhere, hard, graph.neighbors,
              graph.weights, energies)
    return float(energies.sum())
