"""Islands: patches of one part amid another that could as well be the other's.

The plain top of a seat that turns about its middle looks as if it had stayed: still, it lies as
well as turned. It is a sheet in the air then, held by nothing of its own part. So is the rim of a
wheel, whose spokes alone are seen to turn.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from part2gs_robotics.decide.labelling import Unary
from part2gs_robotics.evidence.graph import Graph
from part2gs_robotics.evidence.landing import MATCHED
from part2gs_robotics.evidence.surfels import FLOATER
from part2gs_robotics.model.arrays import F64, Labels

LINKED = 0.3  # weight of neighbours on one face: across a right angle it is 0.25 at most
FACING = 0.7  # length of the mean normal: a sheet looks one way (half a pipe 0.64), a post all ways
AMID = 0.7  # of the neighbours around a face: another part has it all but surrounded
TIE = 0.05  # mean landing cost, a colour step: what one label explains better than the other
TOUCH = 0.01  # weight of neighbours that touch: within 2.7 times the reach of most, 3.2 on one face
GONE = 0.05  # of the diagonal: what moves less, a hinge's post amid doors, may as well stay
ROUNDS = 3  # patches of both states vouch for each other; those that fail take others along


def joined(hard: Labels, unary: Unary, graph: Graph, normals: F64, ways: F64, first: int) -> Labels:
    """Return labels [N0 + N1] with islands given to what surrounds them, if they fit as well there.

    Args:
        hard: [N0 + N1] labels.
        unary: landing under every label.
        graph: neighbours, state 1 after state 0.
        normals: [N0 + N1, 3] unit.
        ways: [N0 + N1, K+1] how far every label carries a surfel, diagonals of the object.
        first: N0.
    """
    hard = _given(hard, unary, *_islands(hard, graph, normals), np.inf)
    return _given(hard, unary, *_afloat(hard, graph, ways, first), MATCHED)


def _given(hard: Labels, unary: Unary, patches: Labels, wanted: Labels, dearest: float) -> Labels:
    """Return labels with patches given away that cost no more there, and `dearest` at most.

    Args:
        hard: [N] labels.
        unary: landing under every label.
        patches: [N] number of the patch of every surfel, -1 = none.
        wanted: label of every patch.
        dearest: mean landing cost.
    """
    if not len(wanted):
        return hard
    before = unary.own(hard)
    for _ in range(ROUNDS):
        new = hard.copy()
        inside = patches >= 0
        new[inside] = wanted[patches[inside]]
        after = unary.own(new)
        worse, costs, sizes = (np.bincount(patches[inside], w, len(wanted))
                               for w in ((after - before)[inside], after[inside], None))
        dear = costs / np.maximum(sizes, 1) > dearest
        bad = (sizes > 0) & ((worse > TIE * sizes) | dear)
        if not bad.any():
            return new
        patches = np.where(inside & bad[patches], -1, patches)
    return hard


def _afloat(hard: Labels, graph: Graph, ways: F64, first: int) -> tuple[Labels, Labels]:
    """Return [N] number of the floating body of every surfel, -1 = none, and what each touches.

    The base stands; what of it touches a moving part alone, which would carry it far, hangs in the
    air. A hub amid a wheel hardly moves.
    """
    rows, cols = np.repeat(np.arange(len(hard)), graph.neighbors.shape[1]), graph.neighbors.ravel()
    touch = graph.weights.ravel() > TOUCH
    rows, cols = rows[touch], cols[touch]
    linked = (hard[rows] == 0) & (hard[cols] == 0)
    links = csr_matrix((np.ones(linked.sum()), (rows[linked], cols[linked])), (len(hard),) * 2)
    total, body = connected_components(links, directed=False)
    sizes = np.bincount(body[hard == 0], minlength=total)
    around = np.zeros((total, ways.shape[1]))
    for one, two in ((rows, cols), (cols, rows)):
        out = (hard[one] == 0) & (hard[two] > 0)
        np.add.at(around, (body[one[out]], hard[two[out]]), 1.0)
    wanted = around.argmax(1)
    far = np.bincount(body, ways[np.arange(len(hard)), wanted[body]], total)
    loose = (sizes >= FLOATER) & (around.max(1) >= AMID * around.sum(1)) & (around.max(1) > 0)
    loose &= far >= GONE * np.maximum(sizes, 1)
    for state in (body[:first], body[first:]):
        if len(state):
            loose[state[sizes[state].argmax()]] = False  # the base itself
    number = np.where(loose, np.cumsum(loose) - 1, -1)
    return number[body], wanted[loose]


def _islands(hard: Labels, graph: Graph, normals: F64) -> tuple[Labels, Labels]:
    """Return [N] number of the island of every surfel, -1 = none, and the labels around each.

    An island is what of a smooth face has one label; it looks one way, and is smaller than the
    largest face beside it. A hinge's post amid doors is none: it is a body, and hardly moves.
    """
    rows = np.repeat(np.arange(len(hard)), graph.neighbors.shape[1])
    cols = graph.neighbors.ravel()
    linked = (hard[rows] == hard[cols]) & (graph.weights.ravel() > LINKED)
    links = csr_matrix((np.ones(linked.sum()), (rows[linked], cols[linked])), (len(hard),) * 2)
    total, face = connected_components(links, directed=False)
    out = face[rows] != face[cols]
    one, two = np.r_[rows[out], cols[out]], np.r_[cols[out], rows[out]]
    around, beside = np.zeros((total, hard.max() + 1)), np.zeros(total)
    np.add.at(around, (face[one], hard[two]), 1.0)
    wanted, sizes = around.argmax(1), np.bincount(face)
    theirs = hard[two] == wanted[face[one]]
    np.maximum.at(beside, face[one[theirs]], sizes[face[two[theirs]]])
    own = hard[np.unique(face, return_index=True)[1]]
    looks = np.stack([np.bincount(face, n, total) for n in normals.T], 1)
    flat = np.linalg.norm(looks, axis=1) > FACING * sizes
    amid = (wanted != own) & (around.max(1) >= AMID * around.sum(1)) & (sizes < beside) & flat
    number = np.where(amid, np.cumsum(amid) - 1, -1)
    return number[face], wanted[amid]
