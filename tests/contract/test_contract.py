"""Words, URDF rules, looks and the world of a twin folder: ours pass, planted defects are named."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synth import toy_cabinet_twin, write_all

from part2gs_robotics.contract import contract
from part2gs_robotics.contract.looks import looks
from part2gs_robotics.contract.sites import sites
from part2gs_robotics.contract.urdf import urdf_rules
from part2gs_robotics.contract.words import MJCF, URDF, own_words, words_of
from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.read_twin import read_twin
from part2gs_robotics.exporters.twin_yaml import read_twin_yaml
from part2gs_robotics.model.twin import PartMesh, Texture


@pytest.fixture(scope="module")
def twin(tmp_path_factory) -> Path:
    return write_all(toy_cabinet_twin(4), tmp_path_factory.mktemp("contract") / "twin")


def bad(rows) -> list:
    return [r for r in rows if r.status == "fail"]


@pytest.mark.parametrize("parts", [0, 1, 2, 4])
def test_what_the_program_writes_is_all_in_its_own_words(tmp_path: Path, parts: int) -> None:
    import mujoco

    folder = write_all(toy_cabinet_twin(parts), tmp_path / "twin")
    scene = mujoco.MjModel.from_xml_path(str(folder / "scene.xml"))
    rows = contract(folder, ("sdf/model.sdf",), {"scene.xml": scene})
    assert not bad(rows), bad(rows)
    assert {r.name for r in rows} == {"own words", "own settings", "same look", "clear world"}


@pytest.mark.parametrize(("text", "word"), [
    ("<mujoco><worldbody><geom priority='1'/></worldbody></mujoco>", "priority of <geom>"),
    ("<mujoco><asset><mesh name='m' maxhullvert='4'/></asset></mujoco>", "maxhullvert of <mesh>"),
    ("<mujoco><extension/></mujoco>", "<extension>")])
def test_a_word_of_another_program_is_named(text: str, word: str) -> None:
    (row,) = bad(own_words("twin.xml", ET.fromstring(text), MJCF))
    assert row.detail.startswith(word)


def test_sensors_and_cameras_only_tell() -> None:
    text = ("<mujoco><worldbody><camera name='c' fovy='40'/></worldbody><custom><numeric data='1'/>"
            "</custom></mujoco>")
    assert not bad(own_words("twin.xml", ET.fromstring(text), MJCF))
    assert bad(own_words("twin.urdf", ET.fromstring("<robot><gazebo/></robot>"), URDF))


def test_files_that_cannot_be_read_are_left_to_other_rows(tmp_path: Path) -> None:
    (tmp_path / "twin.xml").write_text("<mujoco")
    assert words_of(tmp_path) == []
    assert urdf_rules(tmp_path / "none.urdf") == []


@pytest.mark.parametrize(("old", "new", "check"), [
    ('offset="0"', 'offset="0.1"', "same joint"),
    ('<link name="world" />', '<link name="world"><collision /></link>', "own settings"),
    ('value="1e-06"', 'value="5"', "same mass"), ('upper="0.02"', 'upper="0.01"', "same limits"),
    ('xyz="1 0 0"', 'xyz="2 0 0"', "same joint"), ('strippath="false"', 'strippath="true"',
                                                  "own settings")])
def test_a_urdf_that_engines_read_otherwise_is_named(tmp_path, twin, old, new, check) -> None:
    text = (twin / "twin.urdf").read_text()
    assert old in text
    (tmp_path / "twin.urdf").write_text(text.replace(old, new, 1))
    (row,) = bad(urdf_rules(tmp_path / "twin.urdf"))
    assert row.name == check
    assert not bad(urdf_rules(twin / "twin.urdf"))


def textured(mesh: PartMesh, image: np.ndarray) -> PartMesh:
    uv = np.random.default_rng(1).uniform(0.1, 0.9, (len(mesh.faces), 3, 2)).astype(np.float32)
    high, wide = image.shape[:2]
    x, y = (uv[..., 0] * wide).astype(int), ((1 - uv[..., 1]) * high).astype(int)
    colors = np.array(mesh.colors)
    colors[mesh.faces.ravel()] = image[y.ravel(), x.ravel()]  # of the last face at a corner
    return replace(mesh, colors=colors, texture=Texture(uv, image))


def test_pictures_must_be_those_of_their_mesh(tmp_path: Path) -> None:
    import cv2

    made, rng = toy_cabinet_twin(2), np.random.default_rng(0)
    images = [np.full((64, 64, 3), c, np.uint8) + rng.integers(0, 9, (64, 64, 3), np.uint8)
              for c in ((200, 40, 40), (40, 40, 200), (60, 200, 60))]
    parts = tuple(replace(p, mesh=textured(p.mesh, i))
                  for p, i in zip(made.parts, images, strict=True))
    folder = write_all(replace(made, parts=parts), tmp_path / "twin")
    assert not bad(looks(folder, read_twin(folder)))
    files = [folder / f"assets/{n}_texture.png" for n in ("part_1", "base")]
    shown = [f.read_bytes() for f in files]
    files[0].write_bytes(shown[1])
    files[1].write_bytes(shown[0])
    assert {r.subject for r in bad(looks(folder, read_twin(folder)))} >= {
        f"assets/{f.name}" for f in files if f.name == "part_1_texture.png"}
    cv2.imwrite(str(files[0]), np.zeros((64, 64, 3), np.uint8))
    assert "mean colour" in bad(looks(folder, read_twin(folder)))[0].detail or bad(
        looks(folder, read_twin(folder)))


@pytest.mark.parametrize(("size", "named"), [(1e-6, 0), (1.0, 1)])
def test_triangles_of_another_colour_count_by_their_area(tmp_path, size, named) -> None:
    made = toy_cabinet_twin(1)
    noise = np.random.default_rng(0).integers(0, 9, (64, 64, 3), np.uint8)
    mesh = textured(made.parts[0].mesh, np.full((64, 64, 3), 60, np.uint8) + noise)
    count, end = 3 * len(mesh.faces), len(mesh.vertices)
    corners = size * np.tile([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], (count, 1)) + mesh.vertices[0]
    uv = np.random.default_rng(1).uniform(0.1, 0.9, (count, 3, 2)).astype(np.float32)
    mixed = replace(
        mesh, vertices=np.vstack([mesh.vertices, corners]),
        faces=np.vstack([mesh.faces, end + np.arange(3 * count).reshape(-1, 3)]),
        colors=np.vstack([mesh.colors, np.full((3 * count, 3), 255, np.uint8)]),
        texture=replace(mesh.texture, uv=np.concatenate([mesh.texture.uv, uv])))
    folder = write_all(made, tmp_path / "twin")
    twin = replace(made, parts=(replace(made.parts[0], mesh=mixed), *made.parts[1:]))
    off = [r for r in bad(looks(folder, twin)) if r.subject == "assets/base_texture.png"]
    assert len(off) == named


def test_a_picture_is_sampled_upright() -> None:
    image = np.zeros((2, 2, 3), np.uint8)
    image[0, 1] = 255  # above, right
    uv = np.array([[[0.75, 0.75], [0.25, 0.75], [0.75, 0.25]]], np.float32)
    texture = Texture(uv, image)
    assert texture.at(uv)[:, 0].tolist() == [1.0, 0.0, 0.0]
    bare = PartMesh(np.zeros((4, 3)), np.array([[0, 1, 2]]), np.full((4, 3), 7, np.uint8))
    mesh = bare.painted(texture)
    assert mesh.texture is texture
    assert mesh.colors[:, 0].tolist() == [255, 0, 0, 7], "of no corner: as it was"
    twice = PartMesh(bare.vertices, np.array([[0, 1, 0]]), bare.colors).painted(texture)
    assert twice.colors[0, 0] == 128, "the mean of two corners"


@pytest.mark.parametrize(("change", "file"), [
    (lambda m: m.set("rgba", "1 0 0 1"), "twin.xml"), (lambda m: m.set("rgba", "1 1 1 0"),
                                                       "twin_actuated.xml")])
def test_a_colour_that_is_not_the_mesh_is_named(tmp_path, change, file) -> None:
    folder = write_all(toy_cabinet_twin(1), tmp_path / "twin")
    tree = ET.parse(folder / file)
    change(tree.getroot().find("asset/material"))
    tree.write(folder / file)
    (row,) = bad(looks(folder, read_twin(folder)))
    assert row.subject.startswith(file)


def test_sites_are_those_of_the_meshes(tmp_path: Path, twin: Path) -> None:
    assert not bad(sites(twin, read_twin(twin)))
    text = (twin / "twin.xml").read_text()
    (tmp_path / "twin.xml").write_text(text.replace('name="top_site" pos="0', 'name="top_site" '
                                                    'pos="9'))
    (row,) = bad(sites(tmp_path, read_twin(twin)))
    assert "top_site" in row.subject


@pytest.mark.parametrize(("text", "said"), [
    ("[" * 20_000, "nested"), ("a: &a [*a]", "aliases"),
    ("a: &a [x, x]\n" + "".join(f"b{k}: &b{k} [{', '.join([f'*b{k - 1}'] * 10)}]\n" if k else
                                "b0: &b0 [*a, *a]\n" for k in range(9)), "aliases")])
def test_bombs_in_a_description_are_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "twin.yaml").write_text(text)
    with pytest.raises(CheckError, match=said):
        read_twin_yaml(tmp_path)
