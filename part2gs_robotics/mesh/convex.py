"""Convex pieces: what a physics engine collides instead of the true surface.

Engines take the convex hull of a collision mesh; the hull of a drawer is a full block. A part is
cut along its own walls until the hull of every piece sticks out no further than a tolerance.
"""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from part2gs_robotics.mesh.walls import Cut, Facets, facets, main_directions, wall_cuts
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.solids import corners_of, hull_of, require_closed, to_mesh
from part2gs_robotics.model.twin import PartMesh

if TYPE_CHECKING:
    from manifold3d import Manifold

CONVEX = 0.01  # hull sticks out by less than 1 % of the volume: convex
STICKS_OUT = 0.5  # of the tolerance, mean over the hull's surface: convex enough
OPEN = 0.5  # of the hull empty: less is a noisy board; slices of a frame were three quarters empty
FAR = 3.0  # tolerances from the surface: an opening, not noise of a wall
GAPING = 0.25  # of the hull's surface so far away: more lets nothing through where the part does
PROBES = 400, 4000  # points on the hull, and on the piece, whose spacing is allowed for
SIMPLER = 0.25  # of the tolerance: noise below it is not worth a cut
FEW_FACES = 6000  # cuts cost 10 ms on so many
CRUMB = 1e-5  # of the volume: dropped
FILM = 0.2  # of the tolerance: thinner pieces are dropped
MAX_VERTICES = 64  # of one hull: keeps the engine's support function fast
HALF = 0.5  # of the hull's section: less is more phantom than part
SHRINK = 0.7  # share of its volume a piece keeps when its sides are cut flat


def convex_pieces(
    mesh: PartMesh, *, tolerance: float, max_pieces: int = 64
) -> tuple[PartMesh, ...]:
    """Cut a closed noisy mesh into convex pieces.

    Args:
        mesh: watertight.
        tolerance: how far hulls may stick out of the part, scene units; about the grid size.
        max_pieces: at most so many.

    Returns:
        Convex meshes in the mean colour of the part; at least one.

    Raises:
        MeshError: if the mesh is not closed.

    Source: binary space partition along walls, least sum of (hull - volume); planes come from
        face-area peaks, because a noisy wall has no concave edge to start from.
    """
    solid = _simpler(require_closed(mesh, "convex_pieces"), tolerance)
    leaves = _cut_up(solid, tolerance, max_pieces)
    red, green, blue = (int(c) for c in mesh.colors.mean(0)) if len(mesh.colors) else (160,) * 3
    hulls = [_tidy(leaf, tolerance) for leaf in leaves]
    kept = [h for h in hulls if h.num_tri() >= 4 and h.volume() > CRUMB * solid.volume() / 10]
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
    directions = main_directions(_facets(solid))
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
        if len(children) + len(queue) + len(done) > max_pieces or not children:
            done.append(piece)
            continue
        for child in children:
            put(child)
    return done + [piece for _, _, piece in queue]


def _facets(solid: Manifold) -> Facets:
    raw = solid.to_mesh64()
    return facets(np.array(raw.vert_properties[:, :3]), np.array(raw.tri_verts, np.int64))


def _excess(piece: Manifold, tolerance: float) -> float:
    """Return hull minus volume, 0 when the piece is convex enough."""
    hull = piece.hull()
    gap = float(hull.volume() - piece.volume())
    allowed = max(CONVEX * piece.volume(), STICKS_OUT * tolerance * hull.surface_area())
    return gap if gap > allowed or _gaping(piece, hull, tolerance) else 0.0


def _gaping(piece: Manifold, hull: Manifold, tolerance: float) -> bool:
    """Return whether the hull closes an opening that is wide, however thin the piece.

    A slice of a frame has little empty volume in its hull, and yet nothing goes through it.
    """
    if piece.volume() > (1 - OPEN) * hull.volume():
        return False
    rng = np.random.default_rng(0)
    outer, own = (_sprinkled(solid, count, rng)
                  for solid, count in zip((hull, piece), PROBES, strict=True))
    spacing = float(np.sqrt(piece.surface_area() / PROBES[1]))
    away = cKDTree(own).query(outer, distance_upper_bound=FAR * tolerance + spacing)[0]
    return bool((away == np.inf).mean() > GAPING)


def _sprinkled(solid: Manifold, count: int, rng: np.random.Generator) -> F64:
    """Return [count, 3] points spread evenly over a surface."""
    raw = solid.to_mesh64()
    tri = np.array(raw.vert_properties[:, :3])[np.array(raw.tri_verts, np.int64)]
    areas = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1)
    tri = tri[rng.choice(len(tri), count, p=areas / areas.sum())]
    side, up = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
    return np.asarray((1 - side) * tri[:, 0] + side * (1 - up) * tri[:, 1] + side * up * tri[:, 2])


def _best_split(
    piece: Manifold, directions: F64, tolerance: float, smallest: float
) -> list[Manifold]:
    best: list[Manifold] = []
    least = np.inf
    for cut in wall_cuts(_facets(piece), directions, tolerance):
        children = split(piece, cut, tolerance, smallest)
        if len(children) < 2:
            continue
        cost = _cost(children, tolerance)
        if cost < least:
            best, least = children, cost
    return best


def split(piece: Manifold, cut: Cut, tolerance: float, smallest: float) -> list[Manifold]:
    """Return the connected pieces on both sides of a cut, crumbs and films dropped."""
    normal = cut.normal.tolist()
    opposite = (-cut.normal).tolist()
    sides = (piece.trim_by_plane(opposite, -cut.low), piece.trim_by_plane(normal, cut.high))
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


def _tidy(piece: Manifold, tolerance: float) -> Manifold:
    """Return the hull of a piece with its walls cut flat and few corners."""
    hull = hull_of(corners_of(_flat_sides(piece, tolerance)))
    step = 0.05 * tolerance
    while hull.num_vert() > MAX_VERTICES and step < 4 * tolerance:
        # corners are only dropped: the hull can only shrink
        hull = hull_of(corners_of(hull.simplify(step)))
        step *= 1.5
    return hull


def _flat_sides(piece: Manifold, tolerance: float) -> Manifold:
    """Cut every noisy side at the level where the piece fills half of its hull's section.

    The hull of a noisy board touches its highest bumps. Above the chosen level more of the hull is
    empty than full: cutting there removes more phantom than part.
    """
    surface, outer = _facets(piece), _facets(piece.hull())
    out = piece
    for axis in main_directions(outer):
        for direction in (axis, -axis):
            level = _half_full(surface, outer, direction, 2 * tolerance)
            trimmed = out.trim_by_plane((-direction).tolist(), -level)
            if trimmed.volume() > SHRINK * out.volume():
                out = trimmed
    return out


def _half_full(surface: Facets, outer: Facets, direction: F64, reach: float) -> float:
    """Return the highest level, at most `reach` below the top, that is half full.

    The section of a solid at a level is the net area, along the direction, of all faces above it.
    Without such a level (a bar, a wedge) the top itself is returned.
    """
    offsets = surface.centers @ direction
    order = np.argsort(-offsets)
    section = np.cumsum((surface.areas * (surface.normals @ direction))[order])
    front = float((outer.areas * np.maximum(outer.normals @ direction, 0)).sum())
    full = np.flatnonzero(section >= HALF * front)
    top = float(offsets[order[0]]) + reach  # centres of faces lie below the highest corner
    if not len(full) or offsets[order[full[0]]] < offsets[order[0]] - reach:
        return top
    return float(offsets[order[full[0]]])
