"""Textures of the twin folder: what MuJoCo draws of them, and that the surface stays closed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest
from synth import toy_cabinet_twin

from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.urdf import write_urdf
from part2gs_robotics.mesh.clearance import separate_pieces
from part2gs_robotics.model.scene_frame import SceneFrame, parts_in_scene
from part2gs_robotics.model.twin import Texture, Twin
from part2gs_robotics.sim_checks import check
from part2gs_robotics.texture.atlas import make_atlas
from part2gs_robotics.texture.fill import fill

SIDE, FOV = 300, 40.0


def pattern(points: np.ndarray) -> np.ndarray:
    """Return [n, 3] colours of points: another one towards every side, none a mirror image."""
    return np.clip(np.stack([60 + 250 * points[:, 0], 40 + 200 * points[:, 2],
                             200 - 150 * points[:, 1]], 1), 0, 255)


def painted(twin: Twin) -> Twin:
    """Return the twin with textures that show the pattern at every point's place at state 0."""
    parts = []
    for part in twin.parts:
        atlas = make_atlas(part.mesh, 0.002, 1024)
        colors, seen = pattern(atlas.points).astype(np.float32), np.ones(len(atlas.points), bool)
        image = fill(atlas, colors, seen, np.zeros(3, np.float32))
        parts.append(replace(part, mesh=replace(part.mesh, texture=Texture(atlas.uv, image))))
    return replace(twin, parts=tuple(parts))


def drawn(path: Path, eye: np.ndarray, state: str) -> tuple[np.ndarray, np.ndarray, mujoco.MjData]:
    """Return the unlit picture and depth of a model from a camera that looks along -z of `eye`."""
    spec = mujoco.MjSpec.from_file(str(path))
    camera = spec.worldbody.add_camera(name="eye", fovy=FOV, pos=eye[:3, 3])
    camera.quat = np.zeros(4)
    mujoco.mju_mat2Quat(camera.quat, np.ascontiguousarray(eye[:3, :3]).ravel())
    light = spec.visual.headlight
    light.ambient, light.diffuse, light.specular = [1, 1, 1], [0, 0, 0], [0, 0, 0]
    spec.visual.quality.offsamples = 0
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(state).id)
    mujoco.mj_forward(model, data)
    shown = mujoco.MjvOption()
    shown.geomgroup[:] = [0, 0, 1, 0, 0, 0]
    with mujoco.Renderer(model, SIDE, SIDE) as renderer:
        renderer.update_scene(data, camera="eye", scene_option=shown)
        image = renderer.render().copy()
        renderer.enable_depth_rendering()
        renderer.update_scene(data, camera="eye", scene_option=shown)
        return image, renderer.render().copy(), data


def looking(at: np.ndarray, way: np.ndarray, distance: float) -> np.ndarray:
    """Return [4, 4] world from an OpenGL camera."""
    z = -way / np.linalg.norm(way)
    x = np.cross([0.0, 0, 1], z)
    x /= np.linalg.norm(x)
    out = np.eye(4)
    out[:3, :3] = np.stack([x, np.cross(z, x), z], 1)
    out[:3, 3] = at + distance * z
    return out


@pytest.mark.parametrize("way", [(0.3, 1.0, -0.4), (-1.0, 0.4, -0.3), (0.2, -1.0, -0.6)])
def test_mujoco_draws_the_pattern_where_it_was_painted(tmp_path: Path, way: tuple) -> None:
    twin = painted(toy_cabinet_twin(2))
    write_mjcf(twin, tmp_path)
    eye = looking(np.array([0.25, 0.3, 0.4]), np.array(way), 2.2)
    image, depth, _ = drawn(tmp_path / "twin.xml", eye, "state_0")
    rows, columns = np.mgrid[:SIDE, :SIDE] + 0.5
    focal = SIDE / 2 / np.tan(np.deg2rad(FOV / 2))
    local = np.stack([(columns - SIDE / 2) / focal, -(rows - SIDE / 2) / focal,
                      -np.ones_like(rows)], -1) * depth[..., None]
    points = local @ eye[:3, :3].T + eye[:3, 3]
    hit = cv2.erode((depth < 5).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    assert hit.sum() > 5000
    off = np.abs(image[hit].astype(float) - pattern(points[hit])).max(1)
    assert np.median(off) <= 3
    assert np.percentile(off, 95) <= 8


def test_checks_pass_as_without_textures(tmp_path: Path) -> None:
    plain, pretty = tmp_path / "plain", tmp_path / "pretty"
    rows = []
    for folder, twin in ((plain, toy_cabinet_twin(2)), (pretty, painted(toy_cabinet_twin(2)))):
        folder.mkdir()
        write_mjcf(twin, folder)
        rows.append([(r.name, r.subject, r.status, r.detail)
                     for r in check(folder / "twin.xml", steps=3).results])
    assert rows[0] == rows[1]
    assert ("mesh", "base", "pass") in [row[:3] for row in rows[1]]


def test_the_compiled_mesh_is_the_same(tmp_path: Path) -> None:
    models = []
    for name, twin in (("plain", toy_cabinet_twin(2)), ("pretty", painted(toy_cabinet_twin(2)))):
        folder = tmp_path / name
        folder.mkdir()
        write_mjcf(twin, folder)
        models.append(mujoco.MjModel.from_xml_path(str(folder / "twin.xml")))
    plain, pretty = models
    assert np.array_equal(plain.mesh_vert, pretty.mesh_vert)
    assert np.array_equal(plain.mesh_face, pretty.mesh_face)
    assert np.array_equal(plain.body_inertia, pretty.body_inertia)
    assert pretty.ntex == 3


def test_files_name_each_other(tmp_path: Path) -> None:
    files = write_urdf(painted(toy_cabinet_twin(1)), tmp_path)
    assert all(file.is_file() for file in files)
    obj = (tmp_path / "assets/base_visual.obj").read_text()
    assert "mtllib base_visual.mtl" in obj
    material = (tmp_path / "assets/base_visual.mtl").read_text()
    assert "usemtl base_visual" in obj
    assert "newmtl base_visual" in material
    assert "map_Kd base_texture.png" in material
    assert cv2.imread(str(tmp_path / "assets/base_texture.png")) is not None


def test_a_picture_is_stored_as_it_is(tmp_path: Path) -> None:
    twin = painted(toy_cabinet_twin(0))
    write_mjcf(twin, tmp_path)
    read = cv2.imread(str(tmp_path / "assets/base_texture.png"))[..., ::-1]
    assert np.array_equal(read, twin.parts[0].mesh.texture.image)


def test_other_rooms_hand_textures_on() -> None:
    twin = painted(toy_cabinet_twin(2))
    apart = separate_pieces(twin)
    placed = parts_in_scene(apart.parts, SceneFrame(2.0, (1.0, 0.0, 0.0)), False)
    for before, after in zip(twin.parts, placed, strict=True):
        assert after.mesh.texture is before.mesh.texture


def test_without_textures_no_picture_is_written(tmp_path: Path) -> None:
    write_mjcf(toy_cabinet_twin(1), tmp_path)
    assert not [*tmp_path.rglob("*.png"), *tmp_path.rglob("*.mtl")]
    assert "texture" not in (tmp_path / "twin.xml").read_text()
