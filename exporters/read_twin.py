"""A twin folder read back: twin.yaml and its meshes to a Twin, whatever else lies beside them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import cast, get_args

import numpy as np

from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.meshfile import ASSETS, read_obj, read_png
from part2gs_robotics.exporters.twin_yaml import FORMAT, read_twin_yaml
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint, JointKind
from part2gs_robotics.model.twin import Part, PartMesh, Twin

Tree = dict[str, object]
FILE = re.compile(rf"(?:{ASSETS}/)?[\w-][\w.-]*")  # in the folder or in its assets/, nowhere else
MOST_PARTS = 1000  # a building has fewer moving parts; a list of millions is no twin
UNIT = 1e-6  # how far an axis may be from length 1; files have 10 digits


def read_twin(folder: Path) -> Twin:
    """Return the twin of a folder as `build` wrote it.

    Numbers come from twin.yaml with all their digits, surfaces and pictures from the files it
    names. Standard deviations and criteria come back too; what only a build needs does not.

    Args:
        folder: with twin.yaml.

    Raises:
        CheckError: a file is missing, damaged, or says what no twin can be.
    """
    summary = read_twin_yaml(folder)
    tree = summary.document
    where = folder / "twin.yaml"
    if tree.get("format") not in range(1, FORMAT + 1):
        raise CheckError(f"{where}: has format {tree.get('format')!r}. Needed 1 to {FORMAT}, which "
                         "this version reads; build the twin again.")
    entries = [_tree(entry, where, "parts") for entry in _list(tree.get("parts"), where, "parts")]
    joints = {str(joint.get("part")): joint for joint in summary.joints.values()}
    if not 0 < len(entries) <= MOST_PARTS:
        raise CheckError(f"{where}: has {len(entries)} parts. Needed 1 to {MOST_PARTS}, the base "
                         "first; build the twin again.")
    names = [str(entry.get("name")) for entry in entries]
    parts = tuple(_part(folder, entry, names[:i], joints.get(names[i]))
                  for i, entry in enumerate(entries))
    scale, material = _tree(tree.get("meters_per_unit"), where, "meters_per_unit"), _tree(
        tree.get("material"), where, "material")
    known = scale.get("source") != "assumed"
    return Twin(
        summary.name, parts,
        meters_per_unit=_positive(scale, where, "meters_per_unit") if known else None,
        up=_up(tree.get("up"), where),
        notes=tuple(map(str, _list(tree.get("notes") or [], where, "notes"))),
        assumed_meters=1.0 if known else _positive({"value": scale.get("taken", 1.0)}, where,
                                                   "meters_per_unit.taken"),
        scale_note=str(scale.get("note") or "given"),
        material=None if material.get("source") == "assumed" else str(material.get("value")))


def _part(folder: Path, entry: Tree, before: Sequence[str], joint: Tree | None) -> Part:
    where, name = folder / "twin.yaml", str(entry.get("name"))
    path = f"parts.{name}"
    if entry.get("parent") not in (before if before else [None]) or name in before:
        raise CheckError(f"{where}: part {name!r} has parent {entry.get('parent')!r}. Needed the "
                         "base without one first, then parts of new names that hang on one before "
                         "them; build the twin again.")
    if before and joint is None:
        raise CheckError(f"{where}: part {name!r} has no joint. Needed one for every part but the "
                         "base; build the twin again.")
    share = _number(entry.get("synthesised"), where, f"{path}.synthesised", 0.0)
    mesh = _mesh(folder, entry, share)
    pieces = [read_obj(_inside(folder, file, path))
              for file in _list(entry.get("collision_meshes"), where, f"{path}.collision_meshes")]
    part = Part(name, before.index(str(entry["parent"])) if before else -1, mesh, tuple(pieces),
                None, num_gaussians=int(_number(entry.get("num_gaussians"), where,
                                                f"{path}.num_gaussians", 0.0)),
                diagnostics=_numbers(entry.get("diagnostics"), where, path))
    return _hung(part, joint, where) if before and joint else part


def _mesh(folder: Path, entry: Tree, synthesised: float) -> PartMesh:
    """Return the visual mesh of a part, with the picture that twin.yaml names."""
    path = f"parts.{entry.get('name')}"
    picture = entry.get("texture")
    image = read_png(_inside(folder, picture, path)) if picture is not None else None
    return read_obj(_inside(folder, entry.get("visual_mesh"), path), image, synthesised)


def _hung(part: Part, entry: Tree, where: Path) -> Part:
    """Return the part with its joint and range."""
    path = f"joints.{entry.get('name')}"
    kind = str(entry.get("type"))
    if kind not in get_args(JointKind):
        raise CheckError(f"{where}: {path} has type {kind!r}. Needed one of "
                         f"{', '.join(get_args(JointKind))}; build the twin again.")
    axis = _vector(entry.get("axis"), where, f"{path}.axis", 3)
    if abs(float(np.linalg.norm(axis)) - 1.0) > UNIT:
        raise CheckError(f"{where}: {path}.axis has length {np.linalg.norm(axis):.6g}. Needed a "
                         "unit vector; correct it or build the twin again.")
    sigma = entry.get("sigma") if isinstance(entry.get("sigma"), dict) else {}
    spread = [_number(cast("Tree", sigma).get(key), where, path, float("nan"))
              for key in ("axis", "origin", "value", "rise")]
    joint = Joint(
        cast("JointKind", kind), axis, _vector(entry.get("origin"), where, f"{path}.origin", 3),
        _number(entry.get("state_1"), where, f"{path}.state_1"),
        _number(entry.get("pitch"), where, f"{path}.pitch", 0.0),
        bic=_numbers(entry.get("bic"), where, path), sigma_axis=spread[0],
        sigma_origin=spread[1], sigma_value=spread[2], sigma_rise=spread[3],
        confidence=_number(entry.get("confidence"), where, path, float("nan")))
    low, high = _vector(entry.get("range"), where, f"{path}.range", 2)
    if not low <= high:
        raise CheckError(f"{where}: {path}.range is {low:g} to {high:g}. Needed the lower end "
                         "first; correct it or build the twin again.")
    found = entry["range"].get("source") if isinstance(entry["range"], dict) else None
    return Part(part.name, part.parent, part.mesh, part.pieces, joint, (float(low), float(high)),
                str(found or "measured"), part.num_gaussians, part.diagnostics)


def _up(entry: object, where: Path) -> F64 | None:
    if isinstance(entry, dict) and entry.get("source") == "assumed":
        return None
    up = _vector(entry, where, "up", 3)
    if abs(float(np.linalg.norm(up)) - 1.0) > UNIT:
        raise CheckError(f"{where}: up has length {np.linalg.norm(up):.6g}. Needed a unit vector; "
                         "correct it or build the twin again.")
    return up


def _inside(folder: Path, name: object, part: str) -> Path:
    """Return the file of a name that cannot leave the folder."""
    path = folder / str(name)
    if not isinstance(name, str) or not FILE.fullmatch(name) or not path.is_file():
        raise CheckError(f"{folder / 'twin.yaml'}: {part} names the file {str(name)[:100]!r}, "
                         f"which is not there. Needed a mesh or picture in {folder / ASSETS}; "
                         "build the twin again.")
    if not path.resolve().is_relative_to(folder.resolve()):
        raise CheckError(f"{path}: is a link that leaves the twin folder. Needed a file in it; "
                         "copy the file there.")
    return path


def _tree(entry: object, where: Path, path: str) -> Tree:
    if not isinstance(entry, dict):
        raise CheckError(f"{where}: {path} is {str(entry)[:60]!r}. Needed a mapping as `build` "
                         "writes it; build the twin again.")
    return cast("Tree", entry)


def _list(entry: object, where: Path, path: str) -> list[object]:
    if not isinstance(entry, list):
        raise CheckError(f"{where}: {path} is {str(entry)[:60]!r}. Needed a list as `build` writes "
                         "it; build the twin again.")
    return entry


def _number(entry: object, where: Path, path: str, otherwise: float | None = None) -> float:
    """Return the finite value of {value, source, note}; `otherwise` where there is none."""
    value = entry.get("value") if isinstance(entry, dict) else None
    if value is None and otherwise is not None:
        return otherwise
    return float(_finite(value, where, path, ())[()])


def _positive(entry: Tree, where: Path, path: str) -> float:
    value = _number(entry, where, path)
    if value <= 0:
        raise CheckError(f"{where}: {path} is {value:g}. Needed a positive number; correct it or "
                         "build the twin again.")
    return value


def _numbers(entry: object, where: Path, path: str) -> dict[str, float]:
    found = cast("Tree", entry) if isinstance(entry, dict) else {}
    return {str(key): _number(value, where, f"{path}.{key}", float("nan"))
            for key, value in found.items()}


def _vector(entry: object, where: Path, path: str, size: int) -> F64:
    value = entry.get("value") if isinstance(entry, dict) else None
    return _finite(value, where, path, (size,))


def _finite(value: object, where: Path, path: str, shape: tuple[int, ...]) -> F64:
    try:
        found = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        found = np.zeros(0)
    plain = not isinstance(value, (str, bool)) and found.shape == shape
    if not plain or not np.isfinite(found).all():
        wanted = f"{shape[0]} finite numbers" if shape else "a finite number"
        raise CheckError(f"{where}: {path} is {str(value)[:60]!r}. Needed {wanted}; correct it or "
                         "build the twin again.")
    return found
