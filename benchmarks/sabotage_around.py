"""Further kinds of sabotage around a twin: its world, URDF, description and exports."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

from sabotage_exports import usd
from sabotage_models import SCENE
from sabotage_tools import Deed, Kind, NotHereError, both, edit_xml, insert, put, tell, times, told

URDF, YAML, SDF = "twin.urdf", "twin.yaml", "sdf/model.sdf"
LINK, LIMB = ".//link[@name='part_1']", ".//joint[@name='part_1_joint']"
RULES, LOOKS = ("contact rules",), ("same look", "own words")


def kinds() -> list[Kind]:
    """Return every kind, in the order of the table."""
    return [*_world(), *_urdf(), *_descriptions(), *_exports()]


def _world() -> list[Kind]:
    clear = ("clear world",)
    return [
        Kind("scene: a post in the way half-open", (SCENE,), clear, _post),
        Kind("scene: a ball lies on the twin", (SCENE,), (*clear, "same bodies"), insert(
            SCENE, "worldbody", "<body pos='0 0 5'><freejoint/><geom size='.1'/></body>")),
        Kind("scene: the twin is seen from 1000 km (statistic)", (SCENE,), ("options", *clear),
             put(SCENE, "statistic", "extent", "1e6")),
        Kind("scene: ground of jelly", (SCENE,), RULES, put(
            SCENE, "worldbody/geom", "solref", "5 1")),
        Kind("scene: ground without friction", (SCENE,), RULES, put(
            SCENE, "worldbody/geom", "friction", "0 0 0")),
        Kind("scene: water (density 1000)", (SCENE,), ("options",), put(
            SCENE, "option", "density", "1000")),
        Kind("scene: everything asleep", (SCENE,), ("options", "compile"), insert(
            SCENE, "option", "<flag sleep='enable'/>")),
        Kind("scene: a second servo", (SCENE,), ("servos",), insert(
            SCENE, ".", "<actuator><motor joint='part_1_joint'/></actuator>")),
        Kind("scene: autolimits off", (SCENE,), ("same limits", "compile", "options"), insert(
            SCENE, ".", "<compiler autolimits='false'/>")),
        Kind("scene: contacts without a solver (constraint off)", (SCENE,), ("options",), insert(
            SCENE, "option", "<flag constraint='disable'/>")),
    ]


def _post(folder: Path) -> None:
    """Put a thin post into the scene where the first part passes, clear at both states."""
    import mujoco
    import numpy as np

    model = mujoco.MjModel.from_xml_path(str(folder / SCENE))
    data = mujoco.MjData(model)
    joint = next((j for j in range(model.njnt) if model.jnt_limited[j]), None)
    if joint is None or model.nkey < 2:
        raise NotHereError("two states")
    body, root = int(model.jnt_bodyid[joint]), ET.parse(folder / SCENE)
    mine = model.geom_bodyid == body
    solid = [g for g in range(model.ngeom) if mine[g] and model.geom_contype[g]]
    ends = [float(model.key_qpos[k, model.jnt_qposadr[joint]]) for k in (0, 1)]
    for share in (0.5, 0.6, 0.4, 0.7, 0.3):
        data.qpos[:] = 0
        data.qpos[model.jnt_qposadr[joint]] = ends[0] + share * (ends[1] - ends[0])
        mujoco.mj_kinematics(model, data)
        spots = [np.array(data.geom_xpos[g]) for g in solid]
        for spot in sorted(spots, key=lambda p: -float(np.linalg.norm(p - data.xpos[body]))):
            if _clear(model, spot):
                place = " ".join(f"{x:.6g}" for x in spot)
                found = root.find("worldbody")
                if found is not None:
                    found.append(ET.fromstring(f"<geom name='post' size='.002' pos='{place}'/>"))
                    root.write(folder / SCENE)
                    return
    raise NotHereError("no place for a post")


def _clear(model: Any, spot: Any) -> bool:
    """Return whether a small ball touches nothing at both keyframes."""
    import mujoco
    import numpy as np

    for k in range(2):
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, k)
        mujoco.mj_kinematics(model, data)
        for g in range(model.ngeom):
            if model.geom_contype[g] and model.geom_bodyid[g]:
                local = data.geom_xmat[g].reshape(3, 3).T @ (spot - data.geom_xpos[g])
                box = model.geom_aabb[g]
                if (np.abs(local - box[:3]) < box[3:] + 0.003).all():
                    return False
    return True


def _urdf() -> list[Kind]:
    def kind(name: str, meant: tuple[str, ...], deed: Deed) -> Kind:
        return Kind(f"URDF: {name}", (URDF,), meant, deed)

    joint, own = ("same joint", "same motion"), ("own settings", "own words")
    inertial = ("<inertial><mass value='500'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' "
                "izz='1'/></inertial>")
    box = "<collision><geometry><box size='1 1 1'/></geometry></collision>"
    return [
        kind("screw's mimic shifted (offset)", joint, put(URDF, ".//mimic", "offset", "0.01")),
        kind("one joint mimics another", joint, edit_xml(URDF, _mimic)),
        kind("axis of length 2", joint, put(URDF, f"{LIMB}/axis", "xyz", times(2))),
        kind("a part weighs twice (two <inertial>)", ("readable", "same mass", *own),
             insert(URDF, LINK, inertial)),
        kind("two <limit>", ("readable", "same limits", *own), insert(
            URDF, LIMB, "<limit lower='-9' upper='9' effort='1' velocity='1'/>")),
        kind("the world is a box", own, insert(URDF, ".//link[@name='world']", box)),
        kind("the world weighs", own, insert(URDF, ".//link[@name='world']", inertial)),
        kind("screw's turn weighs 500 kg", ("same mass", *own), put(
            URDF, ".//link[@name='part_4_turn']/inertial/mass", "value", "500")),
        kind("screw's slide has no room", ("same limits", *joint), put(
            URDF, ".//joint[@name='part_4_joint_slide']/limit", "upper", "0.001")),
        kind("Gazebo takes gravity away", own, insert(
            URDF, ".", "<gazebo reference='part_1'><gravity>0</gravity></gazebo>")),
        kind("Gazebo holds it still", own, insert(
            URDF, ".", "<gazebo><static>true</static></gazebo>")),
        kind("MuJoCo is told degrees", own, put(URDF, "mujoco/compiler", "angle", "degree")),
        kind("MuJoCo is told to weigh geoms", own, put(
            URDF, "mujoco/compiler", "inertiafromgeom", "true")),
        kind("two roots", ("same bodies", "compile"), insert(URDF, ".", "<link name='other'/>")),
        kind("in millimetres", ("same surface",), _millimetres),
        kind("degrees for radians", ("same limits",), put(
            URDF, ".//joint[@type='revolute']/limit", "upper", times(57.29578))),
        kind("velocity negative", ("same dynamics",), put(
            URDF, f"{LIMB}/limit", "velocity", times(-1))),
        kind("mesh mirrored", ("same surface",), put(
            URDF, f"{LINK}/visual/geometry/mesh", "scale", "-1 1 1")),
        kind("a piece is a ball", ("same collision",), edit_xml(URDF, _urdf_ball)),
        kind("a piece twice", ("same collision",), edit_xml(URDF, lambda r: r.find(LINK).append(
            ET.fromstring(ET.tostring(r.find(f"{LINK}/collision")))))),
        kind("transmission of a motor of no limit", own, insert(
            URDF, ".", "<transmission name='t'><joint name='part_1_joint'/></transmission>")),
    ]


def _mimic(root: ET.Element) -> None:
    names = [j.get("name", "") for j in root.iter("joint") if j.find("limit") is not None]
    if len(names) < 2:
        raise NotHereError("two joints")
    joint = next(j for j in root.iter("joint") if j.get("name") == names[1])
    joint.append(ET.fromstring(f"<mimic joint='{names[0]}' multiplier='1'/>"))


def _urdf_ball(root: ET.Element) -> None:
    geometry = root.find(f"{LINK}/collision/geometry")
    if geometry is not None:
        geometry.remove(geometry[0])
        geometry.append(ET.fromstring("<sphere radius='0.05'/>"))


def _millimetres(folder: Path) -> None:
    both(put(URDF, "*.//origin", "xyz", times(1000)),
         put(URDF, "*.//geometry/mesh", "scale", "1000 1000 1000"))(folder)


def _descriptions() -> list[Kind]:
    def kind(name: str, meant: tuple[str, ...], deed: Deed) -> Kind:
        return Kind(f"yaml: {name}", (YAML,), meant, deed)

    return [
        kind("up is no unit vector", ("own numbers", "options", "assets"),
             told("", "up", lambda v: [2 * x for x in v])),
        kind("a joint twice", ("assets", "own numbers"),
             tell(lambda t: t["joints"].append(t["joints"][0]))),
        kind("a bomb of aliases", ("assets", "compile", "readable"), _alias_bomb),
        kind("velocity x 10", ("same dynamics",), told("joints", "velocity", lambda v: 10 * v)),
        kind("armature x 100", ("same dynamics",), told("joints", "armature", lambda v: 100 * v)),
        kind("inertia of no body (A + B < C)", ("same inertia", "mass of mesh"), told(
            "parts", "inertia", [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 9.0]])),
        kind("a range of NaN", ("same limits", "assets", "own numbers", "provenance"), told(
            "joints", "range", [float("nan"), 1.0])),
    ]


def _alias_bomb(folder: Path) -> None:
    path = folder / YAML
    lines = ["bomb0: &b0 [ha, ha, ha, ha, ha, ha, ha, ha, ha, ha]"]
    lines += [f"bomb{k}: &b{k} [{', '.join([f'*b{k - 1}'] * 10)}]" for k in range(1, 9)]
    path.write_text(path.read_text() + "\n".join(lines) + "\n")


def _exports() -> list[Kind]:
    link, joint = ".//link[@name='part_1']", ".//joint[@name='part_1_joint']"

    def prim(path: str, key: str, value: Any) -> Deed:
        def change(stage: Any, root: str) -> None:
            found = stage.GetPrimAtPath(f"{root}/{path}").GetAttribute(key)
            if not found:
                raise NotHereError(key)
            found.Set(value)
        return usd(change)

    def made(path: str, key: str, value: bool) -> Deed:
        from pxr import Sdf

        return usd(lambda s, root: s.GetPrimAtPath(f"{root}/{path}").CreateAttribute(
            key, Sdf.ValueTypeNames.Bool).Set(value))

    files, own = ("usd/twin.usd",), ("own settings", "same joint", "same bodies", "collision there")
    return [
        Kind("SDF: velocity 0", (SDF,), ("same dynamics",), put(
            SDF, f"{joint}/axis/limit/velocity", "TEXT", "0")),
        Kind("SDF: a spring", (SDF,), ("same dynamics", "own words"), insert(
            SDF, f"{joint}/axis/dynamics", "<spring_stiffness>100</spring_stiffness>")),
        Kind("SDF: surfaces of ice", (SDF,), ("own words", "contact rules"), insert(
            SDF, f"{link}/collision", "<surface><friction><ode><mu>0</mu></ode></friction>"
            "</surface>")),
        Kind("SDF: invisible", (SDF,), LOOKS, insert(
            SDF, f"{link}/visual", "<transparency>1</transparency>")),
        Kind("SDF: a plugin", (SDF,), ("own words",), insert(
            SDF, "model", "<plugin name='p' filename='libx.so'/>")),
        Kind("SDF: a joint more", (SDF,), ("same joint", "same bodies", "own settings"), insert(
            SDF, "model", "<joint name='weld' type='fixed'><parent>world</parent><child>part_1"
            "</child></joint>")),
        Kind("USD: part collides no more", files, own, made(
            "part_1", "physics:collisionEnabled", False)),
        Kind("USD: joint is off", files, own, made(
            "joints/part_1_joint", "physics:jointEnabled", False)),
        Kind("USD: part is no rigid body", files, own, made(
            "part_1", "physics:rigidBodyEnabled", False)),
        Kind("USD: part is held (kinematic)", files, own, made(
            "part_1", "physics:kinematicEnabled", True)),
        Kind("USD: axis", files, ("same joint", "same motion", "readable"), prim(
            "joints/part_1_joint", "physics:axis", "Y")),
    ]

