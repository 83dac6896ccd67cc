"""Whether exports beside a twin show its pictures and colours: glTF, OpenUSD, SDFormat."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.agree.finding import CheckResult, fails
from part2gs_robotics.agree.of_glb import Node, chunks, floats
from part2gs_robotics.errors import CheckError, ExportError
from part2gs_robotics.exporters.meshfile import mean_rgba, read_png
from part2gs_robotics.exporters.sound import sound_twin
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.twin import Part, Twin

if TYPE_CHECKING:
    from pxr import Usd, UsdShade

COLOUR = 0.01  # of 1: colours of a file have four digits
PLACE = 1e-4  # of a picture: places of corners are float32
MATERIAL = {"name", "pbrMetallicRoughness"}  # of a glTF material: more changes what it shows
# What the exporter writes: photos say nothing of gloss.
LOOK = {"metallicFactor": 0.0, "roughnessFactor": 1.0, "baseColorTexture": None}
INPUTS = ("roughness", "diffuseColor")  # of a surface in OpenUSD


def exported_looks(folder: Path, twin: Twin, further: dict[str, str]) -> list[CheckResult]:
    """Return a row per export that shows a part as something else.

    Args:
        folder: of the twin.
        twin: with meshes and pictures.
        further: format by name of every export, from the folder.
    """
    out = []
    for name, kind in further.items():
        texts = _otherwise(folder / name, kind, twin)
        if texts:  # of a twin that has to be repaired an export shows what it has become
            try:
                texts = _otherwise(folder / name, kind, sound_twin(twin))
            except ExportError:
                pass
        out += [fails("same look", name, text, f"{name}: export it again") for text in texts]
    return out


def _otherwise(path: Path, kind: str, twin: Twin) -> list[str]:
    """Return what an export shows otherwise, nothing where it cannot be read."""
    try:
        return list({"glb": _glb, "usd": _usd, "sdf": _copies}[kind](path, twin))
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, OSError, RuntimeError,
            RecursionError, struct.error, CheckError):
        return []  # the row `readable` says so


def _glb(path: Path, twin: Twin) -> Iterator[str]:
    """Yield what a glTF shows otherwise."""
    tree, chunk = chunks(path)
    nodes = {str(n["name"]): n for n in cast("list[Node]", tree["nodes"])[1:]}
    meshes = cast("list[Node]", tree["meshes"])
    for part in twin.parts:
        drawn = cast("list[Node]", meshes[cast(int, nodes[part.name]["mesh"])]["primitives"])[0]
        material = cast("list[Node]", tree["materials"])[cast(int, drawn["material"])]
        look = cast("Node", material.get("pbrMetallicRoughness", {}))
        odd = sorted({*material} - MATERIAL) + [
            f"{k} {v}" for k, v in look.items()
            if k not in LOOK or (LOOK[k] is not None and v != LOOK[k])]
        if odd:
            yield f"the material of {part.name} has {', '.join(map(str, odd))[:200]}"
        elif ("baseColorTexture" in look) != (part.mesh.texture is not None):
            yield f"{part.name} has a picture in one of {path.name} and twin.yaml alone"
        elif part.mesh.texture is not None and not np.array_equal(
                _picture(tree, chunk, look), part.mesh.texture.image):
            yield f"the picture of {part.name} is not that of assets/{part.name}_texture.png"
        elif not _same_corners(tree, chunk, drawn, part):
            yield f"corners of {part.name} have other colours or places in the picture"


def _picture(tree: Node, chunk: bytes, look: Node) -> NDArray[np.uint8]:
    """Return the [H, W, 3] RGB picture of a material, empty where it is none."""
    import cv2

    which = cast("dict[str, int]", look["baseColorTexture"])["index"]
    source = cast("list[dict[str, int]]", tree["textures"])[which]["source"]
    image = cast("list[dict[str, int]]", tree["images"])[source]
    view = cast("list[dict[str, int]]", tree["bufferViews"])[image["bufferView"]]
    data = chunk[view["byteOffset"]:view["byteOffset"] + view["byteLength"]]
    found = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    return np.asarray(np.zeros((0, 0, 3)) if found is None else found[..., ::-1], np.uint8)


def _same_corners(tree: Node, chunk: bytes, drawn: Node, part: Part) -> bool:
    """Return whether corners have the colour or the place in the picture that the mesh says."""
    keys, mesh = cast("dict[str, int]", drawn["attributes"]), part.mesh
    index = floats(tree, chunk, cast(int, drawn["indices"]), 1).ravel()
    if mesh.texture is None:
        c = mesh.colors.astype(np.float64)[mesh.faces] / 255.0  # linear, by the rule of sRGB
        wanted: F64 = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
        own, most = floats(tree, chunk, keys["COLOR_0"], 3)[index.astype(int)], COLOUR
    else:
        wanted = mesh.texture.uv.astype(np.float64) * (1.0, -1.0) + (0.0, 1.0)
        own, most = floats(tree, chunk, keys["TEXCOORD_0"], 2)[index.astype(int)], PLACE
    wanted = wanted.reshape(-1, wanted.shape[-1])
    return own.shape == wanted.shape and float(np.abs(own - wanted).max(initial=0.0)) <= most


def _usd(path: Path, twin: Twin) -> Iterator[str]:
    """Yield what an OpenUSD stage shows otherwise; nothing where it cannot be read."""
    try:
        from pxr import Usd, UsdShade
    except ImportError:
        return
    stage = Usd.Stage.Open(str(path))  # its prims live as long as it does
    root = stage.GetDefaultPrim()
    for part in twin.parts:
        visual = root.GetPrimAtPath(f"{part.name}/visual")
        if not visual:
            continue  # a name that the format has no letters for
        material = UsdShade.MaterialBindingAPI(visual).ComputeBoundMaterial()[0]
        surface = material.ComputeSurfaceSource()[0] if material else None
        if not surface or material.GetPrim().GetParent() != visual.GetParent():
            yield f"{part.name} is shown in the material of nobody or of another part"
            continue
        odd = [i.GetBaseName() for i in surface.GetInputs() if i.GetBaseName() not in INPUTS]
        if odd:
            yield f"the surface of {part.name} has {', '.join(odd)}"
        yield from _usd_colour(path, part, surface.GetInput("diffuseColor"), visual)


def _usd_colour(path: Path, part: Part, color: UsdShade.Input, visual: Usd.Prim) -> Iterator[str]:
    from pxr import UsdGeom, UsdShade

    texture = part.mesh.texture
    source = UsdShade.ConnectableAPI.GetConnectedSource(color)
    if texture is None or not source:
        value = np.array(color.Get(), float)
        wanted = np.array(mean_rgba(part.mesh)[:3], float)
        if texture is not None or source or np.abs(value - wanted).max() > COLOUR:
            yield (f"{part.name} has colour {value.round(3).tolist()}; its mesh has "
                   f"{wanted.tolist()}")
        return
    file = UsdShade.Shader(source[0].GetPrim()).GetInput("file").Get()
    if not np.array_equal(read_png(path.parent / str(file.path)), texture.image):
        yield f"the picture {file.path} of {part.name} is not that of the twin"
    places = np.array(UsdGeom.PrimvarsAPI(visual).GetPrimvar("st").Get(), float)
    wanted = texture.uv.reshape(-1, 2).astype(float)
    if places.shape != wanted.shape or np.abs(places - wanted).max(initial=0.0) > PLACE:
        yield f"corners of {part.name} have other places in the picture"


def _copies(path: Path, twin: Twin) -> Iterator[str]:
    """Yield pictures and materials beside an SDFormat file that are not those of the twin."""
    own, theirs = path.parent / "assets", path.parents[1] / "assets"
    for part in twin.parts if own.is_dir() and own != path.parents[1] else ():
        if part.mesh.texture is None:
            continue
        picture, material = own / f"{part.name}_texture.png", f"{part.name}_visual.mtl"
        if not picture.is_file() or not np.array_equal(read_png(picture),
                                                       part.mesh.texture.image):
            yield f"the picture assets/{picture.name} is not that of the twin"
        elif (theirs / material).is_file() and (not (own / material).is_file() or (
                own / material).read_bytes() != (theirs / material).read_bytes()):
            yield f"the material assets/{material} is not that of the twin"
