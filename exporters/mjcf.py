"""Write twin.xml, twin_actuated.xml and scene.xml: MJCF that MuJoCo 3.13 to 4 understand alike.

The two twins hold nothing that counts for a whole model: no <compiler>, no <option>, and defaults
in classes of the twin's own name only. So `<include>` beside other bodies and `attach` with a
prefix leave those as they are. Angles are degrees, as MJCF means where nobody says otherwise.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from part2gs_robotics.exporters.dynamics import JointDynamics, Physics, physics_of
from part2gs_robotics.exporters.inertia import MassProperties
from part2gs_robotics.exporters.meshfile import add_material, piece_name, visual_name, write_meshes
from part2gs_robotics.exporters.scene import scene_xml
from part2gs_robotics.exporters.xmlio import add, write_xml
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import children, moves
from part2gs_robotics.model.se3 import quat_from_rotation
from part2gs_robotics.model.solids import bounds, box_of
from part2gs_robotics.model.twin import COLLIDES_GROUP, SEEN_GROUP, Part, PartMesh, Twin


def write_mjcf(twin: Twin, folder: Path) -> list[Path]:
    """Write twin.xml, scene.xml and the mesh files; return all files.

    Body frames are the world frame at state 0, so every number in the file is the scene's own.

    Raises:
        ExportError: if a number, name or mass cannot be written.
    """
    physics = physics_of(twin)
    files = write_meshes(twin, folder)
    return [
        write_xml(twin_xml(twin, physics), folder / "twin.xml"),
        write_xml(twin_xml(twin, physics, actuated=True), folder / "twin_actuated.xml"),
        write_xml(scene_xml(twin, physics), folder / "scene.xml"),
        *files,
    ]


def joint_name(part: Part) -> str:
    """Return the name of a part's joint in every file."""
    return f"{part.name}_joint"


def twin_xml(twin: Twin, physics: Physics, *, actuated: bool = False) -> ET.Element:
    """Return the <mujoco> element of the object alone, passive or with a servo on every joint."""
    root = ET.Element("mujoco", model=twin.name)
    _defaults(root, twin)
    visual, collision = f"{twin.name}_visual", f"{twin.name}_collision"
    asset = add(root, "asset")
    for part in twin.parts:
        add_material(asset, part)
        add(asset, "mesh", class_=visual, name=f"{part.name}_visual", file=visual_name(part))
        for i, piece in enumerate(part.pieces):
            name, file = f"{part.name}_piece_{i:02d}", piece_name(part, i)
            if box_of(piece) is None:
                add(asset, "mesh", class_=collision, name=name, file=file)
    _body(add(root, "worldbody"), twin, physics, 0)
    if actuated:
        _actuators(root, twin, physics)
    _screws(root, twin)
    _keyframes(root, twin, physics, actuated)
    return root


def _defaults(root: ET.Element, twin: Twin) -> None:
    """Hang every default on a class of the twin's own: the nameless one counts for all models."""
    own = add(add(root, "default"), "default", class_=f"{twin.name}_part")
    # the engine's own softness of friction lets a lid creep down by a degree in a second
    add(own, "joint", solreflimit=(0.008, 1), solimplimit=(0.95, 0.99, 0.001),
        solimpfriction=(0.9999, 0.9999, 0.001))
    visual = add(own, "default", class_=f"{twin.name}_visual")
    add(visual, "mesh", inertia="exact")
    add(visual, "geom", type="mesh", group=str(SEEN_GROUP), contype="0", conaffinity="0", mass=0)
    collision = add(own, "default", class_=f"{twin.name}_collision")
    add(collision, "mesh", inertia="convex")
    # positive solref only: a negative one bypasses the engine's stability clamp
    pale = (0.2, 0.6, 0.9, 0.4)
    add(collision, "geom", type="mesh", group=str(COLLIDES_GROUP), mass=0, solref=(0.008, 1),
        rgba=pale)


def _body(parent: ET.Element, twin: Twin, physics: Physics, index: int) -> None:
    part = twin.parts[index]
    own = {} if index else {"childclass": f"{twin.name}_part"}  # what it carries inherits it
    body = add(parent, "body", name=part.name, **own)
    _inertial(body, physics.masses[index])
    if part.joint is not None and moves(part):
        _joints(body, part, part.joint, physics.joints[index])
    add(
        body,
        "geom",
        class_=f"{twin.name}_visual",
        name=f"{part.name}_visual",
        mesh=f"{part.name}_visual",
        material=f"{part.name}_color",
    )
    for i, piece in enumerate(part.pieces):
        _collision(body, f"{twin.name}_collision", f"{part.name}_piece_{i:02d}", piece)
    if index == 0:
        _sites(body, twin)
    for child in children(twin, index):
        _body(body, twin, physics, child)


def _collision(body: ET.Element, class_: str, name: str, piece: PartMesh) -> None:
    """Add a convex piece; a box as such, which the engine collides faster and at more points."""
    box = box_of(piece)
    if box is None:
        add(body, "geom", class_=class_, name=name, mesh=name)
        return
    add(body, "geom", class_=class_, name=name, type="box", size=box.half, pos=box.middle,
        quat=quat_from_rotation(box.rotation))


def _inertial(body: ET.Element, props: MassProperties) -> None:
    i = props.inertia
    add(
        body,
        "inertial",
        pos=props.center,
        mass=props.mass,
        fullinertia=(i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]),
    )


def _joints(body: ET.Element, part: Part, joint: Joint, dyn: JointDynamics) -> None:
    kind = "slide" if joint.kind == "prismatic" else "hinge"
    add(
        body,
        "joint",
        name=joint_name(part),
        type=kind,
        pos=joint.origin,
        axis=joint.axis,
        range=part.limits if kind == "slide" else np.degrees(part.limits),
        damping=dyn.damping,
        frictionloss=dyn.friction,
        armature=dyn.armature,
    )
    if joint.kind == "screw":
        add(
            body,
            "joint",
            name=f"{joint_name(part)}_slide",
            type="slide",
            pos=joint.origin,
            axis=joint.axis,
            armature=0,
            damping=0,
        )


def _sites(body: ET.Element, twin: Twin) -> None:
    low, high = bounds(tuple(p.mesh for p in twin.parts))
    size = (0.005 * float(np.linalg.norm(high - low)),)
    for name, pos in size_sites(twin).items():
        add(body, "site", name=name, pos=pos, size=size, rgba=(0, 0, 0, 0))


def size_sites(twin: Twin) -> dict[str, F64]:
    """Return [3] places of the three sites that robosuite reads object sizes from, by name."""
    low, high = bounds(tuple(p.mesh for p in twin.parts))
    middle = (low + high) / 2
    up = -np.asarray([0, 0, -1.0]) if twin.up is None else np.asarray(twin.up, float)
    half = float(np.abs(up) @ (high - low)) / 2
    radius = (
        float(np.linalg.norm((high - low) - np.abs(up) * np.abs((high - low) @ np.abs(up)))) / 2
    )
    side = np.eye(3)[int(np.argmin(np.abs(up)))]
    return {
        "bottom_site": middle - half * up,
        "top_site": middle + half * up,
        "horizontal_radius_site": middle + radius * side,
    }


def _actuators(root: ET.Element, twin: Twin, physics: Physics) -> None:
    """Add a critically damped position servo per joint; its command is in rad or scene units."""
    if not physics.joints:
        return
    actuator = add(root, "actuator")
    for index, dyn in physics.joints.items():
        part = twin.parts[index]
        assert part.joint is not None  # moving parts have one
        # the engine's own damping ratio does not see the slide that a screw's turn carries along
        damping = {"kv": dyn.kv} if part.joint.kind == "screw" else {"dampratio": 1.0}
        add(
            actuator,
            "position",
            class_=f"{twin.name}_part",
            name=f"{part.name}_servo",
            joint=joint_name(part),
            kp=dyn.kp,
            **damping,
            ctrlrange=part.limits,
            forcerange=(-dyn.force, dyn.force),
        )


def _screws(root: ET.Element, twin: Twin) -> None:
    screws = [p for p in twin.parts if p.joint is not None and p.joint.kind == "screw"]
    if not screws:
        return
    equality = add(root, "equality")
    for part in screws:
        assert part.joint is not None  # filtered above
        add(
            equality,
            "joint",
            name=f"{part.name}_pitch",
            joint1=f"{joint_name(part)}_slide",
            joint2=joint_name(part),
            polycoef=(0, part.joint.pitch, 0, 0, 0),
            solref=(0.004, 1),
            solimp=(0.99, 0.999, 0.0001),
        )


def _keyframes(root: ET.Element, twin: Twin, physics: Physics, actuated: bool) -> None:
    placed = [twin.parts[i] for i in _down(twin, 0) if moves(twin.parts[i])]
    if not placed:
        return
    keyframe = add(root, "keyframe")
    for state in (0, 1):
        qpos = [state * value for part in placed for value in _positions(part)]
        ctrl = [state * _positions(twin.parts[i])[0] for i in physics.joints]
        commands = {"ctrl": ctrl} if actuated else {}
        add(keyframe, "key", name=f"state_{state}", qpos=qpos, **commands)


def _down(twin: Twin, index: int) -> Iterator[int]:
    """Yield a part and all it carries in the order of `_body`, which is that of MuJoCo's qpos.

    A part that hangs on part 1 comes before part 2, whatever its number is.
    """
    yield index
    for child in children(twin, index):
        yield from _down(twin, child)


def _positions(part: Part) -> list[float]:
    """Return the positions of a moving part's joints in state 1."""
    assert part.joint is not None  # moving parts have one
    value = part.joint.value
    return [value, value * part.joint.pitch] if part.joint.kind == "screw" else [value]
