"""An exported model.sdf in the words of `described.py`: metres and its pose taken back."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from part2gs_robotics.agree.described import Body, Described, Drive, rotated, tensor_of
from part2gs_robotics.agree.meshes import Meshes
from part2gs_robotics.agree.of_urdf import WORLD, numbers, place_of
from part2gs_robotics.exporters.inertia import upright
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.twin import Twin

UP = (0.0, 0.0, 1.0)  # of the format
TURNED = 1e-6  # of a matrix' entries: ten digits of three angles


def of_sdf(path: Path, name: str, meshes: Meshes, twin: Twin) -> Described:
    """Return what a model.sdf says, in scene units and the scene's world.

    Args:
        path: inspected before: plain XML.
        name: of the file, from the twin folder.
        meshes: of the folder, in metres.
        twin: whose unit and up it must have.

    Raises:
        ValueError: a number or mesh that is none.
    """
    model = ET.parse(path).getroot().find("model")
    if model is None:
        raise ValueError("no <model> in <sdf>")
    joints = {j.findtext("child", ""): j for j in model.iter("joint")}
    unit, poses = twin.meters, {k.get("name", ""): _pose(k) for k in model.iter("link")}
    bodies = {}
    for link in model.iter("link"):
        body = _body(link, joints.get(link.get("name", "")), poses, meshes, unit)
        bodies[body.name] = body
    stands = _pose(model)
    wrong = np.abs(stands[:3, :3] - upright(twin, UP)).max() > TURNED or np.abs(
        stands[:3, 3]).max() > TURNED
    pose = (("same pose", name, f"the model's pose is {model.findtext('pose')}, which does not "
               "turn the scene's up to +z about the origin",
               f"{name}: correct <pose> of <model>, or export it again"),) if wrong else ()
    faults = (*pose, *_held(name, model, joints))
    return Described(name, bodies, faults=faults, title=model.get("name", ""))


def _held(name: str, model: ET.Element, joints: dict[str, ET.Element]
          ) -> Iterator[tuple[str, str, str, str]]:
    """Yield what holds or frees the whole besides its joints."""
    for tag, good in (("static", "false"), ("gravity", "true"), ("kinematic", "false")):
        for element in model.iter(tag):
            if (element.text or "").strip().lower() not in (good, str(int(good == "true"))):
                yield ("own settings", name, f"<{tag}> is {element.text}",
                       f"{name}: remove <{tag}>")
    moved = [j.findtext("child", "") for j in model.iter("joint")]
    for child in dict.fromkeys(c for c in moved if moved.count(c) > 1):
        yield ("same joint", f"{name}: {child}", f"{moved.count(child)} joints hold it",
               f"{name}: leave one joint whose child is {child}")
    base = [j for j in joints.values() if j.findtext("parent") == WORLD]
    if [j.get("type") for j in base] != ["fixed"]:
        yield ("same joint", name, "its base is not fixed to the world",
               f"{name}: add the fixed world_joint, or export it again")


def _body(link: ET.Element, joint: ET.Element | None, poses: dict[str, F64], meshes: Meshes,
          unit: float) -> Body:
    name, place = link.get("name", ""), _pose(link)
    inertial = link.find("inertial")
    at = place if inertial is None else place @ _pose(inertial)
    tensor = {} if inertial is None else {t.tag: numbers(t.text or "", 1)[0]
                                          for t in inertial.iterfind("inertia/*")}
    shapes = {tag: [place_of(_corners(s, meshes), place @ _pose(s)) / unit
                    for s in link.iter(tag)]
              for tag in ("visual", "collision")}
    parent = WORLD if joint is None else joint.findtext("parent", "")
    mass = numbers(link.findtext("inertial/mass", ""), 1)[0]
    seen = shapes["visual"]
    return Body(name, "" if parent == WORLD else parent, mass, at[:3, 3] / unit,
                rotated(tensor_of(tensor), at[:3, :3]) / unit**2,
                np.concatenate(seen) if seen else np.zeros((0, 3)), tuple(shapes["collision"]),
                None if joint is None or parent == WORLD else _drive(joint, place, unit))


def _corners(shape: ET.Element, meshes: Meshes) -> F64:
    scale = np.array(numbers(shape.findtext("geometry/mesh/scale", "1 1 1"), 3))
    return meshes.corners(shape.findtext("geometry/mesh/uri", "")) * scale


def _drive(joint: ET.Element, link: F64, unit: float) -> Drive:
    kind = joint.get("type", "")
    place = link @ _pose(joint)
    if kind == "fixed":
        return Drive(kind, np.array([0.0, 0.0, 1.0]), place[:3, 3] / unit,
                     name=joint.get("name", ""))
    along = np.array(numbers(joint.findtext("axis/xyz", ""), 3))
    if joint.find("axis/xyz[@expressed_in]") is not None:
        raise ValueError(f"the axis of {joint.get('name')} is expressed_in another frame")
    pitch = numbers(joint.findtext("screw_thread_pitch", "0"), 1)[0] / (2 * np.pi) / unit
    slide = unit if kind == "prismatic" else 1.0
    low, high = (numbers(joint.findtext(f"axis/limit/{e}", ""), 1)[0] / slide
                 for e in ("lower", "upper"))
    effort = numbers(joint.findtext("axis/limit/effort", ""), 1)[0]
    rubs, damps = (numbers(joint.findtext(f"axis/dynamics/{e}", "0"), 1)[0]
                   for e in ("friction", "damping"))
    force = unit if kind == "prismatic" else unit**2  # newton, or newton metre, in scene units
    fast = numbers(joint.findtext("axis/limit/velocity", ""), 1)[0] / slide
    return Drive(kind, place[:3, :3] @ along / max(float(np.linalg.norm(along)), 1e-300),
                 place[:3, 3] / unit, pitch if kind == "screw" else 0.0, (low, high),
                 {"velocity": fast, "effort": effort / force, "friction": rubs / force,
                  "damping": damps / (1.0 if kind == "prismatic" else unit**2)},
                 name=joint.get("name", ""))


def _pose(element: ET.Element) -> F64:
    out = np.eye(4)
    text = element.findtext("pose")
    if text is not None:
        found = numbers(text, 6)
        out[:3, 3] = found[:3]
        out[:3, :3] = Rotation.from_euler("xyz", found[3:]).as_matrix()
    return out
