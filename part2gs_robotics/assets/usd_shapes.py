"""Bodies, joints and shapes of a UsdPhysics stage, written as elements of an MJCF world."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.twin import COLLIDES_GROUP, SEEN_GROUP

if TYPE_CHECKING:
    from pxr import Usd

HINGE, SLIDE = "PhysicsRevoluteJoint", "PhysicsPrismaticJoint"
# Approximations that one hull of the engine stands for; of others it would fill what is hollow.
HULLS = ("", "none", "convexHull", "boundingCube", "boundingSphere")
DENSITY = "1000"  # kg/m3 of a body that says neither mass nor density, as UsdPhysics has it


@dataclass(frozen=True)
class Hung:
    """A joint seen from the body it hangs on: that body, the other, both frames, along or against.

    Attributes:
        joint: prim.  child: path.  near, far: [4, 4] body_from_joint of carrier and child.
        sign: -1 where the joint names the child first.
    """

    joint: Usd.Prim
    child: str
    near: F64
    far: F64
    sign: float


@dataclass(frozen=True)
class Shapes:
    """A stage on its way to MJCF.

    Attributes:
        stage.  unit: metres.  assets: element for meshes.  folder: for their files.
    """

    stage: Usd.Stage
    unit: float
    assets: ET.Element
    folder: Path

    def world(self, element: ET.Element, bodies: Mapping[str, Usd.Prim],
              joints: Sequence[Usd.Prim]) -> None:
        """Write every body below the one that carries it; roots stand where the stage has them."""
        ends = {str(j.GetPath()): tuple(self._end(j, side, bodies) for side in (0, 1))
                for j in joints}
        done = set[str]()
        held = [b for pair in ends.values() for a, b in (pair, pair[::-1]) if not a and b]
        carried = {pair[1] for pair in ends.values() if pair[0]}
        free = [path for path in bodies if path not in carried]
        for path in (*held, *free, *bodies):
            if path not in done:
                self._body(element, (path, self._place(bodies[path]), None), (bodies, joints, ends),
                           done)

    def _end(self, joint: Usd.Prim, side: int, bodies: Mapping[str, Usd.Prim]) -> str:
        """Return the path of a joint's body, "" for the world."""
        targets = joint.GetRelationship(f"physics:body{side}").GetTargets()
        path = str(targets[0]) if targets else ""
        while path not in bodies and path not in ("", "/"):
            path = path.rpartition("/")[0]
        return path if path in bodies else ""

    def _place(self, prim: Usd.Prim) -> F64:
        """Return [4, 4] world_from_prim in metres, its scale left out."""
        from pxr import UsdGeom

        matrix = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim), np.float64).T
        out = np.eye(4)
        u, _, vt = np.linalg.svd(matrix[:3, :3])
        out[:3, :3] = u @ vt
        out[:3, 3] = matrix[:3, 3] * self.unit
        return out

    def _body(self, element: ET.Element, hung: tuple[str, F64, Hung | None],
              stage: tuple[Mapping[str, Usd.Prim], Sequence[Usd.Prim], dict[str, tuple[str, ...]]],
              done: set[str]) -> None:
        path, place, joint = hung
        bodies, joints, ends = stage
        done.add(path)
        body = ET.SubElement(element, "body", {"name": path.rpartition("/")[2], **_pose(place)})
        self._inertia(body, bodies[path])
        if joint is not None:
            self._joint(body, joint)
        for geom in self._geoms(bodies[path], bodies):
            body.append(geom)
        for found in joints:
            pair = ends[str(found.GetPath())]
            for side in (0, 1):
                other = pair[1 - side]
                if pair[side] == path and other and other not in done:
                    near, far = self._frame(found, side), self._frame(found, 1 - side)
                    below = Hung(found, other, near, far, 1.0 - 2.0 * side)
                    self._body(body, (other, near @ np.linalg.inv(far), below), stage, done)

    def _frame(self, joint: Usd.Prim, side: int) -> F64:
        """Return [4, 4] body_from_joint of one side, in metres."""
        frame, turn = np.eye(4), joint.GetAttribute(f"physics:localRot{side}").Get()
        if turn is not None:
            quat = np.array([[turn.GetReal(), *turn.GetImaginary()]], np.float64)
            frame[:3, :3] = se3.rotation_from_quats(quat)[0]
        place = joint.GetAttribute(f"physics:localPos{side}").Get()
        frame[:3, 3] = 0.0 if place is None else np.array(place, np.float64) * self.unit
        return frame

    def _joint(self, body: ET.Element, hung: Hung) -> None:
        prim, kind = hung.joint, hung.joint.GetTypeName()
        if kind not in (HINGE, SLIDE):
            return
        which = "XYZ".index(str(prim.GetAttribute("physics:axis").Get() or "X"))
        axis = hung.sign * hung.far[:3, which]
        out = ET.SubElement(body, "joint", name=prim.GetName(), axis=_text(axis),
                            type="hinge" if kind == HINGE else "slide", pos=_text(hung.far[:3, 3]))
        scale = np.pi / 180 if kind == HINGE else self.unit
        ends = [prim.GetAttribute(f"physics:{end}Limit").Get() for end in ("lower", "upper")]
        if all(end is not None and np.isfinite(end) for end in ends):
            out.set("range", _text(np.array(ends, np.float64) * scale))
        drive = "angular" if kind == HINGE else "linear"
        damping = prim.GetAttribute(f"drive:{drive}:physics:damping").Get()
        if damping and np.isfinite(damping):  # angular ones count degrees
            out.set("damping", f"{damping * (180 / np.pi if kind == HINGE else 1.0):.9g}")

    def _inertia(self, body: ET.Element, prim: Usd.Prim) -> None:
        read = {key: prim.GetAttribute(f"physics:{key}").Get()
                for key in ("mass", "centerOfMass", "diagonalInertia", "principalAxes")}
        moments = read["diagonalInertia"]
        if not read["mass"] or moments is None or min(moments) <= 0:
            return  # the engine's own, of shapes and density
        quat = read["principalAxes"]
        center = np.array(read["centerOfMass"] or (0, 0, 0), np.float64)
        ET.SubElement(body, "inertial", mass=f"{read['mass']:.9g}", pos=_text(center * self.unit),
                      diaginertia=_text(np.array(moments, np.float64) * self.unit**2),
                      quat="1 0 0 0" if quat is None else _text(
                          np.array([quat.GetReal(), *quat.GetImaginary()])))

    def _geoms(self, prim: Usd.Prim, bodies: Mapping[str, Usd.Prim]) -> Iterator[ET.Element]:
        """Yield the shapes of a body: what collides in group 3, what is only seen in group 2."""
        from pxr import Usd, UsdGeom

        home = se3.inverse(self._place(prim))
        walk = iter(Usd.PrimRange(prim, Usd.TraverseInstanceProxies()))
        for one in walk:
            if one != prim and str(one.GetPath()) in bodies:
                walk.PruneChildren()
            elif one.IsA(UsdGeom.Gprim):
                points = self._points(one)
                if points is not None:
                    matrix = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(one),
                                      np.float64).T
                    world: F64 = (points @ matrix[:3, :3].T + matrix[:3, 3]) * self.unit
                    yield self._geom(one, world @ home[:3, :3].T + home[:3, 3])

    def _geom(self, prim: Usd.Prim, points: F64) -> ET.Element:
        name = f"shape_{len(self.assets):04d}"
        faces = _triangles(prim)
        lines = ["v " + _text(p) for p in points] + [
            f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
        (self.folder / f"{name}.obj").write_text("\n".join(lines) + "\n")
        near = str(prim.GetAttribute("physics:approximation").Get() or "")
        collides = bool(prim.GetAttribute("physics:collisionEnabled").Get() is not False
                        and "PhysicsCollisionAPI" in prim.GetAppliedSchemas() and near in HULLS)
        # an open mesh that is only seen has no volume to weigh, and weighs nothing
        ET.SubElement(self.assets, "mesh", name=name, file=f"{name}.obj",
                      inertia="convex" if collides else "shell")
        given = {"group": str(COLLIDES_GROUP), "density": DENSITY} if collides else {
            "group": str(SEEN_GROUP), "contype": "0", "conaffinity": "0", "density": "0"}
        named = {"type": "mesh", "mesh": name, "name": f"{name}_{prim.GetName()}"}
        return ET.Element("geom", named | given)

    def _points(self, prim: Usd.Prim) -> F64 | None:
        points = prim.GetAttribute("points").Get() if prim.GetTypeName() == "Mesh" else None
        if points is None or len(points) < 4:
            solid = _primitive(prim)
            return None if solid is None else solid[0]
        return np.array(points, np.float64)


def _triangles(prim: Usd.Prim) -> list[tuple[int, int, int]]:
    """Return the faces of a mesh, cut into fans."""
    if prim.GetTypeName() != "Mesh":
        solid = _primitive(prim)
        return [] if solid is None else [tuple(map(int, f)) for f in solid[1]]  # type: ignore[misc]
    counts = prim.GetAttribute("faceVertexCounts").Get() or []
    corners = list(prim.GetAttribute("faceVertexIndices").Get() or [])
    out, start = [], 0
    for count in counts:
        face = corners[start:start + count]
        out += [(face[0], face[k], face[k + 1]) for k in range(1, len(face) - 1)]
        start += count
    return out


def _primitive(prim: Usd.Prim) -> tuple[F64, F64] | None:
    """Return corners and faces of a cube, ball, cylinder or capsule in its own units."""
    import manifold3d

    kind, read = prim.GetTypeName(), prim.GetAttribute
    if kind == "Cube":
        solid = manifold3d.Manifold.cube([float(read("size").Get())] * 3, True)
    elif kind == "Sphere":
        solid = manifold3d.Manifold.sphere(float(read("radius").Get()), 32)
    elif kind in ("Cylinder", "Capsule"):
        radius, height = float(read("radius").Get()), float(read("height").Get())
        solid = manifold3d.Manifold.cylinder(height, radius, -1.0, 32, True)
        if kind == "Capsule":
            ball = manifold3d.Manifold.sphere(radius, 32)
            solid = (solid + ball.translate([0, 0, height / 2])
                     + ball.translate([0, 0, -height / 2])).hull()
        turn = {"X": [0, 90, 0], "Y": [90, 0, 0]}.get(str(read("axis").Get()))
        solid = solid.rotate(turn) if turn else solid
    else:
        return None
    mesh = solid.to_mesh()
    return (np.asarray(mesh.vert_properties, np.float64)[:, :3],
            np.asarray(mesh.tri_verts, np.float64))


def _pose(place: F64) -> dict[str, str]:
    return {"pos": _text(place[:3, 3]), "quat": _text(se3.quat_from_rotation(place[:3, :3]))}


def _text(values: F64) -> str:
    return " ".join(f"{v:.9g}" for v in values)
