"""Fitted pieces: slices of a hull that are mostly empty go, all else stays."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest

from part2gs_robotics.collision.fitted import fitted, volumes_above
from part2gs_robotics.model.se3 import rotation_from_rotvec


def triangles(solid: manifold3d.Manifold) -> np.ndarray:
    """Return [F, 3, 3] corners of the faces of a solid."""
    raw = solid.to_mesh64()
    return np.array(raw.vert_properties[:, :3])[np.array(raw.tri_verts, np.int64)]


def turned(solid: manifold3d.Manifold) -> manifold3d.Manifold:
    """Return a solid in a general pose."""
    pose = np.eye(3, 4)
    pose[:, :3], pose[:, 3] = rotation_from_rotvec(np.array([0.4, -0.9, 0.3])), (2.0, -1.0, 0.5)
    return solid.transform(pose)


@pytest.mark.parametrize("seed", range(4))
def test_volumes_above_a_level_are_those_of_what_is_cut_off(seed: int) -> None:
    rng = np.random.default_rng(seed)
    solid = manifold3d.Manifold.sphere(1.0, 12) - turned(manifold3d.Manifold.cube((1, 2, 3), True))
    solid = solid.translate(rng.normal(size=3).tolist())
    normals = rng.normal(size=(3, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    corners = triangles(solid).reshape(-1, 3) @ normals.T
    levels = rng.uniform(corners.min(0)[:, None] - 0.2, corners.max(0)[:, None] + 0.2, (3, 6))
    levels[:, 0] = corners[0]  # exactly at a corner
    exact = [[solid.trim_by_plane(n.tolist(), float(level)).volume() for level in row]
             for n, row in zip(normals, levels, strict=True)]
    np.testing.assert_allclose(volumes_above(triangles(solid), normals, levels), exact, atol=1e-9)


def test_a_convex_part_keeps_its_hull() -> None:
    solid = turned(manifold3d.Manifold.sphere(1.0, 16))
    assert fitted(solid, solid).volume() == pytest.approx(solid.volume(), rel=1e-12)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_a_bump_on_a_board_does_not_lift_its_face(scale: float) -> None:
    board = manifold3d.Manifold.cube((1.0, 1.0, 0.05), True)
    bump = manifold3d.Manifold.cube((0.05, 0.05, 0.02), True).translate((0.2, 0.1, 0.03))
    part = turned(board + bump).scale((scale,) * 3)
    hull = part.hull()
    found = fitted(hull, part)
    assert (hull - part).volume() > 0.05 * part.volume()
    assert (found - part).volume() < 1e-3 * part.volume()
    assert (part - found).volume() < 2e-3 * part.volume()  # the bump has 0.06 % of the volume


def test_what_is_more_real_than_empty_stays() -> None:
    comb = manifold3d.Manifold.cube((1.0, 1.0, 1.0), True)
    for place in np.linspace(-0.4, 0.4, 5):  # slots of a fifth of the width, to half of the height
        slot = manifold3d.Manifold.cube((0.04, 1.1, 0.5), True)
        comb = comb - slot.translate((float(place), 0.0, 0.3))
    found = fitted(comb.hull(), comb)
    assert found.volume() == pytest.approx(comb.hull().volume(), rel=1e-9)
