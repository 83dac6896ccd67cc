"""Pictures of meshes: the colour that lies where a pixel looks, whatever is behind it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.model.scene import Camera
from part2gs_robotics.model.se3 import make
from part2gs_robotics.model.twin import PartMesh, Texture
from part2gs_robotics.render.mesh_pictures import draw_meshes

CAMERA = Camera(np.eye(4), np.array([[50.0, 0, 20], [0, 50, 15], [0, 0, 1]]), 40, 30)


def sheet(depth: float, half: float = 0.2) -> PartMesh:
    """Return a square across the camera's axis."""
    corners = half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]) + [0, 0, depth]
    return PartMesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), np.full((4, 3), 90, np.uint8))


def textured(mesh: PartMesh, image: np.ndarray) -> PartMesh:
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0.0]], np.float32)[mesh.faces]  # y is down
    return replace(mesh, texture=Texture(uv, image))


def test_a_square_covers_its_pixels_and_white_the_rest():
    seen = draw_meshes([sheet(1.0)], [np.eye(4)], CAMERA)
    inside = np.zeros((30, 40), bool)
    inside[5:25, 10:30] = True
    assert (seen[inside] == 90).all()
    assert (seen[~inside] == 255).all()


def test_the_nearer_one_hides_the_other_and_a_moved_one_does_not():
    far = replace(sheet(2.0, 0.4), colors=np.full((4, 3), 10, np.uint8))
    aside = make(np.eye(3), np.array([0.0, 5.0, 0.0]))
    assert (draw_meshes([far, sheet(1.0)], [np.eye(4)] * 2, CAMERA)[15, 20] == 90).all()
    assert (draw_meshes([far, sheet(1.0)], [np.eye(4), aside], CAMERA)[15, 20] == 10).all()


def test_a_texture_lies_upright_texel_for_pixel():
    image = np.random.default_rng(0).integers(0, 255, (20, 20, 3), dtype=np.uint8)
    smooth = np.repeat(np.repeat(image[::5, ::5], 5, 0), 5, 1)
    seen = draw_meshes([textured(sheet(1.0), smooth)], [np.eye(4)], CAMERA)[5:25, 10:30]
    np.testing.assert_allclose(seen[2::5, 2::5].astype(int), smooth[2::5, 2::5], atol=1)


def test_perspective_is_in_a_slanted_texture():
    mesh = sheet(0.0)
    ramp = np.tile(np.linspace(0, 255, 256).astype(np.uint8)[None, :, None], (4, 1, 3))
    turned = np.array([[np.cos(1.0), 0, np.sin(1.0)], [0, 1, 0], [-np.sin(1.0), 0, np.cos(1.0)]])
    seen = draw_meshes([textured(mesh, ramp)], [make(turned, np.array([0, 0, 1.0]))], CAMERA)
    for column in range(17, 24):
        ray = (column + 0.5 - 20) / 50
        along = ray / (np.cos(1.0) + ray * np.sin(1.0))  # where the ray meets the sheet
        assert seen[15, column, 0] == pytest.approx(255 * (along / 0.4 + 0.5), abs=2)


def test_what_is_behind_the_camera_is_not_drawn():
    assert (draw_meshes([sheet(-1.0)], [np.eye(4)], CAMERA) == 255).all()
