"""Convex pieces: what a physics engine collides instead of the true surface.

Engines take the convex hull of a collision mesh; the hull of a drawer is a full block. A part is
cut along the planes beside its concave edges until its pieces fill their hulls; then those that
hull well together are joined again, and slices of a hull that are mostly empty are cut away.
"""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.collision.concave import concave_planes
from part2gs_robotics.collision.few_corners import few_cornered
from part2gs_robotics.collision.fitted import fitted
from part2gs_robotics.collision.joined import hull, joined
from part2gs_robotics.collision.walls import Cut, facets, main_directions, wall_cuts
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.solids import arrays, corners_of, hull_of, require_closed, to_mesh
from part2gs_robotics.model.twin import PartMesh

if TYPE_CHECKING:
    from manifold3d import Manifold

CONVEX = 0.01  # of what is real in a hull may be empty: a third of what a part's pieces should have
STICKS_OUT = 0.02  # of the tolerance, mean over the hull's surface: rounding, not shape
SIMPLER = 0.1  # of the tolerance: what a surface may move before it is cut
FEW_FACES = 4000  # a cut costs about 10 ms on so many
LEAVES = 4  # times the pieces that are wanted: so fine is cut before neighbours are joined
CRUMB = 1e-6  # of the volume: dropped
FILM = 0.05  # of the tolerance: thinner pieces are dropped
LIFT = 1e-7  # of the tolerance, that a cut lies above a face: what just touches leaves films
MOST_PIECES = 32  # of a part: engines test pairs


def convex_pieces(
    mesh: PartMesh, *, tolerance: float, max_pieces: int = MOST_PIECES
) -> tuple[PartMesh, ...]:
    """Cut a closed mesh into few convex pieces.

    Args:
        mesh: watertight.
        tolerance: about the noise of its surface, scene units; the grid size.
        max_pieces: at most so many.

    Returns:
        Convex meshes in the mean colour of the part; at least one.

    Raises:
        MeshError: if the mesh is not closed.

    Source: binary space partition along planes of concave edges and of walls, least sum of
        (hull - volume), greedy joining, then `fitted`; chosen by benchmarks/geometry.py.
    """
    solid = _simpler(require_closed(mesh, "convex_pieces"), tolerance)
    leaves = _cut_up(solid, tolerance, LEAVES * max_pieces)
    pieces = [hull(corners_of(leaf), float(leaf.volume())) for leaf in leaves]
    fewer = joined([p for p in pieces if p.volume > 0], max_pieces, CONVEX, tolerance)
    red, green, blue = (int(c) for c in mesh.colors.mean(0)) if len(mesh.colors) else (160,) * 3
    within = [fitted(hull_of(piece.corners), solid) for piece in fewer]
    hulls = [few_cornered(hull_of(corners_of(piece))) for piece in within if not piece.is_empty()]
    kept = [h for h in hulls if h.num_tri() >= 4 and h.volume() > CRUMB * solid.volume()]
    return tuple(to_mesh(h, (red, green, blue)) for h in kept or [hull_of(mesh.vertices)])


def _simpler(solid: Manifold, tolerance: float) -> Manifold:
    step = SIMPLER * tolerance
    out = solid.simplify(step)
    while out.num_tri() > FEW_FACES and step < tolerance:
        step *= 1.5
        out = solid.simplify(step)
    return out if out.volume() > 0 else solid


def _cut_up(solid: Manifold, tolerance: float, max_pieces: int) -> list[Manifold]:
    """Split the most concave piece until all are convex enough or there are too many."""
    smallest = CRUMB * solid.volume()
    directions = main_directions(facets(*arrays(solid)))
    done: list[Manifold] = []
    queue: list[tuple[float, int, Manifold]] = []
    count = 0

    def put(piece: Manifold) -> None:
        nonlocal count
        count += 1
        excess = _excess(piece, tolerance)
        if excess > 0:
            heapq.heappush(queue, (-excess, count, piece))
        else:
            done.append(piece)

    for piece in solid.decompose():
        put(piece)
    while queue and len(queue) + len(done) < max_pieces:
        piece = heapq.heappop(queue)[2]
        children = _best_split(piece, directions, tolerance, smallest)
        if not children:
            done.append(piece)
        for child in children:
            put(child)
    return done + [piece for _, _, piece in queue]


def _excess(piece: Manifold, tolerance: float) -> float:
    """Return hull minus volume, 0 when the piece is convex enough."""
    outer = piece.hull()
    gap = float(outer.volume() - piece.volume())
    allowed = max(CONVEX * piece.volume(), STICKS_OUT * tolerance * outer.surface_area())
    return gap if gap > allowed else 0.0


def _best_split(
    piece: Manifold, directions: F64, tolerance: float, smallest: float
) -> list[Manifold]:
    best: list[Manifold] = []
    least = np.inf
    for cut in _cuts(piece, directions, tolerance):
        children = split(piece, cut, tolerance, smallest)
        if len(children) < 2:
            continue
        cost = _cost(children, tolerance)
        if cost < least:
            best, least = children, cost
    return best


def _cuts(piece: Manifold, directions: F64, tolerance: float) -> list[Cut]:
    vertices, faces = arrays(piece)
    lift = LIFT * tolerance
    planes = concave_planes(vertices, faces, 0.25 * tolerance)
    sharp = [Cut(normal, float(level) + lift, 0.0)
             for normal, level in zip(planes.normals, planes.levels, strict=True)]
    return sharp + wall_cuts(facets(vertices, faces), directions, tolerance)


def split(piece: Manifold, cut: Cut, tolerance: float, smallest: float) -> list[Manifold]:
    """Return the connected pieces on both sides of a cut, crumbs and films dropped."""
    normal = cut.normal.tolist()
    opposite = (-cut.normal).tolist()
    sides = (piece.trim_by_plane(opposite, -cut.level), piece.trim_by_plane(normal, cut.level))
    if any(side.volume() < smallest for side in sides):
        return []
    parts = [p for side in sides for p in side.decompose()]
    return [p for p in parts if p.volume() > smallest and _thickness(p) > FILM * tolerance]


def _thickness(solid: Manifold) -> float:
    return 2 * float(solid.volume()) / max(float(solid.surface_area()), 1e-300)


def _cost(children: list[Manifold], tolerance: float) -> float:
    """Return the empty space left in hulls; ties go to the cut that leaves smaller hulls.

    The second term matters for boxes: cutting one board off leaves as much empty space as before.
    """
    cost = 0.0
    for child in children:
        excess = _excess(child, tolerance)
        if excess > 0:
            cost += excess + 0.1 * float(child.hull().volume())
    return cost
