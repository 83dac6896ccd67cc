"""What engines make of a URDF beyond its plain numbers: doubles, mimics, the world, the engine."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from part2gs_robotics.agree.finding import CheckResult, fails, passes

FILE, WORLD, TURN, SLIDE = "twin.urdf", "world", "_turn", "_slide"
ONCE = ("inertial", "origin", "axis", "limit", "dynamics", "mimic", "parent", "child", "mass",
        "inertia", "geometry", "safety_controller")  # fmt: skip
LONG = 1e-6  # how far an axis may be from length 1: ten digits
LIGHT = 1e-3  # kg: the link between a screw's turn and slide weighs a milligram
ROOM = 1e-6  # of a screw's travel, that its slide may lack: ten digits
COMPILER = {"discardvisual": "false", "fusestatic": "false", "strippath": "false"}


def urdf_rules(path: Path) -> list[CheckResult]:
    """Return what of a twin.urdf other files have no word for, or one row that passes.

    Args:
        path: of the file; one that cannot be read is told by other rows.
    """
    try:
        root = ET.parse(path).getroot()
        found = [fails(check, f"{FILE}: {name}" if name else FILE, text, f"{FILE}: {cause}")
                 for check, name, text, cause in _faults(root)]
    except (OSError, ET.ParseError, ValueError, KeyError):
        return []
    return found or [passes("own settings", FILE, "joints, links and engine as in other files")]


Fault = tuple[str, str, str, str]  # check, name, text, cause


def _faults(root: ET.Element) -> Iterator[Fault]:
    yield from _twice(root)
    yield from _links(root)
    yield from _joints(root)
    compiler = root.find("mujoco/compiler")
    if compiler is not None and dict(compiler.attrib) != COMPILER:
        yield ("own settings", "", f"tells MuJoCo {dict(compiler.attrib)}",
               f"give <mujoco><compiler> {COMPILER} alone")


def _twice(root: ET.Element) -> Iterator[Fault]:
    for element in root.iter():
        tags = [str(child.tag) for child in element]
        for tag in (t for t in ONCE if tags.count(t) > 1):
            yield ("own settings", element.get("name", ""), f"{tags.count(tag)} <{tag}>, of which "
                   "engines take different ones", f"leave one <{tag}>")


def _links(root: ET.Element) -> Iterator[Fault]:
    names = {link.get("name", "") for link in root.iter("link")}
    for link in root.iter("link"):
        name = link.get("name", "")
        if name == WORLD and len(link):
            yield ("own settings", name, f"the world has <{link[0].tag}>",
                   "leave the link `world` empty: it stands for what is around")
        if (count := len(link.findall("visual"))) > 1:
            yield ("same look", name, f"{count} <visual>, of which engines show the first, or all",
                   f"leave one <visual> of {name}")
        if name.endswith(TURN) and name.removesuffix(TURN) in names:
            mass = float(link.find("inertial/mass").get("value", "nan"))  # type: ignore[union-attr]
            if not mass <= LIGHT or link.find("collision") is not None:
                yield ("same mass", name, f"the link between turn and slide weighs {mass:g} kg",
                       f"give {name} a milligram and no shape")


def _joints(root: ET.Element) -> Iterator[Fault]:
    joints = {j.get("name", ""): j for j in root.iter("joint") if j.find("parent") is not None}
    for name, joint in joints.items():
        axis = joint.find("axis")
        if axis is not None:
            length = float(np.linalg.norm([float(w) for w in axis.get("xyz", "").split()]))
            if not abs(length - 1) <= LONG:
                yield ("same joint", name, f"its axis has length {length:g}",
                       f"give {name} an axis of length 1")
        mimic = joint.find("mimic")
        if mimic is None:
            continue
        led = mimic.get("joint", "")
        if name != f"{led}{SLIDE}":
            yield ("same joint", name, f"follows {led}", f"remove <mimic> of {name}")
            continue
        if float(mimic.get("offset", "0")) != 0:
            yield ("same joint", name, f"its mimic has offset {mimic.get('offset')}",
                   f"set the offset of {name} to 0")
        yield from _slide(name, joint, joints[led], float(mimic.get("multiplier", "1")))


def _slide(name: str, slide: ET.Element, turn: ET.Element, pitch: float) -> Iterator[Fault]:
    """Yield that the slide of a screw cannot go as far as its turn takes it."""
    ends = [[float(j.find("limit").get(k, "nan"))  # type: ignore[union-attr]
             for k in ("lower", "upper")] for j in (slide, turn)]
    needed = sorted(pitch * e for e in ends[1])
    slack = ROOM * max(abs(needed[0]), abs(needed[1]))
    if not (ends[0][0] <= needed[0] + slack and ends[0][1] >= needed[1] - slack):
        yield ("same limits", name, f"range {ends[0]}, its turn takes it from {needed[0]:g} to "
               f"{needed[1]:g}", f"widen <limit> of {name} to that")
