"""Reach: what one state hides belongs to the part whose proven surface is nearest along it.

The floor of a drawer is unseen while the drawer is closed: every motion that hides it explains it
equally well. It hangs together with the drawer's front, which only one motion explains.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from part2gs_robotics.decide.candidate import Candidate
from part2gs_robotics.decide.labelling import FOREIGN_COST, NEUTRAL_COST, Unary, label, unary_costs
from part2gs_robotics.decide.passage import PASS_COST, Seen, passage_costs
from part2gs_robotics.decide.surrounded import joined
from part2gs_robotics.evidence.graph import Graph, ways_from
from part2gs_robotics.evidence.landing import MATCHED, Landing
from part2gs_robotics.evidence.study import Study
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64, Labels, Mask
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel

Lands = tuple[Landing, Landing]
MARGIN = 0.1  # that every other label costs more
AGREED = 0.8  # of the neighbours of a proof are proofs too: similar grain proves patches by chance
SHELLS = 4  # times that is asked: patches less than four surfels wide are such chances
KEPT = 0.25  # of a part's proofs at least: a drawer's front may be no wider than its handle
REACH = 0.5  # of the diagonal, along the surface: farther apart all labels are equally far
# Of the diagonal, added to ways to moving parts: hinges touch the rest (0 to 0.04 swept, 9 scenes).
STAYS = 0.03
LEAD = 0.02  # of the diagonal, two surfels: what a way must be longer to count in full
FAR_COST = 0.15  # half of what an unobserved place costs: breaks ties, outvotes no match
ROUNDS = 2  # of proving and labelling; a third changes less than 0.1 % of the labels


def claim(study: Study, lands: Lands, found: Candidate, stays: float = 0.0) -> Labels:
    """Return labels [N0 + N1] with unobserved surfels claimed by reach.

    Args:
        study: both states.
        lands: landing grids of both states, nothing claimed.
        found: motions, and labels to start from.
        stays: diagonals by which a moving part must be nearer than the base to claim a surfel.
    """
    hard = found.labels
    moves = [np.eye(4), *(j.state1_from_0 for j in found.motions)]
    unary = unary_costs(moves, study.surfels, lands, study.tau)
    extra = np.zeros_like(unary.match)
    for turn in range(ROUNDS):
        costs = unary.cost(np.eye(len(moves))[hard])
        proofs = _proofs(costs, hard)
        cores = _cores(proofs, study.graph)
        # Once joints are final (used before, it cost a draft a true part), and once ways have
        # told parts apart that hide it alike.
        if turn and stays:
            slides = np.array([False, *(j.kind == "prismatic" for j in found.motions)])
            cores |= _cores(_gone(costs, extra, hard) & slides, study.graph)
        extra = _far(cores, study.ways, study.diag, stays) + _passing(study, costs, proofs, found)
        hard = label(Unary(unary.match, unary.target, unary.miss, extra), study.web, hard)
    normals = np.concatenate([s.normals for s in study.surfels])
    return joined(hard, unary, study.graph, normals, _carried_by(study, moves),
                  len(study.surfels[0].points))


def _carried_by(study: Study, moves: list[F64]) -> F64:
    """Return [N0 + N1, L] how far every motion carries surfels, diagonals of the object."""
    back = [se3.inverse(move) for move in moves]
    return np.concatenate([
        np.stack([np.linalg.norm(se3.apply(m, s.points) - s.points, axis=1) for m in there], 1)
        for s, there in zip(study.surfels, (moves, back), strict=True)]) / study.diag


def _passing(study: Study, costs: F64, proofs: NDArray[np.bool_], found: Candidate) -> F64:
    """Return [N, L] cost of passing through other parts, where that could change a label."""
    least = np.partition(costs, 1, axis=1)
    asked = np.flatnonzero(least[:, 1] - least[:, 0] < PASS_COST + FAR_COST)
    points, normals = (np.concatenate([getattr(s, name) for s in study.surfels])
                       for name in ("points", "normals"))
    late = np.arange(len(points)) >= len(study.surfels[0])
    out = np.zeros_like(costs)
    seen = Seen(points, normals, late, proofs)
    out[asked] = passage_costs(seen, asked, found.motions, found.parents, study.lands[0].voxel)
    out[costs[:, 0] < MATCHED, 0] = 0.0  # seen in one place in both states: nothing passed there
    return out


def _proofs(costs: F64, hard: Labels) -> NDArray[np.bool_]:
    """Return [N, L] which surfels only one label explains well."""
    rows = np.arange(len(hard))
    own, others = costs[rows, hard], costs.copy()
    others[rows, hard] = np.inf
    proven = (own < MATCHED) & (own + MARGIN < others.min(1))
    return np.asarray(proven[:, None] & (hard[:, None] == np.arange(costs.shape[1])))


def _gone(costs: F64, extra: F64, hard: Labels) -> NDArray[np.bool_]:
    """Return [N, L] which surfels are seen not to rest, and are nearest to one part by far.

    The pulled-out half of a drawer's floor is hidden where it was, yet no less proven than a match:
    its place was seen empty. What hangs together with it, still inside, goes with it.
    """
    rows = np.arange(len(hard))
    own, whole = costs[rows, hard], costs + extra
    others = whole.copy()
    others[rows, hard] = np.inf
    gone = (own < FOREIGN_COST) & (costs[:, 0] > own + NEUTRAL_COST)
    gone &= others.min(1) > whole[rows, hard] + MARGIN
    return np.asarray(gone[:, None] & (hard[:, None] == np.arange(costs.shape[1])))


def _cores(proofs: NDArray[np.bool_], graph: Graph) -> NDArray[np.bool_]:
    """Return [N, L] the proofs amid others of their label."""
    return np.stack([_core(own, graph) for own in proofs.T], 1)


def _core(proofs: NDArray[np.bool_], graph: Graph) -> NDArray[np.bool_]:
    """Return the proofs amid proofs; a part that has no wide patch of them keeps narrow ones."""
    proofs, fewest = np.ascontiguousarray(proofs), KEPT * proofs.sum()  # one kernel for both
    for _ in range(SHELLS):
        inner = np.zeros_like(proofs)
        _amid(proofs, graph.neighbors, AGREED, inner)
        if inner.sum() < fewest:
            break
        proofs = inner
    return proofs


@kernel
def _amid(proofs: Mask, neighbors: NDArray[np.int32], agreed: float, out: Mask) -> None:
    """Mark the proofs of whose neighbours such a share are proofs."""
    ring = neighbors.shape[1]
    for_each(len(proofs), _amid_at, (proofs, neighbors, agreed, out, ring))


@inlined
def _amid_at(i: int, proofs: Mask, neighbors: NDArray[np.int32], agreed: float, out: Mask,
             ring: int) -> None:
    if proofs[i]:
        count = 0
        for n in range(ring):
            count += proofs[neighbors[i, n]]
        out[i] = count / ring >= agreed


def _far(proven: NDArray[np.bool_], surface: csr_matrix, diag: float, stays: float) -> F64:
    """Return [N, L] cost of being farther from what is proven to have a label than from others.

    Column 0 is the base: where a part is not clearly nearer, what nothing shows to move stays.
    """
    # What lags more costs all, whatever its way; twice, as sums are rounded.
    ways = ways_from(surface, proven, REACH * diag, 2.0 * (LEAD + stays) * diag)
    ways[:, 1:] += stays * diag
    behind = ways - ways.min(1, keepdims=True)
    return FAR_COST * np.minimum(behind / (LEAD * diag), 1.0)
