"""Guides: an axis along or across known directions is drawn to them, by the errors of both."""

from __future__ import annotations

import numpy as np
import pytest
from toys import angle

from part2gs_robotics.evidence.guides import Direction, Guides, direction_of, guides_of
from part2gs_robotics.joints.drawn_to_edges import BEND, drawn, squared
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint

TURN = se3.rotation_from_rotvec(np.array([0.3, -0.5, 0.9]))
WALL = np.deg2rad(0.12)  # rad: normals of fitted walls are known that well


def tilted(axis, degrees, rng):
    side = np.cross(axis, rng.normal(size=3))
    return se3.rotation_from_rotvec(np.deg2rad(degrees) * side / np.linalg.norm(side)) @ axis


@pytest.fixture(scope="module")
def walls():
    """The normals of a box, each a little off, and their errors."""
    rng = np.random.default_rng(0)
    found = []
    for k in range(3):
        normal = TURN[:, k] + 0.2 * WALL * rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        found.append((normal, WALL**2 * (np.eye(3) - np.outer(normal, normal))))
    return guides_of([*found, *found])


@pytest.mark.parametrize("k", range(3))
def test_an_axis_near_an_edge_is_drawn_to_it(walls, k):
    rng = np.random.default_rng(k)
    edge = TURN[:, k]
    axis = tilted(edge, 0.5, rng)
    known = direction_of(axis, walls)
    sides = np.linalg.svd(axis[None])[2][1:]
    end = axis + known.tilts @ sides
    assert angle(end / np.linalg.norm(end), edge) < np.deg2rad(0.1)
    assert np.sqrt(np.linalg.eigvalsh(known.covariance)).max() < WALL


def test_an_axis_off_every_face_stays(walls):
    axis = TURN @ np.array([0.6, 0.48, 0.64])
    assert direction_of(axis, walls) is None
    assert drawn(0.01, None) is None


def test_one_crooked_face_does_not_draw(walls):
    crooked = se3.rotation_from_rotvec(np.deg2rad(2.0) * TURN[:, 0]) @ TURN[:, 2]
    more = walls + guides_of([(crooked, walls.errors[0])])
    axis = tilted(TURN[:, 2], 0.3, np.random.default_rng(1))
    a, b = direction_of(axis, walls), direction_of(axis, more)
    assert np.linalg.norm(a.tilts - b.tilts) < np.deg2rad(0.05)


def test_a_sharp_edge_outweighs_bent_walls(walls):
    """However far off the axis starts and whatever the walls say."""
    sharp = np.deg2rad(0.01)
    edge = tilted(TURN[:, 2], 0.15, np.random.default_rng(5))
    more = walls + guides_of([(edge, sharp**2 * (np.eye(3) - np.outer(edge, edge)))])
    for off in (0.05, 0.3, 0.8):
        axis = tilted(edge, off, np.random.default_rng(6))
        end = axis + direction_of(axis, more).tilts @ np.linalg.svd(axis[None])[2][1:]
        assert angle(end / np.linalg.norm(end), edge) < 2 * sharp


def test_axis_and_guides_are_weighed_by_their_errors():
    one = np.sqrt(2) * BEND  # and the bend again: twice its square in every direction
    there = Direction(np.array([BEND, 0.0]), 2 * np.eye(2) * BEND**2)
    both = drawn(one, there)
    np.testing.assert_allclose(both.tilts, [0.5 * BEND, 0.0])
    np.testing.assert_allclose(both.covariance, np.eye(2) * BEND**2)
    assert drawn(0.0, Direction(np.array([10 * BEND, 0.0]), there.covariance)) is None  # far off
    assert drawn(np.inf, there) is there  # nothing else is known
    vague = Direction(there.tilts, 1e6 * there.covariance)
    np.testing.assert_allclose(drawn(one, vague).tilts, 0.0, atol=1e-5 * BEND)


def test_no_guides_say_nothing():
    nothing = Guides(np.zeros((0, 3)), np.zeros((0, 3, 3)))
    assert direction_of(np.array([0.0, 0, 1]), nothing) is None


def test_what_the_images_hold_together_moves_together(walls):
    """An origin that the images tie to the axis follows it; the value, not tied, stays."""
    edge = TURN[:, 2]
    axis = tilted(edge, 0.4, np.random.default_rng(3))
    joint = Joint("revolute", axis, np.zeros(3), 0.7, sigma_axis=np.deg2rad(0.5))
    h = np.eye(5) * 1e4
    h[0, 3] = h[3, 0] = -5e3
    out = squared(joint, h, walls, 1.0)
    assert angle(out.axis, edge) < angle(axis, edge) / 3
    assert out.value == pytest.approx(0.7)
    sides = np.linalg.svd(axis[None])[2][1:]
    tilt = sides @ (out.axis - axis)
    np.testing.assert_allclose(sides @ out.origin, [0.5 * tilt[0], 0.0], rtol=2e-2, atol=1e-7)
    assert out.sigma_axis < joint.sigma_axis
