"""Board solid: a part of flat faces and sharp edges, out of what photos say and likely planes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import map_coordinates

from part2gs_robotics.boards.cells import Cells, cells_of
from part2gs_robotics.boards.cut import Belief, gain_of, inside_cells
from part2gs_robotics.boards.facets import Facets, smooth_facets
from part2gs_robotics.boards.fewer import without_idle
from part2gs_robotics.boards.outlines import Outlines, drawn_to_outlines
from part2gs_robotics.boards.planes import Family, directions, families, flat_share, tilted
from part2gs_robotics.boards.polyhedra import convex_cells, joined
from part2gs_robotics.model.arrays import F32, F64, I64, Mask
from part2gs_robotics.model.solids import arrays

if TYPE_CHECKING:
    from manifold3d import Manifold

TILT = 0.22  # of the seen surface: noise of depths gave 0.09 to 0.19, walls 0.25 to 0.5
FACES = 2.0  # times what faces a tilt's way, beside what it explains: 0.11 and more of it in walls
PLANE = 0.001  # of it, what a plane must explain: at none, parts have 1.3 times the triangles
ROUNDS = 12  # of looking for planes that go: parts took two to eight
ITS_WAY = np.cos(np.deg2rad(3.0))  # of a tilt: twice the noise of smoothed normals
MOSTLY = 0.45  # of the observed surface: parts of boards had 0.48 to 0.93, curved ones 0.02 to 0.6


@dataclass(frozen=True)
class BoardSolid:
    """A solid of flat faces.

    Attributes:
        belief: what photos say about it.
        cells: that its planes make of its box.
        inside: [C] which cells are inside.
        pieces: convex solids that it is the union of.
        whole: their union, closed; empty if no cell is inside.
        flat: share of the observed noisy surface that lies in planes, 0..1.
    """

    belief: Belief
    cells: Cells
    inside: Mask
    pieces: list[Manifold]
    whole: Manifold
    flat: float

    @property
    def curved(self) -> bool:
        """Whether flat faces are not what the part is made of."""
        return self.flat < MOSTLY

    @property
    def values(self) -> F32:
        """[X, Y, Z] 1 inside, -1 outside, at the voxels of the grid."""
        filled = self.inside[self.cells.of_voxel]
        return np.where(filled, np.float32(1), np.float32(-1))


def refined(solid: BoardSolid, states: Sequence[Outlines]) -> BoardSolid:
    """Return the solid with its planes moved onto the outlines of masks.

    Args:
        solid: of a part.
        states: masks of both states, with cameras in the part's frame.
    """
    if not solid.pieces:
        return solid
    cells = solid.cells
    moved = drawn_to_outlines(cells.families, *arrays(solid.whole), states, cells.grid.voxel)
    cells = replace(cells, families=moved)
    pieces = convex_cells(cells, solid.inside)
    return replace(solid, cells=cells, pieces=pieces, whole=joined(pieces, cells.grid.voxel))


def board_solid(belief: Belief, vertices: F64, faces: I64, edges: F64) -> BoardSolid:
    """Return the solid of flat faces that explains a belief best.

    Args:
        belief: what photos say about the part.
        vertices: [V, 3] of its noisy closed surface, where planes are looked for.
        faces: [F, 3] outward.
        edges: [E, 3] unit directions of straight edges, in the part's frame at state 0.

    Source: cells of planes labelled by a minimum cut, after Chauve, Labatut and Pons 2010; their
        planes come from fitted surfaces and from edges in the photos.
    """
    surface, grid = smooth_facets(vertices, faces), belief.grid
    tri = vertices[faces]
    flux = 0.5 * np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    place = ((surface.centers - grid.lo) / grid.voxel).T
    observed = map_coordinates(belief.surface, place, order=1, mode="nearest")
    normals = directions(surface, observed, edges)

    def planes(normals: Sequence[F64]) -> tuple[Family, ...]:
        return families(normals, surface, flux, grid.voxel)

    tilts = tilted(normals, surface, observed, grid.voxel)
    found = planes([*normals, *tilts])
    flat = flat_share(surface, found, observed, grid.voxel)
    if flat < MOSTLY:
        return _of_cells(belief, cells_of(grid, ()), 0.0, flat)
    normals = _with_tilts(normals, tilts, planes, belief, surface, observed)
    return _of_cells(belief, cells_of(grid, planes(normals)), 0.0, flat)


def _with_tilts(normals: list[F64], tilts: Sequence[F64],
                planes: Callable[[Sequence[F64]], tuple[Family, ...]], belief: Belief,
                surface: Facets, observed: F64) -> list[F64]:
    """Return directions with those a few degrees off that photos speak for.

    A tilt is worth what it lets planes explain better, and the surface that faces its way: a bulge
    has some of the one, a wall of both.
    """
    best = inside_cells(cells_of(belief.grid, planes(normals)), belief)[1] if tilts else 0.0
    kept, seen = list(normals), float(surface.areas @ observed)
    for tilt in tilts:
        gain = inside_cells(cells_of(belief.grid, planes([*kept, tilt])), belief)[1]
        faces = float(surface.areas @ (observed * (np.abs(surface.normals @ tilt) > ITS_WAY)))
        if (gain - best) * belief.grid.voxel**2 + FACES * faces > TILT * seen:
            kept, best = [*kept, tilt], gain
    return kept


def filled(solid: BoardSolid, worth: F64) -> BoardSolid:
    """Return the solid cut anew with more that speaks for its cells.

    Args:
        solid: of a part.
        worth: [X, Y, Z] in voxels of full belief.
    """
    if solid.curved:
        return solid
    return _of_cells(solid.belief, solid.cells, worth, solid.flat)


def paying(solid: BoardSolid, worth: F64) -> BoardSolid:
    """Return the solid of those planes alone that explain enough of what speaks for its cells.

    Args:
        solid: of a part.
        worth: [X, Y, Z] what else speaks for them, in voxels of full belief.
    """
    if solid.curved:
        return solid
    cells, belief, price = solid.cells, solid.belief, PLANE * float(solid.belief.surface.sum())
    inside, best = inside_cells(cells, belief, worth)
    for _ in range(ROUNDS):
        fewer = cells_of(belief.grid, without_idle(cells, inside, gain_of(cells, belief, worth),
                                                   price))
        gone = cells.planes - fewer.planes
        inside, rest = inside_cells(fewer, belief, worth)
        if not gone or rest < best - gone * price:
            break
        cells, best = fewer, rest
    return _of_cells(belief, cells, worth, solid.flat)


def _of_cells(belief: Belief, cells: Cells, worth: F64 | float, flat: float) -> BoardSolid:
    inside = inside_cells(cells, belief, worth)[0]
    pieces = convex_cells(cells, inside)
    return BoardSolid(belief, cells, inside, pieces, joined(pieces, cells.grid.voxel), flat)
