"""Faces: flat walls are found with their errors, and draw the axes that lie along or across."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics import se3
from part2gs_robotics.faces import BENT, Direction, Faces, direction_of, drawn, flat_faces, squared
from part2gs_robotics.joints import Joint
from part2gs_robotics.surfels import Surfels

TURN = se3.rotation_from_rotvec(np.array([0.3, -0.5, 0.9]))


def walls(rng, noise=0.002, turn=TURN):
    """Return surfels of three walls of a unit box, turned."""
    points, normals = [], []
    for k in range(3):
        flat = rng.random((2000, 3))
        flat[:, k] = 1.0 + noise * rng.normal(size=2000)
        points.append(flat)
        normals.append(np.tile(np.eye(3)[k], (2000, 1)) + 0.05 * rng.normal(size=(2000, 3)))
    all_normals = np.concatenate(normals)
    all_normals /= np.linalg.norm(all_normals, axis=1, keepdims=True)
    count = len(all_normals)
    return Surfels(np.concatenate(points) @ turn.T, all_normals @ turn.T,
                   np.full((count, 3), 0.5), np.full(count, 5))


def angle(a, b):
    return float(np.arccos(min(1.0, abs(a @ b))))


def tilted(axis, degrees, rng):
    side = np.cross(axis, rng.normal(size=3))
    return se3.rotation_from_rotvec(np.deg2rad(degrees) * side / np.linalg.norm(side)) @ axis


@pytest.fixture(scope="module")
def faces():
    rng = np.random.default_rng(0)
    return flat_faces((walls(rng), walls(rng)), np.sqrt(3.0), rng)


def test_walls_are_found_within_their_errors(faces):
    assert len(faces.normals) == 6  # three walls in either state
    for normal, error in zip(faces.normals, faces.errors, strict=True):
        gaps = [angle(normal, TURN[:, k]) for k in range(3)]
        assert min(gaps) < 3 * np.sqrt(np.trace(error))
        assert normal @ error @ normal == pytest.approx(0.0, abs=1e-12)


def test_caps_of_a_ball_claim_to_know_little():
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(4000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    ball = Surfels(normals, normals, np.full((4000, 3), 0.5), np.full(4000, 5))
    known = direction_of(np.array([0.0, 0, 1]), flat_faces((ball, ball), 2 * np.sqrt(3.0), rng))
    assert known is None or np.sqrt(np.linalg.eigvalsh(known.covariance)).min() > np.deg2rad(1.0)


@pytest.mark.parametrize("k", range(3))
def test_an_axis_near_an_edge_is_drawn_to_it(faces, k):
    rng = np.random.default_rng(k)
    edge = TURN[:, k]
    axis = tilted(edge, 0.5, rng)
    known = direction_of(axis, faces)
    sides = np.linalg.svd(axis[None])[2][1:]
    end = axis + known.tilts @ sides
    assert angle(end / np.linalg.norm(end), edge) < np.deg2rad(0.1)
    assert np.sqrt(np.linalg.eigvalsh(known.covariance)).max() < BENT


def test_an_axis_off_every_face_stays(faces):
    axis = TURN @ np.array([0.6, 0.48, 0.64])
    assert direction_of(axis, faces) is None
    assert drawn(0.01, None) is None


def test_one_crooked_face_does_not_draw(faces):
    crooked = se3.rotation_from_rotvec(np.deg2rad(2.0) * TURN[:, 0]) @ TURN[:, 2]
    more = Faces(np.vstack([faces.normals, crooked]),
                 np.concatenate([faces.errors, faces.errors[:1]]))
    axis = tilted(TURN[:, 2], 0.3, np.random.default_rng(1))
    a, b = direction_of(axis, faces), direction_of(axis, more)
    assert np.linalg.norm(a.tilts - b.tilts) < np.deg2rad(0.05)


def test_axis_and_faces_are_weighed_by_their_errors():
    one = 1e-3
    there = Direction(np.array([1e-3, 0.0]), np.eye(2) * 0.5 * one**2)
    both = drawn(one, there)
    np.testing.assert_allclose(both.tilts, [5e-4, 0.0])
    np.testing.assert_allclose(both.covariance, np.eye(2) * 0.25 * one**2)
    assert drawn(1e-4, Direction(np.array([0.02, 0.0]), there.covariance)) is None  # far off
    assert drawn(np.inf, there) is there  # nothing else is known
    np.testing.assert_allclose(drawn(1e-6, there).tilts, 0.0, atol=1e-8)


def test_what_the_images_hold_together_moves_together(faces):
    """An origin that the images tie to the axis follows it; the value, not tied, stays."""
    edge = TURN[:, 2]
    axis = tilted(edge, 0.4, np.random.default_rng(3))
    joint = Joint("revolute", axis, np.zeros(3), 0.7, sigma_axis=np.deg2rad(0.5))
    h = np.eye(5) * 1e4
    h[0, 3] = h[3, 0] = -5e3
    out = squared(joint, h, faces, 1.0)
    assert angle(out.axis, edge) < angle(axis, edge) / 3
    assert out.value == pytest.approx(0.7)
    sides = np.linalg.svd(axis[None])[2][1:]
    tilt = sides @ (out.axis - axis)
    np.testing.assert_allclose(sides @ out.origin, [0.5 * tilt[0], 0.0], rtol=2e-2, atol=1e-7)
    assert out.sigma_axis < joint.sigma_axis
