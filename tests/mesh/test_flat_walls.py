"""Flat walls: noisy boards become flat and sharp, curved surfaces stay, and nothing opens."""

from __future__ import annotations

from types import SimpleNamespace

import manifold3d
import numpy as np
import pytest

from part2gs_robotics.mesh.carve import Solid
from part2gs_robotics.mesh.flat_parts import flat_surfaces
from part2gs_robotics.mesh.flat_walls import flattened, with_flat_walls
from part2gs_robotics.mesh.surface import arrays, closed_surface, flaw
from part2gs_robotics.model.grid import Grid
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.se3 import rotation_from_rotvec

VOXEL = 0.02
HALF = np.array([0.5, 0.3, 0.2])
TURN = rotation_from_rotvec(np.array([0.3, -0.5, 0.2]))  # no wall along the grid


def surface_of(distance, noise, seed=0):
    """Return the closed surface of a distance in scene units, with smooth noise in cells."""
    grid = Grid.around(np.full(3, -0.75), np.full(3, 0.75), VOXEL)
    index = np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), -1)
    points = grid.centers(index.reshape(-1, 3))
    rng = np.random.default_rng(seed)
    waves = sum(np.sin(points @ rng.normal(0, 40, 3) + rng.uniform(0, 7)) for _ in range(6))
    values = distance(points) / VOXEL + noise * waves / np.sqrt(3)
    solid = Solid(grid, values.reshape(grid.shape).clip(-3, 3).astype(np.float32))
    return closed_surface(solid, "toy", 0.0)


def box(points):
    """Distance to a turned box, positive inside; true beside faces and edges."""
    gap = HALF - np.abs(points @ TURN)
    return np.where((gap > 0).all(1), gap.min(1), -np.linalg.norm(np.minimum(gap, 0), axis=1))


def ball(points):
    return 0.6 - np.linalg.norm(points, axis=1)


SIZE = 2 * float(np.linalg.norm(HALF))


def off_box(vertices):
    """Return how far points lie off the box's surface."""
    return np.abs(box(vertices))


@pytest.mark.parametrize("noise", [0.0, 0.15])
def test_a_noisy_box_becomes_flat_sharp_and_simple(noise):
    rough = surface_of(box, noise)
    flat = with_flat_walls(rough, VOXEL, SIZE)
    vertices, _ = arrays(flat)
    assert flaw(flat) is None
    before, after = (np.sqrt((off_box(arrays(s)[0]) ** 2).mean()) for s in (rough, flat))
    assert after < 0.1 * VOXEL
    assert noise == 0.0 or after < 0.35 * before
    assert flat.volume() == pytest.approx(8 * HALF.prod(), rel=0.01)
    assert flat.num_tri() < 0.2 * rough.num_tri()
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * HALF
    gaps = np.linalg.norm((vertices @ TURN)[:, None] - corners, axis=2).min(0)
    assert gaps.max() < 0.25 * VOXEL, "every corner is there, sharp"


def test_a_ball_keeps_its_round():
    vertices, faces = arrays(surface_of(ball, 0.0))
    moved = flattened(vertices, faces, 0.75 * VOXEL)
    assert np.linalg.norm(moved - vertices, axis=1).max() < 1e-12


def test_a_wall_that_must_not_move_stays_and_the_others_are_flat():
    vertices, faces = arrays(surface_of(box, 0.15))
    on_top = np.array([[0.0, 0.0, HALF[2]]]) @ TURN.T
    moved = flattened(vertices, faces, 0.75 * VOXEL, on_top)
    local = vertices @ TURN
    top = (np.abs(local[:, 2] - HALF[2]) < VOXEL) & (np.abs(local[:, :2]) < HALF[:2] - 0.1).all(1)
    under = (np.abs(local[:, 2] + HALF[2]) < VOXEL) & (np.abs(local[:, :2]) < HALF[:2] - 0.1).all(1)
    np.testing.assert_array_equal(moved[top], vertices[top])
    assert off_box(moved[under]).max() < 0.2 * off_box(vertices[under]).max()


def test_unit_and_place_do_not_matter():
    vertices, faces = arrays(surface_of(box, 0.2))
    here = flattened(vertices, faces, 0.75 * VOXEL)
    shift = np.array([3.0, -2.0, 5.0])
    there = flattened(1000 * (vertices + shift), faces, 750 * VOXEL)
    np.testing.assert_allclose(there / 1000 - shift, here, atol=1e-9)


def test_what_would_not_close_stays_as_it_was(monkeypatch):
    rough = surface_of(box, 0.2)
    monkeypatch.setattr("part2gs_robotics.mesh.flat_walls.flaw", lambda _: "open")
    assert with_flat_walls(rough, VOXEL, SIZE) is rough


def test_parts_that_would_meet_by_it_keep_their_noise(monkeypatch):
    """A drawer in a shaft: were its walls laid flat too far out, it keeps the noisy ones."""
    shaft = manifold3d.Manifold.cube((1.0, 0.6, 0.6), True) - manifold3d.Manifold.cube(
        (1.2, 0.4, 0.4), True)
    drawer = manifold3d.Manifold.cube((0.9, 0.39, 0.39), True)
    joint = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.3)
    place = SimpleNamespace(joints=[joint], parents=[0])
    grid = Grid.around(np.full(3, -0.75), np.full(3, 0.75), VOXEL)
    fat = drawer.scale((1.0, 1.06, 1.06))
    change = {drawer.num_tri(): fat}
    monkeypatch.setattr("part2gs_robotics.mesh.flat_parts.with_flat_walls",
                        lambda s, *_: change.get(s.num_tri(), s) if s is drawer else s)
    assert flat_surfaces([shaft, drawer], place, grid)[1] is drawer
    slim = drawer.scale((1.0, 1.01, 1.01))
    change[drawer.num_tri()] = slim
    assert flat_surfaces([shaft, drawer], place, grid)[1] is slim
