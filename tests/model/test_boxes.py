"""Boxes: a box is found at any place, turn and size, and nothing else is taken for one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from manifold3d import Manifold

from part2gs_robotics.model.se3 import rotation_from_rotvec
from part2gs_robotics.model.solids import box_of, to_mesh


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("seed", range(8))
def test_a_box_is_found_with_its_sides(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    half = scale * rng.uniform(0.01, 1.0, 3)
    turn = rotation_from_rotvec(rng.normal(size=3)) if seed else np.eye(3)
    middle = scale * rng.normal(size=3)
    mesh = to_mesh(Manifold.cube((2 * half).tolist(), True))
    found = box_of(replace(mesh, vertices=mesh.vertices @ turn.T + middle))
    assert found is not None
    np.testing.assert_allclose(found.middle, middle, atol=1e-9 * scale)
    np.testing.assert_allclose(np.sort(found.half), np.sort(half), rtol=1e-9)
    np.testing.assert_allclose(np.linalg.det(found.rotation), 1.0)
    corners = found.middle + (found.rotation @ (found.half[:, None] * np.sign(
        (mesh.vertices @ turn.T) @ found.rotation).T)).T
    np.testing.assert_allclose(corners, mesh.vertices @ turn.T + middle, atol=1e-9 * scale)


def test_what_is_no_box_is_none() -> None:
    cube = Manifold.cube([1, 1, 1], True)
    wedge = cube.trim_by_plane([1, 0.1, 0], -0.3)
    slanted = to_mesh(cube)
    slanted = replace(slanted, vertices=slanted.vertices @ np.array([[1, 0.01, 0], [0, 1, 0],
                                                                     [0, 0, 1.0]]))
    ell = cube + cube.translate([1, 0, 0]).scale([1, 0.5, 1])
    for mesh in (to_mesh(wedge), slanted, to_mesh(Manifold.sphere(1.0, 8)), to_mesh(ell)):
        assert box_of(mesh) is None
