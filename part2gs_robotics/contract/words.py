"""Words of a twin's files: an element or attribute that no exporter writes may change anything.

Engines know hundreds of words; other checks compare the numbers behind those that exporters write.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from pathlib import Path

from part2gs_robotics.agree.finding import CheckResult, fails, passes

Words = Mapping[str, str]  # attributes by element
# What tells and changes nothing: a user may add it; * is any attribute.
TELLS = {"camera": "*", "light": "*", "custom": "*", "numeric": "*", "text": "*", "sensor": "*"}
MJCF: Words = TELLS | {
    "mujoco": "model", "default": "class", "asset": "", "worldbody": "", "keyframe": "",
    "equality": "", "body": "childclass name", "inertial": "fullinertia mass pos",
    "joint": "name class type pos axis range limited damping frictionloss armature solreflimit "
             "solimplimit solimpfriction joint1 joint2 polycoef solref solimp",
    "geom": "name class type mesh material size pos quat group contype conaffinity mass rgba "
            "solref solimp friction condim margin gap",
    "mesh": "name class file inertia scale", "material": "name texture rgba",
    "texture": "name type file", "site": "name pos size rgba", "key": "name qpos ctrl",
    "contact": "", "exclude": "name body1 body2"}
ACTUATED: Words = dict(MJCF) | {
    "actuator": "", "position": "name class joint kp kv dampratio ctrlrange forcerange"}
URDF: Words = {
    "robot": "name", "link": "name", "joint": "name type", "parent": "link", "child": "link",
    "origin": "xyz rpy", "axis": "xyz", "limit": "lower upper effort velocity",
    "dynamics": "damping friction", "mimic": "joint multiplier offset", "inertial": "",
    "mass": "value", "inertia": "ixx ixy ixz iyy iyz izz", "visual": "name", "collision": "name",
    "geometry": "", "mesh": "filename scale", "box": "size", "material": "name",
    "color": "rgba", "mujoco": "", "compiler": "discardvisual fusestatic strippath"}
SDF: Words = dict.fromkeys(
    "axis child damping dynamics effort friction geometry inertia inertial ixx ixy ixz iyy iyz izz "
    "limit lower mass mesh parent pose screw_thread_pitch upper uri velocity xyz".split(), "") | {
    "sdf": "version", "model": "canonical_link name", "link": "name", "joint": "name type",
    "visual": "name", "collision": "name", "pose": "relative_to"}
FILES = {"twin.xml": MJCF, "twin_actuated.xml": ACTUATED, "twin.urdf": URDF}
TOLD = 4  # rows per file: a file of another program has hundreds


def own_words(file: str, root: ET.Element, words: Words) -> list[CheckResult]:
    """Return a row per word that a file of a twin cannot have, or one that passes.

    Args:
        file: its name.
        root: of its XML.
        words: attributes by element.
    """
    found = dict.fromkeys(_odd(root, words))
    return [fails("own words", f"{file}: {where}" if where else file,
                  f"{word} is no word of a twin's file; engines read it, other files cannot say it",
                  f"{file}: remove {word}, or put it into a file of yours that includes the twin")
            for word, where in list(found)[:TOLD]] or [
        passes("own words", file, "says nothing that no other file could say")]


def _odd(root: ET.Element, words: Words) -> Iterator[tuple[str, str]]:
    for element in root.iter():
        tag, name = str(element.tag), element.get("name", "")
        if tag not in words:
            yield f"<{tag}>", name
            continue
        known = words[tag].split()
        for key in element.attrib if "*" not in known else ():
            if key not in known:
                yield f"{key} of <{tag}>", name


def words_of(folder: Path, sdf: tuple[str, ...] = ()) -> list[CheckResult]:
    """Return rows about the words of all XML files of a twin that can be read.

    Args:
        folder: of the twin.
        sdf: names of exported SDFormat files in it.
    """
    out = []
    for name, words in (FILES | dict.fromkeys(sdf, SDF)).items():
        try:
            root = ET.parse(folder / name).getroot()
        except (OSError, ET.ParseError):
            continue  # other rows say so
        out += own_words(name, root, words)
    return out
