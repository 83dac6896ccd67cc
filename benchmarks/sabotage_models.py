"""Kinds of sabotage of MJCF: the twin, its servos, and the world around it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from sabotage_tools import (
    MJCF,
    Kind,
    NotHereError,
    both,
    drop,
    edit_xml,
    insert,
    obj,
    plus,
    put,
    swapped,
    times,
    turned,
)

PASSIVE, DRIVEN, SCENE = "twin.xml", "twin_actuated.xml", "scene.xml"
PART = ".//body[@name='part_1']"
BODY, JOINT, MASS = PART, f"{PART}/joint", f"{PART}/inertial"
STRIKES = "default/default/default[mesh]/geom[@group='3']"
SERVO = "actuator/position"
JOINTS = ("same joint", "same motion")
HITS = ("collision there", "contact rules", "same collision", "collision")


def kinds() -> list[Kind]:
    """Return every kind, in the order of the table."""
    return [*_collision(), *_bodies(), *_joints(), *_servos(), *_states(), *_world()]


def _no_pieces(root: ET.Element, parts: str) -> None:
    for body in root.iter("body"):
        if body.get("name", "").startswith(parts):
            for geom in [g for g in body.findall("geom") if "piece" in g.get("name", "")]:
                body.remove(geom)


def _all_pieces(key: str, change: object) -> object:
    def on(root: ET.Element) -> None:
        for geom in root.iter("geom"):
            if "part_1_piece" in geom.get("name", ""):
                geom.set(key, change(geom.get(key, "0 0 0")) if callable(change) else str(change))
    return on


def _collision() -> list[Kind]:
    pieces = "assets/part_1_piece_*.obj"
    return [
        Kind("no collision geoms at all", MJCF, HITS, edit_xml(MJCF, lambda r: _no_pieces(r, ""))),
        Kind("no collision geoms on a part", MJCF, HITS,
             edit_xml(MJCF, lambda r: _no_pieces(r, "part_1"))),
        Kind("no collision geoms on a part, in one file", (PASSIVE,), HITS,
             edit_xml(PASSIVE, lambda r: _no_pieces(r, "part_1"))),
        Kind("contype and conaffinity 0", MJCF, HITS, both(
            put(MJCF, STRIKES, "contype", "0"), put(MJCF, STRIKES, "conaffinity", "0"))),
        Kind("contype 0 on a part", MJCF, HITS, both(
            edit_xml(MJCF, _all_pieces("contype", "0")),
            edit_xml(MJCF, _all_pieces("conaffinity", "0")))),
        Kind("contact bits that nothing else has", MJCF, HITS, both(
            edit_xml(MJCF, _all_pieces("contype", "2")),
            edit_xml(MJCF, _all_pieces("conaffinity", "2")))),
        Kind("pieces shifted by 10 cm in MJCF", MJCF, HITS,
             edit_xml(MJCF, _all_pieces("pos", plus(0.1)))),
        Kind("pieces x 0.5 in every file", (*MJCF, "assets"), HITS, both(
            obj(pieces, lambda v: v.mean(0) + 0.5 * (v - v.mean(0))),
            edit_xml(MJCF, _all_pieces("size", times(0.5))),
            put("twin.urdf", "*.//link[@name='part_1']/collision/geometry/box", "size",
                times(0.5)))),
        Kind("pieces shifted by 10 cm in every file", (*MJCF, "assets"), HITS, both(
            obj(pieces, lambda v: v + 0.1), edit_xml(MJCF, _all_pieces("pos", plus(0.1))),
            put("twin.urdf", "*.//link[@name='part_1']/collision/origin", "xyz", plus(0.1)))),
        Kind("one piece is lacking", MJCF, HITS,
             drop(MJCF, f"{PART}/geom[@name='part_1_piece_00']")),
        Kind("exclude that hides an overlap", MJCF, ("contact exclude",), both(
            insert(MJCF, ".", "<contact><exclude body1='base' body2='part_1'/></contact>"),
            edit_xml(MJCF, _all_pieces("pos", plus(0.01))))),
        Kind("exclude, both parts near each other", MJCF, ("contact exclude",), both(
            insert(MJCF, ".", "<contact><exclude body1='base' body2='part_1'/></contact>"),
            edit_xml(MJCF, _all_pieces("pos", plus(0.003))))),
        Kind("a floating geom that collides", MJCF, HITS, insert(
            MJCF, BODY, "<geom type='box' size='.1 .1 .1' pos='3 0 0' mass='0' group='3'/>")),
        Kind("negative solref", MJCF, ("contact rules",), put(MJCF, STRIKES, "solref", "-1e4 -50")),
        Kind("contacts of jelly", MJCF, ("contact rules",), put(MJCF, STRIKES, "solref", "2 1")),
        Kind("solimp that lets through", MJCF, ("contact rules",),
             put(MJCF, STRIKES, "solimp", "0 0 0.001")),
        Kind("a pair of geoms that does not meet", MJCF, ("contact rules",), insert(
            MJCF, ".", "<contact><pair geom1='base_piece_00' geom2='part_1_piece_00' gap='1'/>"
            "</contact>")),
        Kind("contacts without friction (condim 1)", MJCF, ("contact rules",),
             put(MJCF, STRIKES, "condim", "1")),
        Kind("visual meshes collide", MJCF, HITS, put(
            MJCF, "default/default/default/geom[@group='2']", "contype", "1")),
        Kind("a margin of 10 cm", MJCF, ("contact rules",), put(MJCF, STRIKES, "margin", "0.1")),
        Kind("no friction of surfaces", MJCF, ("contact rules",),
             put(MJCF, STRIKES, "friction", "0 0 0")),
    ]


def _bodies() -> list[Kind]:
    return [
        Kind("mass x 1e-4", MJCF, ("same mass",), put(MJCF, MASS, "mass", times(1e-4))),
        Kind("mass x 100", MJCF, ("same mass",), put(MJCF, MASS, "mass", times(100))),
        Kind("mass x 100 with servos only", (DRIVEN,), ("same mass",),
             put(DRIVEN, MASS, "mass", times(100))),
        Kind("mass x 1.01", MJCF, ("same mass",), put(MJCF, MASS, "mass", times(1.01))),
        Kind("inertia axes permuted", MJCF, ("same inertia",),
             put(MJCF, MASS, "fullinertia", swapped(1, 2, 0, 5, 3, 4))),
        Kind("inertia x 10", MJCF, ("same inertia",), put(MJCF, MASS, "fullinertia", times(10))),
        Kind("centre of mass 5 cm off", MJCF, ("same center",), put(MJCF, MASS, "pos", plus(0.05))),
        Kind("no weight (gravcomp)", MJCF, ("own settings",), put(MJCF, BODY, "gravcomp", "1")),
        Kind("a floating body", MJCF, ("same bodies",), insert(
            MJCF, "worldbody", "<body name='bit' pos='3 0 0'><geom size='.05' mass='1'/></body>")),
        Kind("body renamed", MJCF, ("same bodies",), put(MJCF, BODY, "name", "part_one")),
        Kind("body moved by 1 %", MJCF, ("same surface",), put(MJCF, BODY, "pos", "0.01 0 0")),
        Kind("base falls freely", MJCF, ("own settings", "same bodies", "same joint"),
             insert(MJCF, "worldbody/body", "<freejoint/>")),
        Kind("part welded", MJCF, ("own settings",), insert(
            MJCF, ".", "<equality><weld body1='base' body2='part_1'/></equality>")),
        Kind("mass NaN", (PASSIVE,), ("compile", "same mass"), put(PASSIVE, MASS, "mass", "nan")),
        Kind("mass 1e308", MJCF, ("compile", "same mass"), put(MJCF, MASS, "mass", "1e308")),
        Kind("place 1e30", MJCF, ("compile", "same surface"), put(MJCF, BODY, "pos", "1e30 0 0")),
        Kind("a name twice", (PASSIVE,), ("compile",), insert(
            PASSIVE, "worldbody", "<body name='base'/>")),
    ]


def _joints() -> list[Kind]:
    return [
        Kind("axis off by 2 deg", MJCF, JOINTS, put(MJCF, JOINT, "axis", turned(2))),
        Kind("axis off by 0.01 deg", MJCF, JOINTS, put(MJCF, JOINT, "axis", turned(0.01))),
        Kind("axis reversed", MJCF, JOINTS, put(MJCF, JOINT, "axis", times(-1))),
        Kind("pivot of a hinge off by 1 %", MJCF, JOINTS,
             put(MJCF, ".//joint[@type='hinge']", "pos", plus(0.01))),
        Kind("kind of joint changed", MJCF, JOINTS, put(
            MJCF, JOINT, "type", lambda k: "hinge" if k == "slide" else "slide")),
        Kind("pitch of the screw x 2", MJCF, JOINTS,
             put(MJCF, "equality/joint", "polycoef", times(2))),
        Kind("screw comes loose", MJCF, JOINTS, drop(MJCF, "equality")),
        Kind("joint renamed", MJCF, JOINTS, both(
            put(MJCF, JOINT, "name", "joint_one"), put(DRIVEN, SERVO, "joint", "joint_one"))),
        Kind("joint removed with servo and keys", MJCF, ("same joint", "compile"), both(
            drop(MJCF, JOINT), drop(DRIVEN, SERVO), drop(MJCF, "*keyframe"))),
        Kind("limit 90 deg beyond", MJCF, ("same limits",),
             put(MJCF, ".//joint[@type='hinge']", "range", plus(0, 90))),
        Kind("limit halved", MJCF, ("same limits",), put(MJCF, JOINT, "range", times(0.5))),
        Kind("no limit", MJCF, ("same limits",), put(MJCF, JOINT, "limited", "false")),
        Kind("limits that give way", MJCF, ("own settings",),
             put(MJCF, "default/default/joint", "solreflimit", "-100 -1")),
        Kind("joint with a spring", MJCF, ("same dynamics", "own settings"),
             put(MJCF, JOINT, "stiffness", "100")),
        Kind("damping x 1000", MJCF, ("same dynamics",), put(MJCF, JOINT, "damping", times(1e3))),
        Kind("friction x 1000", MJCF, ("same dynamics",),
             put(MJCF, JOINT, "frictionloss", times(1e3))),
        Kind("armature x 1000", MJCF, ("same dynamics",), put(MJCF, JOINT, "armature", times(1e3))),
        Kind("time step in the twin's own file", MJCF, ("own settings",),
             insert(MJCF, ".", "<option timestep='0.02'/>")),
        Kind("angles in radian", MJCF, ("own settings", "same limits"),
             insert(MJCF, ".", "<compiler angle='radian'/>")),
        Kind("a default for every model", MJCF, ("own settings",),
             insert(MJCF, "default", "<geom friction='0.1 0 0'/>")),
    ]


def _servos() -> list[Kind]:
    servo = ("same dynamics", "servos")
    return [
        Kind("kp 1e9", (DRIVEN,), servo, put(DRIVEN, SERVO, "kp", "1e9")),
        Kind("kp x 0.01", (DRIVEN,), servo, put(DRIVEN, SERVO, "kp", times(0.01))),
        Kind("no actuator, keyframes as they were", (DRIVEN,), ("compile",),
             drop(DRIVEN, "*actuator")),
        Kind("no actuator", (DRIVEN,), ("servos",), both(
            drop(DRIVEN, "*actuator"), edit_xml(DRIVEN, lambda r: [
                k.attrib.pop("ctrl") for k in r.iter("key")]))),
        Kind("joint lets no force through", (DRIVEN,), ("servos",),
             put(DRIVEN, JOINT, "actuatorfrcrange", "-1e-3 1e-3")),
        Kind("servo answers after 10 s", (DRIVEN,), ("servos",), put(DRIVEN, SERVO, "timeconst",
                                                                     "10")),
        Kind("one servo is lacking", (DRIVEN,), ("servos",), both(
            drop(DRIVEN, SERVO), drop(DRIVEN, "*keyframe"))),
        Kind("motor instead of servo", (DRIVEN,), ("servos", "same dynamics"), edit_xml(
            DRIVEN, lambda r: _motor(r.find(SERVO)))),
        Kind("effort too weak to hold", (DRIVEN,), servo,
             put(DRIVEN, f"*{SERVO}", "forcerange", times(1e-3))),
        Kind("command range halved", (DRIVEN,), servo, put(DRIVEN, SERVO, "ctrlrange", times(0.5))),
        Kind("gear 10", (DRIVEN,), servo, put(DRIVEN, SERVO, "gear", "10")),
        Kind("no damping of the servo", (DRIVEN,), servo, put(DRIVEN, SERVO, "dampratio", "0")),
        Kind("servo in the passive twin", (PASSIVE,), ("servos",), insert(
            PASSIVE, ".", "<actuator><position joint='part_1_joint' kp='100'/></actuator>")),
    ]


def _motor(servo: ET.Element | None) -> None:
    if servo is not None:
        servo.tag = "motor"
        for key in ("kp", "dampratio", "kv"):
            servo.attrib.pop(key, None)


def _states() -> list[Kind]:
    one, other = "keyframe/key[@name='state_1']", "keyframe/key[@name='state_0']"
    keys = ("same states", "observed state")
    return [
        Kind("keyframes swapped", MJCF, keys, both(
            put(MJCF, one, "name", "other"), put(MJCF, other, "name", "state_1"),
            put(MJCF, "keyframe/key[@name='other']", "name", "state_0"))),
        Kind("keyframe halved", MJCF, keys, put(MJCF, one, "qpos", times(0.5))),
        Kind("keyframe halved in one file", (PASSIVE,), keys,
             put(PASSIVE, one, "qpos", times(0.5))),
        Kind("command of a keyframe halved", (DRIVEN,), keys, put(DRIVEN, one, "ctrl", times(0.5))),
        Kind("no keyframe of state 1", MJCF, keys, drop(MJCF, one)),
        Kind("no keyframes", MJCF, keys, drop(MJCF, "keyframe")),
        Kind("a further keyframe beyond the limits", MJCF, ("own settings",),
             edit_xml(MJCF, _far_key)),
        Kind("a keyframe in motion", MJCF, ("own settings",), edit_xml(MJCF, lambda r: [
            k.set("qvel", k.get("qpos", "").replace("0 0 0 0 0", "1 1 1 1 1")) for k in r.iter(
                "key")])),
        Kind("no keyframes in one file", (DRIVEN,), keys, drop(DRIVEN, "keyframe")),
    ]


def _far_key(root: ET.Element) -> None:
    one = root.find("keyframe/key")
    if one is not None:
        far = " ".join("9" for _ in one.get("qpos", "").split())
        root.find("keyframe").append(ET.fromstring(f"<key name='far' qpos='{far}'/>"))


def _needs_hinge(folder: Path) -> None:
    if ET.parse(folder / PASSIVE).getroot().find(".//joint[@type='hinge']") is None:
        raise NotHereError("a hinge, which has an angle")


def _box(folder: Path) -> None:
    """Put a box of a tenth of the size where the first joint's pieces are at state 1."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(folder / SCENE))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 1)
    mujoco.mj_kinematics(model, data)
    geom = next(g for g in range(model.ngeom) if model.geom_bodyid[g] == model.jnt_bodyid[0]
                and model.geom_contype[g])
    side = " ".join([f"{0.05 * model.stat.extent:.6g}"] * 3)
    place = " ".join(f"{x:.6g}" for x in data.geom_xpos[geom])
    insert(SCENE, "worldbody", f"<geom type='box' size='{side}' pos='{place}'/>")(folder)


def _world() -> list[Kind]:
    def option(key: str, value: str) -> Kind:
        return Kind(f"scene: {key} {value}", (SCENE,), ("options", "compile"),
                    put(SCENE, "option", key, value))

    def flag(name: str) -> Kind:
        return Kind(f"scene: {name} off", (SCENE,), ("options",),
                    insert(SCENE, "option", f"<flag {name}='disable'/>"))

    return [
        Kind("scene: gravity upwards", (SCENE,), ("options",),
             put(SCENE, "option", "gravity", times(-1))),
        option("gravity", "0 0 0"), option("gravity", "9.81 0 0"),
        Kind("scene: time step x 10", (SCENE,), ("options",),
             put(SCENE, "option", "timestep", times(10))),
        option("timestep", "nan"), option("timestep", "0"), option("timestep", "1e308"),
        option("viscosity", "100"), option("wind", "50 0 0"), option("iterations", "1"),
        option("tolerance", "1"), option("impratio", "0.001"),
        flag("contact"), flag("gravity"), flag("limit"), flag("actuation"), flag("equality"),
        Kind("scene: ground through the twin", (SCENE,), ("clear world",),
             put(SCENE, "worldbody/geom", "pos", plus(0, 0, 0.1))),
        Kind("scene: ground that nothing rests on", (SCENE,), ("clear world",), both(
            put(SCENE, "worldbody/geom", "contype", "0"),
            put(SCENE, "worldbody/geom", "conaffinity", "0"))),
        Kind("scene: ground tilted", (SCENE,), ("clear world",),
             put(SCENE, "worldbody/geom", "zaxis", "0.3 0 1")),
        option("actuatorgroupdisable", "0"), option("ls_iterations", "1"),
        Kind("scene: ground 100 m below", (SCENE,), ("clear world",),
             put(SCENE, "worldbody/geom", "pos", plus(0, 0, -100))),
        Kind("scene: no ground", (SCENE,), ("clear world",), drop(SCENE, "worldbody/geom")),
        Kind("scene: includes the passive twin", (SCENE,), ("servos",),
             put(SCENE, "include", "file", "twin.xml")),
        Kind("scene: includes itself", (SCENE,), ("compile",),
             put(SCENE, "include", "file", "scene.xml")),
        Kind("scene: includes what lies outside", (SCENE,), ("compile",),
             put(SCENE, "include", "file", "../../other.xml")),
        Kind("scene: a wall welds a part", (SCENE,), ("own settings",), insert(
            SCENE, ".", "<equality><weld body1='part_1'/></equality>")),
        Kind("scene: a box stands in the twin", (SCENE,), ("clear world",), _box),
        Kind("scene: angles in radian", (SCENE,), ("same limits",), both(
            _needs_hinge, insert(SCENE, ".", "<compiler angle='radian'/>"))),
    ]
