"""Kinds of sabotage of URDF, twin.yaml, meshes, and of whole files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from sabotage_tools import (
    Deed,
    Kind,
    NotHereError,
    drop,
    edit_xml,
    faces,
    file,
    half,
    insert,
    obj,
    plus,
    put,
    tell,
    times,
    told,
    turn_face,
    turned,
)

URDF, YAML = "twin.urdf", "twin.yaml"
LINK, JOINT = ".//link[@name='part_1']", ".//joint[@name='part_1_joint']"
SEEN = "assets/part_1_visual.obj"
JOINTS = ("same joint", "same motion")
SHAPE = ("mass of mesh", "mesh", "same surface", "loose bits", "compile", "assets")
GONE = ("files", "compile", "readable", "assets")


def kinds() -> list[Kind]:
    """Return every kind, in the order of the table."""
    return [*_whole(), *_urdf(), *_yaml(), *_yaml_joints(), *_meshes()]


def _whole() -> list[Kind]:
    out = []
    for name in ("twin.xml", "twin_actuated.xml", "scene.xml", URDF, YAML):
        out += [Kind(f"{name} deleted", (name,), GONE, file(name, None)),
                Kind(f"{name} empty", (name,), GONE, file(name, lambda data: b"")),
                Kind(f"{name} cut in half", (name,), (*GONE, "provenance"), file(name, half))]
    for name, pattern in (("a visual mesh", SEEN), ("a texture", "assets/*_texture.png"),
                          ("a material", "assets/*_visual.mtl"),
                          ("a piece", "assets/*_piece_*.obj")):
        out.append(Kind(f"{name} deleted", ("assets", YAML), GONE, file(pattern, None)))
    out.append(Kind("a texture is no picture", ("assets", YAML), GONE,
                    file("assets/*_texture.png", lambda data: b"text" + data[4:])))
    return out


def _urdf() -> list[Kind]:
    def kind(name: str, meant: tuple[str, ...], deed: Deed) -> Kind:
        return Kind(f"URDF: {name}", (URDF,), meant, deed)

    hits = ("collision there", "same collision")
    return [
        kind("without collision", hits, edit_xml(URDF, lambda r: [
            link.remove(c) for link in r.iter("link") for c in link.findall("collision")])),
        kind("without collision of a part", hits, drop(URDF, f"*{LINK}/collision")),
        kind("mass x 100", ("same mass",), put(URDF, f"{LINK}/inertial/mass", "value", times(100))),
        kind("mass negative", ("same mass", "compile"),
             put(URDF, f"{LINK}/inertial/mass", "value", times(-1))),
        kind("inertia x 10", ("same inertia", "compile"),
             put(URDF, f"{LINK}/inertial/inertia", "ixx", times(1.5))),
        kind("centre of mass off", ("same center",),
             put(URDF, f"{LINK}/inertial/origin", "xyz", plus(0.05))),
        kind("without inertia", ("same mass", "readable"), drop(URDF, f"{LINK}/inertial")),
        kind("joint's origin shifted", (*JOINTS, "same surface"),
             put(URDF, f"{JOINT}/origin", "xyz", plus(0.05))),
        kind("limits +-3", ("same limits",), edit_xml(
            URDF, lambda r: r.find(f"{JOINT}/limit").attrib.update(lower="-3", upper="3"))),
        kind("limits halved", ("same limits",), put(URDF, f"{JOINT}/limit", "upper", times(0.5))),
        kind("effort 0", ("same dynamics",), put(URDF, f"{JOINT}/limit", "effort", "0")),
        kind("velocity 0", ("same dynamics",), put(URDF, f"{JOINT}/limit", "velocity", "0")),
        kind("friction x 1000", ("same dynamics",),
             put(URDF, f"{JOINT}/dynamics", "friction", times(1e3))),
        kind("axis reversed", JOINTS, put(URDF, f"{JOINT}/axis", "xyz", times(-1))),
        kind("axis 90 deg off", JOINTS, put(URDF, f"{JOINT}/axis", "xyz", turned(90))),
        kind("axis 2 deg off", JOINTS, put(URDF, f"{JOINT}/axis", "xyz", turned(2))),
        kind("joint fixed", JOINTS, put(URDF, JOINT, "type", "fixed")),
        kind("joint continuous", (*JOINTS, "same limits"), put(URDF, JOINT, "type", "continuous")),
        kind("joint renamed", JOINTS, put(URDF, JOINT, "name", "joint_one")),
        kind("mesh path wrong", ("compile", "readable"),
             put(URDF, f"{LINK}/visual/geometry/mesh", "filename", "assets/none.obj")),
        kind("mesh path leaves the folder", ("compile", "readable"),
             put(URDF, f"{LINK}/visual/geometry/mesh", "filename", "../../none.obj")),
        kind("mesh of another part", ("same surface",),
             put(URDF, f"{LINK}/visual/geometry/mesh", "filename", "assets/base_visual.obj")),
        kind("mesh scaled", ("same surface",),
             put(URDF, f"{LINK}/visual/geometry/mesh", "scale", "1.1 1.1 1.1")),
        kind("link renamed", ("same bodies", "compile"), edit_xml(URDF, _rename)),
        kind("a link twice", ("compile",), insert(URDF, ".", "<link name='part_1'/>")),
        kind("hung on the world", ("same bodies",), put(URDF, f"{JOINT}/parent", "link", "world")),
        kind("base floats", JOINTS,
             put(URDF, ".//joint[@name='world_joint']", "type", "floating")),
        kind("soft limits inside of the limits", ("same limits",), insert(
            URDF, JOINT, "<safety_controller soft_upper_limit='0.01' k_velocity='1'/>")),
        kind("screw without its mimic", JOINTS, drop(URDF, ".//mimic")),
        kind("a number that is none", ("readable", "compile"),
             put(URDF, f"{LINK}/inertial/mass", "value", "heavy")),
        kind("mass NaN", ("readable", "compile"),
             put(URDF, f"{LINK}/inertial/mass", "value", "nan")),
    ]


def _rename(root: Any) -> None:
    for element in root.iter():
        for key in ("name", "link"):
            if element.get(key) == "part_1":
                element.set(key, "part_one")


def _yaml() -> list[Kind]:
    def kind(name: str, meant: tuple[str, ...], deed: Deed) -> Kind:
        return Kind(f"yaml: {name}", (YAML,), meant, deed)

    mass = ("same mass", "mass of mesh", "own numbers")
    return [
        kind("mass x 10", mass, told("parts", "mass", lambda v: 10 * v)),
        kind("density x 10", mass, told("parts", "density", lambda v: 10 * v)),
        kind("volume x 2", mass, told("parts", "volume", lambda v: 2 * v)),
        kind("centre off", ("same center", "mass of mesh"),
             told("parts", "center", lambda v: [v[0] + 0.05, *v[1:]])),
        kind("inertia axes permuted", ("same inertia", "mass of mesh"),
             told("parts", "inertia", lambda v: np.roll(np.array(v), 1, (0, 1)).tolist())),
        kind("mass NaN", ("same mass", "provenance"), told("parts", "mass", float("nan"))),
        kind("mass 1e308", mass, told("parts", "mass", 1e308)),
        kind("mass is a word", ("same mass", "provenance"), told("parts", "mass", "heavy")),
        kind("mass without a source", ("provenance",),
             tell(lambda t: t["parts"][1]["mass"].pop("source"))),
        kind("a source that is none", ("provenance",),
             tell(lambda t: t["parts"][1]["mass"].update(source="guessed"))),
        kind("no provenance at all", ("provenance",), tell(_plain)),
        kind("material lacks", ("provenance", "assets"), tell(lambda t: t.pop("material"))),
        kind("another material", ("own numbers",),
             tell(lambda t: t["material"].update(value="steel", source="measured"))),
        kind("meters_per_unit x 1000", ("own numbers", "options"),
             tell(_thousandfold)),
        kind("up turned over", ("options", "own numbers"),
             told("", "up", lambda v: [-x for x in v])),
        kind("gravity upwards", ("options",), told("", "gravity", lambda v: [-x for x in v])),
        kind("time step / 10", ("options",), told("", "timestep", lambda v: v / 10)),
        kind("meshes of two parts swapped", SHAPE, tell(_swap_meshes)),
        kind("a piece is not named", ("same collision",),
             tell(lambda t: t["parts"][0]["collision_meshes"].pop())),
        kind("a part lacks", ("same bodies", "assets"), tell(lambda t: t["parts"].pop(1))),
        kind("another name", ("same bodies",), tell(lambda t: t.update(name="other"))),
        kind("a mesh said to be open", ("own numbers",),
             tell(lambda t: t["parts"][1].update(watertight=False))),
        kind("a part twice", ("assets",), tell(lambda t: t["parts"].append(t["parts"][1]))),
        kind("a joint lacks", ("assets",), tell(lambda t: t["joints"].pop(0))),
        kind("another format", ("assets",), tell(lambda t: t.update(format=99))),
        kind("a mesh outside of the folder", ("assets",),
             tell(lambda t: t["parts"][1].update(visual_mesh="../x.obj"))),
    ]


def _thousandfold(tree: Any) -> None:
    leaf = tree["meters_per_unit"]
    leaf["taken" if leaf.get("source") == "assumed" else "value"] *= 1000


def _plain(tree: Any) -> None:
    for entry in [*tree["parts"], *tree["joints"]]:
        for leaf in entry.values():
            if isinstance(leaf, dict):
                leaf.pop("source", None)


def _swap_meshes(tree: Any) -> None:
    one, two = tree["parts"][:2]
    one["visual_mesh"], two["visual_mesh"] = two["visual_mesh"], one["visual_mesh"]


def _yaml_joints() -> list[Kind]:
    def kind(name: str, meant: tuple[str, ...], deed: Deed) -> Kind:
        return Kind(f"yaml: joint's {name}", (YAML,), meant, deed)

    return [
        kind("kind", JOINTS, tell(lambda t: t["joints"][0].update(
            type="revolute" if t["joints"][0]["type"] == "prismatic" else "prismatic"))),
        kind("axis reversed", JOINTS, told("joints", "axis", lambda v: [-x for x in v])),
        kind("axis 90 deg off", JOINTS, told("joints", "axis", lambda v: [v[1], v[2], v[0]])),
        kind("axis not of length 1", (*JOINTS, "assets"), told("joints", "axis", [0.0, 0.0, 3.0])),
        kind("hinge's origin off", JOINTS, tell(_move_hinge)),
        kind("range beyond", ("same limits",),
             told("joints", "range", lambda v: [v[0], v[1] + 1])),
        kind("range turned over", ("same limits", "assets"),
             told("joints", "range", lambda v: [v[1], v[0]])),
        kind("range below its states", ("same limits", "own numbers"),
             told("joints", "range", lambda v: [v[0] / 2, v[1] / 2])),
        kind("state_1 halved", ("same states", "own numbers"),
             told("joints", "state_1", lambda v: v / 2)),
        kind("state_0 not 0", ("same states", "own numbers"), told("joints", "state_0", 0.1)),
        kind("observed doubled", ("own numbers",),
             told("joints", "observed", lambda v: [2 * x for x in v])),
        kind("damping x 10", ("same dynamics",), told("joints", "damping", lambda v: 10 * v)),
        kind("kp x 10", ("same dynamics",), told("joints", "kp", lambda v: 10 * v)),
        kind("force 0", ("same dynamics",), told("joints", "force", 0.0)),
        kind("part is another", ("assets",), tell(lambda t: t["joints"][0].update(part="base"))),
        kind("parent is itself", ("assets",), tell(lambda t: t["parts"][1].update(
            parent=t["parts"][1]["name"]))),
    ]


def _move_hinge(tree: Any) -> None:
    hinge = next((j for j in tree["joints"] if j["type"] == "revolute"), None)
    if hinge is None:
        raise NotHereError("a hinge")
    hinge["origin"]["value"] = [x + 0.01 for x in hinge["origin"]["value"]]


def _meshes() -> list[Kind]:
    def kind(name: str, meant: tuple[str, ...], deed: Deed) -> Kind:
        return Kind(f"mesh: {name}", ("assets", YAML, "part_1_visual"), meant, deed)

    def swap(folder: Path) -> None:
        one, two = folder / SEEN, folder / "assets/base_visual.obj"
        data = one.read_bytes()
        one.write_bytes(two.read_bytes())
        two.write_bytes(data)

    return [
        kind("a hole of 200 faces", SHAPE, faces(SEEN, lambda f: f[:-min(200, len(f) // 2)])),
        kind("a hole of 1 face", SHAPE, faces(SEEN, lambda f: f[:-1])),
        kind("inside out", SHAPE, faces(SEEN, lambda f: [turn_face(x) for x in f])),
        kind("one face turned", SHAPE, faces(SEEN, lambda f: [turn_face(f[0]), *f[1:]])),
        kind("a face twice", SHAPE, faces(SEEN, lambda f: [*f, f[0]])),
        kind("x 1.1", SHAPE, obj(SEEN, lambda v: 1.1 * v)),
        kind("x 1000", SHAPE, obj(SEEN, lambda v: 1000 * v)),
        kind("shifted by 1 cm", SHAPE, obj(SEEN, lambda v: v + 0.01)),
        kind("mirrored", SHAPE, obj(SEEN, lambda v: v * [-1, 1, 1])),
        kind("meshes of two parts swapped", SHAPE, swap),
        kind("one corner 3 m away", SHAPE, obj(SEEN, lambda v: np.vstack([v[:1] + 3, v[1:]]))),
        kind("a corner is NaN", SHAPE, obj(SEEN, lambda v: np.vstack([v[:1] * np.nan, v[1:]]))),
        kind("a corner at 1e308", SHAPE, obj(SEEN, lambda v: np.vstack([v[:1] + 1e308, v[1:]]))),
        kind("a floating bit 3 m away", ("loose bits", "mass of mesh"), _float_bit),
        kind("a face names no corner", SHAPE, faces(SEEN, lambda f: [*f, "f 1 2 999999999"])),
        kind("a piece x 2", ("same collision", "collision", "assets"),
             obj("assets/base_piece_00.obj", lambda v: 2 * v)),
    ]


def _float_bit(folder: Path) -> None:
    """Put a tetrahedron of 10 cm into the mesh, 3 m away."""
    path = folder / SEEN
    lines = path.read_text().splitlines()
    count = sum(line.startswith("v ") for line in lines)
    tail = next(line for line in lines if line.startswith("f ")).split()[1].split("/")[1:]
    corners = [(3, 3, 3), (3.1, 3, 3), (3, 3.1, 3), (3, 3, 3.1)]
    last = max(i for i, line in enumerate(lines) if line.startswith("v "))
    lines[last + 1:last + 1] = [f"v {x} {y} {z} .5 .5 .5" for x, y, z in corners]
    rest = "".join(f"/{t and 1}" for t in tail)
    for a, b, c in ((1, 3, 2), (1, 2, 4), (1, 4, 3), (2, 3, 4)):
        lines.append(" ".join(["f", *(f"{count + i}{rest}" for i in (a, b, c))]))
    path.write_text("\n".join(lines) + "\n")
