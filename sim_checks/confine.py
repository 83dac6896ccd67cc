"""Keep a foreign model inside its folder: every file it names is looked at before the engine."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.xmlio import read_xml

DIRECTORIES = ("meshdir", "texturedir", "assetdir")
MAX_FILES = 20_000  # PartNet-Mobility objects have hundreds
MAX_DEPTH = 8  # of nested includes


def read_confined(path: Path) -> ET.Element:
    """Return the root of a model after checking every file it refers to.

    MuJoCo follows `../`, absolute paths and links; a model from elsewhere must not.

    Raises:
        CheckError: if a path leaves the model's folder, is missing, or includes nest too deep.
    """
    folder = path.parent.resolve()
    root = _confine_file(path, folder, 0)
    if root.tag not in ("mujoco", "robot"):
        raise CheckError(
            f"{path}: the root element is <{root.tag}>. "
            "Needed <mujoco> (MJCF) or <robot> (URDF); name such a file or a twin folder."
        )
    return root


def _confine_file(path: Path, folder: Path, depth: int) -> ET.Element:
    if depth > MAX_DEPTH:
        raise CheckError(
            f"{path}: includes nest deeper than {MAX_DEPTH}. Needed fewer; flatten them."
        )
    root = read_xml(path)
    searched = [folder] + [
        _inside(path, folder, folder, value)
        for element in root.iter("compiler")
        for key, value in element.attrib.items()
        if key in DIRECTORIES
    ]
    named = [(e, v) for e in root.iter() for k, v in e.attrib.items() if k.startswith("file")]
    if len(named) > MAX_FILES:
        raise CheckError(f"{path}: names {len(named)} files. Needed at most {MAX_FILES}.")
    for element, value in named:
        found = _existing(path, folder, searched, value)
        if element.tag in ("include", "model"):
            _confine_file(found, folder, depth + 1)
    return root


def _existing(path: Path, folder: Path, searched: list[Path], value: str) -> Path:
    """Return the file a reference means; every place it could mean must be inside."""
    places = [_inside(path, folder, base, value) for base in searched]
    for place in reversed(places):
        if place.is_file():
            return place
    bare = folder / Path(value).name  # the engine may strip the path of a URDF mesh
    if bare.is_file():
        return bare
    raise CheckError(
        f"{path}: names the file {value!r}, which does not exist in {folder}. "
        "Needed every mesh beside the model; copy it there or correct the name."
    )


def _inside(path: Path, folder: Path, base: Path, value: str) -> Path:
    place = Path(value)
    if "://" in value or "\\" in value or "\0" in value:
        raise CheckError(
            f"{path}: names {value!r}. Needed a plain file name relative to {folder}; "
            "package:// and file:// are not resolved."
        )
    resolved = (base / place).resolve()
    if place.is_absolute() or not resolved.is_relative_to(folder):
        raise CheckError(
            f"{path}: names {value!r}, which leaves {folder}. "
            "Needed files inside the model's own folder; copy them there."
        )
    return resolved
