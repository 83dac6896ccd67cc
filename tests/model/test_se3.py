"""Laws of rigid motions, in float64."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.model import se3

RNG = np.random.default_rng(0)
AXES = [v / np.linalg.norm(v) for v in RNG.normal(size=(6, 3))] + [np.eye(3)[2], -np.eye(3)[0]]


def random_motion(rng):
    return se3.make(se3.rotation_from_rotvec(rng.normal(size=3)), rng.normal(size=3))


@pytest.mark.parametrize("seed", range(5))
def test_motions_form_a_group_that_acts_on_points(seed):
    rng = np.random.default_rng(seed)
    a, b, points = random_motion(rng), random_motion(rng), rng.normal(size=(4, 5, 3))
    assert np.allclose(a @ se3.inverse(a), np.eye(4), atol=1e-13)
    assert np.allclose(se3.inverse(a @ b), se3.inverse(b) @ se3.inverse(a), atol=1e-13)
    assert np.allclose(se3.apply(a @ b, points), se3.apply(a, se3.apply(b, points)), atol=1e-12)
    assert np.isclose(np.linalg.det(a[:3, :3]), 1.0)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 1e-6, 1.1e-6, 1e-3, 1.0, 3.0, np.pi - 1e-7])
def test_the_logarithm_inverts_the_exponential(angle):
    for axis in AXES:
        rot = se3.rotation_from_rotvec(axis * angle)
        assert np.allclose(rot @ rot.T, np.eye(3), atol=1e-12)
        assert np.allclose(se3.rotvec_from_rotation(rot), axis * angle, atol=1e-9)


def test_a_half_turn_keeps_its_axis_up_to_sign():
    for axis in AXES:
        w = se3.rotvec_from_rotation(se3.rotation_from_rotvec(axis * np.pi))
        assert np.isclose(np.linalg.norm(w), np.pi)
        assert np.isclose(abs(w @ axis), np.pi)


def test_the_exponential_of_parallel_vectors_adds():
    for axis in AXES:
        twice = se3.rotation_from_rotvec(axis * 0.4) @ se3.rotation_from_rotvec(axis * 1.1)
        assert np.allclose(twice, se3.rotation_from_rotvec(axis * 1.5), atol=1e-13)


@pytest.mark.parametrize("seed", range(5))
def test_a_turn_leaves_its_line_in_place_and_a_slide_shifts_along_it(seed):
    rng = np.random.default_rng(seed)
    axis, origin = AXES[seed], rng.normal(size=3)
    line = origin + rng.normal(size=(7, 1)) * axis
    assert np.allclose(se3.apply(se3.screw_motion(axis, origin, 1.3, 0.0), line), line)
    assert np.allclose(se3.apply(se3.screw_motion(axis, origin, 1.3, 0.2), line), line + 0.2 * axis)
    two = se3.screw_motion(axis, origin, 0.5, 0.1) @ se3.screw_motion(axis, origin, 0.3, 0.4)
    assert np.allclose(two, se3.screw_motion(axis, origin, 0.8, 0.5), atol=1e-13)


def test_many_screws_at_once_are_each_its_own():
    rng = np.random.default_rng(0)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    origin, turns = rng.normal(size=3), np.array([0.0, 1e-9, -0.4, np.pi, 7.0])
    slides = rng.normal(size=5)
    one = [se3.screw_motion(axis, origin, t, s) for t, s in zip(turns, slides, strict=True)]
    many = se3.screw_motions(axis, origin, turns, slides)
    assert np.allclose(many, one, atol=1e-14)
    assert np.allclose(se3.inverses(many) @ one, np.eye(4), atol=1e-14)


@pytest.mark.parametrize("turn", [1e-3, 1.0, 3.0, np.pi])
def test_a_screw_is_read_off_its_motion(turn):
    for axis in AXES:
        origin, near = RNG.normal(size=3), RNG.normal(size=3)
        motion = se3.screw_motion(axis, origin, turn, 0.3)
        found = se3.screw_of(motion, near)
        assert np.allclose(se3.screw_motion(*found), motion, atol=1e-9)
        assert np.isclose(found[2], turn)
        assert np.isclose(abs(found[3]), 0.3, atol=1e-9)
        gap = found[1] - origin
        assert np.allclose(gap, axis * (gap @ axis), atol=1e-9 / turn)
        assert np.isclose(found[0] @ (found[1] - near), 0.0, atol=1e-9)


def test_a_motion_without_a_turn_is_a_slide_and_no_motion_has_no_axis():
    moved = se3.make(np.eye(3), np.array([0.0, 3.0, 4.0]))
    axis, _, turn, slide = se3.screw_of(moved, RNG.normal(size=3))
    assert np.allclose(axis, (0.0, 0.6, 0.8))
    assert turn == 0.0
    assert np.isclose(slide, 5.0)
    assert np.array_equal(se3.screw_of(np.eye(4), np.ones(3))[0], np.zeros(3))


def test_quaternions_multiply_like_their_matrices():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 50, 4))
    product = se3.rotation_from_quats(a) @ se3.rotation_from_quats(b)
    assert np.allclose(se3.rotation_from_quats(se3.quat_multiply(a, b)), product, atol=1e-12)


def test_a_quaternion_is_the_rotation_it_came_from():
    for angle in (0.0, 1e-8, 1.0, np.pi):
        for axis in AXES:
            rot = se3.rotation_from_rotvec(axis * angle)
            q = se3.quat_from_rotation(rot)
            assert q[0] >= 0
            assert np.isclose(np.linalg.norm(q), 1.0)
            assert np.allclose(se3.rotation_from_quats(q[None])[0], rot, atol=1e-12)
