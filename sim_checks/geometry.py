"""Exact solids of a compiled model and how deep two of them overlap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.solids import defect, thickness, to_manifold
from part2gs_robotics.model.twin import SEEN_GROUP, PartMesh

if TYPE_CHECKING:
    import mujoco
    from manifold3d import Manifold

DENSE = 12_000  # faces of one body above which the sweep uses a simplified copy


@dataclass(frozen=True)
class Overlap:
    """Intersection of two solids.

    Attributes:
        volume: units^3, exact.  thickness: units, 2 volume / surface of the thickest piece.
        solid: the intersection itself, None if empty.
    """

    volume: float
    thickness: float
    solid: Manifold | None


def body_meshes(model: mujoco.MjModel, body: int) -> list[PartMesh]:
    """Return the true surfaces of a body in its own frame.

    Group-2 meshes are the true surface; without any in the model, all meshes and plain shapes are.
    """
    import mujoco

    mesh_type = mujoco.mjtGeom.mjGEOM_MESH
    visual = (model.geom_group == SEEN_GROUP) & (model.geom_type == mesh_type)
    own = model.geom_bodyid == body
    chosen = np.flatnonzero(own & visual if visual.any() else own)
    return [m for g in chosen if (m := _placed_geom(model, int(g))) is not None]


def _placed_geom(model: mujoco.MjModel, geom: int) -> PartMesh | None:
    import mujoco

    local = _geom_surface(model, geom)
    if local is None:
        return None
    rot = np.zeros(9)
    mujoco.mju_quat2Mat(rot, model.geom_quat[geom])
    placed = local.vertices @ rot.reshape(3, 3).T + model.geom_pos[geom]
    return PartMesh(placed, local.faces, local.colors)


def _geom_surface(model: mujoco.MjModel, geom: int) -> PartMesh | None:
    import mujoco

    kind = mujoco.mjtGeom(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _mesh_surface(model, int(model.geom_dataid[geom]))
    solid = _primitive(kind, model.geom_size[geom])
    if solid is None:
        return None
    from part2gs_robotics.model.solids import to_mesh

    return to_mesh(solid)


def _mesh_surface(model: mujoco.MjModel, mesh: int) -> PartMesh:
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    vertices = np.array(model.mesh_vert[start : start + count], np.float64)
    triangles = np.array(model.mesh_face[face : face + faces], np.int64)
    surface = PartMesh(vertices, triangles, np.zeros((count, 3), np.uint8))
    if defect(surface) is None:
        return surface
    # files such as STL list every corner separately: merge the equal ones
    unique, inverse = np.unique(vertices, axis=0, return_inverse=True)
    merged = inverse.reshape(-1)[triangles]
    return PartMesh(unique, merged, np.zeros((len(unique), 3), np.uint8))


def _primitive(kind: mujoco.mjtGeom, size: F64) -> Manifold | None:
    import manifold3d
    import mujoco

    solid = manifold3d.Manifold
    types = mujoco.mjtGeom
    if kind == types.mjGEOM_BOX:
        return solid.cube((2 * size).tolist(), True)
    if kind == types.mjGEOM_SPHERE:
        return solid.sphere(float(size[0]), 48)
    if kind == types.mjGEOM_ELLIPSOID:
        return solid.sphere(1.0, 48).scale(size.tolist())
    if kind == types.mjGEOM_CYLINDER:
        return solid.cylinder(2 * float(size[1]), float(size[0]), -1.0, 48, True)
    if kind == types.mjGEOM_CAPSULE:
        ball, half = solid.sphere(float(size[0]), 48), float(size[1])
        return (ball.translate([0, 0, half]) + ball.translate([0, 0, -half])).hull()
    return None


def body_solid(meshes: list[PartMesh]) -> Manifold | None:
    """Return the union of closed surfaces; None if there are none or one is open."""
    import manifold3d

    if not meshes or any(defect(m) is not None for m in meshes):
        return None
    solids = [to_manifold(m) for m in meshes]
    whole = solids[0]
    if len(solids) > 1:
        whole = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add)
    return whole.as_original()


def collision_pieces(model: mujoco.MjModel, body: int) -> list[PartMesh]:
    """Return the shapes a body collides with, in its own frame; the engine takes their hulls."""
    meets = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    chosen = np.flatnonzero((model.geom_bodyid == body) & meets)
    return [p for g in chosen if (p := _placed_geom(model, int(g))) is not None]


def pieces_solid(model: mujoco.MjModel, body: int) -> Manifold | None:
    """Return the union of what a body collides with, as the engine does: meshes by their hulls.

    None where nothing collides.
    """
    import manifold3d

    hulls = [manifold3d.Manifold.hull_points(np.ascontiguousarray(p.vertices))
             for p in collision_pieces(model, body)]
    hulls = [h for h in hulls if h.volume() > 0]
    if not hulls:
        return None
    return manifold3d.Manifold.batch_boolean(hulls, manifold3d.OpType.Add).as_original()


def lighter(solid: Manifold, tolerance: float) -> tuple[Manifold, bool]:
    """Return the solid, simplified within a tolerance when it is too dense for a sweep."""
    if solid.num_tri() <= DENSE:
        return solid, False
    return solid.simplify(tolerance).as_original(), True


def place(solid: Manifold, world_from_body: F64) -> Manifold:
    """Return the solid moved by a [4, 4] rigid motion."""
    return solid.transform(np.ascontiguousarray(world_from_body[:3, :4]))


def overlap(a: Manifold, b: Manifold, thin: float = 0.0) -> Overlap:
    """Return the exact intersection of two placed solids.

    Args:
        a: one solid.
        b: the other.
        thin: units; what is no thicker is none: two faces that lie on each other leave flakes.
    """
    box_a, box_b = np.array(a.bounding_box()), np.array(b.bounding_box())
    if (box_a[:3] > box_b[3:]).any() or (box_b[:3] > box_a[3:]).any():
        return Overlap(0.0, 0.0, None)
    both = a ^ b
    volume = float(both.volume())
    if volume <= 0:
        return Overlap(0.0, 0.0, None)
    thick = thickness(both)
    return Overlap(volume, thick, both) if thick > thin else Overlap(0.0, 0.0, None)
