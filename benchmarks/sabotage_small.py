"""Sabotage that nobody would see: half a degree, one per cent, one number of a default."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import Any

import numpy as np
from sabotage_models import BODY, DRIVEN, JOINT, MASS, PASSIVE, SCENE, SERVO, STRIKES
from sabotage_more import CONTACT, LOOKS
from sabotage_tools import (
    MJCF,
    Deed,
    Kind,
    NotHereError,
    both,
    edit_xml,
    insert,
    plus,
    put,
    tell,
    times,
    told,
    turned,
)

URDF, YAML, SDF = "twin.urdf", "twin.yaml", "sdf/model.sdf"
LINK, LIMB = ".//link[@name='part_1']", ".//joint[@name='part_1_joint']"
JOINTS, SURFACE = ("same joint", "same motion"), ("same surface", "same collision")
OWN = ("own settings", "own words")
DEGREE = np.pi / 180


def kinds() -> list[Kind]:
    """Return every kind, in the order of the table."""
    return [*_places(), *_defaults(), *_world(), *_servos(), *_urdf(), *_yaml()]


def _places() -> list[Kind]:
    tilt = f"{np.cos(DEGREE / 4):.9f} {np.sin(DEGREE / 4):.9f} 0 0"
    return [
        Kind("axis off by 0.5 deg", MJCF, JOINTS, put(MJCF, JOINT, "axis", turned(0.5))),
        Kind("a part turned by 0.5 deg", MJCF, (*JOINTS, *SURFACE), put(MJCF, BODY, "quat", tilt)),
        Kind("the base turned by 0.5 deg", MJCF, (*JOINTS, *SURFACE),
             put(MJCF, "worldbody/body", "quat", tilt)),
        Kind("limits 1 % wider", MJCF, ("same limits",), put(MJCF, JOINT, "range", times(1.01))),
        Kind("centre of mass 1 mm off", MJCF, ("same center",),
             put(MJCF, MASS, "pos", plus(0.001, 0, 0))),
        Kind("visual mesh x 1.01", MJCF, ("same surface", "own words"), edit_xml(
            MJCF, lambda r: named(r, "mesh", "part_1_visual").set("scale", "1.01 1.01 1.01"))),
        Kind("visual mesh turned by 1 deg", MJCF, ("same surface", "own words"), edit_xml(
            MJCF, lambda r: named(r, "geom", "part_1_visual").set(
                "quat", f"{np.cos(DEGREE / 2):.9f} 0 0 {np.sin(DEGREE / 2):.9f}"))),
        Kind("a piece turned by 2 deg", MJCF, ("same collision", "own words"), edit_xml(
            MJCF, lambda r: next(g for g in r.iter("geom") if "part_1_piece" in g.get("name", "")
                                 ).set("euler", "0 2 0"))),
        Kind("keyframe 2 % on", MJCF, ("same states",),
             put(MJCF, "keyframe/key[@name='state_1']", "qpos", times(1.02))),
        Kind("keyframe renamed", MJCF, ("same states", "observed state", "own words"),
             put(MJCF, "keyframe/key[@name='state_1']", "name", "open")),
        Kind("keyframe with a time", MJCF, ("same states", *OWN),
             put(MJCF, "keyframe/key", "time", "5")),
        Kind("keyframe's command 2 % on", (DRIVEN,), ("same states",),
             put(DRIVEN, "keyframe/key[@name='state_1']", "ctrl", times(1.02))),
    ]


def named(root: ET.Element, tag: str, name: str) -> ET.Element:
    """Return the element of a name, or that shows the mesh of a name."""
    for element in root.iter(tag):
        if element.get("name") == name or element.get("mesh") == name:
            return element
    raise NotHereError(f"{tag} {name}")


def _defaults() -> list[Kind]:
    part = "default/default"
    return [
        Kind("default: joints damp 5", MJCF, ("same dynamics", *OWN), edit_xml(
            MJCF, _default_joint)),
        Kind("default: pieces far apart touch (gap)", MJCF, CONTACT, both(
            put(MJCF, STRIKES, "gap", "0.02"), put(MJCF, STRIKES, "margin", "0.02"))),
        Kind("default: what touches first wins (priority)", MJCF, CONTACT,
             put(MJCF, STRIKES, "priority", "9")),
        Kind("default: pieces mix as others (solmix 0)", MJCF, CONTACT,
             put(MJCF, STRIKES, "solmix", "0")),
        Kind("default: fluid forces (fluidshape)", MJCF, (*CONTACT, *OWN),
             put(MJCF, STRIKES, "fluidshape", "ellipsoid")),
        Kind("default: another class", MJCF, ("compile", *OWN),
             put(MJCF, part, "class", "elsewhere")),
        Kind("compiler: masses from geoms", MJCF, ("same mass", *OWN), insert(
            MJCF, ".", "<compiler inertiafromgeom='true'/>")),
        Kind("compiler: total mass 1", MJCF, ("same mass", *OWN), insert(
            MJCF, ".", "<compiler settotalmass='1'/>")),
        Kind("compiler: no mass below 5 (boundmass)", MJCF, ("same mass", *OWN), insert(
            MJCF, ".", "<compiler boundmass='5'/>")),
        Kind("compiler: no visual meshes", MJCF, ("same surface", "same look", *OWN), insert(
            MJCF, ".", "<compiler discardvisual='true'/>")),
        Kind("little memory", MJCF, (*OWN, "compile"), insert(
            MJCF, ".", "<size memory='20K'/>")),
        Kind("gravcomp 0.5, in one file", (DRIVEN,), (*OWN, "same dynamics"),
             put(DRIVEN, BODY, "gravcomp", "0.5")),
        Kind("a joint with a margin", MJCF, OWN, put(MJCF, JOINT, "margin", "0.2")),
        Kind("a contact sensor", MJCF, (*OWN, "compile"), insert(
            MJCF, ".", "<sensor><jointpos joint='none'/></sensor>")),
        Kind("a part is painted with another material", MJCF, LOOKS, edit_xml(
            MJCF, lambda r: named(r, "geom", "part_1_visual").set("rgba", "0.2 0.9 0.2 1"))),
        Kind("a texture is a builtin", MJCF, LOOKS, edit_xml(MJCF, _builtin)),
        Kind("a material shines like a mirror", MJCF, LOOKS, both(
            put(MJCF, "asset/material", "reflectance", "1"),
            put(MJCF, "asset/material", "specular", "1"))),
    ]


def _default_joint(root: ET.Element) -> None:
    found = root.find("default/default/joint")
    if found is None:
        raise NotHereError("a default of joints")
    found.set("damping", "5")
    for joint in root.iter("joint"):
        joint.attrib.pop("damping", None) if joint.get("axis") else None


def _builtin(root: ET.Element) -> None:
    found = root.find("asset/texture[@file]")
    if found is None:
        raise NotHereError("texture")
    found.attrib.pop("file")
    for key, value in (("builtin", "flat"), ("rgb1", "1 0 1"), ("width", "8"), ("height", "8")):
        found.set(key, value)


def _world() -> list[Kind]:
    def kind(name: str, meant: tuple[str, ...], deed: Deed) -> Kind:
        return Kind(f"scene: {name}", (SCENE,), meant, deed)

    def option(key: str, value: str, *meant: str) -> Kind:
        return kind(f"{key} {value}", ("options", *meant), put(SCENE, "option", key, value))

    def flag(key: str, value: str) -> Kind:
        return kind(f"{key} {value}d", ("options",), insert(
            SCENE, "option", f"<flag {key}='{value}'/>"))

    ground = ".//geom[@name='ground']"
    rules = ("contact rules", "clear world", "own settings", "options")
    return [
        option("timestep", "0.004"), option("gravity", "0 0 -9.7"), option("gravity", "0 0 -10"),
        option("impratio", "1e6"),
        option("ccd_iterations", "1"), option("ccd_tolerance", "0.01"),
        flag("override", "enable"), flag("frictionloss", "disable"), flag("damper", "disable"),
        flag("spring", "disable"), flag("filterparent", "disable"), flag("clampctrl", "disable"),
        flag("warmstart", "disable"), flag("refsafe", "disable"),
        flag("eulerdamp", "disable"), flag("nativeccd", "disable"),
        kind("ground tilted by 1 deg", rules, put(SCENE, ground, "zaxis", turned(1))),
        kind("ground slips (condim 1)", rules, put(SCENE, ground, "condim", "1")),
        kind("ground with a margin", rules, put(SCENE, ground, "margin", "0.1")),
        kind("ground lets through (solimp)", rules, put(SCENE, ground, "solimp", "0.1 0.2 0.1")),
        kind("ground first (priority)", rules, both(put(SCENE, ground, "priority", "3"), put(
            SCENE, ground, "friction", "0.001 0 0"))),
        kind("dark (no light)", rules, both(
            put(SCENE, ".//headlight", "ambient", "0 0 0"),
            put(SCENE, ".//headlight", "diffuse", "0 0 0"), put(SCENE, ".//light", "active",
                                                               "false"))),
        kind("near plane cuts", rules, insert(
            SCENE, "visual", "<map znear='3'/>")),
        kind("contact parameters for all (default)", rules, insert(
            SCENE, ".", "<default><geom friction='0.01 0 0' condim='1'/></default>")),
        kind("a joint equality", (*OWN, *JOINTS), edit_xml(SCENE, lambda r: r.append(
            ET.fromstring("<equality><joint joint1='part_1_joint'/></equality>")))),
    ]


def _servos() -> list[Kind]:
    servo = ("same dynamics", "servos", "own words", "own settings", "compile")

    def kind(name: str, key: str, value: str | Callable[[str], str]) -> Kind:
        return Kind(f"servo: {name}", (DRIVEN,), servo, put(DRIVEN, SERVO, key, value))

    return [
        kind("gear 0.99", "gear", "0.99"), kind("kp 1 % more", "kp", times(1.01)),
        kind("effort 2 % less", "forcerange", times(0.98)),
        kind("commands 1 % less", "ctrlrange", times(0.99)),
        kind("commands not limited", "ctrllimited", "false"),
        kind("force not limited", "forcelimited", "false"),
        kind("lags (timeconst)", "timeconst", "0.05"),
        kind("damping of its own", "kv", "0.001"),
        Kind("joint: actuatorfrcrange", (DRIVEN,), servo, put(
            DRIVEN, JOINT, "actuatorfrcrange", "-0.5 0.5")),
        Kind("joint: weight carried by motors", (DRIVEN,), servo, put(
            DRIVEN, JOINT, "actuatorgravcomp", "true")),
        Kind("joint: damping 1 % more", MJCF, servo, put(MJCF, JOINT, "damping", times(1.01))),
        Kind("joint: friction 1 % more", MJCF, servo, put(
            MJCF, JOINT, "frictionloss", times(1.01))),
        Kind("joint: armature in one file", (PASSIVE,), (*servo, "same twin"),
             put(PASSIVE, JOINT, "armature", "1")),
    ]


def _urdf() -> list[Kind]:
    def kind(name: str, meant: tuple[str, ...], path: str, key: str, value: Any) -> Kind:
        return Kind(f"URDF: {name}", (URDF,), meant, put(URDF, path, key, value))

    return [
        kind("joint's frame turned by 0.5 deg", (*JOINTS, *SURFACE, "same center"),
             f"{LIMB}/origin", "rpy", plus(0.5 * DEGREE, 0, 0)),
        kind("axis 0.5 deg off", JOINTS, f"{LIMB}/axis", "xyz", turned(0.5)),
        kind("visual 1 mm off", ("same surface",), f"{LINK}/visual/origin", "xyz", plus(0.001)),
        kind("a piece turned by 1 deg", ("same collision",), f"{LINK}/collision/origin", "rpy",
             plus(DEGREE, 0, 0)),
        kind("inertia turned by 20 deg", ("same inertia",), f"{LINK}/inertial/origin", "rpy",
             plus(20 * DEGREE, 0, 0)),
        kind("limit 1 % more", ("same limits",), f"{LIMB}/limit", "upper", times(1.01)),
        kind("mass 1 % more", ("same mass",), f"{LINK}/inertial/mass", "value", times(1.01)),
        kind("collision mesh x 1.01", ("same collision",), f"{LINK}/collision/geometry/mesh",
             "scale", "1.01 1.01 1.01"),
        kind("damping 10 % more", ("same dynamics",), f"{LIMB}/dynamics", "damping", times(1.1)),
        kind("velocity 10 % more", ("same dynamics",), f"{LIMB}/limit", "velocity", times(1.1)),
        kind("colour 5 % brighter", LOOKS, ".//material/color", "rgba", lambda t: " ".join(
            f"{min(float(w) + 0.05, 1):.4f}" for w in t.split())),
        kind("stands 5 cm up", (*JOINTS, *SURFACE, "same center"),
             ".//joint[@name='world_joint']/origin", "xyz", plus(0, 0, 0.05)),
        Kind("URDF: calibrated elsewhere", (URDF,), ("own words", "own settings"), insert(
            URDF, LIMB, "<calibration rising='0.3'/>")),
        Kind("URDF: a visual twice", (URDF,), (*LOOKS, "same surface"), edit_xml(
            URDF, lambda r: r.find(LINK).append(ET.fromstring(ET.tostring(
                r.find(f"{LINK}/visual")))))),
    ]


def _yaml() -> list[Kind]:
    def kind(name: str, meant: tuple[str, ...], deed: Deed) -> Kind:
        return Kind(f"yaml: {name}", (YAML,), meant, deed)

    return [
        kind("axis 0.5 deg off", JOINTS, told("joints", "axis", lambda v: [
            float(w) for w in turned(0.5)(" ".join(map(str, v))).split()])),
        kind("range 1 % more", ("same limits",), told(
            "joints", "range", lambda v: [v[0], v[1] * 1.01])),
        kind("density 1 % more", ("own numbers", "mass of mesh"),
             told("parts", "density", lambda v: 1.01 * v)),
        kind("observed 2 % more", ("own numbers", "same limits"), told(
            "joints", "observed", lambda v: [v[0], v[1] * 1.02])),
        kind("a deviation negative", ("provenance", "own numbers"), tell(_deviation(-1.0))),
        kind("all seen (synthesised -1)", ("own numbers", "provenance"),
             told("parts", "synthesised", -1.0)),
        kind("no texture named", (*LOOKS, "assets"), tell(
            lambda t: t["parts"][1].update(texture=None))),
        kind("gravity 1 % more", ("options", "own numbers"), told(
            "", "gravity", lambda v: [1.01 * x for x in v])),
    ]


def _deviation(factor: float) -> Callable[[Any], None]:
    def change(tree: Any) -> None:
        found = [leaf for leaf in tree["joints"][0]["sigma"].values() if leaf.get("value")]
        if not found:
            raise NotHereError("deviations")
        for leaf in found:
            leaf["value"] *= factor
    return change
