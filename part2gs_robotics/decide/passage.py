"""Passage: nothing goes through what was seen to stand in its way.

The wall of a drawer is unseen while the drawer is closed, and it lies flush with the wall of the
drawer above. Pulled out with that one, it would pass through the front of its own. And of drawers
alike, one shut and another opened, the insides land on each other as if they were one thing that
went through all that is between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64, Mask
from part2gs_robotics.model.grid import Grid, index_move
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import orders, sweep
from part2gs_robotics.model.se3 import inverse
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel

PASS_COST = 0.2  # more than being far from a part may cost, less than a contradiction
DEPTHS = (-3.0, -2.5, -2.0, -1.5, -1.0)  # cells behind a surface: nearer is noise, farther thin air
CLEAR = (0.0, 0.5, 1.0)  # cells before it: seen free, also where another surface is close behind
Marks = tuple[tuple[tuple[float, ...], bool], ...]
BEHIND: Marks = ((DEPTHS, True), (CLEAR, False))
# Cells: as far before a surface as its layer goes behind.
BESIDE: Marks = (((-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0), True),)
REAL = 0.25  # of a part's own proofs that pass through the other: they really cross
STEP = 2.0  # cells between poses: fewer than the layer behind a surface is thick
# Of what a part lands: true ones of 20 scenes take 0.053 through others at most, false ones 0.24.
THROUGH = 0.1
# Of it, where one must wait: 6 prices. A false set that saved 9 had two; of 14 true sets one has.
WAITS = 0.3
ASKED = 1000  # surfels of a part that are taken along its way: shares are right to 0.02
MARGIN = 0.1  # of the box around all surfels: what a part sweeps beyond meets nothing


@dataclass(frozen=True)
class Seen:
    """All surfels of both states, each in its own state.

    Attributes:
        points: [N, 3].
        normals: [N, 3] outward.
        late: [N] which surfels are of state 1.
        proofs: [N, K+1] which surfels surely have a label.
    """

    points: F64
    normals: F64
    late: Mask
    proofs: Mask


def through(seen: Seen, joints: Sequence[Joint], parents: Sequence[int], cell: float) -> F64:
    """Return [K] 0..1, how surely every part would have gone through others on its way.

    In full only where it would whichever moved first: a drawer passes where the door was. Where
    all may move at once, as a tray does behind a door that swings open, nothing is strange. What
    lies along another part's surface in a state slides along it, and counts as free.

    Args:
        seen: all surfels; proofs are those that land well under their label.
        joints: of parts 1..K, carriers' motions within.
        parents: part that carries each, 0 = base.
        cell: size of a surfel, scene units.
    """
    labels, grid = range(len(joints) + 1), _around(seen.points, cell)
    corners = _corners(seen.points)
    placed = [_at_0(seen, joints[k - 1].state1_from_0 if k else np.eye(4), seen.proofs[:, k])
              for k in labels]
    layers = [(_layer(*own, grid), _layer(*own, grid, BESIDE)) for own in placed]
    most = np.zeros(len(joints))
    for k, other in permutations(labels, 2):
        own = placed[k][0][:: 1 + len(placed[k][0]) // ASKED]
        if not k or not len(own) or not len(placed[other][0]):
            continue
        (layer, beside), shares = layers[other], list[float]()
        box, around = _box(layer), _box(beside)
        for poses in orders(other, k, joints, parents, corners, STEP * cell):
            moves = index_move(grid, poses, Grid(np.zeros(3), 1.0, grid.shape))
            hits = own[_meets(own, moves, layer, box)]
            along = _meets(hits, moves[[0, -1]], beside, around)
            shares.append(float((~along).sum()) / len(own))
        always, at_once = (np.clip(share / THROUGH - 1.0, 0.0, 1.0)
                           for share in (min(shares), shares[0]))
        most[k - 1] = max(most[k - 1], always, WAITS * at_once)
    return most


def passage_costs(seen: Seen, asked: NDArray[np.int64], joints: Sequence[Joint],
                  parents: Sequence[int], cell: float) -> F64:
    """Return [M, K+1] what passing through other parts costs surfels under every label.

    Args:
        seen: all surfels.
        asked: [M] rows of the surfels asked about.
        joints: of parts 1..K, carriers' motions within.
        parents: part that carries each, 0 = base.
        cell: size of a surfel, scene units.
    """
    labels, proofs = range(len(joints) + 1), seen.proofs
    grid = _around(seen.points, cell)
    everything = np.ones(len(seen.points), bool)
    placed = [_at_0(seen, joints[k - 1].state1_from_0 if k else np.eye(4), everything)
              for k in labels]
    layers = {k: _layer(placed[k][0][proofs[:, k]], placed[k][1][proofs[:, k]], grid)
              for k in labels if k}
    corners = _corners(seen.points)
    boxes = {k: _box(layer) for k, layer in layers.items()}
    about = [points[asked] for points, _ in placed]
    hits = np.zeros((len(asked), len(joints) + 1), bool)
    for k, other in permutations(labels, 2):
        if not other or not proofs[:, other].any():  # whatever stands still was seen twice
            continue
        poses = sweep(other, k, joints, parents, corners, STEP * cell)
        moves = index_move(grid, poses, Grid(np.zeros(3), 1.0, grid.shape))
        own = placed[k][0][proofs[:, k]]
        layer, box = layers[other], boxes[other]
        if not k or len(own) == 0 or _meets(own, moves, layer, box).mean() < REAL:
            left = ~hits[:, k]
            hits[left, k] = _meets(about[k][left], moves, layer, box)
    return PASS_COST * (hits - hits.min(1, keepdims=True).astype(float))


def _around(points: F64, cell: float) -> Grid:
    low, high = points.min(0), points.max(0)
    margin = MARGIN * float((high - low).max())
    return Grid.around(low - margin, high + margin, cell)


def _corners(points: F64) -> F64:
    ends = points.min(0), points.max(0)
    pick = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    return np.where(pick, ends[1], ends[0])


def _at_0(seen: Seen, move: F64, asked: Mask) -> tuple[F64, F64]:
    """Return points and normals of some surfels where a motion puts them at state 0."""
    back = inverse(move)
    turn, shift = back[:3, :3], back[:3, 3]
    points, normals, late = seen.points[asked], seen.normals[asked], seen.late[asked, None]
    return (np.where(late, points @ turn.T + shift, points),
            np.where(late, normals @ turn.T, normals))


def _layer(points: F64, normals: F64, grid: Grid, marks: Marks = BEHIND) -> Mask:
    """Return the cells just behind oriented points and before none of them, or others by marks."""
    out = np.zeros(grid.shape, bool)
    places = (points - grid.lo) / grid.voxel
    for depths, value in marks:
        for depth in depths:
            index = np.rint(places + depth * normals).astype(np.int64)
            index = index[((index >= 0) & (index < grid.shape)).all(1)]
            out[tuple(index.T)] = value
    return out


def _box(layer: Mask) -> F64:
    """Return [3, 2] the first and last cell of a layer; last before first where it has none."""
    flat: Mask = np.asarray(layer.any(2))
    filled = [np.flatnonzero(own) for own in (flat.any(1), flat.any(0), layer.any((0, 1)))]
    return np.array([(own[0], own[-1]) if len(own) else (1, 0) for own in filled], np.float64)


def _meets(points: F64, moves: F64, layer: Mask, box: F64) -> Mask:
    """Return [N] whether a point is in the layer in any of the poses, maps to cells [P, 4, 4]."""
    out = np.zeros(len(points), bool)
    _meet(np.ascontiguousarray(points), moves, layer, box, out)
    return out


@kernel
def _meet(points: F64, moves: F64, layer: Mask, box: F64, out: Mask) -> None:
    """Mark points that come into the layer; box [3, 2]: first and last cell of it."""
    for_each(len(points), _meet_at, (points, moves, layer, box, out))


@inlined
def _meet_at(n: int, points: F64, moves: F64, layer: Mask, box: F64, out: Mask) -> None:
    x, y, z = points[n, 0], points[n, 1], points[n, 2]
    for p in range(len(moves)):
        m = moves[p]
        u = np.rint(m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3])
        if not box[0, 0] <= u <= box[0, 1]:
            continue
        v = np.rint(m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3])
        if not box[1, 0] <= v <= box[1, 1]:
            continue
        w = np.rint(m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3])
        if box[2, 0] <= w <= box[2, 1] and layer[int(u), int(v), int(w)]:
            out[n] = True
            break
