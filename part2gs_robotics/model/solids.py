"""Solids: PartMesh to manifold3d and back, what is measured on both, and what watertight means."""

from __future__ import annotations

from dataclasses import dataclass

import manifold3d
import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from part2gs_robotics.errors import MeshError
from part2gs_robotics.model.arrays import F64, I64
from part2gs_robotics.model.twin import PartMesh

FLAKE = 1e-5  # of the size: overlap as thin is rounding, a tenth of it in files; cells are 1e-2
GREY = (160, 160, 160)  # colour of faces nobody observed
SPRINKLED = 20_000  # points on a surface: 0.7 % of a cube's side apart
ROUND = 1e-6  # of a piece: corners and normals so near are the same, a file has ten digits
KEPT = 0.5  # of its volume a simpler copy must keep; the parts of twenty twins keep 0.96 at least


def to_manifold(mesh: PartMesh) -> Manifold:
    """Return the solid of a mesh; its `status()` tells whether it is closed.

    What is open is not shown to manifold3d: one in a hundred (a face twice) ended the process.
    """
    faces = np.ascontiguousarray(mesh.faces, np.uint64)
    points = np.ascontiguousarray(mesh.vertices, np.float64)
    shown = faces if _cancels(faces) else faces[:1]
    return manifold3d.Manifold(manifold3d.Mesh64(points, shown))


def _cancels(faces: NDArray[np.uint64]) -> bool:
    """Return whether every edge is walked as often one way as the other."""
    ends, most = np.roll(faces, -1, axis=1), faces.max(initial=np.uint64(0)) + np.uint64(1)
    there, back = np.sort((faces * most + ends).ravel()), np.sort((ends * most + faces).ravel())
    return bool(np.array_equal(there, back) or most >= 1 << 32)  # there products wrap around


def to_mesh(solid: Manifold, color: tuple[int, int, int] = GREY) -> PartMesh:
    """Return the surface of a solid in one colour."""
    vertices, faces = arrays(solid)
    return PartMesh(vertices, faces, np.tile(np.array(color, np.uint8), (len(vertices), 1)))


def arrays(solid: Manifold) -> tuple[F64, I64]:
    """Return vertices [V, 3] and faces [F, 3] of a solid."""
    raw = solid.to_mesh64()
    return np.array(raw.vert_properties[:, :3], np.float64), np.array(raw.tri_verts, np.int64)


def hull_of(points: NDArray[np.float64]) -> Manifold:
    """Return the convex hull of points by Qhull, as the physics engine computes it.

    Source: manifold3d's own hull was 0.7 % too large for one noisy board in trials; it remains
    the way out where Qhull's triangles do not close.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return manifold3d.Manifold()
    tri = hull.simplices.astype(np.int64)
    corners = points[tri]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ni,ni->n", normal, hull.equations[:, :3]) < 0
    tri[inward] = tri[inward][:, ::-1]
    used, tri = np.unique(tri, return_inverse=True)
    solid = to_manifold(PartMesh(points[used], tri.reshape(-1, 3), np.zeros((0, 3), np.uint8)))
    closed = solid.status() == manifold3d.Error.NoError and solid.volume() > 0
    return solid if closed else manifold3d.Manifold.hull_points(np.ascontiguousarray(points))


def corners_of(solid: Manifold) -> NDArray[np.float64]:
    """Return the [V, 3] vertices of a solid."""
    return arrays(solid)[0].reshape(-1, 3)


def watertight(mesh: PartMesh) -> bool:
    """Say whether a mesh is closed: manifold3d, its volume and its edges all agree.

    Source: each of the three alone accepted an open or doubled surface in trials.
    """
    return defect(mesh) is None


def defect(mesh: PartMesh) -> str | None:
    """Return why a mesh is not a closed solid, None if it is."""
    if len(mesh.faces) < 4:
        return f"{len(mesh.faces)} faces, a solid has at least 4"
    if not np.isfinite(mesh.vertices).all():
        return "a vertex is not finite"
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        return "a face names a vertex that does not exist"
    solid = to_manifold(mesh)
    if solid.status() != manifold3d.Error.NoError:
        return f"manifold3d says {solid.status().name}"
    if solid.volume() <= 0:
        return f"volume {solid.volume():.3g} is not positive"
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1) @ (
        len(mesh.vertices), 1)
    if (np.unique(edges, return_counts=True)[1] != 2).any():
        return "an edge without exactly two faces"
    return None


def require_closed(mesh: PartMesh, name: str) -> Manifold:
    """Return the solid of a closed mesh.

    Raises:
        MeshError: if the mesh is not watertight.
    """
    if reason := defect(mesh):
        raise MeshError(
            f"{name}: the mesh ({len(mesh.vertices)} vertices, {len(mesh.faces)} faces) "
            f"is not closed: {reason}. Needed a watertight solid; rebuild or repair it."
        )
    return to_manifold(mesh)


def bounds(meshes: tuple[PartMesh, ...]) -> NDArray[np.float64]:
    """Return [2, 3] lowest and highest corner of all meshes."""
    points = np.concatenate([m.vertices for m in meshes])
    return np.stack([points.min(0), points.max(0)])


def size_of(meshes: tuple[PartMesh, ...]) -> float:
    """Return the diagonal of the box around all meshes, scene units."""
    low, high = bounds(meshes)
    return float(np.linalg.norm(high - low))


def simpler(real: Manifold, step: float) -> Manifold:
    """Return a copy of a solid simplified by a step, or itself if it is thin: a pane would vanish.

    Args:
        real: a part.
        step: how far its surface may move, scene units.
    """
    simple = real.simplify(step)
    return simple if simple.volume() > KEPT * real.volume() else real


def thickness(overlap: Manifold) -> float:
    """Return the largest 2 volume / surface of the pieces of a solid: a slab's thickness."""
    if overlap.is_empty() or overlap.volume() <= 0:
        return 0.0
    return max((2 * float(p.volume()) / float(p.surface_area()) for p in overlap.decompose()
                if p.volume() > 0), default=0.0)


@dataclass(frozen=True)
class Bound:
    """How far convex pieces are from the part they stand for.

    Attributes:
        phantom: volume of the pieces outside the part.  missing: part outside the pieces.
        volume: of the part, units^3.  phantom_depth: thickest phantom region, 2 volume / surface.
        beyond: farthest that a point of the pieces lies outside of the part, scene units.
        short: farthest that a point of the part lies outside of the pieces, scene units.
    """

    phantom: float
    missing: float
    volume: float
    phantom_depth: float
    beyond: float
    short: float

    @property
    def overlap(self) -> float:
        """Intersection over union of pieces and part."""
        inside = self.volume - self.missing
        return inside / (self.volume + self.phantom)


def bound(mesh: PartMesh, pieces: tuple[PartMesh, ...]) -> Bound:
    """Measure convex pieces against a mesh, see `bound_of`."""
    return bound_of(to_manifold(mesh), pieces)


def bound_of(solid: Manifold, pieces: tuple[PartMesh, ...]) -> Bound:
    """Measure convex pieces, taken as the hulls of their corners, against a solid.

    Volumes are exact, distances between points sprinkled over both surfaces.
    """
    hulls = [hull_of(p.vertices) for p in pieces]
    union = manifold3d.Manifold.batch_boolean(hulls, manifold3d.OpType.Add)
    phantom = union - solid
    parts = phantom.decompose() if phantom.volume() > 0 else []
    depth = max((2 * p.volume() / p.surface_area() for p in parts if p.volume() > 0), default=0.0)
    left = solid - union
    own, theirs = sprinkled(solid), sprinkled(union)
    return Bound(max(float(phantom.volume()), 0.0), max(float(left.volume()), 0.0),
                 float(solid.volume()), float(depth), _farthest(sprinkled(phantom), own),
                 _farthest(sprinkled(left), theirs))


def sprinkled(solid: Manifold) -> F64:
    """Return [SPRINKLED, 3] points spread by area over a surface, none of an empty solid."""
    (vertices, faces), rng = arrays(solid), np.random.default_rng(0)
    tri = vertices[faces]
    if not len(tri):
        return np.zeros((0, 3))
    areas = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1)
    tri = tri[rng.choice(len(tri), SPRINKLED, p=areas / areas.sum())]
    side, up = np.sqrt(rng.random(SPRINKLED))[:, None], rng.random(SPRINKLED)[:, None]
    return np.asarray((1 - side) * tri[:, 0] + side * (1 - up) * tri[:, 1] + side * up * tri[:, 2])


def _farthest(points: F64, surface: F64) -> float:
    """Return the farthest distance of points from a sprinkled surface, less its spacing."""
    from scipy.spatial import cKDTree

    if not len(points):
        return 0.0
    if not len(surface):
        return np.inf
    tree = cKDTree(surface)
    spacing = float(tree.query(surface, k=2, workers=-1)[0][:, 1].max())
    return max(float(tree.query(points, workers=-1)[0].max()) - spacing, 0.0)


@dataclass(frozen=True)
class Box:
    """A rectangular box in the frame of its part: engines collide it faster and exactly.

    Attributes:
        middle: [3] scene units.  half: [3] half of its sides, scene units.
        rotation: [3, 3] part_from_box, its columns the directions of the sides.
    """

    middle: F64
    half: F64
    rotation: F64


def box_of(piece: PartMesh) -> Box | None:
    """Return the box that a convex piece is, None if it is none."""
    axes = _directions(piece)
    if axes is None:
        return None
    along = piece.vertices @ axes
    low, high = along.min(0), along.max(0)
    half, size = 0.5 * (high - low), float(np.linalg.norm(high - low))
    at_corner = np.minimum(np.abs(along - low), np.abs(along - high)) < ROUND * size
    if not at_corner.all() or (half < ROUND * size).any():
        return None
    return Box(axes @ (0.5 * (low + high)), half, axes)


def _directions(piece: PartMesh) -> F64 | None:
    """Return [3, 3] columns, right-handed, along which all faces look, None if there are none."""
    tri = piece.vertices[piece.faces]
    cross = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    area = np.linalg.norm(cross, axis=1)
    normals = cross[area > ROUND * area.max()] / area[area > ROUND * area.max(), None]
    found: list[F64] = []
    for normal in normals:
        along = np.abs(np.array(found).reshape(-1, 3) @ normal)
        if (along > 1 - ROUND).any():
            continue
        if len(found) == 3 or (along > ROUND).any():
            return None
        found.append(normal)
    if len(found) != 3:
        return None
    order = sorted(found, key=lambda n: int(np.abs(n).argmax()))
    axes = np.stack([n * np.sign(n[np.abs(n).argmax()]) for n in order], 1)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return axes
