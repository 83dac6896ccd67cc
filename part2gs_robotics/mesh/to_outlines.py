"""To outlines: surfaces moved until all photos see them end where their masks do.

Every vertex may move; neighbours, along the surface and through it, move alike, so that a wall
stays as thick as it is and what no outline tells follows what some do. What is flat stays flat: a
board is bent by little, and is one convex piece still. Gauss-Newton, one sparse linear system per
part and round.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, diags, identity

from part2gs_robotics.evidence.depth_maps import DepthMaps
from part2gs_robotics.mesh.bend import Bend, covering
from part2gs_robotics.mesh.see_through import drawn
from part2gs_robotics.mesh.silhouettes import Gaps, Shape, gaps, shape_of, together
from part2gs_robotics.mesh.surface import flaw
from part2gs_robotics.model.arrays import F64, I64
from part2gs_robotics.model.solids import arrays, corners_of, hull_of
from part2gs_robotics.volume.part_maps import PartMaps
from part2gs_robotics.volume.place import Place

if TYPE_CHECKING:
    from manifold3d import Manifold

LONGEST = 16.0  # voxels of an edge: with 8 masks fit 0.1 % better and meshes have twice the faces
ROUNDS = 4  # of moving and looking again; a fifth moves nothing that can be seen
TURNS = 2  # rounds in which all photos are asked once: neighbouring photos say nearly the same
STIFF = 1.0  # pull of neighbours, of a pixel's; 0.3 bends 1.3 times as much, 3 misses by 0.3 %
AROUND = 8  # neighbours of a vertex in space: both sides of a wall
FLAT = 30.0  # pull that keeps flat faces flat; 3 bends them by 0.15 degrees, 300 misses by 0.3 %
WALL = 25.0  # faces of voxels from which on flat is no chance; with 100 the same comes out
LEVEL = np.cos(np.deg2rad(1.0))  # of two triangles of one flat face: what is sharper bends
FAR = 2.0  # voxels at which the pull through space has halved
KNOWN = 0.05  # pull to where a vertex was, likewise; 0.01 and 0.3 end as near the masks
CLEAR = 2.0  # pixels at which a gap counts a quarter; with 1 legs three pixels too long stay so
MOST_STEP = 1.0  # voxels that a vertex moves per round: outlines are looked for as near
CLOSE = 1e-2  # of its residual at which a system is solved: the next round looks again anyway
MOST_TRIES = 300  # of the solver; systems of 50,000 vertices took 60


@dataclass(frozen=True)
class _Body:
    """A part's shape as it was, its movement [V, 3] in voxels, and how neighbours hold it."""

    first: Shape
    moved: F64
    ties: csr_matrix

    def shape(self, voxel: float) -> Shape:
        """Return it as it is now."""
        return replace(self.first, vertices=self.first.vertices + voxel * self.moved)


def to_outlines(surfaces: Sequence[Manifold], place: Place, maps: Sequence[PartMaps],
                voxel: float, held: Sequence[int] = ()) -> tuple[list[Manifold], list[Bend]]:
    """Return all surfaces moved onto the outlines of the masks, and how each moved.

    Args:
        surfaces: closed, base first, in the world frame at state 0.
        place: of the parts in both states.
        maps: masks and cameras of both states.
        voxel: size of the grid's cells, scene units.
        held: numbers of parts that stay as they are.
    """
    shapes = [shape_of(*arrays(surface.refine_to_length(LONGEST * voxel)))
              for surface in surfaces]
    bodies = [_Body(shape, np.zeros_like(shape.vertices), _ties(shape, voxel))
              for shape in shapes]
    for turn in range(ROUNDS):
        found = _looked(bodies, place, maps, voxel, turn % TURNS)
        bodies = [body if own is None or k in held
                  else replace(body, moved=_moved(body, own, voxel))
                  for k, (body, own) in enumerate(zip(bodies, found, strict=True))]
    out, bends = [], []
    for surface, body in zip(surfaces, bodies, strict=True):
        moved = _surface(body.shape(voxel))
        closed = flaw(moved) is None
        out.append(moved if closed else surface)
        bends.append(Bend(body.first.vertices, voxel * body.moved * closed))
    return out, bends


def moved_pieces(pieces: Sequence[Manifold], bend: Bend) -> list[Manifold]:
    """Return convex pieces that went the way of their part's surface, and still cover it."""
    corners = [bend.done(corners_of(piece)) for piece in pieces]
    return [hull_of(own) for own in covering(corners, bend.points + bend.ways)]


def _surface(shape: Shape) -> Manifold:
    """Return the solid of a shape."""
    import manifold3d

    return manifold3d.Manifold(manifold3d.Mesh64(
        np.ascontiguousarray(shape.vertices), np.ascontiguousarray(shape.faces, np.uint64)))


def _ties(shape: Shape, voxel: float) -> csr_matrix:
    """Return [3 V, 3 V] how vertices pull at each other: along edges, and at those near in space.

    Ends of an edge of a flat face are held the most along its normal: the face moves as one.
    """
    from scipy.spatial import cKDTree

    count = len(shape.vertices)
    distance, near = cKDTree(shape.vertices).query(shape.vertices, min(AROUND + 1, count))
    pull = STIFF / (1.0 + (distance[:, 1:].ravel() / (FAR * voxel)) ** 2)
    one = np.r_[shape.edges[:, 0], np.repeat(np.arange(count), near.shape[1] - 1)]
    two = np.r_[shape.edges[:, 1], near[:, 1:].ravel()]
    weight = np.r_[np.full(len(shape.edges), STIFF), pull]
    ends, normals = _flat_edges(shape, WALL * voxel**2)
    every = np.concatenate([weight[:, None, None] * np.eye(3),
                            FLAT * normals[:, :, None] * normals[:, None]])
    ties = _springs(np.r_[one, ends[:, 0]], np.r_[two, ends[:, 1]], every, count)
    return csr_matrix(ties + KNOWN * identity(3 * count))


def _springs(one: I64, two: I64, pull: F64, count: int) -> csr_matrix:
    """Return [3 V, 3 V] of springs between vertices, each with a matrix [3, 3] of its pull."""
    rows, columns = np.mgrid[:3, :3]
    index, values = list[tuple[I64, I64]](), list[F64]()
    for a, b, sign in ((one, one, 1.0), (two, two, 1.0), (one, two, -1.0), (two, one, -1.0)):
        block = 3 * a[:, None, None] + rows, 3 * b[:, None, None] + columns
        index.append((block[0].ravel(), block[1].ravel()))
        values.append(sign * pull.ravel())
    at = tuple(np.concatenate(side) for side in zip(*index, strict=True))
    return coo_matrix((np.concatenate(values), at), (3 * count, 3 * count)).tocsr()


def _flat_edges(shape: Shape, least: float) -> tuple[I64, F64]:
    """Return ends [E, 2] of edges of flat faces of some area, and the normals [E, 3] of those."""
    from scipy.sparse.csgraph import connected_components

    tri = shape.vertices[shape.faces]
    normals = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    areas = 0.5 * np.linalg.norm(normals, axis=1)
    normals /= np.maximum(2 * areas, 1e-300)[:, None]
    level = (normals[shape.sides[:, 0]] * normals[shape.sides[:, 1]]).sum(1) > LEVEL
    one, two = shape.sides[level].T
    beside = coo_matrix((np.ones(len(one)), (one, two)), (len(areas),) * 2)
    number, face = connected_components(beside, directed=False)
    wall = (np.bincount(face, areas, number) > least)[face]
    both = [wall[shape.sides[:, side]] for side in (0, 1)]
    ends = np.concatenate([shape.edges[own] for own in both])
    return ends, np.concatenate([normals[shape.sides[own, side]] for side, own in enumerate(both)])


def _looked(bodies: Sequence[_Body], place: Place, maps: Sequence[PartMaps], voxel: float,
            turn: int) -> list[Gaps | None]:
    """Return per part the gaps between its silhouettes and the masks of some photos."""
    found: list[list[Gaps]] = [[] for _ in bodies]
    shapes = [body.shape(voxel) for body in bodies]
    everything = np.concatenate([shape.vertices for shape in shapes])
    size = float(np.linalg.norm(np.ptp(everything, axis=0)))
    for s in (0, 1):
        poses = [place.state1_from_0[k] if s else np.eye(4) for k in range(place.count)]
        own = _some(maps[s].maps, turn)
        first = drawn([(shape.vertices, shape.faces) for shape in shapes], poses, own, voxel)
        for view, depth in enumerate(first):
            alpha = np.asarray(own.alphas[view], np.uint8)
            for k, shape in enumerate(shapes):
                found[k].append(gaps(shape, own.viewmats[view] @ poses[k], own.Ks[view], alpha,
                                     depth, size))
    joined = [together(own) for own in found]
    return [own if len(own.pixels) else None for own in joined]


def _some(maps: DepthMaps, turn: int) -> DepthMaps:
    """Return the photos of one turn."""
    some = slice(turn, None, TURNS)
    return DepthMaps(maps.depths[some], maps.alphas[some], np.ascontiguousarray(maps.Ks[some]),
                     np.ascontiguousarray(maps.viewmats[some]))


def _moved(body: _Body, found: Gaps, voxel: float) -> F64:
    """Return [V, 3] the movement after one more step of Gauss-Newton, in voxels."""
    from scipy.sparse.linalg import cg

    count, rows = body.moved.size, np.arange(len(found.pixels))
    slopes = voxel * found.shares[:, :, None] * found.slopes[:, None]  # [N, 2, 3]
    columns = 3 * found.ends[:, :, None] + np.arange(3)
    pull = coo_matrix((slopes.ravel(), (np.repeat(rows, 6), columns.ravel())),
                      (len(rows), count)).tocsr()
    weight = TURNS * found.lengths / (1.0 + (found.pixels / CLEAR) ** 2) ** 2
    matrix = pull.T @ diags(weight) @ pull + body.ties
    right = pull.T @ (weight * found.pixels) - body.ties @ body.moved.ravel()
    step, _ = cg(matrix, right, rtol=CLOSE, maxiter=MOST_TRIES, M=diags(1 / matrix.diagonal()))
    return body.moved + np.clip(step.reshape(-1, 3), -MOST_STEP, MOST_STEP)
