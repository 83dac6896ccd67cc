"""Laws of repel points: the seam, the sign, the bound, and the push on the joint."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.se3 import apply, make, rotation_from_rotvec
from part2gs_robotics.paper.repel import joint_gradient, net_wrench, repel_forces, repel_points

VOXEL = 0.02
RNG = np.random.default_rng(0)


def grid(x, y):
    a, b = (m.ravel() for m in np.meshgrid(x, y, indexing="ij"))
    return np.stack([a, b, 0 * a], 1)


STEP = 0.05
PART = grid(np.arange(10) * STEP, np.arange(10) * STEP)
BASE = grid(np.arange(10, 20) * STEP, np.arange(10) * STEP)  # touches the part at x = 0.5


def test_seam_is_the_base_column_beside_the_part():
    seam = repel_points([(BASE, PART)])
    assert len(seam) == 10
    np.testing.assert_allclose(seam[:, 0], 0.5)


def test_no_seam_within_reach_gives_no_points():
    assert repel_points([(BASE + np.array([1.0, 0, 0]), PART)]).shape == (0, 3)
    assert repel_points([(BASE[:0], PART), (BASE, PART[:0])]).shape == (0, 3)
    assert repel_points([]).shape == (0, 3)


def test_seam_of_either_state_counts():
    apart = (BASE, PART - [1.0, 0, 0])
    np.testing.assert_allclose(repel_points([apart, (BASE, PART)]), repel_points([(BASE, PART)]))


def test_seam_is_bounded_and_scales_with_the_scene():
    assert len(repel_points([(BASE, PART)], max_points=4)) == 4
    move = make(rotation_from_rotvec(np.array([1.0, 2, 3])), np.array([4.0, 5, 6]))
    expected = apply(move, 9 * repel_points([(BASE, PART)]))
    got = repel_points([(apply(move, 9 * BASE), apply(move, 9 * PART))])
    np.testing.assert_allclose(got, expected, atol=1e-9)


def test_printed_force_attracts_and_corrected_force_repels():
    mu, r = np.zeros((1, 3)), np.array([[0.1, 0.0, 0.0]])
    printed = repel_forces(mu, r, VOXEL, strength=5e-4, paper=True)
    np.testing.assert_allclose(printed, [[0.05, 0, 0]], rtol=1e-6)  # epsilon: 1.5e-8
    corrected = repel_forces(mu, r, VOXEL, strength=5e-5)
    np.testing.assert_allclose(corrected, [[-0.005, 0, 0]], rtol=1e-6)


def test_magnitude_is_inverse_square():
    near, far = (
        np.linalg.norm(repel_forces(np.zeros((1, 3)), np.array([[0, d, 0]]), 1e9))
        for d in (0.1, 0.3)
    )
    assert near / far == pytest.approx(9.0, rel=1e-6)


def test_printed_sum_explodes_where_the_mean_is_clamped():
    mu = np.zeros((1, 3))
    many = np.tile([[0.1, 0.0, 0.0]], (2000, 1))
    assert repel_forces(mu, many, VOXEL, paper=True)[0, 0] == pytest.approx(100.0, rel=1e-6)
    assert repel_forces(mu, many, VOXEL)[0, 0] == pytest.approx(-0.5 * VOXEL)


def test_corrected_step_never_exceeds_half_a_voxel():
    points, repels = RNG.uniform(size=(50, 3)), RNG.uniform(size=(300, 3))
    forces = repel_forces(points, repels, VOXEL, strength=10.0)
    assert np.linalg.norm(forces, axis=1).max() <= 0.5 * VOXEL * (1 + 1e-12)
    alone = repel_forces(points, repels[:1], VOXEL, strength=10.0)
    np.testing.assert_allclose(np.linalg.norm(alone, axis=1), 0.5 * VOXEL, rtol=1e-6)


@pytest.mark.parametrize("paper", [False, True])
def test_coincident_and_empty_inputs_stay_finite(paper):
    points = np.zeros((3, 3))
    np.testing.assert_array_equal(repel_forces(points, points, VOXEL, paper=paper), 0.0)
    np.testing.assert_array_equal(repel_forces(points, points[:0], VOXEL, paper=paper), 0.0)
    assert repel_forces(points[:0], points, VOXEL, paper=paper).shape == (0, 3)


@pytest.mark.parametrize(("kind", "pitch"), [("revolute", 0.0), ("prismatic", 0.0), ("screw", 0.3)])
def test_joint_gradient_is_the_derivative_of_the_work(kind, pitch):
    axis = np.array([1.0, -2.0, 2.0]) / 3
    joint = Joint(kind, axis, np.array([0.2, 0.1, -0.4]), 1.0, pitch)
    points, forces = RNG.normal(size=(30, 3)), RNG.normal(size=(30, 3))

    def work(q):
        return float((apply(joint.transform(q), points) * forces).sum(1).mean())

    step = 1e-5  # central differences: truncation ~ step^2
    expected = (work(step) - work(-step)) / (2 * step)
    assert joint_gradient(points, forces, joint) == pytest.approx(expected, rel=1e-7)


def test_fixed_joint_and_empty_part_feel_nothing():
    fixed = Joint("fixed", np.array([0.0, 0, 1]), np.zeros(3), 0.0)
    assert joint_gradient(PART, np.ones_like(PART), fixed) == 0.0
    hinge = Joint("revolute", np.array([0.0, 0, 1]), np.zeros(3), 0.0)
    assert joint_gradient(PART[:0], PART[:0], hinge) == 0.0
    np.testing.assert_array_equal(net_wrench(PART[:0], PART[:0], np.zeros(3)), np.zeros((2, 3)))


def test_seam_drives_a_drawer_out_and_the_printed_sign_drives_it_in():
    seam = repel_points([(BASE, PART)])
    slider = Joint("prismatic", np.array([-1.0, 0, 0]), np.zeros(3), 0.2)  # opens away from base
    for paper, sign in ((False, 1), (True, -1)):
        drive = joint_gradient(PART, repel_forces(PART, seam, VOXEL, paper=paper), slider)
        assert np.sign(drive) == sign
