"""Whether every file shows a part as its mesh and picture are, and pictures fit their meshes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from part2gs_robotics.agree.finding import CheckResult, fails, passes
from part2gs_robotics.exporters.meshfile import add_material, mean_rgba
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.twin import SEEN_GROUP, Part, PartMesh, Texture, Twin

COLOUR = 0.01  # of 1: colours of corners have four digits, their mean has the same
BETTER = 1.1  # x; benchmarks/turned.py: 228 of 228 turned pictures told, 0 of 76 right ones
SAME = 1e-6  # of 1: two fits that are exact are alike
# Mean colour of a picture and of corners, by area: at most 0.10 and 0.34 of it in 94 parts.
OFF, OFF_SHARE = 0.15, 0.5
SPREAD = 0.5  # of the faces must have a place of their own in the picture
FACES = 20  # fewer say nothing about a picture
MTL = ("newmtl", "Ka 1 1 1", "Kd 1 1 1", "Ks 0 0 0", "map_Kd")  # how ours begin


def looks(folder: Path, twin: Twin) -> list[CheckResult]:
    """Return a row per part and file that is shown as something else, or one that passes.

    Args:
        folder: of the twin.
        twin: with meshes and pictures, as twin.yaml names them.
    """
    out = [r for name in ("twin.xml", "twin_actuated.xml") for r in _mjcf(folder / name, twin)]
    out += [*_urdf(folder / "twin.urdf", twin), *_materials(folder, twin), *_pictures(twin)]
    return out or [passes("same look", "", "every file shows colours and pictures of the meshes")]


def _bad(where: str, text: str, cause: str) -> CheckResult:
    return fails("same look", where, text, cause)


def _root(path: Path) -> ET.Element | None:
    try:
        return ET.parse(path).getroot()
    except (OSError, ET.ParseError):
        return None  # other rows say so


def _mjcf(path: Path, twin: Twin) -> Iterator[CheckResult]:
    root = _root(path)
    for part in twin.parts if root is not None else ():
        assert root is not None
        asset = ET.Element("asset")
        add_material(asset, part)
        for wanted in asset:
            name = wanted.get("name", "")
            found = root.find(f"asset/{wanted.tag}[@name='{name}']")
            if found is None or not _alike(found, wanted):
                yield _bad(f"{path.name}: {part.name}", f"<{wanted.tag}> {name} is not that of its "
                           "mesh", f"{path.name}: give {name} {dict(wanted.attrib)}")
        geom = root.find(f".//geom[@mesh='{part.name}_visual']")
        if geom is not None and geom.get("material") != f"{part.name}_color":
            yield _bad(f"{path.name}: {part.name}", f"is shown in {geom.get('material')}",
                       f"{path.name}: give its visual geom the material {part.name}_color")
    seen = None if root is None else root.find("default/default/default/mesh[@inertia='exact']/..")
    group = None if seen is None else seen.find("geom")
    if group is not None and group.get("group") != str(SEEN_GROUP):
        yield _bad(path.name, f"visual meshes are in group {group.get('group')}, which viewers "
                   "hide or show as collision", f"{path.name}: put them into group {SEEN_GROUP}")


def _alike(one: ET.Element, two: ET.Element) -> bool:
    keys = set(one.attrib) | set(two.attrib)
    return all(_same(one.get(k, ""), two.get(k, "")) for k in keys)


def _same(one: str, two: str) -> bool:
    try:
        a, b = ([float(w) for w in text.split()] for text in (one, two))
    except ValueError:
        return one == two
    return len(a) == len(b) and all(abs(x - y) <= COLOUR for x, y in zip(a, b, strict=True))


def _urdf(path: Path, twin: Twin) -> Iterator[CheckResult]:
    root = _root(path)
    for part in twin.parts if root is not None else ():
        assert root is not None
        name, wanted = f"{part.name}_color", mean_rgba(part.mesh)
        color = root.find(f"material[@name='{name}']/color")
        own = root.find(f"link[@name='{part.name}']/visual/material")
        text = "" if color is None else color.get("rgba", "")
        if not _same(text, " ".join(map(str, wanted))) or own is None or own.get("name") != name:
            yield _bad(f"{path.name}: {part.name}", f"is shown as {text or 'nothing'}; its mesh "
                       f"has the mean colour {wanted}", f"{path.name}: give the visual of "
                       f"{part.name} the material {name} of that colour")


def _materials(folder: Path, twin: Twin) -> Iterator[CheckResult]:
    """Yield material files that darken, hide or tint what their picture shows."""
    for part in (p for p in twin.parts if p.mesh.texture is not None):
        path = folder / f"assets/{part.name}_visual.mtl"
        text = path.read_text("ascii", "replace") if path.is_file() else ""
        lines = [" ".join(line.split()) for line in text.splitlines() if line.strip()]
        odd = [line for line in lines if not line.startswith(MTL)]
        if text and (odd or "Kd 1 1 1" not in lines):
            yield _bad(f"assets/{path.name}", f"says {(odd or lines)[0]!r}, which changes how the "
                       "picture is shown", f"assets/{path.name}: restore it, or build the twin "
                       "again")


def _pictures(twin: Twin) -> Iterator[CheckResult]:
    """Yield pictures that are not of the mesh they are on: its corners have colours as well."""
    shown = [p for p in twin.parts if p.mesh.texture is not None and len(p.mesh.faces) >= FACES]
    for part in shown:
        file, texture = f"assets/{part.name}_texture.png", part.mesh.texture
        assert texture is not None
        wanted = _corner_colours(part.mesh)
        own = texture.at(texture.uv)
        area, mean = _corner_areas(part.mesh), float(wanted.mean())
        off = float(np.abs(area @ (own - wanted)).mean())
        others = {f"the picture of {p.name}": _texture(p).at(texture.uv) for p in shown
                  if p is not part}
        others |= _other_ways(texture)
        worse = {name: _worse(own - wanted, other - wanted, area) for name, other in others.items()}
        best = max(others, key=worse.__getitem__)
        flat = _flat(texture)
        if flat > 1 - SPREAD:
            yield _bad(f"assets/{part.name}_visual.obj", f"{flat:.0%} of its faces have no area in "
                       "the picture", f"assets/{part.name}_visual.obj: restore it")
        elif worse[best] > BETTER:
            yield _bad(file, f"{best} fits the colours of its mesh better",
                       f"{file}: restore it and the vt of assets/{part.name}_visual.obj, or build "
                       "the twin again")
        elif off > min(OFF, OFF_SHARE * mean + COLOUR):
            yield _bad(file, f"its mean colour is {off:.2g} of 1 off that of its mesh",
                       f"{file}: restore it, or build the twin again")


def _worse(own: F64, other: F64, area: F64) -> float:
    """Return how many times worse a picture fits than another does, by corners and by area.

    The lesser of both: slivers are most of a cut mesh's corners and next to nothing of its area,
    and of what is all of one colour large faces alone tell little.

    Args:
        own: [C, 3] how far colours at corners are off.
        other: [C, 3] the same of the other picture.
        area: [C] shares of the corners.
    """
    gaps = [[weights @ np.abs(off).mean(1) for weights in (np.full_like(area, 1 / len(area)), area)]
            for off in (own, other)]
    return float(min(a / max(b, SAME) for a, b in zip(*gaps, strict=True)))


def _other_ways(texture: Texture) -> dict[str, F64]:
    """Return [3 F, 3] colours at corners if a picture lay another way, by what is done to it."""
    uv = np.asarray(texture.uv, np.float64)
    blue = Texture(texture.uv, np.ascontiguousarray(texture.image[..., ::-1]))
    return {"it upside down": texture.at(uv * (1, -1) + (0, 1)),
            "it mirrored": texture.at(uv * (-1, 1) + (1, 0)),
            "it turned by half": texture.at(1 - uv),
            "it with u and v swapped": texture.at(uv[..., ::-1]),
            "it with red and blue swapped": blue.at(uv)}


def _texture(part: Part) -> Texture:
    assert part.mesh.texture is not None
    return part.mesh.texture


def _corner_colours(mesh: PartMesh) -> F64:
    return np.asarray(mesh.colors, np.float64)[np.asarray(mesh.faces).reshape(-1)] / 255.0


def _corner_areas(mesh: PartMesh) -> F64:
    """Return [3 F] shares of the area at corners: slivers between colours show next to nothing."""
    tri = np.asarray(mesh.vertices, np.float64)[np.asarray(mesh.faces)]
    area = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1)
    return np.asarray(np.repeat(area / (3 * area.sum()), 3))


def _flat(texture: Texture) -> float:
    """Return the share of faces whose three places in the picture are one."""
    uv = np.asarray(texture.uv, np.float64)
    return float((np.ptp(uv, axis=1).max(1) == 0).mean())
