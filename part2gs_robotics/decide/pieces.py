"""Bodies: what one motion carries in several pieces that nothing joins may be several parts."""

from __future__ import annotations

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint

GAP = 0.02  # of the diagonal, two surfels: pieces nearer to each other are joined
PIECE = 0.15  # of a part's surfels: less is a handle or a patch gone astray


def at_home(h: Joint, own: tuple[Surfels, Surfels]) -> F64:
    """Return [n, 3] points of a part's surfels of both states, where they are in state 0."""
    zero, one = own
    return np.concatenate([zero.points, se3.apply(se3.inverse(h.move), one.points)])


def apart(one: Joint, two: Joint, own: tuple[Surfels, Surfels]) -> float:
    """Return how far apart two motions carry a part's surfels on average, scene units.

    Args:
        one: a motion.
        two: another one, that of the surfels.
        own: the part's surfels of both states; infinitely far without any.
    """
    points = at_home(two, own)
    gaps = np.linalg.norm(se3.apply(one.move, points) - se3.apply(two.move, points), axis=1)
    return float(gaps.mean()) if len(points) else float("inf")


def pieces(h: Joint, own: tuple[Surfels, Surfels], diag: float, least: int,
           ) -> list[tuple[Surfels, Surfels]]:
    """Return the surfels of every piece of a part, the largest first.

    Args:
        h: motion of the part.
        own: its surfels of both states.
        diag: of the object, scene units.
        least: surfels in either state that make a piece.
    """
    points = at_home(h, own)
    if not len(points):
        return []
    near = cKDTree(points).sparse_distance_matrix(cKDTree(points), GAP * diag,
                                                  output_type="coo_matrix")
    number, piece = connected_components(near, directed=False)
    sizes = np.bincount(piece, minlength=number)
    found = []
    for n in np.argsort(-sizes, kind="stable"):
        if sizes[n] < PIECE * len(points):
            break
        zero, one = (np.flatnonzero(part == n) for part in np.split(piece, [len(own[0])]))
        if min(len(zero), len(one)) >= least:
            found.append((own[0].select(zero), own[1].select(one)))
    return found
