"""Pairs of Gaussians of both states, as the paper matches them (eq. 2)."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from part2gs_robotics.model.arrays import F64, I64
from part2gs_robotics.model.points import farthest, outermost

MAX_MATCHES = 5000  # samples: ArtGS matches no more
NUM_MATCHES = 2000  # the assignment is O(n^3): so many take 1.5 s on one core


def match_hungarian(points0: F64, points1: F64, num_matches: int = NUM_MATCHES) -> I64:
    """Return [M, 2] pairs of least total distance between bounded subsamples.

    Least total distance is no rigid correspondence (pairs cross under turns above ~30 deg):
    use it to start, then re-match under the joint hypothesis.

    Args:
        points0: [N0, 3] scene units.
        points1: [N1, 3] scene units.
        num_matches: bound; M = min(N0, N1, num_matches, MAX_MATCHES).

    Source: Part2GS eq. 2; the bound as in ArtGS.
    """
    count = min(len(points0), len(points1), num_matches, MAX_MATCHES)
    if count == 0:
        return np.zeros((0, 2), np.int64)
    index0, index1 = (farthest(p, count, outermost(p)) for p in (points0, points1))
    rows, cols = linear_sum_assignment(cdist(points0[index0], points1[index1]))
    return np.stack([index0[rows], index1[cols]], 1).astype(np.int64)
