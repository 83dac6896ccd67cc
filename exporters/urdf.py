"""Write twin.urdf: the same twin for ROS, with mesh names from its own folder."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from part2gs_robotics.exporters.dynamics import Physics, physics_of
from part2gs_robotics.exporters.inertia import MassProperties
from part2gs_robotics.exporters.meshfile import mean_rgba, piece_name, visual_name, write_meshes
from part2gs_robotics.exporters.mjcf import joint_name
from part2gs_robotics.exporters.xmlio import add, numbers, write_xml
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.kinematics import moves
from part2gs_robotics.model.solids import Box, box_of
from part2gs_robotics.model.twin import Part, Twin

WORLD = "world"  # the name that Gazebo, Drake and MuJoCo take for what never moves


def write_urdf(twin: Twin, folder: Path) -> list[Path]:
    """Write twin.urdf and the mesh files; return all files.

    The root is a massless link `world`, the base is fixed to it. Link frames sit at their joint's
    origin, axes parallel to the world: at joint position 0 every mesh lies where its part was in
    state 0.

    Raises:
        ExportError: if a number, name or mass cannot be written.
    """
    files = write_meshes(twin, folder)
    return [write_xml(twin_urdf(twin, physics_of(twin)), folder / "twin.urdf"), *files]


def twin_urdf(twin: Twin, physics: Physics) -> ET.Element:
    """Return the <robot> element."""
    root = ET.Element("robot", name=twin.name)
    # MuJoCo drops visual geoms and the static base without this; every other parser skips the tag
    add(
        add(root, "mujoco"),
        "compiler",
        discardvisual="false",
        fusestatic="false",
        strippath="false",
    )
    for part in twin.parts:
        add(root, "material", name=f"{part.name}_color")
        add(root[-1], "color", rgba=mean_rgba(part.mesh))
    # KDL ignores inertia on a root, and Gazebo lets a root fall: the fixed world has none
    add(root, "link", name=WORLD)
    base = twin.parts[0].name
    _joint_element(root, f"{WORLD}_joint", "fixed", WORLD, base, _link_origin(twin.parts[0]))
    for i, part in enumerate(twin.parts):
        _link(root, part, physics.masses[i], _link_origin(part))
    for i in range(1, len(twin.parts)):
        _joint(root, twin, i, physics)
    return root


def _link_origin(part: Part) -> F64:
    return np.zeros(3) if part.joint is None else np.asarray(part.joint.origin, float)


def _link(root: ET.Element, part: Part, props: MassProperties, origin: F64) -> None:
    link = add(root, "link", name=part.name)
    inertial = add(link, "inertial")
    add(inertial, "origin", xyz=props.center - origin, rpy="0 0 0")
    add(inertial, "mass", value=props.mass)
    i = props.inertia
    add(
        inertial,
        "inertia",
        ixx=i[0, 0],
        ixy=i[0, 1],
        ixz=i[0, 2],
        iyy=i[1, 1],
        iyz=i[1, 2],
        izz=i[2, 2],
    )
    visual = _shape(link, "visual", f"{part.name}_visual", visual_name(part), origin)
    add(visual, "material", name=f"{part.name}_color")
    for k, piece in enumerate(part.pieces):
        name, box = f"{part.name}_piece_{k:02d}", box_of(piece)
        if box is None:
            _shape(link, "collision", name, piece_name(part, k), origin)
        else:
            _box(link, name, box, origin)


def _shape(link: ET.Element, tag: str, name: str, file: str, origin: F64) -> ET.Element:
    shape = add(link, tag, name=name)
    add(shape, "origin", xyz=-origin, rpy="0 0 0")
    add(add(shape, "geometry"), "mesh", filename=file)
    return shape


def _box(link: ET.Element, name: str, box: Box, origin: F64) -> None:
    """Add a piece that is a box; engines with margins put none round it."""
    shape = add(link, "collision", name=name)
    add(shape, "origin", xyz=box.middle - origin, rpy=_rpy(box.rotation))
    add(add(shape, "geometry"), "box", size=2 * box.half)


def _rpy(rotation: F64) -> tuple[float, float, float]:
    """Return roll, pitch and yaw: turns about fixed x, y, z, one after the other."""
    pitch = float(np.arcsin(np.clip(-rotation[2, 0], -1.0, 1.0)))
    if abs(rotation[2, 0]) > 1 - 1e-12:  # straight up or down: roll and yaw are one
        return 0.0, pitch, float(np.arctan2(-rotation[0, 1], rotation[1, 1]))
    roll = float(np.arctan2(rotation[2, 1], rotation[2, 2]))
    return roll, pitch, float(np.arctan2(rotation[1, 0], rotation[0, 0]))


def _joint(root: ET.Element, twin: Twin, index: int, physics: Physics) -> None:
    part = twin.parts[index]
    parent, offset = (
        twin.parts[part.parent],
        _link_origin(part) - _link_origin(twin.parts[part.parent]),
    )
    assert part.joint is not None  # every part but the base has one
    if not moves(part):
        _joint_element(root, joint_name(part), "fixed", parent.name, part.name, offset)
        return
    dyn = physics.joints[index]
    screw = part.joint.kind == "screw"
    kind = "revolute" if screw else part.joint.kind
    child = f"{part.name}_turn" if screw else part.name
    joint = _joint_element(root, joint_name(part), kind, parent.name, child, offset)
    add(joint, "axis", xyz=part.joint.axis)
    add(
        joint,
        "limit",
        lower=part.limits[0],
        upper=part.limits[1],
        effort=dyn.force,
        velocity=dyn.velocity,
    )
    add(joint, "dynamics", damping=dyn.damping, friction=dyn.friction)
    if screw:
        _mimic(root, part, child, part.joint.axis, part.joint.pitch, dyn.force, dyn.velocity)


def _joint_element(
    root: ET.Element, name: str, kind: str, parent: str, child: str, offset: F64
) -> ET.Element:
    joint = add(root, "joint", name=name, type=kind)
    add(joint, "parent", link=parent)
    add(joint, "child", link=child)
    add(joint, "origin", xyz=offset, rpy="0 0 0")
    return joint


def _mimic(
    root: ET.Element, part: Part, turn: str, axis: F64, pitch: float, force: float, velocity: float
) -> None:
    """Add the slide of a screw.

    URDF has no screw joint: an almost massless link turns, its child slides along and mimics it.
    """
    link = add(root, "link", name=turn)
    inertial = add(
        link, "inertial"
    )  # tiny but physical: a link without mass is refused by several simulators
    add(inertial, "origin", xyz="0 0 0", rpy="0 0 0")
    add(inertial, "mass", value=1e-6)
    add(inertial, "inertia", ixx=1e-9, ixy=0, ixz=0, iyy=1e-9, iyz=0, izz=1e-9)
    joint = _joint_element(
        root, f"{joint_name(part)}_slide", "prismatic", turn, part.name, np.zeros(3)
    )
    add(joint, "axis", xyz=numbers(axis))
    ends = sorted((pitch * part.limits[0], pitch * part.limits[1]))
    add(
        joint,
        "limit",
        lower=ends[0],
        upper=ends[1],
        effort=force / max(abs(pitch), 1e-9),
        velocity=velocity,
    )
    add(joint, "mimic", joint=joint_name(part), multiplier=pitch, offset=0)
