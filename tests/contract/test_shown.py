"""What is seen of a twin: exports, normals, materials, light; planted defects are named."""

from __future__ import annotations

import json
import shutil
import struct
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from synth import toy_cabinet_twin, write_all

from part2gs_robotics.agree.folder import further
from part2gs_robotics.agree.truth import changed, pieces
from part2gs_robotics.contract.clear import clear_world
from part2gs_robotics.contract.exported import exported_looks
from part2gs_robotics.contract.looks import looks
from part2gs_robotics.contract.shown import shown
from part2gs_robotics.contract.urdf import urdf_rules
from part2gs_robotics.exporters.read_twin import read_twin
from part2gs_robotics.exporters.twin_yaml import digests
from part2gs_robotics.model.twin import Part, PartMesh, Texture, Twin

mujoco = pytest.importorskip("mujoco")
OBJ, PICTURE = "assets/part_1_visual.obj", "assets/part_1_texture.png"


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a twin with a textured drawer, exported to all formats."""
    made, rng = toy_cabinet_twin(2), np.random.default_rng(0)
    mesh = made.parts[1].mesh
    texture = Texture(rng.random((len(mesh.faces), 3, 2)).astype(np.float32),
                      rng.integers(0, 256, (8, 8, 3), dtype=np.uint8))
    drawer = Part("part_1", 0, PartMesh(mesh.vertices, mesh.faces, mesh.colors, 0.0, texture),
                  made.parts[1].pieces, made.parts[1].joint, made.parts[1].limits)
    twin = Twin(made.name, (made.parts[0], drawer, *made.parts[2:]), made.meters_per_unit, made.up)
    return write_all(twin, tmp_path_factory.mktemp("shown") / "twin")


@pytest.fixture
def folder(clean: Path, tmp_path: Path) -> Path:
    """Return a copy to break."""
    return Path(shutil.copytree(clean, tmp_path / "twin"))


def said(folder: Path) -> list[str]:
    """Return what fails, with the file at fault."""
    twin = read_twin(folder)
    models = {n: mujoco.MjModel.from_xml_path(str(folder / n)) for n in ("twin.xml", "scene.xml")}
    rows = [*shown(folder, twin, models), *exported_looks(folder, twin, further(folder)),
            *clear_world(models["scene.xml"]), *urdf_rules(folder / "twin.urdf")]
    return [f"{r.subject}: {r.detail}" for r in rows if r.status == "fail"]


def lines(folder: Path, name: str, change: Callable[[str], str]) -> None:
    """Change the lines of a text file."""
    path = folder / name
    path.write_text("\n".join(map(change, path.read_text().splitlines())) + "\n")


def test_what_the_program_writes_is_shown_as_it_is(clean: Path) -> None:
    assert not said(clean)
    assert not pieces(read_twin(clean))


@pytest.mark.parametrize(("old", "new", "word"), [
    ("mtllib", "# mtllib", "names the materials"), ("usemtl part_1", "usemtl base", "names the"),
    ("vn ", "vn -", "lit from the wrong side"), ("vn ", "vn 1 0 ", "lit from the wrong side")])
def test_a_mesh_that_other_engines_show_otherwise(folder: Path, old: str, new: str, word: str
                                                  ) -> None:
    def turned(line: str) -> str:
        if old == "vn " and new == "vn -" and line.startswith(old):
            return "vn " + " ".join(f"{-float(w):g}" for w in line.split()[1:])
        return line.replace(old, new, 1) if line.startswith(old) else line

    lines(folder, OBJ, turned)
    (text,) = said(folder)
    assert text.startswith(OBJ)
    assert word in text


def test_paint_over_a_material_and_a_mesh_twice(folder: Path) -> None:
    text = (folder / "twin.xml").read_text()
    start = text.index("<geom", text.index('<body name="part_1"'))
    geom = text[start:text.index("/>", start) + 2]
    assert "part_1_visual" in geom
    (folder / "twin.xml").write_text(text.replace(geom, geom.replace("/>", ' rgba="0 1 0 1"/>')))
    (found,) = said(folder)
    assert found.startswith("twin.xml: part_1")
    assert "hides its material" in found
    again = geom.replace('name="', 'name="again_', 1)
    (folder / "twin.xml").write_text(text.replace(geom, geom + again))
    (found,) = said(folder)
    assert "twice" in found


def test_a_visual_twice_in_a_urdf(folder: Path) -> None:
    text = (folder / "twin.urdf").read_text()
    visual = text[text.index("<visual"):text.index("</visual>") + 9]
    (folder / "twin.urdf").write_text(text.replace(visual, visual + visual))
    (found,) = said(folder)
    assert "2 <visual>" in found


@pytest.mark.parametrize(("old", "new", "word"), [
    ("<visual>", '<visual><map znear="3"/>', "cut off"),
    ("<headlight", '<headlight active="0"', ""), ("<light", '<light active="false"', "")])
def test_a_world_that_shows_nothing(folder: Path, old: str, new: str, word: str) -> None:
    path = folder / "scene.xml"
    path.write_text(path.read_text().replace(old, new, 1))
    assert [word in text for text in said(folder)] == [True] * bool(word)  # one light is enough


def test_a_ground_in_the_base_alone_is_named_though_the_engine_sees_no_contact(tmp_path: Path
                                                                             ) -> None:
    folder = write_all(toy_cabinet_twin(0), tmp_path / "twin")
    path = folder / "scene.xml"
    root = ET.parse(path)
    ground = next(g for g in root.iter("geom") if g.get("name") == "ground")
    ground.set("pos", "0 0 0.01")
    model = mujoco.MjModel.from_xml_path(str(path))
    assert [r.status for r in clear_world(model)] == ["pass"]
    root.write(path)
    (row,) = clear_world(mujoco.MjModel.from_xml_path(str(path)))
    assert "ground cuts base" in row.detail


def test_a_world_without_any_light(folder: Path) -> None:
    path = folder / "scene.xml"
    path.write_text(path.read_text().replace("<headlight", '<headlight active="0"').replace(
        "<light", '<light active="false"'))
    (found,) = said(folder)
    assert "black" in found


def glb(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Change the tree of an exported glTF."""
    path = folder / "glb/twin.glb"
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    tree = json.loads(data[20:20 + length])
    change(tree)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length:]
    path.write_bytes(struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text),
                                 b"JSON") + text + rest)


@pytest.mark.parametrize(("change", "word"), [
    (lambda t: t["materials"][0]["pbrMetallicRoughness"].update(baseColorFactor=[1, 0, 0, 1]),
     "baseColorFactor"),
    (lambda t: t["materials"][1].update(alphaMode="BLEND"), "alphaMode"),
    (lambda t: t["materials"][1]["pbrMetallicRoughness"].pop("baseColorTexture"), "has a picture"),
    (lambda t: t["meshes"][0]["primitives"][0]["attributes"].update(
        COLOR_0=t["meshes"][0]["primitives"][0]["attributes"]["POSITION"]), "corners of base")])
def test_a_gltf_that_shows_something_else(folder: Path, change: Callable[[Any], Any], word: str
                                          ) -> None:
    glb(folder, change)
    (found,) = said(folder)
    assert found.startswith("glb/twin.glb")
    assert word in found


def test_pictures_of_exports_are_those_of_the_twin(folder: Path) -> None:
    path = folder / PICTURE
    cv2.imwrite(str(path), 255 - cv2.imread(str(path)))
    found = said(folder)
    assert sorted(text.split(":")[0] for text in found) == ["glb/twin.glb", "sdf/model.sdf",
                                                            "usd/twin.usd"]
    assert all("picture" in text for text in found)


@pytest.mark.parametrize(("path", "key", "value", "word"), [
    ("base/material/surface", "inputs:diffuseColor", (1.0, 0.0, 0.0), "has colour"),
    ("part_1/material/surface", "inputs:opacity", 0.1, "opacity"),
    ("part_1/visual", "primvars:st", None, "other places")])
def test_a_stage_that_shows_something_else(folder: Path, path: str, key: str, value: Any, word: str
                                           ) -> None:
    pxr = pytest.importorskip("pxr.Usd")
    from pxr import Sdf

    stage = pxr.Stage.Open(str(folder / "usd/twin.usd"))
    prim = stage.GetDefaultPrim().GetPrimAtPath(path)
    attribute = prim.GetAttribute(key) or prim.CreateAttribute(key, Sdf.ValueTypeNames.Float)
    attribute.Set(type(attribute.Get())(len(attribute.Get())) if value is None else value)
    stage.Save()
    (found,) = said(folder)
    assert found.startswith("usd/twin.usd")
    assert word in found


def test_an_export_of_a_twin_that_was_repaired_shows_the_repaired_one(tmp_path: Path) -> None:
    base, drawer, *_ = toy_cabinet_twin(2).parts
    mesh, more = base.mesh, base.mesh.vertices + 0.01  # two bodies through each other: united
    through = PartMesh(np.concatenate([mesh.vertices, more]),
                       np.concatenate([mesh.faces, mesh.faces + len(more)]),
                       np.concatenate([mesh.colors, mesh.colors]))
    twin = Twin("two", (replace(base, mesh=through), drawer), 1.0, (0.0, 0.0, 1.0))
    folder = write_all(twin, tmp_path / "twin")
    assert not exported_looks(folder, read_twin(folder), further(folder))


def test_exports_that_cannot_be_read_are_left_to_other_rows(folder: Path) -> None:
    for name in ("glb/twin.glb", "usd/twin.usd"):
        (folder / name).write_bytes((folder / name).read_bytes()[:100])
    twin = read_twin(folder)
    assert not exported_looks(folder, twin, further(folder))


@pytest.mark.parametrize(("change", "word"), [
    (lambda v: v * (-1, 1) + (1, 0), "mirrored"), (lambda v: 1 - v, "turned by half"),
    (lambda v: v[..., ::-1], "u and v swapped"), (None, "red and blue swapped"),
    (lambda v: v, "")])
def test_the_wrong_side_of_a_picture_is_seen_at_the_corners(
        tmp_path: Path, change: Callable[[Any], Any] | None, word: str) -> None:
    rng = np.random.default_rng(3)
    image = rng.integers(0, 256, (32, 32, 3), dtype=np.uint8)
    uv = rng.random((30, 3, 2)).astype(np.float32)
    colors = np.round(255 * Texture(uv, image).at(uv)).astype(np.uint8)
    corners = rng.random((90, 3)).astype(np.float32)
    worn = Texture(uv, np.ascontiguousarray(image[..., ::-1])) if change is None else Texture(
        np.ascontiguousarray(change(uv), np.float32), image)
    mesh = PartMesh(corners, np.arange(90, dtype=np.int32).reshape(30, 3), colors, 0.0, worn)
    part = Part("base", -1, mesh, (), None)
    rows = looks(tmp_path, Twin("t", (part,), None, (0.0, 0.0, 1.0)))
    texts = [r.detail for r in rows if r.subject == "assets/base_texture.png"]
    assert [word in text for text in texts] == [True] * bool(word)


@pytest.mark.parametrize(("large", "fits"), [(0, True), (255, False)])
def test_slivers_alone_do_not_turn_a_picture(tmp_path: Path, large: int, fits: bool) -> None:
    """A picture black above and white below; forty slivers in its upper half are white."""
    image = np.zeros((32, 32, 3), np.uint8)
    image[16:] = 255
    uv = np.random.default_rng(0).uniform(0.55, 1, (48, 3, 2)).astype(np.float32)
    size = np.repeat([1.0, 1e-3], [8, 40])
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) * np.stack([np.ones(48), size, size],
                                                                     1)[:, None]
    colors = np.repeat([large, 255], [24, 120])[:, None] * np.ones(3)
    mesh = PartMesh(corners.reshape(-1, 3).astype(np.float32),
                    np.arange(144, dtype=np.int32).reshape(48, 3), colors.astype(np.uint8), 0.0,
                    Texture(uv, image))
    rows = looks(tmp_path, Twin("t", (Part("base", -1, mesh, (), None),), None, (0.0, 0.0, 1.0)))
    texts = [r.detail for r in rows if r.subject == "assets/base_texture.png"]
    assert ["upside down" in text for text in texts] == [True] * (not fits)


@pytest.mark.parametrize("deed", ["inside out", "the same solid"])
def test_a_piece_inside_out_or_twice_is_named_without_digests(folder: Path, deed: str) -> None:
    one, two, *_ = sorted(folder.glob("assets/base_piece_*.obj"))
    if deed == "inside out":
        lines(folder, f"assets/{two.name}", lambda line: " ".join(
            ["f", *line.split()[:0:-1]]) if line.startswith("f ") else line)
    else:
        two.write_bytes(one.read_bytes())
    (row,) = pieces(read_twin(folder))
    assert row.subject == f"assets/{two.name}"
    assert deed in row.detail


def test_a_changed_file_is_named_with_the_digest_that_accepts_it(folder: Path) -> None:
    def document() -> dict[str, object]:
        return dict(yaml.safe_load((folder / "twin.yaml").read_text()))

    assert document()["files"] == digests(read_twin(folder), folder)
    assert not changed(folder, document())
    piece = next(folder.glob("assets/part_1_piece_*.obj"))
    piece.write_bytes(piece.read_bytes().replace(b"\n", b"\r\n"))  # what git does on Windows
    assert not changed(folder, document())
    piece.write_bytes(piece.read_bytes() + b"# more\n")
    (row,) = changed(folder, document())
    assert row.subject == f"assets/{piece.name}"
    tree = document()
    files = dict(tree["files"])  # type: ignore[call-overload]
    files[f"assets/{piece.name}"] = next(w for w in row.cause.split() if len(w) == 64)
    assert not changed(folder, tree | {"files": files})


def test_digests_name_nothing_outside_of_the_twin(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("x")
    for told in ({"../secret": "0"}, {"assets/../secret": "0"}, {"/etc/passwd": "0"}, ["x"], None):
        assert not changed(tmp_path / "twin", {"files": told})
