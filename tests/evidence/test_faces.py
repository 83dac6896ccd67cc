"""Faces: flat walls are found with their errors."""

from __future__ import annotations

import numpy as np
import pytest
from toys import angle

from part2gs_robotics.evidence.faces import flat_faces
from part2gs_robotics.evidence.guides import direction_of
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model import se3

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


@pytest.fixture(scope="module")
def faces():
    rng = np.random.default_rng(0)
    return flat_faces((walls(rng), walls(rng)), np.sqrt(3.0), rng)


def test_walls_are_found_within_their_errors(faces):
    assert len(faces.directions) == 6  # three walls in either state
    for normal, error in zip(faces.directions, faces.errors, strict=True):
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
