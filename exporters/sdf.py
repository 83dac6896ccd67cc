"""Write model.sdf and model.config: SDFormat 1.10, in metres, z up, as Gazebo reads it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np

from part2gs_robotics.exporters.dynamics import Physics, physics_of
from part2gs_robotics.exporters.inertia import MassProperties, link_origin, upright
from part2gs_robotics.exporters.meshfile import piece_name, visual_name, write_meshes
from part2gs_robotics.exporters.mjcf import joint_name
from part2gs_robotics.exporters.xmlio import add, numbers, write_xml
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.kinematics import moves
from part2gs_robotics.model.twin import Part, PartMesh, Twin

VERSION = "1.10"  # the first with screw_thread_pitch, metres per turn, right-handed


def write_sdf(twin: Twin, folder: Path) -> list[Path]:
    """Write model.sdf, model.config and the mesh files; return all files.

    Lengths are metres, as the format wants; the model's pose turns the scene's up to +z.

    Raises:
        ExportError: if a number, name or mass cannot be written.
    """
    metric = in_metres(twin)
    files = write_meshes(metric, folder)
    config = ET.Element("model")
    add(config, "name").text = twin.name
    add(config, "sdf", version=VERSION).text = "model.sdf"
    return [write_xml(model_sdf(metric, physics_of(metric)), folder / "model.sdf"),
            write_xml(config, folder / "model.config"), *files]


def in_metres(twin: Twin) -> Twin:
    """Return the same object with a metre as its unit; an assumed scale is taken as it is."""
    unit = twin.meters

    def longer(mesh: PartMesh) -> PartMesh:
        return replace(mesh, vertices=mesh.vertices * unit)

    parts = []
    for part in twin.parts:
        joint, limits = part.joint, part.limits
        if joint is not None:
            slide = 1.0 if joint.turns else unit
            joint = replace(joint, origin=joint.origin * unit, value=joint.value * slide,
                            pitch=joint.pitch * unit)
            limits = (limits[0] * slide, limits[1] * slide)
        parts.append(replace(part, mesh=longer(part.mesh), joint=joint, limits=limits,
                             pieces=tuple(map(longer, part.pieces))))
    return replace(twin, parts=tuple(parts), meters_per_unit=1.0)


def model_sdf(twin: Twin, physics: Physics) -> ET.Element:
    """Return the <sdf> element of a twin in metres."""
    root = ET.Element("sdf", version=VERSION)
    model = add(root, "model", name=twin.name, canonical_link=twin.parts[0].name)
    _text(model, "pose", f"0 0 0 {numbers(_roll_pitch_yaw(upright(twin, (0.0, 0.0, 1.0))))}")
    for part, props in zip(twin.parts, physics.masses, strict=True):
        _link(model, part, props)
    _joint(model, "world_joint", "fixed", "world", twin.parts[0].name)
    for index in range(1, len(twin.parts)):
        _moving_joint(model, twin, index, physics)
    return root


def _roll_pitch_yaw(rot: F64) -> F64:
    level = float(np.hypot(rot[0, 0], rot[1, 0]))
    pitch = np.arctan2(-rot[2, 0], level)
    if level < 1e-7:  # straight up or down: roll and yaw are one turn
        return np.array([np.arctan2(-rot[1, 2], rot[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(rot[2, 1], rot[2, 2]), pitch, np.arctan2(rot[1, 0], rot[0, 0])])


def _text(parent: ET.Element, tag: str, value: str | float | F64) -> ET.Element:
    found = add(parent, tag)
    found.text = value if isinstance(value, str) else numbers(np.atleast_1d(value))
    return found


def _link(model: ET.Element, part: Part, props: MassProperties) -> None:
    origin = link_origin(part)
    link = add(model, "link", name=part.name)
    _text(link, "pose", f"{numbers(origin)} 0 0 0")
    inertial = add(link, "inertial")
    _text(inertial, "pose", f"{numbers(props.center - origin)} 0 0 0")
    _text(inertial, "mass", props.mass)
    inertia, i = add(inertial, "inertia"), props.inertia
    for tag, value in (("ixx", i[0, 0]), ("ixy", i[0, 1]), ("ixz", i[0, 2]), ("iyy", i[1, 1]),
                       ("iyz", i[1, 2]), ("izz", i[2, 2])):
        _text(inertia, tag, float(value))
    _shape(link, "visual", f"{part.name}_visual", visual_name(part), origin)
    for k in range(len(part.pieces)):
        _shape(link, "collision", f"{part.name}_piece_{k:02d}", piece_name(part, k), origin)


def _shape(link: ET.Element, tag: str, name: str, file: str, origin: F64) -> None:
    shape = add(link, tag, name=name)
    _text(shape, "pose", f"{numbers(-origin)} 0 0 0")
    _text(add(add(shape, "geometry"), "mesh"), "uri", file)


def _joint(model: ET.Element, name: str, kind: str, parent: str, child: str) -> ET.Element:
    joint = add(model, "joint", name=name, type=kind)
    _text(joint, "parent", parent)
    _text(joint, "child", child)
    return joint


def _moving_joint(model: ET.Element, twin: Twin, index: int, physics: Physics) -> None:
    part = twin.parts[index]
    assert part.joint is not None  # every part but the base has one
    kind = part.joint.kind
    joint = _joint(model, joint_name(part), kind, twin.parts[part.parent].name, part.name)
    if not moves(part):
        return
    if kind == "screw":
        _text(joint, "screw_thread_pitch", 2 * np.pi * part.joint.pitch)
    axis, dyn = add(joint, "axis"), physics.joints[index]
    _text(axis, "xyz", part.joint.axis)
    limit = add(axis, "limit")
    for tag, value in (("lower", part.limits[0]), ("upper", part.limits[1]), ("effort", dyn.force),
                       ("velocity", dyn.velocity)):
        _text(limit, tag, value)
    dynamics = add(axis, "dynamics")
    _text(dynamics, "damping", dyn.damping)
    _text(dynamics, "friction", dyn.friction)
