"""An exported twin.usd in the words of `described.py`, where OpenUSD is installed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from part2gs_robotics.agree.described import NO, Body, Described, Drive, rotated
from part2gs_robotics.agree.of_urdf import SLIDE, TURN, place_of
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.twin import Twin

if TYPE_CHECKING:
    from pxr import Usd

FLOATS = 1e-5  # relative: masses, places and axes are float32
SWITCHES = {"physics:rigidBodyEnabled": False, "physics:jointEnabled": False,
            "physics:collisionEnabled": False, "physics:kinematicEnabled": True,
            "physics:startsAsleep": True, "visibility": "invisible"}
KINDS = {"PhysicsRevoluteJoint": "revolute", "PhysicsPrismaticJoint": "prismatic",
         "PhysicsFixedJoint": "fixed"}  # fmt: skip


def of_usd(path: Path, name: str, twin: Twin) -> Described | None:
    """Return what a twin.usd says, None where usd-core is not installed.

    Args:
        path: file.
        name: of the file, from the twin folder.
        twin: whose unit it must have.

    Raises:
        ValueError: if it cannot be opened, or is not such a stage.
    """
    try:
        from pxr import Tf, Usd, UsdGeom
    except ImportError:
        return None
    try:
        stage = Usd.Stage.Open(str(path))
        unit = float(UsdGeom.GetStageMetersPerUnit(stage))
        root = stage.GetDefaultPrim()
        joints = {_target(p, 1): p for p in stage.Traverse() if p.GetTypeName() in KINDS}
        bodies, off = {}, tuple(_off(name, root))
        for prim in root.GetChildren():
            if prim.GetName() in joints and not _carrier(prim.GetName(), joints):
                bodies[prim.GetName()] = _body(prim, joints, root.GetName())
    except (Tf.ErrorException, TypeError, AttributeError, IndexError, RuntimeError) as error:
        first = str(error).splitlines()[0][:100] if str(error) else type(error).__name__
        raise ValueError(f"not a stage of ours ({first})") from None
    wrong = abs(unit / twin.meters - 1) > FLOATS
    text = f"metersPerUnit is {unit:g}, a unit of the twin is {twin.meters:g} m"
    faults = (("same pose", name, text, f"{name}: correct metersPerUnit, or export it again"),)
    return Described(name, bodies, FLOATS, (faults if wrong else ()) + off)


def _off(name: str, root: Usd.Prim) -> Iterator[tuple[str, str, str, str]]:
    """Yield what is switched off, held or hidden."""
    from pxr import Usd

    for prim in Usd.PrimRange(root):
        for key, bad in SWITCHES.items():
            found = prim.GetAttribute(key)
            if found and found.HasAuthoredValue() and found.Get() == bad:
                yield ("own settings", f"{name}: {prim.GetName()}", f"{key} is {bad}",
                       f"{name}: remove {key} of {prim.GetName()}, or export it again")




def _target(joint: Usd.Prim, side: int) -> str:
    found = joint.GetRelationship(f"physics:body{side}").GetTargets()
    return str(found[0].name) if found else ""


def _carrier(name: str, joints: dict[str, Usd.Prim]) -> bool:
    """Whether a body is the light link between the turn and the slide of a screw."""
    return name.endswith(TURN) and name.removesuffix(TURN) in joints


def _rest(name: str, joints: dict[str, Usd.Prim]) -> F64:
    """Return [4, 4] world_from_body with all joints at 0."""
    out, seen = np.eye(4), set[str]()
    while name in joints and name not in seen:
        seen.add(name)
        one, two = (_local(joints[name], side) for side in (0, 1))
        out = one @ np.linalg.inv(two) @ out
        name = _target(joints[name], 0)
    return out


def _local(joint: Usd.Prim, side: int) -> F64:
    out, turn = np.eye(4), joint.GetAttribute(f"physics:localRot{side}").Get()
    out[:3, :3] = Rotation.from_quat([*turn.GetImaginary(), turn.GetReal()]).as_matrix()
    out[:3, 3] = np.array(joint.GetAttribute(f"physics:localPos{side}").Get(), float)
    return out


def _body(prim: Usd.Prim, joints: dict[str, Usd.Prim], root: str) -> Body:
    name = prim.GetName()
    place, joint = _rest(name, joints), joints[name]
    parent = _target(joints.get(f"{name}{TURN}", joint), 0)
    stands = np.array(prim.GetAttribute("xformOp:translate").Get(), float)
    quat = prim.GetAttribute("physics:principalAxes").Get()
    axes = place[:3, :3] @ Rotation.from_quat(
        [*quat.GetImaginary(), quat.GetReal()]).as_matrix()
    moments = np.array(prim.GetAttribute("physics:diagonalInertia").Get(), float)
    center = np.array(prim.GetAttribute("physics:centerOfMass").Get(), float)
    kids = {c.GetName(): c.GetAttribute("points").Get() for c in prim.GetChildren()
            if c.GetAttribute("points")}
    # what is seen stands where the prim does, what the engine moves where the joint says
    placed = {key: np.array(value, float) + stands for key, value in kids.items()}
    pieces = tuple(v for k, v in sorted(placed.items()) if k.startswith("piece")
                   and prim.GetChild(k).GetAttribute("physics:collisionEnabled"))
    return Body(name, "" if parent == root else parent,
                float(prim.GetAttribute("physics:mass").Get()),
                place_of(center[None], place)[0], rotated(np.diag(moments), axes),
                placed.get("visual", np.zeros((0, 3))), pieces,
                None if parent == root else _drive(name, joints))


def _drive(name: str, joints: dict[str, Usd.Prim]) -> Drive:
    joint, turn = joints[name], joints.get(f"{name}{TURN}")
    if turn is not None and joint.GetName().endswith(SLIDE):
        found = _plain(turn, f"{name}{TURN}", joints)
        pitch = joint.GetCustomDataByKey("screwPitchPerRadian")
        return Drive("screw", found.axis, found.origin, NO if pitch is None else float(pitch),
                     found.limits, name=found.name)
    return _plain(joint, name, joints)


def _plain(joint: Usd.Prim, name: str, joints: dict[str, Usd.Prim]) -> Drive:
    kind, frame = KINDS[joint.GetTypeName()], _rest(name, joints) @ _local(joint, 1)
    if kind == "fixed":
        return Drive(kind, frame[:3, 0], frame[:3, 3], name=joint.GetName())
    which = "XYZ".index(str(joint.GetAttribute("physics:axis").Get() or "X"))
    ends = [float(joint.GetAttribute(f"physics:{e}Limit").Get()) for e in ("lower", "upper")]
    low, high = np.radians(ends) if kind == "revolute" else ends
    return Drive(kind, frame[:3, which], frame[:3, 3], 0.0, (float(low), float(high)),
                 name=joint.GetName())
