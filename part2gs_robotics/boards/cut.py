"""Cut: which cells are inside, by one minimum cut over all of them.

A cell gains by the belief of its voxels; a face between inside and outside costs its area, unless
photos saw a surface there (Chauve et al. 2010, Labatut et al. 2009). So a hole that no photo asks
for is closed, and a wall ends where its plane ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from part2gs_robotics.boards.cell_kernels import borders, gains
from part2gs_robotics.boards.cells import Cells
from part2gs_robotics.model.arrays import F32, F64, Mask
from part2gs_robotics.model.grid import Grid

INVENTED = 0.5  # voxels of full belief that a voxel's face nobody saw costs
SEEN_FACE = 0.02  # the same of a face that photos saw: ties go to the smaller surface
CAPACITY = 1e9  # all capacities together, in the whole numbers of the flow: int32 holds twice that
FINENESS = 100.0  # whole numbers per voxel, where CAPACITY allows it


@dataclass(frozen=True)
class Belief:
    """What photos say about a part on a grid.

    Attributes:
        grid: where, in the part's frame at state 0.
        inside: [X, Y, Z] from -1, seen free, to 1, right behind a surface of the part; near 0 where
            nobody saw.
        surface: [X, Y, Z] 0..1, whether views saw a surface of the part there.
        outside: [X, Y, Z] whether masks show background there.
    """

    grid: Grid
    inside: F32
    surface: F32
    outside: Mask


def inside_cells(cells: Cells, belief: Belief, worth: F64 | float = 0.0) -> tuple[Mask, float]:
    """Return [C] which cells are inside, and what they gain less what their faces cost.

    Args:
        cells: to choose from.
        belief: about their voxels.
        worth: [X, Y, Z] what else speaks for a voxel, in those of full belief.
    """
    count, gain = len(cells), gain_of(cells, belief, worth)
    one, two, cost = borders(cells.of_voxel, belief.surface, INVENTED, SEEN_FACE)
    ties = coo_matrix((np.r_[cost, cost], (np.r_[one, two], np.r_[two, one])), (count, count))
    inside = _cut(gain, ties.tocsr())
    return inside, float(gain[inside].sum() - cost[inside[one] != inside[two]].sum())


def gain_of(cells: Cells, belief: Belief, worth: F64 | float) -> F64:
    """Return [C] what speaks for cells, in voxels of full belief; arguments as `inside_cells`."""
    gain = np.zeros(len(cells))
    more = worth if isinstance(worth, np.ndarray) else np.full(belief.inside.shape, float(worth))
    gains(cells.of_voxel, belief.inside, more, gain)
    return gain


def _cut(gain: F64, ties: csr_matrix) -> Mask:
    """Return the side of the source in a minimum cut: what gains, less what its faces cost."""
    count = len(gain)
    source, sink = count, count + 1
    up, down = np.flatnonzero(gain > 0), np.flatnonzero(gain < 0)
    ties = ties.tocoo()
    rows = np.r_[ties.row, np.full(len(up), source), down]
    columns = np.r_[ties.col, up, np.full(len(down), sink)]
    values = np.r_[ties.data, gain[up], -gain[down]]
    scale = min(FINENESS, CAPACITY / max(values.sum(), 1.0))
    graph = csr_matrix((np.rint(values * scale).astype(np.int32), (rows, columns)),
                       (count + 2, count + 2))
    graph.sum_duplicates()
    left = graph - maximum_flow(graph, source, sink).flow
    left.data = np.maximum(left.data, 0)
    left.eliminate_zeros()
    inside = np.zeros(count + 2, bool)
    inside[breadth_first_order(left, source, return_predecessors=False)] = True
    return inside[:count]
