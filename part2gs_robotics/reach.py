"""Reach: what one state hides belongs to the part whose proven surface is nearest along it.

The floor of a drawer is unseen while the drawer is closed: every motion that hides it explains it
equally well. It hangs together with the drawer's front, which only one motion explains.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from part2gs_robotics.decide import Judge
from part2gs_robotics.joint_fit import move_of
from part2gs_robotics.joints import Joint
from part2gs_robotics.labelling import Unary, label, unary_costs
from part2gs_robotics.study import Study

F64 = NDArray[np.float64]
Labels = NDArray[np.int64]
PROVEN = 0.25  # landing cost: a fair match, well below an unobserved place
MARGIN = 0.1  # that every other label costs more
REACH = 0.15  # of the diagonal, along the surface: farther apart all labels are equally far
FAR_COST = 0.15  # half of what an unobserved place costs: breaks ties, outvotes no match
ROUNDS = 2  # of proving and labelling; a third changes less than 0.1 % of the labels


def claim(judge: Judge, joints: list[Joint], hard: Labels) -> tuple[Labels, F64]:
    """Return labels [N0 + N1] and costs [N0 + N1, K+1] with unobserved surfels claimed by reach.

    Args:
        judge: of the study.
        joints: of parts 1..K.
        hard: [N0 + N1] labels to start from.
    """
    study = judge.study
    moves = [np.eye(4), *(move_of(j) for j in joints)]
    unary = unary_costs(moves, study.surfels, judge.lands, study.tau)
    surface = _surface(study)
    for _ in range(ROUNDS):
        costs = unary.cost(np.eye(len(moves))[hard])
        far = _far(costs, hard, surface, REACH * study.diag)
        hard, _ = label(Unary(unary.match, unary.target, unary.miss, far), study.graph)
    costs = unary.cost(np.eye(len(moves))[hard]) + far
    return hard, costs


def _surface(study: Study) -> csr_matrix:
    """Return the distances between neighbouring surfels as a symmetric sparse matrix."""
    points = np.concatenate([s.points for s in study.surfels])
    neighbors = study.graph.neighbors
    rows, cols = np.repeat(np.arange(len(points)), neighbors.shape[1]), neighbors.ravel()
    gaps = np.linalg.norm(points[rows] - points[cols], axis=1)
    one_way = csr_matrix((gaps, (rows, cols)), shape=(len(points), len(points)))
    return one_way.maximum(one_way.T)


def _far(costs: F64, hard: Labels, surface: csr_matrix, reach: float) -> F64:
    """Return [N, L] cost of the way along the surface to a surfel proven to have the label."""
    rows = np.arange(len(hard))
    own, others = costs[rows, hard], costs.copy()
    others[rows, hard] = np.inf
    proven = (own < PROVEN) & (own + MARGIN < others.min(1))
    far = np.full(costs.shape, FAR_COST)
    for k in range(costs.shape[1]):
        sources = np.flatnonzero(proven & (hard == k))
        if len(sources):
            way = dijkstra(surface, indices=sources, min_only=True, limit=reach)
            far[:, k] *= np.minimum(way / reach, 1.0)
    return far
