"""Bodies: every connected piece of what a set of motions leaves is searched on its own.

What is left is small things: a handle, a latch, a tray. Each is one body in the air once all else
is explained, and its joint lies beside it.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from part2gs_robotics.evidence.faces import directions
from part2gs_robotics.evidence.study import FINE_TAU, Study
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model.arrays import F64, Labels
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.runtime.side_by_side import side_by_side
from part2gs_robotics.search.cover import SEARCH_TAU, landings, on_patch
from part2gs_robotics.search.patches import Aim

GAP = 0.02  # of the diagonal, two surfels: what lies nearer is one body
LEAST = 15  # surfels: fewer rank no motions
MOST, PLACES = 4, 6  # bodies of each state, the largest, and places of each: a second in all
BESIDE = 0.07  # of the diagonal: a hinge passes its part by 0.036 at most, and part of it may hide
SHARE = 0.25  # of a body's size: a coarser landing takes the body beside its place for landed


def propose_bodies(study: Study, rng: np.random.Generator, patch_points: int) -> list[Joint]:
    """Return motions of the connected bodies of the evidence of both states.

    Refined on its few surfels of one state, a motion may be led astray: both are returned.

    Args:
        study: its evidence is what a set of motions leaves.
        rng: picks surfels.
        patch_points: surfels of a body that rank the motions.
    """
    tasks = []
    for state in (1, 0):
        for body in bodies(study.evidence.sets[state], study.diag):
            patch = body.select(rng.permutation(len(body))[:patch_points])
            axes = directions(study.lands[0].surfels, patch, rng, known=study.straight.directions)
            tasks.append(partial(_motions, study, (patch, body), axes, _aim(study, body, state)))
    return [h for found in side_by_side(tasks) for h in found]


def _motions(study: Study, own: tuple[Surfels, Surfels], axes: F64, aim: Aim) -> list[Joint]:
    found = landings(own[0], axes, aim, study.straight.directions, PLACES)
    return [*(on_patch(h, own[1], aim, study) for h in found), *found]


def _aim(study: Study, body: Surfels, state: int) -> Aim:
    """Return where a body may land, by turns about axes beside it, as coarsely as it bears."""
    diag, size = study.diag, float(np.linalg.norm(np.ptp(body.points, axis=0)))
    box = body.points.min(0) - BESIDE * diag, body.points.max(0) + BESIDE * diag
    tau = float(np.clip(SHARE * size, FINE_TAU * diag, SEARCH_TAU * diag))
    return Aim(study.lands[1 - state], box, diag, tau, state == 0)


def bodies(surfels: Surfels, diag: float) -> list[Surfels]:
    """Return the connected bodies of surfels, the largest first; diag: of the object."""
    if len(surfels) < LEAST:
        return []
    piece, sizes = connected(surfels.points, GAP * diag)
    return [surfels.select(piece == n) for n in np.argsort(-sizes, kind="stable")[:MOST]
            if sizes[n] >= LEAST]


def connected(points: F64, gap: float) -> tuple[Labels, Labels]:
    """Return [n] the piece of every point, and [m] sizes; points nearer than a gap are of one."""
    tree = cKDTree(points)
    near = tree.sparse_distance_matrix(tree, gap, output_type="coo_matrix")
    number, piece = connected_components(near, directed=False)
    return piece.astype(np.int64), np.bincount(piece, minlength=number)
