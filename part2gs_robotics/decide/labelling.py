"""Labelling of surfels: which motion carries each, and which motions are needed at all."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.decide.mean_field import NEVER, descend, wide
from part2gs_robotics.evidence.graph import Graph
from part2gs_robotics.evidence.landing import FREE_COST, Landing, land
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.runtime.jit import inlined, parallel_kernel

SMOOTHNESS = 0.12  # per neighbour: ten neighbours outvote a neutral surfel, not a clear one
NEUTRAL_COST = (
    0.3  # landing unobserved: a part is proven by contradictions it removes, not by what it hides
)
# Dearer than unseen at rest: 0.32 to 0.91 as many wrong labels, four scenes (0.01 to 0.1 tried).
UNSEEN_MOVES = 0.05
FOREIGN_COST = 0.35  # a surfel met that another motion carries: two surfaces cannot both become it
TEMPERATURES = (0.3, 0.2, 0.12, 0.07, 0.04)  # annealing of the mean field; costs are in 0..1
SWEEPS = 4  # per temperature
EVEN = (0.0,)  # what motions cost more than rest in a start of the mean field
# The better counts: a shared wall costs 76 or 60, a narrow one 41 or 60 (0.02 to 0.3: 61 to 59).
STARTS = (*EVEN, 0.1)
# Gained by hiding, of that by landing: true parts of 25 objects up to 10 times, false ones all.
HIDES = 16.0
BETTER = 0.02  # of the energy: less is noise, which cost a scene of seven alike fronts two parts


@inlined
def _cost(match: float, target: int, miss: float, theirs: float) -> float:
    """Return what a landing costs, at most a miss; theirs: the met surfel's share of the label."""
    if target < 0:
        return miss
    return min(match + FOREIGN_COST * (1.0 - theirs), max(miss, FOREIGN_COST))


@parallel_kernel
def _costs(match: F64, target: NDArray[np.int64], miss: F64, far: F64,
           q: NDArray[np.floating], out: NDArray[np.floating]) -> None:
    """Fill out [N, L or more]: what the surfel met costs; far from its part, more."""
    for i in numba.prange(len(match)):
        for k in range(match.shape[1]):
            j = target[i, k]
            out[i, k] = far[i, k] + _cost(match[i, k], j, miss[i, k], q[max(j, 0), k])


@parallel_kernel
def _own_costs(match: F64, target: NDArray[np.int64], miss: F64, far: F64,
               hard: NDArray[np.int64], out: F64) -> None:
    """Fill out [N] with what every surfel's landing costs under hard labels."""
    for i in numba.prange(len(match)):
        k = hard[i]
        j = target[i, k]
        theirs = 1.0 if hard[max(j, 0)] == k else 0.0
        out[i] = far[i, k] + _cost(match[i, k], j, miss[i, k], theirs)


@parallel_kernel
def _start(match: F64, target: NDArray[np.int64], miss: F64, temperature: float, lean: float,
           out: F32) -> None:
    """Fill out [N, L or more] with soft labels as if every surfel met were of the same part.

    lean: what is added to the cost of every label but rest.
    """
    for i in numba.prange(len(match)):
        whole = 0.0
        for k in range(match.shape[1]):
            free = match[i, k] if target[i, k] >= 0 else miss[i, k]
            free += lean if k else 0.0
            out[i, k] = np.exp(-free / temperature)
            whole += out[i, k]
        for k in range(match.shape[1]):
            out[i, k] /= whole


@parallel_kernel
def _energies(match: F64, target: NDArray[np.int64], miss: F64, far: F64, hard: NDArray[np.int64],
              neighbors: NDArray[np.int32], weights: NDArray[np.float32], out: F64) -> None:
    """Fill out [N] with what hard labels cost, each surfel alone and with its neighbours."""
    for i in numba.prange(len(match)):
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
        """These costs, but what moves (columns 1 ..) is a little dearer where nothing was seen."""
        miss = self.miss.copy()
        miss[:, 1:] += UNSEEN_MOVES * (miss[:, 1:] < FREE_COST)
        return Unary(self.match, self.target, miss, self.far)

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
    miss = np.stack([c[2] for c in columns], 1)
    return Unary(
        np.stack([c[0] for c in columns], 1),
        np.stack([c[1] for c in columns], 1),
        np.where(miss == FREE_COST, miss, NEUTRAL_COST),
    )


def label(unary: Unary, graph: Graph, sought: Unary | None = None,
          starts: tuple[float, ...] = STARTS) -> tuple[NDArray[np.int64], float]:
    """Return hard labels [N] and their energy by annealed mean field, from the better start.

    Args:
        unary: landing of every surfel under every motion.
        graph: neighbours.
        sought: the same with the ties broken that labels are found with; the energy is without.
        starts: what makes a motion dearer than rest at first; later ones must be better.
    """
    best = starts[0] if len(starts) == 1 else roughly(unary, graph, sought, starts)[2]
    return _found(unary, graph, sought, best, SWEEPS)


def roughly(unary: Unary, graph: Graph, sought: Unary | None = None,
            starts: tuple[float, ...] = STARTS) -> tuple[NDArray[np.int64], float, float]:
    """Return hard labels [N], their energy, and which start was better, by one sweep per step.

    Enough to tell good sets of motions and starts from bad. Arguments as of `label`.
    """
    tried = {lean: _found(unary, graph, sought, lean, 1) for lean in starts}
    best = starts[0]
    for lean in starts[1:]:
        best = lean if tried[lean][1] < (1 - BETTER) * tried[best][1] else best
    return *tried[best], best


def _found(unary: Unary, graph: Graph, sought: Unary | None, lean: float, sweeps: int,
           ) -> tuple[NDArray[np.int64], float]:
    """Return hard labels [N] from one start and their energy."""
    weights = (SMOOTHNESS * graph.weights).astype(np.float32)
    hard = _annealed(sought or unary, graph.neighbors, weights, lean, sweeps)
    return hard, energy_of(unary, graph, hard)


def energy_of(unary: Unary, graph: Graph, hard: NDArray[np.int64]) -> float:
    """Return what hard labels [N] cost, all surfels together."""
    energies = np.zeros(len(hard))
    _energies(unary.match, unary.target, unary.miss, unary.everywhere, hard, graph.neighbors,
              graph.weights, energies)
    return float(energies.sum())


def vanished(unary: Unary, hard: NDArray[np.int64]) -> float:
    """Return what moving parts gain by hiding beyond `HIDES` times what they gain by landing.

    A motion is proven by what it lands: to put a thing where nobody can see it explains anything.
    """
    rest, own = (unary.own(label) for label in (np.zeros_like(hard), hard))
    gain = np.maximum(rest - own, 0.0)
    met, miss = unary.target[np.arange(len(hard)), hard], unary.miss[np.arange(len(hard)), hard]
    lands = (met >= 0) & (hard[met] == hard)
    landed, hidden = (np.bincount(hard, gain * here, unary.match.shape[1])[1:]
                      for here in (lands, ~lands & (miss < FREE_COST)))
    return float(np.maximum(hidden - HIDES * landed, 0.0).sum())


def _annealed(unary: Unary, neighbors: NDArray[np.int32], weights: F32, lean: float, sweeps: int,
              ) -> NDArray[np.int64]:
    """Return hard labels [N] by mean field from one start, `sweeps` per temperature."""
    parts, far = (unary.match, unary.target, unary.miss), unary.everywhere
    count, labels = unary.match.shape
    q, cost = (wide(count, labels, fill) for fill in (0.0, NEVER))
    _start(*parts, TEMPERATURES[0], lean, q)
    for temperature in TEMPERATURES:
        _costs(*parts, far, q, cost)
        q = descend(cost, q, neighbors, weights, temperature, sweeps)
    return q.argmax(1)
