"""A URDF in the words of `described.py`, read as text: no engine drops a number on the way."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from part2gs_robotics.agree.described import NO, Body, Described, Drive, rotated, tensor_of
from part2gs_robotics.agree.meshes import Meshes
from part2gs_robotics.agree.of_mujoco import SIGNS
from part2gs_robotics.model.arrays import F64

WORLD, TURN, SLIDE = "world", "_turn", "_slide"  # names our URDF adds to those of parts


def of_urdf(path: Path, meshes: Meshes) -> Described:
    """Return what a URDF says, a screw's turn and slide as one joint.

    Args:
        path: inspected before, so it is plain XML whose names stay in its folder.
        meshes: of the folder.

    Raises:
        ValueError: a number that is none, with its place.
    """
    root = ET.parse(path).getroot()
    joints = {_child(j): j for j in root.iter("joint") if j.find("parent") is not None}
    links = [k for k in root.iter("link") if k.get("name") != WORLD]
    names = {k.get("name", "") for k in links}
    bodies = {}
    for link in links:
        name = link.get("name", "")
        if name.endswith(TURN) and name.removesuffix(TURN) in names:
            continue
        bodies[name] = _body(link, joints, meshes)
    return Described(path.name, bodies, faults=tuple(_faults(path.name, root, joints)),
                     title=root.get("name", ""))


def _faults(file: str, root: ET.Element, joints: dict[str, ET.Element]
            ) -> Iterator[tuple[str, str, str, str]]:
    """Yield what no other file has a word for: a base that is not fixed, limits inside limits."""
    for name, joint in joints.items():
        if _parent(joint) == WORLD and joint.get("type") != "fixed":
            yield ("same joint", f"{file}: {name}", f"hangs on the world by a {joint.get('type')} "
                   "joint", f"{file}: make the joint of {name} to the world fixed")
        if joint.find("safety_controller") is not None:
            yield ("same limits", f"{file}: {name}", "has soft limits of a safety_controller",
                   f"{file}: remove <safety_controller> of {joint.get('name')}")
    if root.find(f"link[@name='{WORLD}']") is None:
        yield ("same bodies", file, "has no link `world`", f"{file}: hang the base on a massless "
               "link `world` by a fixed joint, or build the twin again")


def _child(joint: ET.Element) -> str:
    child = joint.find("child")
    return "" if child is None else child.get("link", "")


def _parent(joint: ET.Element) -> str:
    parent = joint.find("parent")
    return "" if parent is None else parent.get("link", "")


def _body(link: ET.Element, joints: dict[str, ET.Element], meshes: Meshes) -> Body:
    name = link.get("name", "")
    place = _rest(name, joints)
    inertial = link.find("inertial")
    at = place @ _origin(inertial)
    tensor = None if inertial is None else inertial.find("inertia")
    found = {k: numbers(v, 1)[0] for k, v in ({} if tensor is None else tensor.attrib).items()}
    joint = joints.get(name)
    turn = joints.get(f"{name}{TURN}")
    parent = "" if joint is None else _parent(joint if turn is None else turn)
    shapes = {tag: [place_of(_corners(s, meshes), place @ _origin(s)) for s in link.iter(tag)]
              for tag in ("visual", "collision")}
    seen = shapes["visual"]
    return Body(
        name, "" if parent == WORLD else parent, _value(inertial, "mass", "value"), at[:3, 3],
        rotated(tensor_of(found), at[:3, :3]), np.concatenate(seen) if seen else np.zeros((0, 3)),
        tuple(shapes["collision"]),
        None if joint is None or parent == WORLD else _drive(name, joint, joints))


def _drive(name: str, joint: ET.Element, joints: dict[str, ET.Element]) -> Drive:
    turn = joints.get(f"{name}{TURN}")
    mimic = joint.find("mimic")
    if turn is not None and mimic is not None and mimic.get("joint") == turn.get("name"):
        found = _plain(f"{name}{TURN}", turn, joints)
        pitch = numbers(mimic.get("multiplier", "1"), 1)[0]
        along = float(found.axis @ _plain(name, joint, joints).axis)
        return Drive("screw", found.axis, found.origin, pitch * np.sign(along), found.limits,
                     found.numbers, name=found.name)
    return _plain(name, joint, joints)


def _plain(name: str, joint: ET.Element, joints: dict[str, ET.Element]) -> Drive:
    place, axis, limit = _rest(name, joints), joint.find("axis"), joint.find("limit")
    along = np.array([1.0, 0.0, 0.0] if axis is None else numbers(axis.get("xyz", ""), 3))
    length = float(np.linalg.norm(along))
    kind = joint.get("type", "")
    ends = [_value(joint, "limit", key, 0.0) for key in ("lower", "upper")]
    if kind == "continuous" or (limit is None and kind != "fixed"):
        ends = [-np.inf, np.inf]
    said = {"damping": _value(joint, "dynamics", "damping", 0.0),
            "friction": _value(joint, "dynamics", "friction", 0.0),
            "effort": _value(joint, "limit", "effort", 0.0),
            "velocity": _value(joint, "limit", "velocity", 0.0)}
    return Drive("revolute" if kind == "continuous" else kind,
                 place[:3, :3] @ along / (length or 1.0), place[:3, 3], 0.0, (ends[0], ends[1]),
                 {} if kind == "fixed" else said, name=joint.get("name", ""))


def _rest(name: str, joints: dict[str, ET.Element]) -> F64:
    """Return [4, 4] world_from_link with all joints at 0."""
    out, seen = np.eye(4), set[str]()
    while name in joints and name not in seen:
        seen.add(name)
        out = _origin(joints[name]) @ out
        name = _parent(joints[name])
    return out


def _origin(element: ET.Element | None) -> F64:
    origin, out = None if element is None else element.find("origin"), np.eye(4)
    if origin is not None:
        out[:3, 3] = numbers(origin.get("xyz", "0 0 0"), 3)
        out[:3, :3] = Rotation.from_euler("xyz", numbers(origin.get("rpy", "0 0 0"), 3)).as_matrix()
    return out


def _corners(shape: ET.Element, meshes: Meshes) -> F64:
    mesh, box = shape.find("geometry/mesh"), shape.find("geometry/box")
    if mesh is not None:
        scale = np.array(numbers(mesh.get("scale", "1 1 1"), 3))
        return meshes.corners(mesh.get("filename", "")) * scale
    if box is not None:
        return SIGNS * np.array(numbers(box.get("size", ""), 3)) / 2
    return np.full((1, 3), NO)  # a shape no exporter writes: it is like no other


def place_of(points: F64, world_from_local: F64) -> F64:
    """Return [N, 3] points in the world."""
    return np.asarray(points @ world_from_local[:3, :3].T + world_from_local[:3, 3])


def _value(element: ET.Element | None, tag: str, key: str, otherwise: float = NO) -> float:
    found = None if element is None else element.find(tag)
    text = None if found is None else found.get(key)
    return otherwise if text is None else numbers(text, 1)[0]


def numbers(text: str, count: int) -> list[float]:
    """Return the numbers of an attribute.

    Raises:
        ValueError: if they are not `count` finite ones.
    """
    try:
        found = [float(word) for word in text.split()]
    except ValueError:
        found = []
    if len(found) != count or not np.isfinite(found).all():
        raise ValueError(f"{text[:60]!r} where {count} finite number(s) are needed")
    return found
