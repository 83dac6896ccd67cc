"""Rest: where photos contradict flat faces, a handle, a bend, the smooth surface takes over."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import binary_dilation, label, uniform_filter

from part2gs_robotics.boards.board_solid import BoardSolid
from part2gs_robotics.boards.cut import Belief
from part2gs_robotics.model.arrays import F32, F64, I64, Mask
from part2gs_robotics.model.grid import Grid

if TYPE_CHECKING:
    from manifold3d import Manifold

DEEP = 1.5  # voxels from flat faces: nearer is the noise of fitted depths
FEWEST = 12.0  # faces of voxels that rays want stopped in one place: fewer are a ragged rim
AROUND = 2  # voxels about them: as far as the flat faces are wrong, and their noise
AROUND_SIDE = 2 * AROUND + 1  # voxels of the cube about one in which rays may ask for a surface
ASKED = 0.1  # faces of voxels that rays ask for in it: the tail of a single ray's share
BLOCK = 4  # voxels: what is replaced is made of such blocks
OVERLAP = 0.02  # voxels that both reach into each other: what just touches does not join


@dataclass(frozen=True)
class Box:
    """An axis-aligned box [low, high), corners in voxels of a grid."""

    low: I64
    high: I64

    def solid(self, grid: Grid, grow: float = 0.0) -> Manifold:
        """Return it in the grid's frame, grown by so many voxels."""
        import manifold3d

        low = grid.lo + grid.voxel * (self.low - 0.5 - grow)
        size = grid.voxel * (self.high - self.low + 2 * grow)
        return manifold3d.Manifold.cube(size.tolist()).translate(low.tolist())


def with_rest(solid: BoardSolid, smooth: Manifold, fine: F32, missed: F64) -> BoardSolid:
    """Return the solid with the smooth surface where masks contradict its flat faces.

    Args:
        solid: of flat faces.
        smooth: closed surface of the same part.
        fine: [X, Y, Z] the same as values of the grid, positive inside.
        missed: [X, Y, Z] faces of voxels that rays want stopped and that stop at nothing.
    """
    import manifold3d

    if solid.curved:
        return solid
    grid = solid.belief.grid
    boxes = boxes_of(contradicted(solid.belief, solid.values > 0, fine > 0, missed))
    if not boxes or smooth.is_empty():
        return solid
    union = manifold3d.OpType.Add
    room = manifold3d.Manifold.batch_boolean([b.solid(grid) for b in boxes], union)
    taken = manifold3d.Manifold.batch_boolean([b.solid(grid, OVERLAP) for b in boxes], union)
    rest = smooth ^ taken
    hulls = [(smooth ^ box.solid(grid)).hull() for box in boxes]
    pieces = [*_outside(solid.pieces, boxes, grid), *(h for h in hulls if not h.is_empty())]
    return replace(solid, pieces=pieces, whole=(solid.whole - room) + rest)


def contradicted(belief: Belief, filled: Mask, fine: Mask, missed: F64) -> Mask:
    """Return [X, Y, Z] about where masks contradict a solid, beyond the noise of depths.

    Depths of rooms within are wrong by cells; only what masks say is worth a surface that is not
    flat: background where the solid is, and rays that must end and do not.

    Args:
        belief: what photos say.
        filled: [X, Y, Z] the solid.
        fine: [X, Y, Z] the smooth solid.
        missed: [X, Y, Z] see `with_rest`.
    """
    asked = AROUND_SIDE**3 * uniform_filter(missed, AROUND_SIDE, mode="constant") >= ASKED
    wrong = np.where(filled, belief.outside, fine & asked)
    wrong[wrong] = _deep(filled, np.argwhere(wrong))
    places, count = label(wrong, np.ones((3, 3, 3)))
    worth = np.bincount(places.ravel(), np.where(filled, 1.0, missed).ravel(), count + 1)
    many = worth >= FEWEST
    many[0] = False
    return np.asarray(binary_dilation(many[places], np.ones((3, 3, 3)), AROUND))


def _deep(filled: Mask, index: I64) -> Mask:
    """Return [N] whether voxels lie further than `DEEP` from the surface of a solid.

    Args:
        filled: [X, Y, Z] the solid.
        index: [N, 3] of the voxels.
    """
    last, reach = np.array(filled.shape) - 1, np.arange(-int(DEEP), int(DEEP) + 1)
    own, deep = filled[tuple(index.T)], np.ones(len(index), bool)
    for step in product(reach, reach, reach):
        if np.linalg.norm(step) <= DEEP:
            near = np.clip(index + step, 0, last)  # beyond the grid lies what is at its border
            deep &= filled[tuple(near.T)] == own
    return deep


def boxes_of(where: Mask) -> list[Box]:
    """Return boxes of blocks that cover a mask, none over another, as few as greed finds."""
    shape = -(-np.array(where.shape) // BLOCK)
    left = np.zeros(shape, bool)
    left[tuple((np.argwhere(where) // BLOCK).T)] = True
    found: list[Box] = []
    while left.any():
        low = np.argwhere(left)[0]
        high = low + 1
        for axis in (2, 1, 0):
            while high[axis] < shape[axis]:
                slab = [slice(a, b) for a, b in zip(low, high, strict=True)]
                slab[axis] = slice(high[axis], high[axis] + 1)
                if not left[tuple(slab)].all():
                    break
                high[axis] += 1
        left[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = False
        found.append(Box(low * BLOCK, high * BLOCK))
    return found


def _outside(pieces: list[Manifold], boxes: list[Box], grid: Grid) -> list[Manifold]:
    """Return convex pieces of what lies outside of all boxes."""
    for box in boxes:
        low = grid.lo + grid.voxel * (box.low - 0.5)
        high = grid.lo + grid.voxel * (box.high - 0.5)
        kept: list[Manifold] = []
        for piece in pieces:
            own = np.array(piece.bounding_box())
            if (own[:3] >= high).any() or (own[3:] <= low).any():
                kept.append(piece)
                continue
            for axis in range(3):
                normal = np.eye(3)[axis]
                kept += [side for n, at in ((normal, high), (-normal, -low))
                         if not (side := piece.trim_by_plane(n.tolist(), at[axis])).is_empty()]
                piece = piece.trim_by_plane(normal.tolist(), low[axis])
                piece = piece.trim_by_plane((-normal).tolist(), -high[axis])
        pieces = kept
    return pieces
