"""Normals of corners: sharp at edges, smooth on round surfaces, and no change of the shape."""

from __future__ import annotations

import manifold3d
import mujoco
import numpy as np
import pytest
from synth import toy_cabinet_twin

from part2gs_robotics.exporters.meshfile import CREASE, write_meshes, write_obj
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.model.se3 import rotation_from_rotvec
from part2gs_robotics.model.twin import PartMesh, corner_normals


def arrays(solid):
    raw = solid.to_mesh64()
    return np.array(raw.vert_properties[:, :3]), np.array(raw.tri_verts, np.int64)


def face_normals(vertices, faces):
    tri = vertices[faces]
    normals = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    return normals / np.linalg.norm(normals, axis=1)[:, None]


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_a_box_is_flat_up_to_its_edges(scale):
    vertices, faces = arrays(manifold3d.Manifold.cube((1.0, 2.0, 0.1)))
    vertices = scale * vertices @ rotation_from_rotvec(np.array([0.4, -0.2, 1.0])).T
    wanted = np.repeat(face_normals(vertices, faces)[:, None], 3, 1)
    np.testing.assert_allclose(corner_normals(vertices, faces, CREASE), wanted, atol=1e-12)


def test_a_ball_is_round():
    vertices, faces = arrays(manifold3d.Manifold.sphere(2.0, 64))
    normals = corner_normals(vertices, faces, CREASE)
    cos = (normals * vertices[faces] / 2.0).sum(2)
    assert np.rad2deg(np.arccos(cos.clip(-1, 1))).max() < 1.5
    flat = (face_normals(vertices, faces)[:, None] * vertices[faces] / 2.0).sum(2)
    assert cos.mean() > flat.mean()


def test_a_face_without_area_has_a_normal_too():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]])
    normals = corner_normals(vertices, np.array([[0, 1, 2], [0, 1, 3]]), CREASE)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1.0)


def test_normals_reach_mujoco_and_change_nothing_else(tmp_path):
    twin = toy_cabinet_twin()
    write_mjcf(twin, tmp_path)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "twin.xml"))
    part = twin.parts[0]
    write_obj(part.mesh, tmp_path / "assets/base_visual.obj")  # the same without normals
    plain = mujoco.MjModel.from_xml_path(str(tmp_path / "twin.xml"))
    np.testing.assert_array_equal(model.mesh_vert, plain.mesh_vert)
    np.testing.assert_array_equal(model.mesh_face, plain.mesh_face)
    np.testing.assert_array_equal(model.body_inertia, plain.body_inertia)
    mesh = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_MESH, "base_visual")
    start, count = model.mesh_normaladr[mesh], model.mesh_normalnum[mesh]
    faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    seen = model.mesh_normal[start:start + count][model.mesh_facenormal[faces]]
    at = model.mesh_vert[model.mesh_vertadr[mesh]:][model.mesh_face[faces]]
    own = face_normals(at.astype(float).reshape(-1, 3), np.arange(3 * len(at)).reshape(-1, 3))
    assert (seen * own[:, None]).sum(2).min() > np.cos(np.deg2rad(31.0))


def test_pieces_need_no_normals(tmp_path):
    for path in write_meshes(toy_cabinet_twin(), tmp_path):
        if path.suffix == ".obj":
            assert ("\nvn " in path.read_text()) == path.stem.endswith("_visual")


def test_a_corner_names_what_there_is(tmp_path):
    vertices, faces = arrays(manifold3d.Manifold.cube((1.0, 1.0, 1.0)))
    mesh = PartMesh(vertices, faces, np.zeros((len(vertices), 3), np.uint8))
    text = write_obj(mesh, tmp_path / "a.obj", shaded=True).read_text()
    assert text.count("\nvn ") == 6
    assert all(word.count("/") == 2 and "//" in word for line in text.splitlines()
               if line.startswith("f ") for word in line.split()[1:])
