"""Polyhedra: inside cells -> few exact convex pieces, and their union as one closed solid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.boards.cells import Cells
from part2gs_robotics.model.arrays import I64, Mask

if TYPE_CHECKING:
    from manifold3d import Manifold

OVERLAP = 0.01  # cells that neighbours reach into each other: what just touches does not join
BEYOND = 1.0  # cells: what is thinner holds no voxel, and is filled with its neighbours
FLUSH = 0.2  # overlaps: what lies so near to a face is in it


def convex_cells(cells: Cells, inside: Mask) -> list[Manifold]:
    """Return convex solids whose union is that of the inside cells.

    The box is split by the plane that parts inside from outside best, until every piece is one or
    the other (Murali and Funkhouser 1997); so a board of a hundred cells is one piece.
    """
    import manifold3d

    grid, overlap = cells.grid, OVERLAP * cells.grid.voxel
    low, size = grid.lo - grid.voxel, grid.voxel * (np.array(grid.shape) + 1.0)
    box = manifold3d.Manifold.cube(size.tolist()).translate(low.tolist())
    found: list[Manifold] = []
    waiting = [(box, np.arange(len(cells)))]
    while waiting:
        body, index = waiting.pop()
        full = inside[index]
        if full.all():
            body = _trimmed(body, cells, index)
            found += [] if body.is_empty() else [body]
        if full.all() or not full.any():
            continue
        family, level = _best_split(cells.digits[index], full)
        normal, offset = cells.families[family].normal, cells.families[family].offsets[level]
        below = cells.digits[index, family] <= level
        waiting += [
            (body.trim_by_plane(normal.tolist(), offset - overlap), index[~below]),
            (body.trim_by_plane((-normal).tolist(), -offset - overlap), index[below])]
    return found


def _trimmed(body: Manifold, cells: Cells, index: I64) -> Manifold:
    """Return a body without what lies well beyond the planes about its cells.

    Cells too thin for any voxel are in no list, and a body may reach along them as a spike.
    """
    reach = BEYOND * cells.grid.voxel
    for family, own in zip(cells.families, cells.digits[index].T, strict=True):
        normal, first, last = family.normal, int(own.min()), int(own.max())
        if first > 0:
            body = body.trim_by_plane(normal.tolist(), family.offsets[first - 1] - reach)
        if last < len(family.offsets):
            body = body.trim_by_plane((-normal).tolist(), -family.offsets[last] - reach)
    return body


def _best_split(digits: I64, full: Mask) -> tuple[int, int]:
    """Return family and plane that leave least mixed cells on both sides, by Gini impurity."""
    best, chosen = np.inf, (0, 0)
    for family in range(digits.shape[1]):
        own = digits[:, family]
        first = int(own.min())
        total = np.cumsum(np.bincount(own - first))
        filled = np.cumsum(np.bincount(own - first, full))
        n, f = total[:-1], filled[:-1]
        if not len(n):
            continue
        rest, other = total[-1] - n, filled[-1] - f
        mixed = f * (n - f) / np.maximum(n, 1) + other * (rest - other) / np.maximum(rest, 1)
        level = int(mixed.argmin())
        if mixed[level] < best:
            best, chosen = float(mixed[level]), (family, first + level)
    return chosen


def joined(pieces: list[Manifold], voxel: float) -> Manifold:
    """Return the union of convex solids that reach into each other by a hair."""
    import manifold3d

    whole = manifold3d.Manifold.batch_boolean(pieces, manifold3d.OpType.Add)
    return whole.as_original().simplify(FLUSH * OVERLAP * voxel)
