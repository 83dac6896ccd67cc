"""Kinds of sabotage of what is seen, and of exports, that no number of the twin's files tells."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from sabotage_exports import usd
from sabotage_models import BODY
from sabotage_more import LOOKS
from sabotage_small import DEGREE, JOINTS, SDF, SURFACE, YAML, named
from sabotage_tools import (
    MJCF,
    Deed,
    Kind,
    NotHereError,
    edit_xml,
    file,
    glb,
    obj,
    put,
    tell,
    times,
    turned,
)

SHAPE = ("mass of mesh", "mesh", *SURFACE, "loose bits", "compile", "assets")
MESH, PICTURE = "assets/part_1_visual.obj", "assets/part_1_texture.png"


def kinds() -> list[Kind]:
    """Return every kind, in the order of the table."""
    return [*_meshes(), *_pictures(), *_exports()]


def _meshes() -> list[Kind]:
    def kind(name: str, meant: tuple[str, ...], deed: Deed) -> Kind:
        return Kind(f"mesh: {name}", ("assets", YAML, "part_1_visual"), meant, deed)

    piece = ("collision", "same collision", "contact rules", "mass of mesh", "phantom contact",
             "assets", "own numbers")
    return [
        kind("x 1.002", SHAPE, obj(MESH, lambda v: 1.002 * v)),
        kind("turned by 0.5 deg", SHAPE, obj(MESH, lambda v: _about(v, 0.5))),
        kind("one corner 2 cm out", SHAPE, obj(MESH, lambda v: np.vstack([v[:1] + 0.02, v[1:]]))),
        kind("bumpy by 1 mm", SHAPE, obj(MESH, lambda v: v + np.random.default_rng(0).normal(
            0, 0.001, v.shape))),
        kind("turned through itself", SHAPE, obj(MESH, _through)),
        kind("a face of no area", SHAPE, obj(MESH, lambda v: np.vstack([v[1:2], v[1:]]))),
        kind("without its material", (*LOOKS, "assets"), file(MESH, lambda d: b"\n".join(
            line for line in d.split(b"\n") if not line.startswith((b"mtllib", b"usemtl"))))),
        kind("another material's name", (*LOOKS, "assets"), file(MESH, lambda d: d.replace(
            b"usemtl part_1", b"usemtl base").replace(b"mtllib part_1", b"mtllib base"))),
        kind("corners painted red", LOOKS, file(MESH, _painted)),
        kind("all pieces 5 mm off", piece, obj("assets/part_1_piece_*.obj", lambda v: v + 0.005)),
        kind("a piece x 1.2", piece, obj("assets/part_1_piece_00.obj", _grown(1.2))),
        kind("a piece x 0.5", piece, obj("assets/part_1_piece_00.obj", _grown(0.5))),
        kind("a piece where another one is", piece, _doubled),
        kind("a piece inside out", piece, file("assets/part_1_piece_00.obj", _inside_out)),
        kind("normals turned over", (*LOOKS, "assets"), file(MESH, lambda d: b"\n".join(
            b"vn " + b" ".join(b"%g" % -float(w) for w in x.split()[1:]) if x.startswith(b"vn ")
            else x for x in d.split(b"\n")))),
        Kind("a visual mesh twice", MJCF, (*LOOKS, "same surface"), edit_xml(MJCF, _seen_twice)),
    ]


def _seen_twice(root: ET.Element) -> None:
    body = root.find(BODY)
    again = ET.fromstring(ET.tostring(named(root, "geom", "part_1_visual")))
    again.set("name", "again")
    if body is not None:
        body.append(again)


def _about(v: np.ndarray, degrees: float) -> np.ndarray:
    c, s = np.cos(degrees * DEGREE), np.sin(degrees * DEGREE)
    return (v - v.mean(0)) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + v.mean(0)


def _through(v: np.ndarray) -> np.ndarray:
    """Swap two far corners: every face is there, the volume is another."""
    v = v.copy()
    far = int(np.linalg.norm(v - v[0], axis=1).argmax())
    v[[0, far]] = v[[far, 0]]
    return v


def _grown(factor: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda v: v.mean(0) + factor * (v - v.mean(0))


def _painted(data: bytes) -> bytes:
    lines = data.split(b"\n")
    return b"\n".join(b" ".join([*x.split()[:4], b"1 0 0"]) if x.startswith(b"v ")
                      and len(x.split()) == 7 else x for x in lines)


def _doubled(folder: Path) -> None:
    found = sorted((folder / "assets").glob("part_1_piece_*.obj"))
    if len(found) < 2:
        raise NotHereError("two pieces")
    found[1].write_bytes(found[0].read_bytes())


def _inside_out(data: bytes) -> bytes:
    return b"\n".join(b" ".join([b"f", *x.split()[:0:-1]]) if x.startswith(b"f ") else x
                      for x in data.split(b"\n"))


def _picture(change: Callable[[np.ndarray], np.ndarray], name: str = PICTURE) -> Deed:
    def deed(folder: Path) -> None:
        import cv2

        path = folder / name
        if not path.is_file():
            raise NotHereError(name)
        before = cv2.imread(str(path))
        after = np.ascontiguousarray(change(before))
        if np.array_equal(before, after):
            raise NotHereError(f"{name}: looks the same")
        cv2.imwrite(str(path), after)
    return deed


def _places_of_texture(change: Callable[[np.ndarray], np.ndarray]) -> Deed:
    def on(data: bytes) -> bytes:
        if b"\nvt " not in data:
            raise NotHereError("texture")
        lines = data.decode().splitlines()
        rows = [i for i, line in enumerate(lines) if line.startswith("vt ")]
        found = change(np.array([lines[i].split()[1:3] for i in rows], float))
        for i, (u, v) in zip(rows, found, strict=True):
            lines[i] = f"vt {u:.6f} {v:.6f}"
        return ("\n".join(lines) + "\n").encode()
    return file(MESH, on)


def _pictures() -> list[Kind]:
    def kind(name: str, deed: Deed) -> Kind:
        return Kind(f"texture: {name}", ("assets", "part_1"), (*LOOKS, "assets"), deed)

    return [
        kind("upside down", _picture(lambda p: p[::-1])),
        kind("mirrored", _picture(lambda p: p[:, ::-1])),
        kind("red and blue swapped", _picture(lambda p: p[..., ::-1])),
        kind("grey", _picture(lambda p: np.repeat(p.mean(2, keepdims=True), 3, 2).astype("u1"))),
        kind("negative", _picture(lambda p: 255 - p)),
        kind("half as bright", _picture(lambda p: (p * 0.5).astype("u1"))),
        kind("shifted by a tenth", _picture(lambda p: np.roll(p, p.shape[1] // 10, 1))),
        kind("noise", _picture(lambda p: np.random.default_rng(0).integers(
            0, 256, p.shape, np.uint8))),
        kind("one colour, its mean", _picture(lambda p: np.broadcast_to(
            p.mean((0, 1)), p.shape).astype("u1"))),
        kind("a logo across it", _picture(_logo)),
        kind("places swapped (u, v)", _places_of_texture(lambda t: t[:, ::-1])),
        kind("places upside down (1 - v)", _places_of_texture(lambda t: t * [1, -1] + [0, 1])),
        kind("places shifted by 5 %", _places_of_texture(lambda t: t + 0.05)),
        kind("places x 0.9", _places_of_texture(lambda t: t * 0.9)),
        Kind("yaml: a texture of another part", (YAML, "assets"), (*LOOKS, "assets"),
             tell(_swap_textures)),
    ]


def _logo(picture: np.ndarray) -> np.ndarray:
    h, w = picture.shape[:2]
    out = picture.copy()
    out[h // 4:3 * h // 4, w // 4:3 * w // 4] = (255, 0, 255)
    return out


def _exports() -> list[Kind]:
    link, joint = ".//link[@name='part_1']", ".//joint[@name='part_1_joint']"

    def drawn(change: Callable[[dict[str, Any]], object]) -> Deed:
        return glb(change)

    def prim(path: str, key: str, change: Callable[[Any], Any]) -> Deed:
        def on(stage: Any, root: str) -> None:
            found = stage.GetPrimAtPath(f"{root}/{path}").GetAttribute(key)
            if not found or found.Get() is None:
                raise NotHereError(key)
            found.Set(change(found.Get()))
        return usd(on)

    files = ("usd/twin.usd",)
    return [
        Kind("SDF: mass 1 % more", (SDF,), ("same mass",), put(
            SDF, f"{link}/inertial/mass", "TEXT", times(1.01))),
        Kind("SDF: axis 0.5 deg off", (SDF,), JOINTS, put(
            SDF, f"{joint}/axis/xyz", "TEXT", turned(0.5))),
        Kind("SDF: damping 10 % more", (SDF,), ("same dynamics",), put(
            SDF, f"{joint}/axis/dynamics/damping", "TEXT", times(1.1))),
        Kind("SDF: a picture beside it black", (SDF,), LOOKS, _picture(
            lambda p: p * 0, "sdf/assets/part_1_texture.png")),
        Kind("USD: red", files, LOOKS, _usd_colour),
        Kind("USD: glass", files, LOOKS, usd(_usd_glass)),
        Kind("GLB: a part turned by 1 deg", ("glb/twin.glb",), (*JOINTS, "same surface"), drawn(
            lambda t: t["nodes"][2].update(rotation=[0, 0, 0.0087265, 0.99996192]))),
        Kind("GLB: a part x 1.01", ("glb/twin.glb",), (*JOINTS, "same surface"), drawn(
            lambda t: t["nodes"][2].update(scale=[1.01] * 3))),
        Kind("GLB: red", ("glb/twin.glb",), LOOKS, drawn(lambda t: [m.setdefault(
            "pbrMetallicRoughness", {}).update(baseColorFactor=[1, 0, 0, 1])
            for m in t["materials"]])),
        Kind("GLB: glass", ("glb/twin.glb",), LOOKS, drawn(lambda t: [m.update(
            alphaMode="BLEND") or m.setdefault("pbrMetallicRoughness", {}).update(
                baseColorFactor=[1, 1, 1, 0.1]) for m in t["materials"]])),
        Kind("GLB: pictures of two parts swapped", ("glb/twin.glb",), LOOKS, drawn(_swap_images)),
        Kind("USD: mass 1 % more", files, ("same mass",), prim(
            "part_1", "physics:mass", lambda m: 1.01 * m)),
        Kind("USD: limit 1 % more", files, ("same limits",), prim(
            "joints/part_1_joint", "physics:upperLimit", lambda m: 1.01 * m)),
        Kind("USD: joint's place 5 mm off", files, (*JOINTS, *SURFACE, "same center"), prim(
            "joints/part_1_joint", "physics:localPos0", lambda p: p + type(p)(0.005, 0, 0))),
        Kind("USD: centre of mass off", files, ("same center",), prim(
            "part_1", "physics:centerOfMass", lambda p: p + type(p)(0.01, 0, 0))),
    ]


def _swap_images(tree: dict[str, Any]) -> None:
    found = tree.get("textures", [])
    if len(found) < 2:
        raise NotHereError("two textures")
    found[0]["source"], found[1]["source"] = found[1]["source"], found[0]["source"]


def _usd_colour(folder: Path) -> None:
    """Paint the parts of a stage, textured or not."""
    def on(stage: Any, _: str) -> None:
        for prim in stage.Traverse():
            found = prim.GetAttribute("inputs:diffuseColor")
            if found:
                found.ClearConnections()
                found.Set((1.0, 0.0, 0.0))
    usd(on)(folder)


def _usd_glass(stage: Any, root: str) -> None:
    from pxr import Sdf, UsdShade

    shader = UsdShade.Shader(stage.GetPrimAtPath(f"{root}/part_1/material/surface"))
    shader.CreateInput("opacity", Sdf.ValueTypeNames.Float).Set(0.1)


def _swap_textures(tree: Any) -> None:
    one, two = tree["parts"][:2]
    if not one.get("texture") or not two.get("texture"):
        raise NotHereError("two textures")
    one["texture"], two["texture"] = two["texture"], one["texture"]
