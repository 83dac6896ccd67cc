"""Further kinds of sabotage, thought up against the checks: hidden rules, looks, couplings."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

from sabotage_models import BODY, DRIVEN, JOINT, SERVO, STRIKES
from sabotage_tools import (
    MJCF,
    Deed,
    Kind,
    NotHereError,
    both,
    drop,
    edit_xml,
    file,
    insert,
    plus,
    put,
)

URDF, YAML, SDF = "twin.urdf", "twin.yaml", "sdf/model.sdf"
LINK, LIMB = ".//link[@name='part_1']", ".//joint[@name='part_1_joint']"
SEEN = "default/default/default/geom[@group='2']"
RULES, LOOKS = ("contact rules",), ("same look", "own words")
CONTACT = (*RULES, "same collision", "collision there", "own words")


def kinds() -> list[Kind]:
    """Return every kind, in the order of the table."""
    return [*_contacts(), *_looks(), *_joints(), *_servos()]


def _all(names: str | tuple[str, ...], tag: str, key: str, value: str, part: str = "") -> Deed:
    """Return a deed that sets an attribute of every element of a tag whose name holds a word."""
    return edit_xml(names, lambda root: [e.set(key, value) for e in root.iter(tag)
                                         if part in e.get("name", "")])


def _contacts() -> list[Kind]:
    return [
        Kind("contacts that hardly press (solimp 0.01)", MJCF, RULES,
             put(MJCF, STRIKES, "solimp", "0.01 0.01 0.001")),
        Kind("surfaces like ice (friction 0.001)", MJCF, RULES,
             put(MJCF, STRIKES, "friction", "0.001 0.005 0.0001")),
        Kind("surfaces like glue (friction 1e4)", MJCF, RULES,
             put(MJCF, STRIKES, "friction", "1e4 0.005 0.0001")),
        Kind("a piece twice", MJCF, CONTACT, edit_xml(MJCF, _twice)),
        Kind("hulls of four corners (maxhullvert)", MJCF, CONTACT,
             put(MJCF, "default/default/default/mesh[@inertia='convex']", "maxhullvert", "4")),
        Kind("a piece is a ball", MJCF, CONTACT, edit_xml(MJCF, _ball)),
        Kind("solref of one piece direct", MJCF, RULES, edit_xml(MJCF, lambda r: next(
            g for g in r.iter("geom") if "piece" in g.get("name", "")).set("solref", "-500 -5"))),
        Kind("contact bits that differ per pair", MJCF, CONTACT, both(
            edit_xml(MJCF, lambda r: [g.set("contype", "3") for g in _pieces(r, "part_1")]),
            edit_xml(MJCF, lambda r: [g.set("conaffinity", "2") for g in _pieces(r, "part_1")]))),
        Kind("pieces sit in the visual group", MJCF, RULES, put(MJCF, STRIKES, "group", "2")),
        Kind("margin on one piece", MJCF, RULES, edit_xml(MJCF, lambda r: next(
            _pieces(r, "part_1")).set("margin", "0.05"))),
    ]


def _pieces(root: ET.Element, part: str) -> Any:
    return (g for g in root.iter("geom") if f"{part}_piece" in g.get("name", ""))


def _twice(root: ET.Element) -> None:
    body = root.find(BODY)
    geom = next(_pieces(root, "part_1"))
    again = ET.fromstring(ET.tostring(geom))
    again.set("name", "again")
    if body is not None:
        body.append(again)


def _ball(root: ET.Element) -> None:
    geom = next(_pieces(root, "part_1"))
    geom.set("type", "sphere")
    geom.set("size", "0.05")
    geom.attrib.pop("mesh", None)


def _looks() -> list[Kind]:
    first = "asset/material"
    return [
        Kind("a part is invisible (alpha 0)", MJCF, LOOKS, put(MJCF, first, "rgba", "1 1 1 0")),
        Kind("a part is red", MJCF, LOOKS, put(MJCF, f"{first}[2]", "rgba", "1 0 0 1")),
        Kind("materials of two parts swapped", MJCF, LOOKS, edit_xml(MJCF, _swap_materials)),
        Kind("a texture lies upside down (vflip)", MJCF, LOOKS,
             put(MJCF, "asset/texture", "vflip", "true")),
        Kind("a texture repeats ten times", MJCF, LOOKS, put(
            MJCF, "asset/material[@texture]", "texrepeat", "10 10")),
        Kind("a part shines by itself", MJCF, LOOKS, put(MJCF, first, "emission", "1")),
        Kind("visual meshes in a hidden group", MJCF, (*LOOKS, *CONTACT),
             put(MJCF, SEEN, "group", "5")),
        Kind("textures of two parts swapped", ("assets",), LOOKS, _swap_pictures),
        Kind("texture black", ("assets",), LOOKS, _black),
        Kind("texture places all 0", ("assets",), LOOKS, file(
            "assets/*_visual.obj", lambda d: b"\n".join(
                b"vt 0 0" if line.startswith(b"vt ") else line for line in d.split(b"\n"))
            if b"\nvt " in d else _nothing())),
        Kind("material file: transparent", ("assets",), (*LOOKS, "assets"), file(
            "assets/*_visual.mtl", lambda d: d + b"\nd 0\n")),
        Kind("material file: black", ("assets",), (*LOOKS, "assets"), file(
            "assets/*_visual.mtl", lambda d: d.replace(b"Kd ", b"Kd 0 0 0\n#"))),
        Kind("URDF: a part is red", (URDF,), LOOKS, put(URDF, ".//material/color", "rgba",
                                                        "1 0 0 1")),
        Kind("URDF: a part is invisible", (URDF,), LOOKS, put(
            URDF, ".//material/color", "rgba", "1 1 1 0")),
    ]


def _nothing() -> bytes:
    raise NotHereError("no texture")


def _swap_materials(root: ET.Element) -> None:
    seen = [g for g in root.iter("geom") if g.get("material") and g.get("name")]
    if len({g.get("material") for g in seen}) < 2:
        raise NotHereError("materials")
    one, two = seen[0], next(g for g in seen if g.get("material") != seen[0].get("material"))
    first, second = one.get("material", ""), two.get("material", "")
    one.set("material", second)
    two.set("material", first)


def _pictures(folder: Path) -> list[Path]:
    return sorted((folder / "assets").glob("*_texture.png"))


def _swap_pictures(folder: Path) -> None:
    found = _pictures(folder)
    if len(found) < 2:
        raise NotHereError("two textures")
    one, two = found[0].read_bytes(), found[1].read_bytes()
    found[0].write_bytes(two)
    found[1].write_bytes(one)


def _black(folder: Path) -> None:
    import cv2

    for path in _pictures(folder)[:1]:
        cv2.imwrite(str(path), cv2.imread(str(path)) * 0)
        return
    raise NotHereError("texture")


def _joints() -> list[Kind]:
    own = ("own settings", "own words")
    dynamics = ("same dynamics", *own)
    return [
        Kind("limits that hardly press (solimplimit)", MJCF, own, edit_xml(
            MJCF, lambda r: [j.set("solimplimit", "0.01 0.01 0.001") for j in r.iter("joint")
                             if j.get("axis")])),
        Kind("friction that creeps (solreffriction)", MJCF, own,
             put(MJCF, JOINT, "solreffriction", "10 1")),
        Kind("a joint's zero is shifted (ref)", MJCF, ("same surface", "same joint", *own), put(
            MJCF, ".//joint[@type='hinge']", "ref", "10")),
        Kind("a spring that rests half-open", MJCF, dynamics, both(
            put(MJCF, JOINT, "stiffness", "1"), put(MJCF, JOINT, "springref", "0.1"))),
        Kind("damping that grows with speed", MJCF, dynamics, put(
            MJCF, JOINT, "damping", lambda t: f"{t} 50")),
        Kind("friction 1e9", MJCF, dynamics, put(MJCF, JOINT, "frictionloss", "1e9")),
        Kind("armature 1e9", MJCF, dynamics, put(MJCF, JOINT, "armature", "1e9")),
        Kind("the base can be carried off (mocap)", MJCF, own, put(
            MJCF, "worldbody/body", "mocap", "true")),
        Kind("screw's coupling switched off", MJCF, ("same joint", "same motion"),
             put(MJCF, "equality/joint", "active", "false")),
        Kind("screw's coupling gives way", MJCF, own, put(
            MJCF, "equality/joint", "solref", "2 1")),
        Kind("a tendon ties two joints", MJCF, own, edit_xml(MJCF, _tie)),
        Kind("one joint follows another", MJCF, (*own, "same joint"), edit_xml(MJCF, _follow)),
        Kind("a second joint on a part", MJCF, ("same joint", "compile"), both(
            insert(MJCF, BODY, "<joint name='more' type='hinge' axis='0 1 0' range='0 5'/>"),
            drop(MJCF, "keyframe"))),
        Kind("part hangs on another part", MJCF, ("same bodies", "same motion"), edit_xml(
            MJCF, _rehang)),
        Kind("a site that says the bottom 1 m off", MJCF, ("own settings", "same surface"),
             put(MJCF, ".//site[@name='bottom_site']", "pos", plus(0, 0, 1))),
        Kind("settings of the camera in the twin's own file", MJCF, own, insert(
            MJCF, ".", "<visual><map znear='10'/></visual>")),
        Kind("a sleeping plugin", MJCF, (*own, "compile"), insert(
            MJCF, ".", "<extension><plugin plugin='mujoco.elasticity.shell'/></extension>")),
    ]


def _tie(root: ET.Element) -> None:
    names = [j.get("name", "") for j in root.iter("joint") if j.get("range")]
    if len(names) < 2:
        raise NotHereError("two joints")
    root.append(ET.fromstring(
        "<tendon><fixed name='tie' range='-1 1' limited='true'>"
        f"<joint joint='{names[0]}' coef='1'/><joint joint='{names[1]}' coef='1'/>"
        "</fixed></tendon>"))


def _follow(root: ET.Element) -> None:
    names = [j.get("name", "") for j in root.iter("joint") if j.get("range")]
    if len(names) < 2:
        raise NotHereError("two joints")
    root.append(ET.fromstring(f"<equality><joint joint1='{names[0]}' joint2='{names[1]}'/>"
                              "</equality>"))


def _rehang(root: ET.Element) -> None:
    base = root.find("worldbody/body")
    parts = [] if base is None else base.findall("body")
    if base is None or len(parts) < 2:
        raise NotHereError("two parts")
    base.remove(parts[1])
    parts[0].append(parts[1])


def _servos() -> list[Kind]:
    servo = ("same dynamics", "servos", "own words")
    return [
        Kind("servo without a force limit", (DRIVEN,), servo, edit_xml(
            DRIVEN, lambda r: [s.attrib.pop("forcerange", None) for s in r.findall(SERVO)])),
        Kind("servo without a command range", (DRIVEN,), servo, edit_xml(
            DRIVEN, lambda r: [s.attrib.pop("ctrlrange", None) for s in r.findall(SERVO)])),
        Kind("servo answers late (delay)", (DRIVEN,), (*servo, "compile"), both(
            put(DRIVEN, SERVO, "delay", "0.2"), put(DRIVEN, SERVO, "nsample", "200"))),
        Kind("servo pushes one way alone", (DRIVEN,), servo, put(
            DRIVEN, SERVO, "forcerange", lambda t: f"0 {t.split()[1]}")),
        Kind("servo turned over (gear -1)", (DRIVEN,), servo, put(DRIVEN, SERVO, "gear", "-1")),
        Kind("servo drives another joint", (DRIVEN,), servo, edit_xml(DRIVEN, _cross)),
        Kind("servo damps 100 times", (DRIVEN,), (*servo, "settling"), put(
            DRIVEN, SERVO, "dampratio", "100")),
        Kind("servos carry each other's name", (DRIVEN,), servo, edit_xml(DRIVEN, _rename_servos)),
    ]


def _cross(root: ET.Element) -> None:
    found = root.findall(SERVO)
    if len(found) < 2:
        raise NotHereError("two servos")
    found[0].set("joint", found[1].get("joint", ""))


def _rename_servos(root: ET.Element) -> None:
    found = root.findall(SERVO)
    if len(found) < 2:
        raise NotHereError("two servos")
    one, two = found[0].get("name", ""), found[1].get("name", "")
    found[0].set("name", two)
    found[1].set("name", one)
