"""twin.yaml and the meshes it names in the words of `described.py`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import numpy as np

from part2gs_robotics.agree.described import NO, Body, Described, Drive
from part2gs_robotics.agree.finding import CheckResult, fails, passes
from part2gs_robotics.exporters.read_twin import read_twin
from part2gs_robotics.exporters.twin_yaml import Source, read_twin_yaml
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.materials import DEFAULT, density_of
from part2gs_robotics.model.twin import Twin

YAML = "twin.yaml"
NUMBERS = ("damping", "friction", "armature", "kp", "kv", "velocity")
CLOSE = 1e-6  # relative; files hold ten digits, twin.yaml all of them
# What every description holds of the whole, of a part and of a joint.
WHOLE = ("meters_per_unit", "up", "material", "gravity", "timestep")
PART = ("volume", "density", "mass", "center", "inertia")
JOINT = ("axis", "origin", "pitch", "range", "state_0", "state_1", "observed")


def of_yaml(folder: Path) -> tuple[Described, Twin, dict[str, object]]:
    """Return what twin.yaml says, the twin of its meshes, and the whole tree.

    Args:
        folder: of the twin.

    Raises:
        CheckError: if it is no description of a twin, or names a file that is not one.
    """
    twin, summary = read_twin(folder), read_twin_yaml(folder)
    joints = {str(j.get("part")): j for j in summary.joints.values()}
    bodies = {}
    for index, part in enumerate(twin.parts):
        entry, joint = summary.parts[part.name], joints.get(part.name)
        bodies[part.name] = Body(
            part.name, twin.parts[part.parent].name if index else "", float(number(entry, "mass")),
            array(entry, "center", (3,)), array(entry, "inertia", (3, 3)), part.mesh.vertices,
            tuple(p.vertices for p in part.pieces),
            None if part.joint is None or joint is None else _drive(part.limits, joint))
    return Described(YAML, bodies, title=twin.name), twin, summary.document


def _drive(limits: tuple[float, float], joint: dict[str, object]) -> Drive:
    said = {key: number(joint, key) for key in NUMBERS}
    effort = number(joint, "force")
    said |= {"effort": effort, "effort back": effort, "stiffness": 0.0, "servos": 1.0,
             "motors": 0.0, "gear": 1.0, "bias": 0.0, "kp back": said["kp"],
             "command low": limits[0], "command high": limits[1]}
    states = {name: number(joint, name) for name in ("state_0", "state_1")}
    states |= {f"command {name}": value for name, value in states.items()}
    kind = str(joint.get("type"))
    return Drive(kind, array(joint, "axis", (3,)), array(joint, "origin", (3,)),
                 number(joint, "pitch") if kind == "screw" else 0.0,
                 limits if kind != "fixed" else (NO, NO), said if kind != "fixed" else {}, states,
                 str(joint.get("name")))


def number(entry: object, key: str) -> float:
    """Return the number of {value: ...} under a key, NaN if there is none."""
    found = array(entry, key, ())
    return float(found)


def array(entry: object, key: str, shape: tuple[int, ...]) -> F64:
    """Return the numbers of {value: ...} under a key, NaN where they have another shape."""
    leaf = entry.get(key) if isinstance(entry, dict) else None
    value = leaf.get("value") if isinstance(leaf, dict) else None
    try:
        found = np.asarray(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        found = np.full(shape, NO)
    wrong = isinstance(value, str | bool) or found.shape != shape
    return np.full(shape, NO) if wrong else found


def provenance(document: dict[str, object]) -> list[CheckResult]:
    """Return what lacks its value or where it comes from, one passing row if nothing does."""
    wanted: list[tuple[str, dict[str, object], tuple[str, ...]]] = [("", document, WHOLE)]
    wanted += [(f"parts.{e.get('name')}.", e, PART) for e in _entries(document, "parts")]
    wanted += [(f"joints.{e.get('name')}.", e, JOINT) for e in _entries(document, "joints")]
    lacking = [f"{path}{key}" for path, entry, keys in wanted for key in keys
               if not _known(entry.get(key))]
    lacking += [path for path in _leaves(document, "") if path not in lacking]
    if not lacking:
        return [passes("provenance", YAML, "every number says where it comes from")]
    rest = f" and {len(lacking) - 1} more" if len(lacking) > 1 else ""
    return [fails("provenance", YAML, f"{lacking[0]}{rest} without value, source and note",
                  f"twin.yaml: give {lacking[0]} a value and a source, one of "
                  f"{', '.join(get_args(Source))}, or build the twin again")]


def _entries(document: dict[str, object], key: str) -> list[dict[str, object]]:
    found = document.get(key)
    return [e for e in found if isinstance(e, dict)] if isinstance(found, list) else []


def _known(leaf: object) -> bool:
    return isinstance(leaf, dict) and leaf.get("value") is not None and leaf.get(
        "source") in get_args(Source)


def _leaves(tree: object, path: str) -> Iterator[str]:
    """Yield the path of every {value: ...} whose source is none."""
    if isinstance(tree, dict):
        number = "value" in tree and not isinstance(tree["value"], dict)  # sigma has a key `value`
        if number and tree.get("source") not in get_args(Source):
            yield path
        for key, value in tree.items():
            if key != "build":
                yield from _leaves(value, f"{path}.{key}" if path else str(key))
    elif isinstance(tree, list):
        for i, value in enumerate(tree):
            name = value.get("name", i) if isinstance(value, dict) else i
            yield from _leaves(value, f"{path}.{name}")


def ranges(described: Described, document: dict[str, object]) -> list[CheckResult]:
    """Return where twin.yaml contradicts itself: states outside of the range, observed ends."""
    out, moved = [], [str(e.get("part")) for e in _entries(document, "joints")]
    out += [_yaml_fault(name, "two joints move it", "the joints")
            for name in dict.fromkeys(moved) if moved.count(name) > 1]
    for entry in _entries(document, "joints"):
        name, drive = str(entry.get("name")), described.drives().get(str(entry.get("part")))
        if drive is None or drive.kind == "fixed":
            continue
        parent = described.bodies[str(entry.get("part"))].parent
        if entry.get("parent") != parent:
            out.append(_yaml_fault(name, f"parent is {entry.get('parent')!r}, its part hangs on "
                                   f"{parent!r}", "parent"))
        sigma = entry.get("sigma")
        if any(array(sigma, k, ()) < 0 for k in (sigma if isinstance(sigma, dict) else ())):
            out.append(_yaml_fault(name, "a standard deviation is negative", "sigma"))
        ends = sorted((drive.states["state_0"], drive.states["state_1"]))
        seen, slack = array(entry, "observed", (2,)), CLOSE * max(1e-9, ends[1] - ends[0])
        if drive.states["state_0"] != 0.0:
            out.append(_yaml_fault(name, f"state_0 is {drive.states['state_0']:g}, and every joint "
                                   "position is 0 there", "state_0 to 0"))
        if not np.abs(seen - ends).max() <= slack:
            out.append(_yaml_fault(name, f"observed is {seen.tolist()}, the states are {ends}",
                                   "observed or state_1"))
        if not (drive.limits[0] - slack <= ends[0] and ends[1] <= drive.limits[1] + slack):
            out.append(_yaml_fault(name, f"range {drive.limits} does not hold the states {ends}",
                                   "range or state_1"))
    return out or [passes("own numbers", YAML, "ranges hold the observed states")]


def frame(document: dict[str, object]) -> list[CheckResult]:
    """Return where unit, up and gravity of twin.yaml do not fit together, assumed ones as well."""
    up, gravity = array(document, "up", (3,)), array(document, "gravity", (3,))
    leaf, out = document.get("meters_per_unit"), []
    told = leaf.get("value") if isinstance(leaf, dict) else None
    if isinstance(told, str) and told != "unknown":
        out.append(_yaml_fault("whole", f"meters_per_unit is {told[:40]!r}", "meters_per_unit"))
    if not abs(float(np.linalg.norm(up)) - 1) <= CLOSE:
        out.append(_yaml_fault("whole", f"up is {up.tolist()}, no unit vector", "up"))
    elif not np.abs(gravity / np.linalg.norm(gravity) + up).max() <= CLOSE:
        out.append(_yaml_fault("whole", f"gravity {gravity.tolist()} is not along -up, up is "
                               f"{up.tolist()}", "up or gravity"))
    return out


def _yaml_fault(name: str, detail: str, key: str) -> CheckResult:
    return fails("own numbers", f"{YAML}: {name}", detail,
                 f"twin.yaml: correct {key} of {name}, or build the twin again")


def density_of_material(twin: Twin, document: dict[str, object]) -> list[CheckResult]:
    """Return parts whose density is not that of the material at the scale twin.yaml gives."""
    known = density_of(twin.material or DEFAULT)
    wanted = NO if known is None else known * twin.meters**3
    out = []
    for entry in _entries(document, "parts"):
        found, seen = number(entry, "density"), number(entry, "synthesised")
        if seen < 0 or seen > 1 or number(entry, "num_gaussians") < 0:
            out.append(_yaml_fault(str(entry.get("name")), f"a share of {seen:g} is synthesised, "
                                   f"of {number(entry, 'num_gaussians'):g} Gaussians",
                                   "synthesised or num_gaussians"))
        if not abs(found - wanted) <= CLOSE * wanted:
            name = entry.get("name")
            out.append(fails(
                "own numbers", f"{YAML}: {name}", f"density {found:.6g} kg/unit^3; the material "
                f"{twin.material or DEFAULT} at {twin.meters:g} m per unit has {wanted:.6g}",
                f"twin.yaml: correct density of {name}, the material or meters_per_unit"))
    return out
