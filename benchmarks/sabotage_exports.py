"""Kinds of sabotage of exports beside a twin: SDFormat, glTF, OpenUSD."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sabotage_tools import (
    Deed,
    Kind,
    NotHereError,
    drop,
    edit_xml,
    file,
    glb,
    half,
    insert,
    obj,
    plus,
    put,
    swapped,
    times,
)

SDF = "sdf/model.sdf"
JOINTS = ("same joint", "same motion")


def kinds() -> list[Kind]:
    """Return every kind, in the order of the table."""
    return [*_sdf(), *_glb(), *_usd()]


def _sdf() -> list[Kind]:
    def kind(name: str, meant: tuple[str, ...], path: str, change: Any) -> Kind:
        return Kind(f"SDF: {name}", (SDF,), meant, put(SDF, path, "TEXT", change))

    link, joint = ".//link[@name='part_1']", ".//joint[@name='part_1_joint']"
    return [
        kind("mass x 10", ("same mass",), f"{link}/inertial/mass", times(10)),
        kind("link's pose off", ("same surface",), f"{link}/pose", plus(0.01)),
        kind("model turned over", ("same pose",), "model/pose", plus(0, 0, 0, 3.14159, 0, 0)),
        kind("mesh of another part", ("same surface",), f"{link}/visual/geometry/mesh/uri",
             "assets/base_visual.obj"),
        kind("mesh outside of the folder", ("readable",), f"{link}/visual/geometry/mesh/uri",
             "../../../../etc/passwd"),
        kind("axis reversed", JOINTS, f"{joint}/axis/xyz", times(-1)),
        kind("upper limit", ("same limits",), f"{joint}/axis/limit/upper", times(2)),
        kind("effort 0", ("same dynamics",), f"{joint}/axis/limit/effort", "0"),
        Kind("SDF: without collision", (SDF,), ("collision there",),
             drop(SDF, f"*{link}/collision")),
        Kind("SDF: meshes in another unit", (SDF,), ("same surface", "same collision"),
             obj("sdf/assets/*.obj", lambda v: 1000 * v)),
        Kind("SDF: inertia axes swapped", (SDF,), ("same inertia",), _swap_sdf(link)),
        Kind("SDF: static", (SDF,), ("own settings",),
             insert(SDF, "model", "<static>true</static>")),
        Kind("SDF: falls from the world", (SDF,), ("same joint",),
             drop(SDF, ".//joint[@name='world_joint']")),
        Kind("SDF: mesh scaled", (SDF,), ("same surface",),
             insert(SDF, f"{link}/visual/geometry/mesh", "<scale>2 2 2</scale>")),
        Kind("SDF: cut in half", (SDF,), ("readable",), file(SDF, half)),
    ]


def _swap_sdf(link: str) -> Deed:
    def change(root: Any) -> None:
        tensor = root.find(f"{link}/inertial/inertia")
        one, two = tensor.find("ixx"), tensor.find("izz")
        one.text, two.text = swapped(1, 0)(f"{one.text} {two.text}").split()
    return edit_xml(SDF, change)


def _glb() -> list[Kind]:
    def kind(name: str, meant: tuple[str, ...], change: Any) -> Kind:
        return Kind(f"GLB: {name}", ("glb/twin.glb",), meant, glb(change))

    return [
        kind("scale x 1000", ("same pose",), lambda t: t["nodes"][0].update(scale=[1000] * 3)),
        kind("mass x 10", ("same mass",),
             lambda t: t["nodes"][2]["extras"].update(mass=10 * t["nodes"][2]["extras"]["mass"])),
        kind("part elsewhere", (*JOINTS, "same surface"),
             lambda t: t["nodes"][2].update(translation=[1, 2, 3])),
        kind("axis reversed", JOINTS, lambda t: t["nodes"][2]["extras"]["joint"].update(
            axis=[-x for x in t["nodes"][2]["extras"]["joint"]["axis"]])),
        Kind("GLB: cut in half", ("glb/twin.glb",), ("readable",), file("glb/twin.glb", half)),
    ]


def usd(change: Any) -> Deed:
    """Return a deed on the stage and the path of the root prim of an exported OpenUSD file."""
    def deed(folder: Path) -> None:
        if not (folder / "usd/twin.usd").exists():
            raise NotHereError("usd/twin.usd")
        from pxr import Usd

        stage = Usd.Stage.Open(str(folder / "usd/twin.usd"))
        change(stage, str(stage.GetDefaultPrim().GetPath()))
        stage.GetRootLayer().Save()
    return deed


def _usd() -> list[Kind]:
    def put_usd(path: str, key: str, value: Any) -> Deed:
        return usd(lambda s, root: s.GetPrimAtPath(f"{root}/{path}").GetAttribute(key).Set(value))

    return [
        Kind("USD: unit", ("usd/twin.usd",), ("same pose",),
             usd(lambda s, _: s.SetMetadata("metersPerUnit", 0.01))),
        Kind("USD: mass", ("usd/twin.usd",), ("same mass",),
             put_usd("part_1", "physics:mass", 99.0)),
        Kind("USD: limit", ("usd/twin.usd",), ("same limits",),
             put_usd("joints/part_1_joint", "physics:upperLimit", 7.0)),
    ]
